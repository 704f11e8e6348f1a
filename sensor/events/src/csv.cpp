// Text, one event a line, in three conventions:
//   csv    a header line with the columns and the unit of time, "t_us,x,y,p", and no comments, which common readers do
//          not accept. Also read: "# width=1280 height=720", other orders and separators (comma, semicolon,
//          tab, space), t_s, t_ms and t_ns, decimal times, p of -1, and Metavision's "%geometry:W,H" and x,y,p,t in
//          microseconds.
//   e2vid  "W H", then t x y p in seconds (ESIM, E2VID)
//   v2e    comments with '#', then t x y p in seconds (v2e, the RPG DAVIS data); also read: a fifth column, v2e's
//          signal or noise. Without a comment that says so, recognised by a decimal point in one of the first times.
// Decimal times are parsed exactly and rounded to 1 us. The user may state the unit of times where the file does not.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstring>
#include <map>
#include <string_view>
#include <utility>

#include "buffer_size.h"
#include "checked_writer.h"
#include "codec.h"
#include "input_file.h"
#include "output_file.h"
#include "pecs/text.h"

namespace pecs::events {
namespace {

constexpr std::size_t kMaxLine = 4096;
constexpr std::string_view kSeparators = ",; \t\r";
enum Field { kT, kX, kY, kP };
constexpr std::string_view kWanted = "a header line such as t_us,x,y,p";

class LineReader {
 public:
  explicit LineReader(const std::filesystem::path& path) : file_(path), buffer_(buffer_size(1 << 16, kMaxLine + 64)) {
    filled_ = file_.read(std::as_writable_bytes(std::span(buffer_)));
    const std::string_view head(buffer_.data(), filled_);
    if (head.starts_with("\xff\xfe") || head.starts_with("\xfe\xff"))
      throw bad_input(path.string(), "byte 0", "UTF-16 text", "UTF-8 or ASCII");
    if (head.starts_with("\xef\xbb\xbf")) position_ = next_start_ = 3;  // a byte order mark
    const std::size_t end = std::min(head.find_first_of("\r\n"), head.size());
    if (end + 1 < head.size() && head[end] == '\r' && head[end + 1] != '\n') line_end_ = '\r';  // old Macintosh
  }

  // The line without its end; valid until the next call.
  bool next(std::string_view& line) {
    const void* end = nullptr;
    while (!(end = std::memchr(buffer_.data() + position_, line_end_, filled_ - position_)) && !ended_) {
      if (filled_ - position_ > kMaxLine)
        throw bad_input(file_.path().string(), fmt::format("line {} (byte {})", line_ + 1, next_start_),
                        fmt::format("more than {} bytes", kMaxLine), "lines of events");
      std::memmove(buffer_.data(), buffer_.data() + position_, filled_ - position_);
      filled_ -= position_;
      position_ = 0;
      const std::size_t got = file_.read(std::as_writable_bytes(std::span(buffer_).subspan(filled_)));
      ended_ = got == 0;
      filled_ += got;
    }
    const char* begin = buffer_.data() + position_;
    line = {begin, end ? static_cast<std::size_t>(static_cast<const char*>(end) - begin) : filled_ - position_};
    if (!end && line.empty()) return false;
    const std::size_t bytes = line.size() + (end ? 1 : 0);
    position_ += bytes;
    line_start_ = std::exchange(next_start_, next_start_ + bytes);
    ++line_;
    return true;
  }

  // The line after the last one, as far as it is buffered.
  std::string_view following() const {
    const std::string_view rest(buffer_.data() + position_, filled_ - position_);
    return rest.substr(0, rest.find(line_end_));
  }
  // Byte offset of the last line.
  std::string place() const { return fmt::format("line {}, byte {}", line_, line_start_); }
  Error damage(std::string_view got, std::string_view wanted) const {
    return bad_input(file_.path().string(), fmt::format("line {} (byte {})", line_, line_start_), shortened(got, 80),
                     std::string(wanted));
  }

