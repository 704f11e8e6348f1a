#pragma once
// RAII handles for the HDF5 C library: every failure becomes a pecs::Error with the file and the object's name.
#include <hdf5.h>

#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs::events::hdf5 {

// Debian's build of the library is not thread-safe: hold a Session around every use. A Session also stops the library
// from printing its error stack, and from closing open objects at exit, where it crashes after a full disk.
class Session {
 public:
  Session();
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

 private:
  std::unique_lock<std::recursive_mutex> lock_;
  H5E_auto2_t print_ = nullptr;
  void* print_data_ = nullptr;
};

class Handle {
 public:
  using Close = herr_t (*)(hid_t);
  Handle() = default;
  Handle(hid_t id, Close closer) : id_(id), close_(closer) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Handle() { close(); }
  herr_t close();  // negative: failed (reports a full disk)
  hid_t get() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
  Close close_ = nullptr;
};

bool is_hdf5(std::span<const std::byte> head);
// True if the file opens and has these paths. Never throws.
bool has_paths(const std::filesystem::path& path, const std::vector<std::string>& names);

Handle open_file(const std::filesystem::path& path);  // throws not_found, bad_input

// A one-dimensional dataset opened for reading; `place` of its errors is its name. Rejects datasets whose items are not
// all in this file: links to other files, external storage, virtual datasets and chunks that were never written.
class Column {
 public:
  Column(const Handle& file, std::filesystem::path path, std::string name);  // throws bad_input
  hid_t id() const { return dataset_.get(); }
  std::uint64_t size() const { return size_; }
  std::uint64_t chunk() const { return chunk_; }  // items; 0 when contiguous
  // Items first .. first + count - 1 as `memory_type`.
  void read(std::uint64_t first, std::uint64_t count, hid_t memory_type, void* out) const;
  // Integers, or an enumeration, as h5py stores booleans; unchanged: the bits of unsigned ones.
  void require_integers() const;
  void read_integers(std::uint64_t first, std::span<std::int64_t> out) const;
  bool is_unsigned() const { return kind_ == Kind::unsigned_integer; }
  Error damage(const std::string& got, const std::string& wanted) const;

 private:
  enum class Kind { signed_integer, unsigned_integer, other };
  void open(const Handle& file, hid_t access);
  void check_storage(std::uint64_t item_bytes) const;
  Error unreadable(std::uint64_t first, std::uint64_t last) const;
  void limit_chunks(const Handle& file, hid_t properties, std::uint64_t item_bytes);

  std::filesystem::path path_;
  std::string name_;
  Handle dataset_;
  Kind kind_ = Kind::other;
  std::uint64_t size_ = 0, chunk_ = 0;
};

// Value of an attribute of the root or a group; empty if absent or of another type.
std::optional<std::string> text_attribute(hid_t object, const char* name);
std::optional<std::int64_t> integer_attribute(hid_t object, const char* name);
// Value of a scalar dataset in this file; empty if absent or beyond int64.
std::optional<std::int64_t> integer_dataset(const Handle& file, const char* name);
bool is_unsigned(hid_t integer_type);
void write_attribute(hid_t object, const char* name, const std::string& text);
void write_attribute(hid_t object, const char* name, std::int64_t value);

// A new file: written as "<path>.partial", renamed by commit(). All throw bad_output. The same items make the same
// bytes.
class Output {
 public:
  explicit Output(std::filesystem::path path);
  hid_t id() const { return file_.get(); }
  void write_scalar(const char* name, std::int64_t value);
  void commit();  // after all groups and datasets are finished
  void check(bool done) const;

 private:
  std::filesystem::path path_;
  PartialFile partial_;
  Handle file_;
};

class Group {
 public:
  Group(const Output& file, const char* name);
  hid_t id() const { return group_.get(); }
  void finish() { group_.close(); }

 private:
  Handle group_;
};

Handle type_of(std::uint8_t);
Handle type_of(std::uint16_t);
Handle type_of(std::int64_t);
Handle type_of(std::uint64_t);

struct DatasetOptions {
  std::size_t chunk = 1 << 15;            // items
  bool gzip = false;                      // after shuffling
  H5Z_filter_t filter = H5Z_FILTER_NONE;  // optional; its encoded chunks come through append_chunk
};

// A growing one-dimensional dataset.
class GrowingDataset {
 public:
  GrowingDataset(const Output& file, const char* name, Handle type, const DatasetOptions& options);
  hid_t id() const { return dataset_.get(); }
  void append(const void* items, std::size_t count);
  void append_chunk(std::span<const std::byte> encoded, std::size_t count);  // starts at a multiple of the chunk
  void finish();

 private:
  const Output& file_;
  Handle type_, dataset_;
  std::uint64_t size_ = 0;
};

// A gzipped dataset of integers, written item by item.
template <class T>
class Appender {
 public:
  Appender(const Output& file, const char* name) : dataset_(file, name, type_of(T{}), {.chunk = kChunk, .gzip = true}) {
    buffer_.reserve(kChunk);
  }
  void append(T value) {
    buffer_.push_back(value);
    if (buffer_.size() == kChunk) flush();
  }
  void finish() {
    flush();
    dataset_.finish();
  }

 private:
  static constexpr std::size_t kChunk = 1 << 15;
  void flush() {
    if (!buffer_.empty()) dataset_.append(buffer_.data(), buffer_.size());
    buffer_.clear();
  }
  GrowingDataset dataset_;
  std::vector<T> buffer_;
};

}  // namespace pecs::events::hdf5
