#pragma once
// Base class of the readers of Prophesee RAW files: header, words, check of pixel coordinates.
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "codec.h"
#include "input_file.h"
#include "raw_header.h"

namespace pecs::events {

template <class Derived, class Word>
class RawReader : public EventReader<Derived> {
 public:
  std::string place() const final { return fmt::format("byte {}", file_.offset() - sizeof(Word)); }

 protected:
  RawReader(const std::filesystem::path& path, int max_size) : file_(path) {
    RawHeader header = parse_raw_header(head_of(path, kHeadBytes));
    this->info_ = header.info;
    options_ = std::move(header.options);
    this->extent_.emplace(this->info_, max_size);
    file_.seek(header.bytes);
  }

  // The next word; none at the end of the file.
  std::optional<Word> next_word() { return file_.next<Word>(); }

  void check_inside(const Event& e) {
    if (!this->extent_->add(e))
      throw damage(fmt::format("an event at pixel ({}, {})", e.x, e.y), this->extent_->wanted());
  }

  Error damage(const std::string& got, const std::string& wanted) const {
    return file_.damage(got, wanted, sizeof(Word));
  }

  std::map<std::string, std::string> options_;  // of the header's format line

 private:
  InputFile file_;
};

template <class RawFileReader, class RawFileWriter>
Codec make_raw_codec(const char* name, const char* description, const char* encoding, const Limits& limits) {
  return make_codec<RawFileReader, RawFileWriter>(
      name, description, ".raw", limits, [encoding](const std::filesystem::path&, std::span<const std::byte> head) {
        return parse_raw_header(head).encoding == encoding;
      });
}

// The high part of the time in RAW streams: it counts to `range`, then wraps to 0; readers count the wraps.
class TimeHighReader {
 public:
  explicit TimeHighReader(std::int64_t range) : range_(range) {}
  bool known() const { return high_ >= 0; }  // events before the first TIME_HIGH have no time and are discarded
  std::int64_t value() const { return high_; }
  // A decrease by half the range or more is a wrap; a smaller one is kept: the stream is not in order.
  void take(std::int64_t value) {
    if (!known()) {
      high_ = value;
      return;
    }
    const std::int64_t wraps = high_ / range_ + (high_ % range_ >= value + range_ / 2 ? 1 : 0);
    high_ = wraps * range_ + value;
  }

 private:
  std::int64_t range_, high_ = -1;
};

// Calls put(value) for every TIME_HIGH to write between `from` and `to`: in steps of at most a quarter of the range,
// and at each wrap from the last value to 0, so that all readers count the same wraps in any gap.
template <class Put>
void step_time_high(std::int64_t from, std::int64_t to, std::int64_t range, Put&& put) {
  while (from < to) {
    const std::int64_t last_of_wrap = from - from % range + range - 1;
    from = from == last_of_wrap ? from + 1 : std::min({from + range / 4, to, last_of_wrap});
    put(from);
  }
}

}  // namespace pecs::events
