#pragma once
// Opens all outputs, and reads small inputs whole. An output is written according to its path:
//   new, or a regular file   it is written as "<path>.partial" and renamed when complete. Destroyed before that, the
//                            .partial remains. A link to a file is followed.
//   pipe, character device   written directly, front to back; an error for formats that seek
//   anything else            an error: directory, block device, socket, dangling link
// A second writer of the same output is an error.
#include <cstdio>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "pecs/platform.h"

namespace pecs {

// A claim on "<path>.partial", for libraries that open files themselves (HDF5, libzip, OpenCV). Throws bad_output.
class PartialFile {
 public:
  // keeps_extension: for a library that chooses the format by it: ".<stem>.partial<extension>".
  explicit PartialFile(const std::filesystem::path& path, bool keeps_extension = false);

  const platform::Descriptor& file() const { return file_; }  // the .partial, which is empty at first
  const std::filesystem::path& partial_path() const { return partial_; }
  // Flushes the .partial to the disk, or `written` for a library that requires a name of its own, and renames it.
  void commit();
  void commit(const std::filesystem::path& written);

 private:
  std::filesystem::path path_, partial_;
  platform::Descriptor file_;
};

class AtomicFile {
 public:
  enum class Order { front_to_back, goes_back };
  explicit AtomicFile(const std::filesystem::path& path, Order order = Order::front_to_back);  // throws bad_output
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  void write(std::span<const std::byte> bytes);  // throws bad_output (disk full, …)
  void write(std::string_view text);
  void seek(std::uint64_t offset);  // throws bad_output
  void commit();

 private:
  std::filesystem::path path_;
  std::optional<PartialFile> partial_;  // none: written directly
  std::FILE* file_ = nullptr;
};

// A whole file at once, as AtomicFile.
void write_file(const std::filesystem::path& path, std::span<const std::byte> bytes);
void write_file(const std::filesystem::path& path, std::string_view text);

std::filesystem::path partial_path(const std::filesystem::path& path);
std::filesystem::path run_record_path(const std::filesystem::path& output);  // run_record.h
bool is_stream(const std::filesystem::path& path);  // whether it is a pipe or a character device
// Throws usage when writing an output (with its .partial and its run record) would replace an input, a frame of an
// input folder, or another output. Empty paths are ignored.
void check_outputs(const std::vector<std::filesystem::path>& inputs, const std::vector<std::filesystem::path>& outputs);

// Without a byte order mark of UTF-8. Throws not_found, bad_input.
std::string read_text(const std::filesystem::path& path, std::size_t max_bytes);
std::string sha256_of_file(const std::filesystem::path& path);  // lower-case hex; throws not_found

}  // namespace pecs
