#pragma once
// Buffered sequential reading with the current byte offset.
#include <bit>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/error.h"

namespace pecs::events {

static_assert(std::endian::native == std::endian::little, "the codecs copy little-endian fields as they are");

class InputFile {
 public:
  explicit InputFile(std::filesystem::path path);  // throws not_found
  const std::filesystem::path& path() const { return path_; }
  std::uint64_t size() const { return size_; }
  std::uint64_t offset() const { return base_ + position_; }  // of the next byte

  // At most out.size() bytes; fewer only at the end of the file.
  std::size_t read(std::span<std::byte> out);
  void read_exactly(std::span<std::byte> out, const char* what);  // throws bad_input if the file is too short
  void seek(std::uint64_t offset);

  // The next item of a sequence that fills the rest of the file; throws bad_input if the last one is truncated.
  template <class T>
  std::optional<T> next() {
    if (filled_ - position_ < sizeof(T) && !refill(sizeof(T))) return {};
    T value;
    std::memcpy(&value, buffer_.data() + position_, sizeof(T));
    position_ += sizeof(T);
    return value;
  }

  // An error at the byte `back` before offset().
  Error damage(const std::string& got, const std::string& wanted, std::uint64_t back = 0) const;

 private:
  bool refill(std::size_t wanted);

  struct Closer {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Closer> file_;
  std::uint64_t size_ = 0;
  std::vector<std::byte> buffer_;
  std::size_t filled_ = 0, position_ = 0;
  std::uint64_t base_ = 0;  // offset of buffer_[0]
};

// The first bytes of a file (at most `limit`). Throws not_found.
std::vector<std::byte> head_of(const std::filesystem::path& path, std::size_t limit);

}  // namespace pecs::events
