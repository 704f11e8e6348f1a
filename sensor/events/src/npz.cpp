// NumPy NPZ: a ZIP of one-dimensional arrays t (int64, microseconds), x, y (uint16) and p (uint8), and of the scalars
// width and height. Also read: other integer types and byte orders, booleans, compressed archives; without the size, t
// in another unit that the user states.
#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <tuple>

#include "buffer_size.h"
#include "checked_writer.h"
#include "codec.h"
#include "event_columns.h"
#include "input_file.h"
#include "pecs/files.h"
#include "pecs/platform.h"

namespace pecs::events {
namespace {

struct ArchiveCloser {
  void operator()(zip_t* z) const { zip_discard(z); }
};
using Archive = std::unique_ptr<zip_t, ArchiveCloser>;
struct MemberCloser {
  void operator()(zip_file_t* f) const { zip_fclose(f); }
};

Archive open_archive(const std::filesystem::path& path) {
  int code = 0;
  Archive archive(zip_open(path.string().c_str(), ZIP_RDONLY, &code));
  if (archive) return archive;
  if (code == ZIP_ER_NOENT || code == ZIP_ER_OPEN) throw not_found(path.string(), std::strerror(errno));
  throw bad_input(path.string(), "byte 0", "data that is not a complete ZIP archive", "an NPZ file");
}

// The value of `key` in the dictionary of an .npy header, as text up to the next ',' outside of parentheses.
std::string_view npy_field(std::string_view header, std::string_view key) {
  const std::string quoted = fmt::format("'{}':", key);
  const std::size_t at = header.find(quoted);
  if (at == std::string_view::npos) return {};
  std::string_view rest = header.substr(at + quoted.size());
  rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size()));
  const char close = rest.starts_with('(') ? ')' : ',';
  const std::size_t end = rest.find(close);
  return end == std::string_view::npos ? std::string_view{} : rest.substr(0, end + (close == ')'));
}

// An array of integers, read front to back.
class ArrayReader {
 public:
  ArrayReader(const std::filesystem::path& path, zip_t* archive, const std::string& name)
      : path_(path), name_(name), member_(zip_fopen(archive, (name + ".npy").c_str(), 0)) {
    if (!member_) throw damage("no such array", "t, x, y and p");
    std::array<std::byte, 10> start{};
    read_exactly(start);
    if (std::memcmp(start.data(), "\x93NUMPY", 6) != 0) throw damage("no .npy header", "one");
    std::size_t header_bytes = std::to_integer<std::size_t>(start[8]) | std::to_integer<std::size_t>(start[9]) << 8;
    if (start[6] != std::byte{1}) {  // version 2 and 3: a 32-bit length
      std::array<std::byte, 2> more{};
      read_exactly(more);
      header_bytes |= std::to_integer<std::size_t>(more[0]) << 16 | std::to_integer<std::size_t>(more[1]) << 24;
    }
    if (header_bytes > (1u << 16)) throw damage(fmt::format("a header of {} bytes", header_bytes), "at most 65536");
    std::string header(header_bytes, '\0');
    read_exactly(std::as_writable_bytes(std::span(header)));
    parse_type(npy_field(header, "descr"));
    parse_shape(npy_field(header, "shape"));
    zip_stat_t stat{};
    if (zip_stat(archive, (name + ".npy").c_str(), 0, &stat) != 0 || stat.size - offset_ != size_ * item_bytes_)
      throw damage(fmt::format("{} values of {} bytes in a member of {} bytes", size_, item_bytes_, stat.size),
                   "values to its end");
  }

  std::uint64_t size() const { return size_; }
  bool is_scalar() const { return scalar_; }

  bool is_unsigned() const { return !signed_; }

  // The next out.size() values, unsigned ones as their bits; at most as many as are left.
  void read(std::span<std::int64_t> out) {
    bytes_.resize(out.size() * item_bytes_);
    read_exactly(bytes_);
    for (std::size_t i = 0; i < out.size(); ++i) {
      std::byte* item = bytes_.data() + i * item_bytes_;
      if (big_endian_) std::reverse(item, item + item_bytes_);
      std::uint64_t value = 0;
      std::memcpy(&value, item, item_bytes_);
      const unsigned unused = static_cast<unsigned>(64 - 8 * item_bytes_);
      out[i] = signed_ ? static_cast<std::int64_t>(value << unused) >> unused : static_cast<std::int64_t>(value);
    }
  }

  // Call after the last value: the archive checks its checksum at the end of the data.
  void end() {
    std::byte more{};
    const zip_int64_t got = zip_fread(member_.get(), &more, 1);
    if (got < 0) throw damage(zip_file_strerror(member_.get()), "the data that were written (CRC-32)");
    if (got > 0) throw damage("more bytes", fmt::format("the end of the array, {} values", size_));
  }

