#pragma once
// What the fuzzers share. Each is a libFuzzer program for one reader: whatever the bytes, the reader comes to an end
// with a value or with one pecs::Error of one line that is not `internal`.
#include <sys/mman.h>
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <string_view>

#include "pecs/error.h"

namespace pecs::fuzz {

[[noreturn]] inline void defect(const std::string& what) {
  std::fprintf(stderr, "fuzz: %s\n", what.c_str());
  std::abort();
}

// A file in memory, with a path for readers that want one.
class MemoryFile {
 public:
  MemoryFile() : fd_(::memfd_create("fuzz", MFD_CLOEXEC)) {
    if (fd_ < 0) defect("no memory file");
  }
  void hold(std::string_view bytes) const {
    if (::ftruncate(fd_, 0) != 0 || ::pwrite(fd_, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
      defect("memory file: cannot be written");
  }
  std::string path() const { return "/proc/self/fd/" + std::to_string(fd_); }

 private:
  int fd_;
};

template <class Read>
void try_to(Read&& read) {
  try {
    read();
  } catch (const Error& e) {
    const std::string line = e.what();
    if (e.code() == ExitCode::internal || line.empty() || line != printable(line)) defect("error: " + printable(line));
  }
}

inline std::string_view text(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

}  // namespace pecs::fuzz
