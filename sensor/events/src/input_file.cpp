#include "input_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cerrno>

#include "buffer_size.h"
#include "pecs/platform.h"

namespace pecs::events {
namespace {
constexpr std::size_t kBufferBytes = buffer_size(1 << 18, 64);
}

InputFile::InputFile(std::filesystem::path path) : path_(std::move(path)), buffer_(kBufferBytes) {
  std::error_code ec;
  if (std::filesystem::is_directory(path_, ec)) throw not_found(path_.string(), "is a folder");
  file_.reset(platform::open_to_read(path_));
  if (!file_) throw not_found(path_.string(), std::strerror(errno));
  std::setvbuf(file_.get(), nullptr, _IONBF, 0);
  size_ = std::filesystem::file_size(path_, ec);
  if (ec) throw not_found(path_.string(), ec.message());
  if (size_ == 0) throw bad_input(path_.string(), "byte 0", "an empty file", "events");
}

bool InputFile::refill(std::size_t wanted) {
  std::memmove(buffer_.data(), buffer_.data() + position_, filled_ - position_);
  base_ += position_;
  filled_ -= position_;
  position_ = 0;
  while (filled_ < wanted) {
    const std::size_t n = std::fread(buffer_.data() + filled_, 1, buffer_.size() - filled_, file_.get());
    if (n == 0) break;
    filled_ += n;
  }
  if (std::ferror(file_.get())) throw damage("a read error", "readable bytes");
  if (filled_ == 0) return false;
  if (filled_ < wanted)
    throw damage(fmt::format("{} trailing bytes", filled_), fmt::format("whole items of {} bytes", wanted));
  return true;
}

std::size_t InputFile::read(std::span<std::byte> out) {
  const std::size_t buffered = std::min(out.size(), filled_ - position_);
  std::copy_n(buffer_.data() + position_, buffered, out.data());
  position_ += buffered;
  std::size_t n = buffered;
  while (n < out.size()) {
    const std::size_t got = std::fread(out.data() + n, 1, out.size() - n, file_.get());
    if (got == 0) break;
    n += got;
  }
  if (std::ferror(file_.get())) throw damage("a read error", "readable bytes");
  base_ += n - buffered;
  return n;
}

void InputFile::read_exactly(std::span<std::byte> out, const char* what) {
  const std::uint64_t start = offset();
  const std::size_t n = read(out);
  if (n < out.size())
    throw bad_input(path_.string(), fmt::format("byte {}", start), fmt::format("{} bytes to the end of the file", n),
                    fmt::format("{} bytes of {}", out.size(), what));
}

void InputFile::seek(std::uint64_t offset) {
  if (offset > size_ || fseeko(file_.get(), static_cast<off_t>(offset), SEEK_SET) != 0)
    throw bad_input(path_.string(), fmt::format("byte {}", offset), fmt::format("a file of {} bytes", size_),
                    "data here");
  base_ = offset;
  filled_ = position_ = 0;
}

Error InputFile::damage(const std::string& got, const std::string& wanted, std::uint64_t back) const {
  return bad_input(path_.string(), fmt::format("byte {}", offset() - back), got, wanted);
}

std::vector<std::byte> head_of(const std::filesystem::path& path, std::size_t limit) {
  InputFile file(path);
  std::vector<std::byte> head(std::min<std::uint64_t>(limit, file.size()));
  head.resize(file.read(head));
  return head;
}

}  // namespace pecs::events
