#include "pecs/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <openssl/evp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <memory>
#include <utility>

#include "pecs/error.h"
#include "pecs/text.h"

namespace pecs {
namespace fs = std::filesystem;
namespace {

constexpr std::string_view kFrameEndings[] = {".json", ".exr", ".png",  ".tif", ".tiff", ".jpg",
                                              ".jpeg", ".bmp", ".webp", ".pgm", ".ppm"};

std::string last_error() { return std::strerror(errno); }

struct FileCloser {
  void operator()(std::FILE* f) const { std::fclose(f); }
};
using FilePtr = std::unique_ptr<std::FILE, FileCloser>;

// Also for paths that do not exist yet.
bool is_same_file(const fs::path& a, const fs::path& b) {
  std::error_code ec;
  if (fs::equivalent(a, b, ec)) return true;
  const fs::path a_path = fs::weakly_canonical(a, ec), b_path = ec ? fs::path() : fs::weakly_canonical(b, ec);
  return !ec && a_path == b_path;
}

// Resolves links in an output's path. Throws bad_output for an existing path that is not a file or a stream.
fs::path file_behind(const fs::path& path) {
  struct stat found{};
  if (path.empty()) throw bad_output("output", "the path is empty");
  if (::stat(path.c_str(), &found) != 0) {
    if (errno != ENOENT) throw bad_output(path.string(), last_error());
    std::error_code ec;
    if (fs::is_symlink(path, ec)) throw bad_output(path.string(), "dangling symbolic link");
    return path;
  }
  if (S_ISDIR(found.st_mode)) throw bad_output(path.string(), "it is a directory");
  if (S_ISBLK(found.st_mode) || S_ISSOCK(found.st_mode))
    throw bad_output(path.string(), "it is a block device or a socket");
  if (!S_ISREG(found.st_mode))
    throw bad_output(path.string(), "it is a pipe or a device; this format needs a seekable file");
  return fs::is_symlink(path) ? fs::canonical(path) : path;
}

// Opens, locks and truncates the .partial, in this order, so that a file that another process writes stays intact.
int claimed(const fs::path& partial, const fs::path& path) {
  const auto refuse = [&](int fd, const std::string& why) {
    if (fd >= 0) ::close(fd);
    return bad_output(path.string(), why);
  };
  for (;;) {
    // O_NONBLOCK: opening a pipe does not block.
    const int fd = ::open(partial.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NOCTTY | O_NONBLOCK | O_CLOEXEC, 0666);
    struct stat opened{}, named{};
    if (fd < 0) {
      const bool is_link = errno == ELOOP && ::lstat(partial.c_str(), &named) == 0 && S_ISLNK(named.st_mode);
      throw refuse(fd, is_link ? partial.string() + " is a symbolic link" : last_error());
    }
    if (::fstat(fd, &opened) != 0 || !S_ISREG(opened.st_mode))
      throw refuse(fd, partial.string() + " is not a regular file");
    // A lock of the open file description, not of the process: closing another descriptor of the file does not release
    // it.
    struct flock lock{};
    lock.l_type = F_WRLCK;
    if (::fcntl(fd, F_OFD_SETLK, &lock) != 0 && (errno == EAGAIN || errno == EACCES))
      throw refuse(fd, "another process is writing it");
    // Another process renamed it between open and lock: it is a finished output now.
    if (::stat(partial.c_str(), &named) != 0 || named.st_ino != opened.st_ino || named.st_dev != opened.st_dev) {
      ::close(fd);
      continue;
    }
    if (::ftruncate(fd, 0) != 0) throw refuse(fd, last_error());
    return fd;
  }
}

FilePtr open_to_read(const fs::path& path) {
  if (fs::is_directory(path)) throw not_found(path.string(), "it is a directory");
  FilePtr f(std::fopen(path.c_str(), "rb"));
  if (!f) throw not_found(path.string(), last_error());
  return f;
}

}  // namespace

PartialFile::PartialFile(const fs::path& path) : path_(file_behind(path)), partial_(pecs::partial_path(path_)) {
  descriptor_ = claimed(partial_, path);
}

PartialFile::~PartialFile() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

void PartialFile::commit() {
  if (::fsync(descriptor_) != 0 || ::rename(partial_.c_str(), path_.c_str()) != 0)
    throw bad_output(path_.string(), last_error());
}

void PartialFile::commit(const fs::path& written) {
  const int fd = ::open(written.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC);
  if (fd < 0) throw bad_output(path_.string(), last_error());
  const bool done = ::fsync(fd) == 0 && ::rename(written.c_str(), path_.c_str()) == 0;
  const int failure = errno;
  ::close(fd);
  if (!done) throw bad_output(path_.string(), std::strerror(failure));
  ::unlink(partial_.c_str());
}

AtomicFile::AtomicFile(const fs::path& path, Order order) : path_(path) {
  int fd = -1;
  if (order == Order::front_to_back && is_stream(path)) {
    fd = ::open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
  } else {
    fd = ::fcntl(partial_.emplace(path).descriptor(), F_DUPFD_CLOEXEC, 0);
  }
  file_ = fd < 0 ? nullptr : ::fdopen(fd, "wb");
  if (!file_) throw bad_output(path.string(), last_error());
}

AtomicFile::~AtomicFile() {
  if (file_) std::fclose(file_);
}

void AtomicFile::write(std::span<const std::byte> bytes) {
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) throw bad_output(path_.string(), last_error());
}