  Error damage(const std::string& got, const std::string& wanted) const {
    return bad_input(path_.string(), fmt::format("{}.npy: byte {}", name_, offset_), got, wanted);
  }

 private:
  void read_exactly(std::span<std::byte> out) {
    for (std::size_t n = 0; n < out.size();) {
      const zip_int64_t got = zip_fread(member_.get(), out.data() + n, out.size() - n);
      if (got < 0) throw damage(zip_file_strerror(member_.get()), "readable data");
      if (got == 0) throw damage("the end of the array", fmt::format("{} more bytes", out.size() - n));
      n += static_cast<std::size_t>(got);
      offset_ += static_cast<std::uint64_t>(got);
    }
  }

  void parse_type(std::string_view descr) {  // '<i8'
    const char* kinds = "iub";
    if (descr.size() == 5 && std::strchr("<>|", descr[1]) && std::strchr(kinds, descr[2]) &&
        std::strchr("1248", descr[3])) {
      big_endian_ = descr[1] == '>';
      signed_ = descr[2] == 'i';
      item_bytes_ = static_cast<std::size_t>(descr[3] - '0');
      return;
    }
    throw damage(fmt::format("type {}", descr.substr(0, 40)), name_ == "t" ? "integer microseconds" : "integers");
  }

  void parse_shape(std::string_view shape) {  // "(123,)", "()"
    if (shape == "()") {
      scalar_ = true;
      size_ = 1;
      return;
    }
    const std::string_view inside = shape.substr(std::min<std::size_t>(1, shape.size()));
    const auto [end, ec] = std::from_chars(inside.data(), inside.data() + inside.size(), size_);
    if (ec != std::errc() || std::string_view(end, inside.data() + inside.size()) != ",)" || size_ > INT64_MAX / 8)
      throw damage(fmt::format("shape {}", shape.substr(0, 40)), "one dimension");
  }

  const std::filesystem::path& path_;
  std::string name_;
  std::unique_ptr<zip_file_t, MemberCloser> member_;
  std::uint64_t offset_ = 0, size_ = 0;
  std::size_t item_bytes_ = 0;
  bool big_endian_ = false, signed_ = false, scalar_ = false;
  std::vector<std::byte> bytes_;
};

class NpzReader final : public BlockReader {
 public:
  NpzReader(const std::filesystem::path& path, const ReadOptions& options)
      : path_(path),
        unit_(options.time_unit),
        archive_(open_archive(path)),
        columns_{{{path_, archive_.get(), "t"},
                  {path_, archive_.get(), "x"},
                  {path_, archive_.get(), "y"},
                  {path_, archive_.get(), "p"}}},
        values_(path.string(), {"t.npy", "x.npy", "y.npy", "p.npy"}),
        size_(columns_[0].size()) {
    for (const ArrayReader& column : columns_) {
      if (column.is_scalar()) throw column.damage("a single value without a dimension", "an array");
      if (column.size() != size_)
        throw column.damage(fmt::format("{} values", column.size()), fmt::format("{}, as in t", size_));
    }
    info_.width = scalar("width");
    info_.height = scalar("height");
    extent_.emplace(info_, 65536);
  }

  // PECS writes a size, and microseconds.
  std::optional<TimeUnit> assumed_unit() const {
    return unit_ || info_.width > 0 ? std::nullopt : std::optional(TimeUnit::us);
  }

 private:
  static constexpr std::size_t kBlock = buffer_size(1 << 14, 64);

  bool next_block() override {
    if (first_ == size_) {
      std::ranges::for_each(columns_, &ArrayReader::end);
      return false;
    }
    block_.resize(std::min<std::uint64_t>(size_ - first_, kBlock));
    const auto read = [&](auto c, std::span<std::int64_t> values) {
      columns_[c].read(values);
      return columns_[c].is_unsigned();
    };
    values_.read(first_, 0, *extent_, block_, read, unit_.value_or(TimeUnit::us));
    first_ += block_.size();
    return true;
  }

  int scalar(const std::string& name) {
    if (zip_name_locate(archive_.get(), (name + ".npy").c_str(), 0) < 0) return 0;
    ArrayReader reader(path_, archive_.get(), name);
    std::int64_t value = 0;
    if (reader.size() == 1) reader.read(std::span(&value, 1));
    reader.end();
    if (value < 0 || value > 65536) throw reader.damage(fmt::format("{}", value), "0 to 65536");
    return static_cast<int>(value);
  }

  std::filesystem::path path_;
  std::optional<TimeUnit> unit_;
  Archive archive_;
  std::array<ArrayReader, 4> columns_;
  EventColumns values_;
  std::uint64_t size_;
};

constexpr Limits kNpzLimits = {};
constexpr std::size_t kHeaderBytes = 128;
constexpr zip_uint16_t kDosDate = 1 << 5 | 1;  // 1980-01-01, as NumPy's: the same events make the same bytes

