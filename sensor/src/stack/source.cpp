#include "pecs/sensor/source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <sstream>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/text.h"

namespace pecs::sensor {
namespace {

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// Whether the run of digits that begins here has a sign: "-0006", "f_-0006"; in "f-0006" the hyphen separates.
bool is_negative(const std::string& s, std::size_t run) {
  return run > 0 && s[run - 1] == '-' && (run == 1 || s[run - 2] == '_' || s[run - 2] == '.');
}

// Compares runs of digits by value, all else by bytes.
bool natural_less(const std::string& a, const std::string& b) {
  std::size_t i = 0, j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto skip = [](const std::string& s, std::size_t& k) {
        while (k + 1 < s.size() && s[k] == '0' && is_digit(s[k + 1])) ++k;
        const std::size_t first = k;
        while (k < s.size() && is_digit(s[k])) ++k;
        return s.substr(first, k - first);
      };
      const bool falls = is_negative(a, i);
      const std::string x = skip(a, i), y = skip(b, j);
      if (x.size() != y.size()) return (x.size() < y.size()) != falls;
      if (x != y) return (x < y) != falls;
    } else if (a[i] != b[j]) {
      return a[i] < b[j];
    } else {
      ++i;
      ++j;
    }
  }
  return a.size() - i < b.size() - j || (a.size() - i == b.size() - j && a < b);
}

}  // namespace

std::vector<float> whole_frame(std::size_t planes, int width, int height,
                               const std::function<void(const RowSink&)>& read) {
  const auto columns = static_cast<std::size_t>(width), plane = columns * static_cast<std::size_t>(height);
  std::vector<float> out(planes * plane);
  read([&](int y, int rows, std::span<const float> values) {
    const std::size_t block = columns * static_cast<std::size_t>(rows);
    for (std::size_t k = 0; k < planes; ++k)
      std::ranges::copy(values.subspan(k * block, block),
                        out.begin() + static_cast<std::ptrdiff_t>(k * plane + static_cast<std::size_t>(y) * columns));
  });
  return out;
}

std::vector<std::int64_t> FrameTimes::of(std::int64_t frames, const std::string& source) const {
  std::vector<std::int64_t> times;
  if (fps && file_us) throw bad_usage("--fps", "--times as well", "one of them");
  if (unit && !file_us) throw bad_usage("--time-unit", "no file of times", "--times as well");
  if (file_us) {
    const double ns = std::pow(10.0, 3 + static_cast<int>(unit.value_or(TimeUnit::us)));
    FrameUnitCheck unit_check;
    std::istringstream lines(read_text(*file_us, std::size_t{64} << 20));
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
      line = line.substr(0, line.find('#'));
      if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
      std::istringstream words(line);
      long double time = 0;  // 64 bits: ns since 1970
      std::string rest;
      const std::string place = fmt::format("line {}", number);
      if (!(words >> time) || words >> rest || !(time >= 0) || time * ns > (unit ? 9e18L : 1e18L))
        throw bad_input(file_us->string(), place, line.substr(0, 40),
                        unit ? fmt::format("one time in {}, and nothing else", name_of(*unit))
                             : fmt::format("one time in us, and nothing else; or {}", kStateTheUnit));
      times.push_back(std::llround(time * ns));
      unit_check.add(static_cast<double>(times.back() - times.front()) * 1e-3);
      if (times.size() > 1 && times.back() <= times[times.size() - 2])
        throw bad_input(file_us->string(), place, line.substr(0, 40), "increasing times");
    }
    if (static_cast<std::int64_t>(times.size()) != frames)
      throw bad_input(file_us->string(), "times", std::to_string(times.size()),
                      fmt::format("{}, one per frame", frames));
    if (!unit) unit_check.check(file_us->string());
  } else if (fps) {
    const double least = 1e-9 * static_cast<double>(std::max<std::int64_t>(1, frames - 1)), most = 1e9;
    if (!(*fps >= least && *fps <= most))
      throw Error(ExitCode::usage,
                  fmt::format("--fps: got {:g}, wanted {:g} to {:g} for {} frames", *fps, least, most, frames));
    for (std::int64_t i = 0; i < frames; ++i) times.push_back(std::llround(static_cast<double>(i) * 1e9 / *fps));
  } else {
    throw bad_input(source, "times", "none", "--fps or --times");
  }
  return times;
}

