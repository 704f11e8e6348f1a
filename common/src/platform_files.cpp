#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "pecs/error.h"
#include "pecs/platform.h"

namespace pecs::platform {
namespace fs = std::filesystem;
namespace {

std::string last_error() { return std::strerror(errno); }

}  // namespace

Descriptor::~Descriptor() {
  if (number_ >= 0) ::close(number_);
}

Descriptor claim(const fs::path& file, const fs::path& path) {
  const auto refuse = [&](const std::string& why) { return bad_output(path.string(), why); };
  for (;;) {
    // O_NONBLOCK: opening a pipe does not block.
    Descriptor fd(::open(file.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NOCTTY | O_NONBLOCK | O_CLOEXEC, 0666));
    struct stat opened{}, named{};
    if (fd.number() < 0) {
      const bool is_link = errno == ELOOP && ::lstat(file.c_str(), &named) == 0 && S_ISLNK(named.st_mode);
      throw refuse(is_link ? file.string() + " is a symbolic link" : last_error());
    }
    if (::fstat(fd.number(), &opened) != 0 || !S_ISREG(opened.st_mode))
      throw refuse(file.string() + " is not a regular file");
    // A lock of the open file description, not of the process: closing another descriptor of the file does not release
    // it.
    struct flock lock{};
    lock.l_type = F_WRLCK;
    if (::fcntl(fd.number(), F_OFD_SETLK, &lock) != 0 && (errno == EAGAIN || errno == EACCES))
      throw refuse("another process is writing it");
    // Another process renamed it between open and lock: it is a finished output now.
    if (::stat(file.c_str(), &named) != 0 || named.st_ino != opened.st_ino || named.st_dev != opened.st_dev) continue;
    if (::ftruncate(fd.number(), 0) != 0) throw refuse(last_error());
    return fd;
  }
}

std::FILE* open_to_read(const fs::path& path) { return std::fopen(path.c_str(), "rb"); }

std::FILE* open_stream(const fs::path& path) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
  return fd < 0 ? nullptr : ::fdopen(fd, "wb");
}

std::FILE* open_again(const Descriptor& file, const char* mode) {
  const int fd = ::fcntl(file.number(), F_DUPFD_CLOEXEC, 0);
  return fd < 0 ? nullptr : ::fdopen(fd, mode);
}

std::FILE* open_unnamed(const fs::path& beside) {
  std::string name = beside.string() + ".XXXXXX";
  Descriptor fd(::mkstemp(name.data()));
  if (fd.number() < 0) return nullptr;
  ::unlink(name.c_str());
  return open_again(fd, "w+b");
}

std::string rename_complete(const Descriptor& file, const fs::path& from, const fs::path& to) {
  return ::fsync(file.number()) == 0 && ::rename(from.c_str(), to.c_str()) == 0 ? "" : last_error();
}

std::string rename_complete(const fs::path& from, const fs::path& to) {
  const Descriptor fd(::open(from.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC));
  return fd.number() < 0 ? last_error() : rename_complete(fd, from, to);
}

std::string name_for_libraries(const fs::path& path) { return path.string(); }

void will_read(const fs::path& path) {
  const Descriptor fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
#ifdef POSIX_FADV_WILLNEED
  if (fd.number() >= 0) ::posix_fadvise(fd.number(), 0, 0, POSIX_FADV_WILLNEED);
#endif
}

}  // namespace pecs::platform