// The header has a fixed length, so that it can be written last.
std::string npy_header(const char* descr, const std::string& shape) {
  std::string header = std::string("\x93NUMPY\x01\x00", 8);
  header += static_cast<char>(kHeaderBytes - 10);
  header += '\0';
  header += fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", descr, shape);
  header.resize(kHeaderBytes - 1, ' ');
  return header + '\n';
}

// A column is buffered in an unnamed file in the output folder until the ZIP is assembled.
class Spool {
 public:
  Spool(const std::filesystem::path& output, const PartialFile& partial, const char* descr)
      : output_(output), descr_(descr) {
    file_.reset(platform::open_unnamed(partial.partial_path()));
    if (!file_) throw bad_output(output.string(), std::strerror(errno));
    write(std::string(kHeaderBytes, ' ').data(), kHeaderBytes);
  }
  void write(const void* data, std::size_t bytes) {
    if (std::fwrite(data, 1, bytes, file_.get()) != bytes) throw bad_output(output_.string(), std::strerror(errno));
  }
  std::FILE* finish(std::uint64_t count) {
    to_start();
    write(npy_header(descr_, fmt::format("({},)", count)).data(), kHeaderBytes);
    if (std::fflush(file_.get()) != 0) throw bad_output(output_.string(), std::strerror(errno));
    to_start();
    return file_.release();  // libzip closes it
  }

 private:
  struct Closer {
    void operator()(std::FILE* f) const { std::fclose(f); }
  };
  void to_start() {
    if (std::fseek(file_.get(), 0, SEEK_SET) != 0) throw bad_output(output_.string(), std::strerror(errno));
  }

  std::filesystem::path output_;
  const char* descr_;
  std::unique_ptr<std::FILE, Closer> file_;
};

class NpzWriter final : public CheckedWriter {
 public:
  NpzWriter(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kNpzLimits, false),
        partial_(path),
        t_(path, partial_, "<i8"),
        x_(path, partial_, "<u2"),
        y_(path, partial_, "<u2"),
        p_(path, partial_, "|u1") {}

 private:
  void put(std::span<const Event> events) override {
    for (const Event& e : events) {
      t_.write(&e.t_us, sizeof e.t_us);
      x_.write(&e.x, sizeof e.x);
      y_.write(&e.y, sizeof e.y);
      p_.write(&e.p, sizeof e.p);
    }
  }

  void finish() override {
    int code = 0;
    // libzip renames its file at the end, so it needs another name than the locked .partial.
    const std::string unfinished = partial_.partial_path().string() + ".zip";
    Archive archive(zip_open(unfinished.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
    if (!archive) throw bad_output(path().string(), std::strerror(errno));
    add(archive.get(), "t", zip_source_filep(archive.get(), t_.finish(count()), 0, -1));
    add(archive.get(), "x", zip_source_filep(archive.get(), x_.finish(count()), 0, -1));
    add(archive.get(), "y", zip_source_filep(archive.get(), y_.finish(count()), 0, -1));
    add(archive.get(), "p", zip_source_filep(archive.get(), p_.finish(count()), 0, -1));
    const std::string width = scalar(info().width), height = scalar(info().height);
    if (info().width > 0) {
      add(archive.get(), "width", zip_source_buffer(archive.get(), width.data(), width.size(), 0));
      add(archive.get(), "height", zip_source_buffer(archive.get(), height.data(), height.size(), 0));
    }
    if (zip_close(archive.get()) != 0) throw bad_output(path().string(), zip_strerror(archive.get()));
    std::ignore = archive.release();  // zip_close has freed it
    partial_.commit(unfinished);
  }

  static std::string scalar(std::int64_t value) {
    std::string bytes = npy_header("<i8", "()");
    bytes.append(reinterpret_cast<const char*>(&value), sizeof value);
    return bytes;
  }

  void add(zip_t* archive, const std::string& name, zip_source_t* source) const {
    const zip_int64_t index = zip_file_add(archive, (name + ".npy").c_str(), source, ZIP_FL_ENC_UTF_8);
    if (index < 0) throw bad_output(path().string(), zip_strerror(archive));
    zip_set_file_compression(archive, static_cast<zip_uint64_t>(index), ZIP_CM_STORE, 0);
    zip_file_set_dostime(archive, static_cast<zip_uint64_t>(index), 0, kDosDate, 0);
  }

  PartialFile partial_;
  Spool t_, x_, y_, p_;
};

}  // namespace

Codec make_npz() {
  return make_codec<NpzReader, NpzWriter>("npz", "NumPy NPZ with t (us), x, y, p", ".npz", kNpzLimits,
                                          [](const auto&, auto head) { return begins_with(head, "PK\3\4"); });
}

}  // namespace pecs::events