std::vector<std::filesystem::path> files_in_order(const std::filesystem::path& folder,
                                                  std::span<const std::string> endings) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (std::ranges::find(endings, lower(entry.path().extension().string())) != endings.end() &&
        !entry.path().filename().string().starts_with('.'))
      files.push_back(entry.path());
  }
  std::ranges::sort(
      files, [](const auto& a, const auto& b) { return natural_less(a.filename().string(), b.filename().string()); });
  return files;
}

namespace {

std::vector<std::string> digit_runs(const std::string& name) {
  std::vector<std::string> runs;
  for (std::size_t i = 0; i < name.size(); ++i)
    if (is_digit(name[i])) {
      if (i == 0 || !is_digit(name[i - 1])) runs.emplace_back(is_negative(name, i) ? "-" : "");
      runs.back() += name[i];
    }
  return runs;
}

// The numbers that count the files; none if the names have no single one that changes.
std::vector<std::int64_t> numbers_of(std::span<const std::filesystem::path> files) {
  std::vector<std::vector<std::string>> runs;
  for (const auto& file : files) {
    runs.push_back(digit_runs(file.stem().string()));
    if (runs.back().size() != runs.front().size()) return {};
  }
  std::vector<std::int64_t> numbers;
  for (std::size_t k = 0; k < runs.front().size(); ++k) {
    const auto same = [&](const std::vector<std::string>& of) { return of[k] == runs.front()[k]; };
    if (std::ranges::all_of(runs, same)) continue;
    if (!numbers.empty()) return {};
    for (const std::vector<std::string>& of : runs) {
      const auto number = number_from<std::int64_t>(of[k]);
      if (!number) return {};
      numbers.push_back(*number);
    }
  }
  return numbers;
}

// "t_0.25": 0.25, of two decimals; the last one.
struct NameDecimal {
  double value;
  std::size_t decimals;
};
std::optional<NameDecimal> decimal_in(const std::string& name) {
  for (std::size_t at = name.size() - std::min<std::size_t>(1, name.size()); at > 0; --at) {
    if (name[at] != '.' || !is_digit(name[at - 1]) || at + 1 == name.size() || !is_digit(name[at + 1])) continue;
    std::size_t begin = at, end = at + 1;
    while (begin > 0 && is_digit(name[begin - 1])) --begin;
    while (end < name.size() && is_digit(name[end])) ++end;
    const auto value = number_from<double>(std::string_view(name).substr(begin, end - begin));
    return value ? std::optional(NameDecimal{*value, end - at - 1}) : std::nullopt;
  }
  return {};
}

}  // namespace

std::vector<std::filesystem::path> frame_files(const std::filesystem::path& folder,
                                               std::span<const std::string> endings, const FrameTimes& times) {
  auto files = files_in_order(folder, endings);
  if (files.size() < 3) return files;
  const std::vector<std::int64_t> numbers = numbers_of(files);
  for (std::size_t i = 2; i < numbers.size() && !times.file_us; ++i)
    if (numbers[i] - numbers[i - 1] != numbers[1] - numbers[0] || numbers[i] == numbers[i - 1])
      throw bad_input(folder.string(), files[i].filename().string(),
                      fmt::format("number {} after {}", numbers[i], numbers[i - 1]),
                      fmt::format("steps of {}, as from the first file to the second (or --times)",
                                  std::max<std::int64_t>(1, numbers[1] - numbers[0])));
  for (std::size_t i = 1; i < files.size() && (numbers.empty() || times.file_us); ++i) {
    const auto before = decimal_in(files[i - 1].stem().string()), now = decimal_in(files[i].stem().string());
    if (before && now && now->value < before->value && now->decimals != before->decimals)
      throw bad_input(folder.string(), files[i].filename().string(),
                      fmt::format("{} after {}", now->value, before->value),
                      "names whose numbers have equally many decimals");
  }
  return files;
}

}  // namespace pecs::sensor