 private:
  InputFile file_;
  std::vector<char> buffer_;
  std::size_t filled_ = 0, position_ = 0;
  std::uint64_t line_ = 0, line_start_ = 0, next_start_ = 0;
  bool ended_ = false;
  char line_end_ = '\n';  // also for "\r\n": '\r' separates words
};

// Removes the next word from `line` and returns it; empty at the end.
std::string_view next_word(std::string_view& line) {
  const std::size_t begin = std::min(line.find_first_not_of(kSeparators), line.size());
  const std::size_t end = std::min(line.find_first_of(kSeparators, begin), line.size());
  const std::string_view word = line.substr(begin, end - begin);
  line.remove_prefix(end);
  return word;
}

// A decimal number times 10^exponent, without floating-point arithmetic.
struct Decimal {
  std::int64_t value = 0;  // rounded half up
  bool exact = true;
};
std::optional<Decimal> parse_decimal(std::string_view text, int exponent) {
  const bool negative = text.starts_with('-');
  if (negative || text.starts_with('+')) text.remove_prefix(1);
  std::uint64_t digits = 0;
  bool any = false, point = false;
  std::size_t i = 0;
  for (; i < text.size(); ++i) {
    const char c = text[i];
    if (c == '.' && !point) {
      point = true;
    } else if (c >= '0' && c <= '9') {
      any = true;
      if (digits < 1'000'000'000'000'000'000) {
        digits = digits * 10 + static_cast<std::uint64_t>(c - '0');
        exponent -= point;
      } else {
        exponent += !point;  // beyond 19 digits
      }
    } else {
      break;
    }
  }
  if (!any) return {};
  if (i < text.size()) {
    if (text[i] != 'e' && text[i] != 'E') return {};
    i += 1 + (i + 1 < text.size() && text[i + 1] == '+');
    const auto power = number_from<int>(text.substr(std::min(i, text.size())));
    if (!power || *power < -400 || *power > 400) return {};
    exponent += *power;
  }
  Decimal out;
  for (; exponent < 0 && digits > 0; ++exponent) {
    const bool last = exponent == -1;
    out.exact = out.exact && digits % 10 == 0;
    digits = digits / 10 + (last && digits % 10 >= 5 ? 1 : 0);
  }
  for (; exponent > 0 && digits > 0; --exponent) {
    if (digits > INT64_MAX / 10) return {};
    digits *= 10;
  }
  if (digits > INT64_MAX) return {};
  out.value = negative ? -static_cast<std::int64_t>(digits) : static_cast<std::int64_t>(digits);
  return out;
}

enum class Convention { csv, e2vid, v2e };

struct Layout {
  std::array<int, 4> column{-1, -1, -1, -1};  // of t, x, y, p
  int columns = 0;
  int t_exponent = 0;  // t in the file = us * 10^-t_exponent
};

class TextReader : public EventReader<TextReader> {
 public:
  // `wanted`: a file of another convention is an error.
  explicit TextReader(const std::filesystem::path& path, const ReadOptions& options = {},
                      std::optional<Convention> wanted = {})
      : lines_(path), wanted_(wanted), unit_(options.time_unit) {
    find_layout();
    if (states_unit_ && unit_)
      throw Error(ExitCode::usage, fmt::format("{}: time_unit: got {}, wanted none: the first line states the unit",
                                               path.string(), name_of(*unit_)));
    if (unit_) layout_.t_exponent = static_cast<int>(*unit_);
    extent_.emplace(info_, 65536);
  }

  std::string place() const override { return lines_.place(); }
  Convention convention() const { return convention_; }
  std::optional<TimeUnit> assumed_unit() const {
    return unit_ || states_unit_ || convention_ == Convention::csv ? std::nullopt : std::optional(TimeUnit::s);
  }

  bool next(Event& event) {
    if (!std::exchange(pending_, false) && !next_content()) return false;
    parse_event(event);
    return true;
  }

 private:
  // The next line that is neither blank nor a comment; a comment may give the size.
  bool next_content() {
    while (lines_.next(line_)) {
      std::string_view rest = line_;
      if (next_word(rest).empty()) continue;
      if (line_[0] != '#' && line_[0] != '%') return true;
      read_comment(line_);
    }
    return false;
  }

  void read_comment(std::string_view comment) {
    const auto number_after = [&](std::string_view key) {
      const std::size_t at = comment.find(key);
      int value = 0;
      if (at != std::string_view::npos)
        std::from_chars(comment.data() + at + key.size(), comment.data() + comment.size(), value);
      return value > 0 && value <= 65536 ? value : 0;
    };
    constexpr std::string_view kGeometry = "%geometry:";
    if (comment.starts_with(kGeometry)) {
      metavision_ = true;
      const int width = number_after(kGeometry), height = number_after(",");
      if (!extent_)
        info_.width = width, info_.height = height;
      else if (extent_->is_given() && (width != info_.width || height != info_.height))
        throw lines_.damage(comment, fmt::format("{}x{} as before", info_.width, info_.height));
    } else if (!extent_ && info_.width == 0) {
      if (comment.find("time (float s), x, y, polarity") != std::string_view::npos) {
        convention_ = Convention::v2e;
        states_unit_ = true;
      }
      info_.width = number_after("width=");
      info_.height = number_after("height=");
    }
  }

