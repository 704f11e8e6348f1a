#pragma once
// Whole-or-nothing files: write to "<path>.partial", then commit() (flush, fsync, rename). Destroyed without
// commit(), the .partial stays: it is never mistaken for a finished output.
#include <cstdio>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>

namespace pecs {

class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path path);  // throws bad_output
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& partial_path() const { return partial_; }
  void write(std::span<const std::byte> bytes);  // throws bad_output (disk full, …)
  void write(std::string_view text);
  std::FILE* stream() { return file_; }
  void commit();

 private:
  std::filesystem::path path_, partial_;
  std::FILE* file_ = nullptr;
};

// For libraries that open files themselves (HDF5, OpenCV, OpenEXR): they write partial_path(path); commit_partial
// fsyncs and renames it.
std::filesystem::path partial_path(const std::filesystem::path& path);
void commit_partial(const std::filesystem::path& path);

std::string read_text(const std::filesystem::path& path, std::size_t max_bytes);  // throws not_found, bad_input
std::string sha256_of_file(const std::filesystem::path& path);                    // lower-case hex; throws not_found
std::string sha256(std::string_view bytes);

}  // namespace pecs
