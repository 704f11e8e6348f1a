#pragma once
// What the fuzzers share. Each is a program of libFuzzer, or of driver.cpp, for one reader: whatever the bytes, the
// reader comes to an end with a value or with one pecs::Error of one line that is not `internal`.
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "pecs/error.h"

extern "C" const char* pecs_fuzz_kind();

namespace pecs::fuzz {

// What this fuzzer reads, of the kinds that its source can: a line of CMakeLists.txt each.
inline const std::string kKind = pecs_fuzz_kind();

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

// Values taken from an input, front to back; zeros after its end.
class Bytes {
 public:
  explicit Bytes(std::string_view bytes) : bytes_(bytes) {}
  template <class T>
  T take() {
    T value{};
    const std::size_t n = std::min(sizeof value, bytes_.size());
    std::memcpy(&value, bytes_.data(), n);
    bytes_.remove_prefix(n);
    return value;
  }
  std::string_view rest() const { return bytes_; }

 private:
  std::string_view bytes_;
};

// So many floats of the input's next bytes, two for each, over and over: below 256 in size, often whole, or what no
// renderer should write.
inline std::vector<float> strange_floats(Bytes& in, std::size_t count) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  constexpr float kStrange[] = {NAN, kInfinity, -kInfinity, 3e38f, -3e38f, 1e-42f, 1e9f, -1e9f, 1e-12f, 0.5f};
  std::vector<float> pattern;
  for (auto left = 1 + in.take<std::uint8_t>(); left > 0 && !in.rest().empty(); --left) {
    const auto bits = in.take<std::int16_t>();
    const auto which = static_cast<std::size_t>(bits) % 64;
    pattern.push_back(which < std::size(kStrange) ? kStrange[which] : static_cast<float>(bits / 64 * (bits % 4)) / 8);
  }
  if (pattern.empty()) pattern = {1};
  std::vector<float> out(count);
  for (std::size_t i = 0; i < count; ++i) out[i] = pattern[i % pattern.size()];
  return out;
}

inline std::string_view text(const std::uint8_t* data, std::size_t size) {
  return {reinterpret_cast<const char*>(data), size};
}

}  // namespace pecs::fuzz
