#pragma once
// What the readers of Prophesee RAW files share: header, words, the check of an event's place.
#include <fmt/format.h>

#include <map>
#include <optional>
#include <string>

#include "extent.h"
#include "input_file.h"
#include "raw_header.h"

namespace pecs::events {

template <class Word>
class RawReader : public Reader {
 public:
  const StreamInfo& info() const final { return info_; }
  std::string place() const final { return fmt::format("byte {}", file_.offset() - sizeof(Word)); }

 protected:
  RawReader(const std::filesystem::path& path, int max_size) : file_(path) {
    RawHeader header = parse_raw_header(head_of(path, kHeadBytes));
    info_ = header.info;
    options_ = std::move(header.options);
    extent_.emplace(info_, max_size);
    file_.seek(header.bytes);
  }

  // The next word; nothing at the file's end.
  std::optional<Word> next_word() {
    const auto word = file_.next<Word>();
    if (!word) extent_->end();
    return word;
  }

  void check_inside(const Event& e) {
    if (!extent_->add(e)) throw damage(fmt::format("an event at pixel ({}, {})", e.x, e.y), extent_->wanted());
  }

  Error damage(const std::string& got, const std::string& wanted) const {
    return file_.damage(got, wanted, sizeof(Word));
  }

  std::map<std::string, std::string> options_;  // of the header's format line

 private:
  InputFile file_;
  StreamInfo info_;
  std::optional<Extent> extent_;
};

}  // namespace pecs::events
