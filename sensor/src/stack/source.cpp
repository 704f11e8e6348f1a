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
      const std::string x = skip(a, i), y = skip(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
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

std::vector<std::int64_t> FrameTimes::of(std::int64_t frames, const std::string& source) const {
  std::vector<std::int64_t> times;
  if (file_us) {
    std::istringstream lines(read_text(*file_us, std::size_t{64} << 20));
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
      line = line.substr(0, line.find('#'));
      if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
      std::istringstream words(line);
      double t_us = 0;
      std::string rest;
      const std::string place = fmt::format("line {}", number);
      if (!(words >> t_us) || words >> rest || !(t_us >= 0) || t_us > 1e15)
        throw bad_input(file_us->string(), place, line.substr(0, 40), "one time in us");
      times.push_back(std::llround(t_us * 1e3));
      if (times.size() > 1 && times.back() <= times[times.size() - 2])
        throw bad_input(file_us->string(), place, line.substr(0, 40), "increasing times");
    }
    if (static_cast<std::int64_t>(times.size()) != frames)
      throw bad_input(file_us->string(), "times", std::to_string(times.size()),
                      fmt::format("{}, one per frame", frames));
  } else if (fps) {
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
    if (std::ranges::find(endings, lower(entry.path().extension().string())) != endings.end())
      files.push_back(entry.path());
  }
  std::ranges::sort(
      files, [](const auto& a, const auto& b) { return natural_less(a.filename().string(), b.filename().string()); });
  return files;
}

}  // namespace pecs::sensor
