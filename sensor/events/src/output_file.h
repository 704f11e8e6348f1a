#pragma once
// Buffered writing to an AtomicFile.
#include <cstring>
#include <span>
#include <vector>

#include "pecs/files.h"

namespace pecs::events {

class OutputFile {
 public:
  explicit OutputFile(const std::filesystem::path& path, AtomicFile::Order order = AtomicFile::Order::front_to_back)
      : file_(path, order) {
    buffer_.reserve(kBytes);
  }
  template <class T>
  void put(const T& item) {
    put_bytes(std::as_bytes(std::span(&item, 1)));
  }
  void put_text(std::string_view text) { put_bytes(std::as_bytes(std::span(text))); }
  void put_bytes(std::span<const std::byte> bytes) {
    if (buffer_.size() + bytes.size() > kBytes) flush();
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
  }
  std::uint64_t offset() const { return written_ + buffer_.size(); }
  // The next put() calls overwrite existing bytes from this offset on; they must not write beyond the end.
  void rewrite_from(std::uint64_t offset) {
    flush();
    file_.seek(offset);
  }
  void commit() {
    flush();
    file_.commit();
  }

 private:
  static constexpr std::size_t kBytes = 1 << 16;
  void flush() {
    file_.write(std::span<const std::byte>(buffer_));
    written_ += buffer_.size();
    buffer_.clear();
  }
  AtomicFile file_;
  std::vector<std::byte> buffer_;
  std::uint64_t written_ = 0;
};

}  // namespace pecs::events