  void find_layout() {
    if (!next_content()) {
      if (convention_ == Convention::v2e && allows(Convention::v2e)) return;  // no events
      if (metavision_ && allows(Convention::csv)) return;
      throw lines_.damage("no content", kWanted);
    }
    std::string_view rest = line_, following = lines_.following();
    const bool names = std::isalpha(static_cast<unsigned char>(line_[0])) || line_[0] == '"';
    const std::string_view first = next_word(rest), second = next_word(following);
    const auto has_point = [](std::string_view word) { return word.find('.') != std::string_view::npos; };
    const bool seconds = states_unit_ || has_point(first) ||
                         (has_point(second) && std::ranges::count_if(line_, [](char c) { return c == ' '; }) >= 3);
    if (names && allows(Convention::csv)) {
      convention_ = Convention::csv;
      parse_header();
      pending_ = next_content();  // parses comments, which may give the size
    } else if (metavision_ && allows(Convention::csv)) {
      convention_ = Convention::csv;
      layout_ = {{3, 0, 1, 2}, 4, 0};
      pending_ = true;
    } else if (wanted_ == Convention::csv) {
      throw lines_.damage(line_, kWanted);
    } else if (wanted_ == Convention::v2e || (seconds && allows(Convention::v2e) && parse_decimal(first, 6))) {
      convention_ = Convention::v2e;
      layout_ = {{0, 1, 2, 3}, 1, 6};
      while (!next_word(rest).empty()) ++layout_.columns;
      if (layout_.columns != 4 && layout_.columns != 5) throw lines_.damage(line_, "t x y p in seconds");
      pending_ = true;
    } else {
      convention_ = Convention::e2vid;
      const auto width = parse_decimal(first, 0), height = parse_decimal(next_word(rest), 0);
      if (!next_word(rest).empty() || !width || !height || width->value < 1 || width->value > 65536 ||
          height->value < 1 || height->value > 65536)
        throw lines_.damage(line_, wanted_ ? "a first line W H, then t x y p"
                                           : fmt::format("{} (or --input-format v2e for t x y p)", kWanted));
      info_.width = static_cast<int>(width->value);
      info_.height = static_cast<int>(height->value);
      layout_ = {{0, 1, 2, 3}, 4, 6};
    }
  }

  void parse_header() {
    static const std::map<std::string, Field, std::less<>> kFields = {{"t", kT},         {"ts", kT},  {"time", kT},
                                                                      {"timestamp", kT}, {"x", kX},   {"y", kY},
                                                                      {"p", kP},         {"pol", kP}, {"polarity", kP}};
    static const std::map<std::string, int, std::less<>> kUnits = {{"us", 0}, {"ns", -3}, {"ms", 3}, {"s", 6}};
    std::string header = lower(std::string(line_));
    for (const char* open : {" [", " ("})  // "timestamp [us]"
      for (std::size_t at; (at = header.find(open)) != std::string::npos;) header.erase(at, 1);
    std::ranges::replace_if(
        header, [](char c) { return std::string_view("\"[]()").find(c) != std::string_view::npos; }, '_');
    std::string_view rest = header;
    for (std::string_view word; !(word = next_word(rest)).empty(); ++layout_.columns) {
      while (word.starts_with('_')) word.remove_prefix(1);
      while (word.ends_with('_')) word.remove_suffix(1);
      const std::size_t underscore = std::min(word.find('_'), word.size());
      const auto field = kFields.find(word.substr(0, underscore));
      if (field == kFields.end()) continue;
      if (field->second == kT) {
        const std::size_t unit_at = std::min(word.find_first_not_of('_', underscore), word.size());
        const auto unit = kUnits.find(word.substr(unit_at));
        states_unit_ = unit != kUnits.end();
        if (!states_unit_ && !unit_)
          throw lines_.damage(fmt::format("time column \"{}\" without its unit", word),
                              fmt::format("t_us, t_ms, t_s or t_ns; or {}", kStateTheUnit));
        if (states_unit_) layout_.t_exponent = unit->second;
      }
      if (layout_.column[field->second] >= 0)
        throw lines_.damage(fmt::format("a second column of {}, \"{}\"", "txyp"[field->second], word), "one of each");
      layout_.column[field->second] = layout_.columns;
    }
    if (std::ranges::find(layout_.column, -1) != layout_.column.end()) throw lines_.damage(line_, kWanted);
  }