void AtomicFile::write(std::string_view text) { write(std::as_bytes(std::span(text))); }

void AtomicFile::commit() {
  if (std::fflush(file_) != 0) throw bad_output(path_.string(), last_error());
  if (partial_) partial_->commit();
  if (std::fclose(std::exchange(file_, nullptr)) != 0) throw bad_output(path_.string(), last_error());
}

void write_file(const fs::path& path, std::span<const std::byte> bytes) {
  AtomicFile file(path);
  file.write(bytes);
  file.commit();
}

void write_file(const fs::path& path, std::string_view text) { write_file(path, std::as_bytes(std::span(text))); }

fs::path partial_path(const fs::path& path) {
  fs::path partial = path;
  partial += ".partial";
  return partial;
}

bool is_stream(const fs::path& path) {
  struct stat found{};
  if (::stat(path.c_str(), &found) != 0) return false;
  return S_ISFIFO(found.st_mode) || S_ISCHR(found.st_mode);
}

void check_outputs(const std::vector<fs::path>& inputs, const std::vector<fs::path>& outputs) {
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    const fs::path& output = outputs[i];
    if (output.empty() || is_stream(output)) continue;
    const auto refuse = [&](const std::string& got, const std::string& wanted) {
      return Error(ExitCode::usage, fmt::format("{}: output: got {}, wanted {}", output.string(), got, wanted));
    };
    for (const fs::path& input : inputs) {
      if (input.empty()) continue;
      if (is_same_file(output, input) || is_same_file(pecs::partial_path(output), input))
        throw refuse("the input itself", "another file");
      if (fs::exists(output) && is_same_file(output.parent_path() / ".", input / ".") &&
          std::ranges::find(kFrameEndings, lower(output.extension().string())) != std::end(kFrameEndings))
        throw refuse("a file of the input folder", "another file");
    }
    for (std::size_t k = 0; k < i; ++k)
      if (!outputs[k].empty() && is_same_file(output, outputs[k])) throw refuse("two outputs", "one file each");
  }
}

namespace {

// Calls visit(bytes) for each part of a file.
template <class Visit>
void read_file(const fs::path& path, const Visit& visit) {
  const FilePtr f = open_to_read(path);
  std::array<char, 1 << 16> buffer{};
  while (!std::feof(f.get())) {
    const std::size_t n = std::fread(buffer.data(), 1, buffer.size(), f.get());
    if (std::ferror(f.get())) throw not_found(path.string(), std::strerror(errno));
    visit(std::string_view(buffer.data(), n));
  }
}

}  // namespace

std::string read_text(const fs::path& path, std::size_t max_bytes) {
  std::string text;
  read_file(path, [&](std::string_view bytes) {
    text += bytes;
    if (text.size() > max_bytes)
      throw bad_input(path.string(), "", "more than " + std::to_string(max_bytes) + " bytes",
                      "at most " + std::to_string(max_bytes));
  });
  return text;
}

std::string sha256_of_file(const fs::path& path) {
  const std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context(EVP_MD_CTX_new(), &EVP_MD_CTX_free);
  EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr);
  read_file(path, [&](std::string_view bytes) { EVP_DigestUpdate(context.get(), bytes.data(), bytes.size()); });
  std::array<unsigned char, 32> digest{};
  EVP_DigestFinal_ex(context.get(), digest.data(), nullptr);
  return fmt::format("{:02x}", fmt::join(digest, ""));
}

}  // namespace pecs
