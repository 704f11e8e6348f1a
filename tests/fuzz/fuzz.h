#pragma once
// What the fuzzers share. Each is a program of libFuzzer, or of driver.cpp, for one reader: whatever the bytes, the
// reader comes to an end with a value or with one pecs::Error of one line that is not `internal`.
#include <unistd.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <string_view>

#include "pecs/error.h"

namespace pecs::fuzz {

[[noreturn]] inline void defect(const std::string& what) {
  std::fprintf(stderr, "fuzz: %s\n", what.c_str());
  std::abort();
}

// A file in memory, with a path for readers that want one (HDF5 asks for its real name: a memfd has none).
class MemoryFile {
 public:
  MemoryFile() : fd_(::mkstemp(path_.data())) {
    if (fd_ < 0) defect("no file in /dev/shm");
  }
  ~MemoryFile() { ::unlink(path_.c_str()); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;

  void hold(std::string_view bytes) const {
    if (::ftruncate(fd_, 0) != 0 || ::pwrite(fd_, bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
      defect("memory file: cannot be written");
  }
  const std::string& path() const { return path_; }

 private:
  std::string path_ = "/dev/shm/pecs_fuzz_XXXXXX";
  int fd_;
};

// A folder in memory.
class MemoryFolder {
 public:
  MemoryFolder() {
    if (!::mkdtemp(path_.data())) defect("no folder in /dev/shm");
  }
  ~MemoryFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  MemoryFolder(const MemoryFolder&) = delete;
  MemoryFolder& operator=(const MemoryFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_ = "/dev/shm/pecs_fuzz_XXXXXX";
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