  void parse_event(Event& e) {
    std::array<std::int64_t, 4> values{};
    std::string_view rest = line_;
    for (int column = 0; column < layout_.columns; ++column) {
      const std::string_view word = next_word(rest);
      const auto field = std::ranges::find(layout_.column, column);
      if (field == layout_.column.end() && word.empty())  // values of an empty one before it moved to the left
        throw lines_.damage(line_, fmt::format("{} columns, none empty", layout_.columns));
      if (field == layout_.column.end()) continue;
      const auto f = static_cast<std::size_t>(field - layout_.column.begin());
      const auto number = parse_decimal(word, f == kT ? layout_.t_exponent : 0);
      if (!number || (f != kT && !number->exact)) throw lines_.damage(line_, "t, x, y and p as numbers");
      values[f] = number->value;
    }
    if (!next_word(rest).empty()) throw lines_.damage(line_, fmt::format("{} columns", layout_.columns));
    const bool p_known = values[kP] >= -1 && values[kP] <= 1;
    e = {values[kT], static_cast<std::uint16_t>(values[kX]), static_cast<std::uint16_t>(values[kY]),
         static_cast<std::uint8_t>(values[kP] > 0)};
    if (!p_known || values[kX] != e.x || values[kY] != e.y || !extent_->add(e))
      throw lines_.damage(line_, fmt::format("a pixel {}, p of -1, 0 or 1", extent_->wanted()));
  }

  bool allows(Convention convention) const { return wanted_.value_or(convention) == convention; }

  LineReader lines_;
  std::optional<Convention> wanted_;
  std::optional<TimeUnit> unit_;  // stated by the user
  bool states_unit_ = false;      // the file does
  std::string_view line_;
  bool pending_ = false, metavision_ = false;
  Layout layout_;
  Convention convention_ = Convention::csv;
};

template <Convention kConvention>
class ReaderOf final : public TextReader {
 public:
  ReaderOf(const std::filesystem::path& path, const ReadOptions& options) : TextReader(path, options, kConvention) {}
};

constexpr Limits kCsvLimits = {.keeps_size = false};
constexpr Limits kSecondsLimits = {.t_min_us = 0};

template <Convention kConvention>
class CsvWriter final : public CheckedWriter {
 public:
  CsvWriter(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kCsv ? kCsvLimits : kSecondsLimits, kConvention == Convention::e2vid), file_(path) {
    if (kCsv) file_.put_text("t_us,x,y,p\n");
    if (kConvention == Convention::e2vid) file_.put_text(fmt::format("{} {}\n", size.width, size.height));
    if (kConvention == Convention::v2e)
      file_.put_text(fmt::format("# Format is time (float s), x, y, polarity (0=off, 1=on)\n# width={} height={}\n",
                                 size.width, size.height));
  }

 private:
  static constexpr bool kCsv = kConvention == Convention::csv;

  void put(std::span<const Event> events) override {
    for (const Event& e : events) {
      std::array<char, 64> line;
      const auto end = kCsv ? fmt::format_to(line.data(), "{},{},{},{}\n", e.t_us, e.x, e.y, e.p)
                            : fmt::format_to(line.data(), "{}.{:06} {} {} {}\n", e.t_us / 1'000'000, e.t_us % 1'000'000,
                                             e.x, e.y, e.p);
      file_.put_bytes(std::as_bytes(std::span(line.data(), end)));
    }
  }
  void finish() override { file_.commit(); }

  OutputFile file_;
};

template <Convention kConvention>
Codec make_text(const char* name, const char* description, const char* extension, const Limits& limits) {
  return make_codec<ReaderOf<kConvention>, CsvWriter<kConvention>>(
      name, description, extension, limits, [](const std::filesystem::path& path, auto) {
        try {
          return TextReader(path).convention() == kConvention;
        } catch (const Error&) {
          return false;
        }
      });
}

}  // namespace

Codec make_csv() { return make_text<Convention::csv>("csv", "CSV with a header line, t_us,x,y,p", ".csv", kCsvLimits); }
Codec make_e2vid() {
  return make_text<Convention::e2vid>("e2vid", "text of ESIM and E2VID: W H, then t x y p in seconds", ".txt",
                                      kSecondsLimits);
}
Codec make_v2e() {
  return make_text<Convention::v2e>("v2e", "text of v2e and the RPG DAVIS data: t x y p in seconds", ".txt",
                                    kSecondsLimits);
}

}  // namespace pecs::events
