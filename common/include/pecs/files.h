#pragma once
// Outputs, all opened here, and small inputs read whole. What an output's name stands for decides:
//   nothing yet, or a file   it is written as "<path>.partial" and renamed when it is whole. Destroyed before that, the
//                            .partial stays: it is never mistaken for a finished output. Of a link to a file, the file.
//   pipe, character device   written through from front to back; refused to formats that go back
//   all else                 refused: folder, block device, socket, link to nothing
// Two that write one output at a time: the second one is refused.
#include <cstdio>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace pecs {

// A claim on "<path>.partial", for libraries that open files themselves (HDF5, libzip, OpenCV). Throws bad_output.
class PartialFile {
 public:
  explicit PartialFile(const std::filesystem::path& path);
  ~PartialFile();
  PartialFile(const PartialFile&) = delete;
  PartialFile& operator=(const PartialFile&) = delete;

  int descriptor() const { return descriptor_; }  // of the .partial, empty at first
  const std::filesystem::path& partial_path() const { return partial_; }
  // What stands in the .partial, or in `written` where a library wants a name of its own, reaches the disk and gets its
  // name.
  void commit();
  void commit(const std::filesystem::path& written);

 private:
  std::filesystem::path path_, partial_;
  int descriptor_ = -1;
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
  std::FILE* stream() { return file_; }
  void commit();

 private:
  std::filesystem::path path_;
  std::optional<PartialFile> partial_;  // none: written through
  std::FILE* file_ = nullptr;
};

std::filesystem::path partial_path(const std::filesystem::path& path);
bool is_stream(const std::filesystem::path& path);  // a pipe or a character device: it keeps nothing
// Throws usage when an output is an input or would be written over one of an input folder's frames, or when two outputs
// are one file. Empty names are left out.
void check_outputs(const std::vector<std::filesystem::path>& inputs, const std::vector<std::filesystem::path>& outputs);

std::string read_text(const std::filesystem::path& path, std::size_t max_bytes);  // throws not_found, bad_input
std::string sha256_of_file(const std::filesystem::path& path);                    // lower-case hex; throws not_found
std::string sha256(std::string_view bytes);

}  // namespace pecs
