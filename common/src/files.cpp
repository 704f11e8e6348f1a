#include "pecs/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/evp.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <memory>

#include "pecs/error.h"

namespace pecs {
namespace {

std::string last_error() { return std::strerror(errno); }

class Sha256 {
 public:
  Sha256() : ctx_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) { EVP_DigestInit_ex(ctx_.get(), EVP_sha256(), nullptr); }
  void add(const void* data, std::size_t n) { EVP_DigestUpdate(ctx_.get(), data, n); }
  std::string hex() {
    std::array<unsigned char, 32> digest{};
    unsigned int n = 0;
    EVP_DigestFinal_ex(ctx_.get(), digest.data(), &n);
    std::string out;
    for (unsigned char byte : digest) out += fmt::format("{:02x}", byte);
    return out;
  }

 private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> ctx_;
};

struct FileCloser {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
using FilePtr = std::unique_ptr<std::FILE, FileCloser>;

FilePtr open_to_read(const std::filesystem::path& path) {
  if (std::filesystem::is_directory(path)) throw not_found(path.string(), "is a folder");
  FilePtr f(std::fopen(path.c_str(), "rb"));
  if (!f) throw not_found(path.string(), last_error());
  return f;
}

}  // namespace

AtomicFile::AtomicFile(std::filesystem::path path) : path_(std::move(path)), partial_(pecs::partial_path(path_)) {
  file_ = std::fopen(partial_.c_str(), "wb");
  if (!file_) throw bad_output(path_.string(), last_error());
}

AtomicFile::~AtomicFile() {
  if (file_) std::fclose(file_);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) throw bad_output(path_.string(), last_error());
}

void AtomicFile::write(std::string_view text) { write(std::as_bytes(std::span(text))); }

void AtomicFile::commit() {
  const bool flushed = std::fflush(file_) == 0;
  const int flush_errno = errno;
  const bool closed = std::fclose(file_) == 0;
  file_ = nullptr;
  if (!flushed || !closed) throw bad_output(path_.string(), std::strerror(flushed ? errno : flush_errno));
  commit_partial(path_);
}

std::filesystem::path partial_path(const std::filesystem::path& path) {
  std::filesystem::path partial = path;
  partial += ".partial";
  return partial;
}

void commit_partial(const std::filesystem::path& path) {
  const std::filesystem::path partial = partial_path(path);
  const int fd = ::open(partial.c_str(), O_RDONLY);
  if (fd < 0) throw bad_output(path.string(), last_error());
  const bool synced = ::fsync(fd) == 0;
  const int sync_errno = errno;
  ::close(fd);
  if (!synced) throw bad_output(path.string(), std::strerror(sync_errno));
  std::error_code ec;
  std::filesystem::rename(partial, path, ec);
  if (ec) throw bad_output(path.string(), ec.message());
}

std::string read_text(const std::filesystem::path& path, std::size_t max_bytes) {
  const FilePtr f = open_to_read(path);
  std::string text;
  std::array<char, 1 << 16> buffer{};
  while (const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), f.get())) {
    text.append(buffer.data(), n);
    if (text.size() > max_bytes)
      throw bad_input(path.string(), "", "more than " + std::to_string(max_bytes) + " bytes",
                      "at most " + std::to_string(max_bytes));
  }
  return text;
}

std::string sha256_of_file(const std::filesystem::path& path) {
  const FilePtr f = open_to_read(path);
  Sha256 sha;
  std::array<char, 1 << 16> buffer{};
  while (const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), f.get())) sha.add(buffer.data(), n);
  return sha.hex();
}

std::string sha256(std::string_view bytes) {
  Sha256 sha;
  sha.add(bytes.data(), bytes.size());
  return sha.hex();
}

}  // namespace pecs
