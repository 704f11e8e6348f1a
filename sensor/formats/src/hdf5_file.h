#pragma once
// The HDF5 C library, held by handles: every failure becomes a pecs::Error with the file and the object's name.
#include <hdf5.h>

#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "pecs/error.h"

namespace pecs::events::hdf5 {

// The library, as Debian builds it, serves one thread at a time: hold a Session around every use. It also keeps the
// library from printing its own error stack.
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
  herr_t close();  // negative: failed (a disk full is seen here)
  hid_t get() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
  Close close_ = nullptr;
};

bool is_hdf5(std::span<const std::byte> head);
// True if the file opens and has these paths. Never throws.
bool has_paths(const std::filesystem::path& path, const std::vector<std::string>& names);

Handle open_file(const std::filesystem::path& path);       // throws not_found, bad_input
Handle create_partial(const std::filesystem::path& path);  // "<path>.partial"; throws bad_output

// A one-dimensional dataset opened for reading; `place` of its errors is its name.
class Column {
 public:
  Column(const Handle& file, std::filesystem::path path, std::string name);  // throws bad_input
  hid_t id() const { return dataset_.get(); }
  std::uint64_t size() const { return size_; }
  std::uint64_t chunk() const { return chunk_; }  // items; 0 when contiguous
  // Items first .. first + count - 1 as `memory_type`.
  void read(std::uint64_t first, std::uint64_t count, hid_t memory_type, void* out) const;
  Error damage(const std::string& got, const std::string& wanted) const;

 private:
  std::filesystem::path path_;
  std::string name_;
  Handle dataset_;
  std::uint64_t size_ = 0, chunk_ = 0;
};

std::optional<std::string> text_attribute(hid_t object, const char* name);
std::optional<std::int64_t> integer_attribute(hid_t object, const char* name);
void write_attribute(hid_t object, const char* name, const std::string& text);
void write_attribute(hid_t object, const char* name, std::int64_t value);

}  // namespace pecs::events::hdf5
