#include "hdf5_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "pecs/platform.h"

namespace pecs::events::hdf5 {
namespace {

std::recursive_mutex& library_mutex() {
  static std::recursive_mutex mutex;
  return mutex;
}

constexpr std::uint64_t kMaxChunkBytes = std::uint64_t{1} << 28;

// Opens objects through links inside the file only.
Handle access_within_file() {
  Handle access(H5Pcreate(H5P_DATASET_ACCESS), H5Pclose);
  const H5L_elink_traverse_t refuse = [](const char*, const char*, const char*, const char*, unsigned*, hid_t,
                                         void*) -> herr_t { return -1; };
  H5Pset_elink_cb(access.get(), refuse, nullptr);
  return access;
}

// The first missing or external link on `path`; empty if there is none.
std::optional<std::string> missing_link(hid_t file, const std::string& path) {
  const Handle access = access_within_file();
  for (std::size_t slash = path.find('/', 1);; slash = path.find('/', slash + 1)) {
    const std::string part = path.substr(0, slash);
    H5L_info_t link{};
    if (H5Lexists(file, part.c_str(), access.get()) <= 0) return "nothing";
    if (H5Lget_info(file, part.c_str(), &link, access.get()) < 0) return "an unreadable link";
    if (link.type != H5L_TYPE_HARD && link.type != H5L_TYPE_SOFT) return "a link to another file";
    if (slash == std::string::npos) return {};
  }
}

}  // namespace

Session::Session() : lock_(library_mutex()) {
  [[maybe_unused]] static const herr_t once = H5dont_atexit();
  H5Eget_auto2(H5E_DEFAULT, &print_, &print_data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Session::~Session() { H5Eset_auto2(H5E_DEFAULT, print_, print_data_); }

herr_t Handle::close() {
  if (id_ < 0) return 0;
  const Session session;
  return close_(std::exchange(id_, -1));
}

bool is_hdf5(std::span<const std::byte> head) {
  return head.size() >= 8 && std::memcmp(head.data(), "\x89HDF\r\n\x1a\n", 8) == 0;
}

bool has_paths(const std::filesystem::path& path, const std::vector<std::string>& names) {
  const Session session;
  const Handle file(H5Fopen(platform::name_for_libraries(path).c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!file) return false;
  return std::ranges::none_of(names,
                              [&](const std::string& name) { return missing_link(file.get(), name) == "nothing"; });
}

Handle open_file(const std::filesystem::path& path) {
  const Session session;
  if (!std::filesystem::is_regular_file(path)) throw not_found(path.string(), "no such file");
  Handle file(H5Fopen(platform::name_for_libraries(path).c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
  if (!file) throw bad_input(path.string(), "byte 0", "data that HDF5 cannot open", "a whole HDF5 file");
  return file;
}

Column::Column(const Handle& file, std::filesystem::path path, std::string name)
    : path_(std::move(path)), name_(std::move(name)) {
  const Session session;
  const Handle access = access_within_file();
  open(file, access.get());
  const Handle space(H5Dget_space(id()), H5Sclose);
  hsize_t size = 0;
  if (H5Sget_simple_extent_ndims(space.get()) != 1 || H5Sget_simple_extent_dims(space.get(), &size, nullptr) < 0)
    throw damage(fmt::format("{} dimensions", H5Sget_simple_extent_ndims(space.get())), "one");
  size_ = size;

  const Handle type(H5Dget_type(id()), H5Tclose);
  const std::uint64_t item_bytes = H5Tget_size(type.get());
  const H5T_class_t kind = H5Tget_class(type.get());
  const Handle base(kind == H5T_ENUM ? H5Tget_super(type.get()) : H5Tcopy(type.get()), H5Tclose);
  if ((kind == H5T_INTEGER || kind == H5T_ENUM) && item_bytes <= sizeof(std::int64_t))
    kind_ = hdf5::is_unsigned(base.get()) ? Kind::unsigned_integer : Kind::signed_integer;

  const Handle properties(H5Dget_create_plist(id()), H5Pclose);
  if (H5Pget_layout(properties.get()) == H5D_VIRTUAL || H5Pget_external_count(properties.get()) != 0)
    throw damage("a virtual dataset, or one in another file", "items in this file");
  if (H5Pget_layout(properties.get()) == H5D_CHUNKED) limit_chunks(file, properties.get(), item_bytes);
  check_storage(item_bytes);
}

void Column::open(const Handle& file, hid_t access) {
  if (const auto missing = missing_link(file.get(), name_)) throw damage(*missing, "a dataset in this file");
  dataset_.close();  // an open dataset keeps its access properties, such as the cache
  dataset_ = Handle(H5Dopen2(file.get(), name_.c_str(), access), H5Dclose);
  if (!dataset_) throw damage("an object that HDF5 cannot open", "a dataset in this file");
}

// Chunks are decompressed as a whole: caches one, and rejects chunk sizes that no writer makes.
void Column::limit_chunks(const Handle& file, hid_t properties, std::uint64_t item_bytes) {
  hsize_t chunk = 0;
  if (H5Pget_chunk(properties, 1, &chunk) != 1) throw damage("unreadable chunk sizes", "one size");
  if (item_bytes == 0 || chunk > kMaxChunkBytes / item_bytes)
    throw damage(fmt::format("chunks of {} items of {} bytes", chunk, item_bytes),
                 fmt::format("at most {} bytes", kMaxChunkBytes));
  chunk_ = chunk;
  const Handle access = access_within_file();
  H5Pset_chunk_cache(access.get(), H5D_CHUNK_CACHE_NSLOTS_DEFAULT, chunk * item_bytes, 1.0);
  open(file, access.get());
}

// Checks that all declared chunks are stored: missing chunks would read as zeros.
void Column::check_storage(std::uint64_t item_bytes) const {
  if (size_ == 0) return;
  if (chunk_ == 0) {
    const std::uint64_t stored = H5Dget_storage_size(id());
    if (size_ > stored / item_bytes || stored > std::filesystem::file_size(path_))
      throw damage(fmt::format("{} items in {} bytes", size_, stored), fmt::format("{} bytes an item", item_bytes));
    return;
  }
  const Handle space(H5Dget_space(id()), H5Sclose);
  hsize_t chunks = 0;
  if (H5Dget_num_chunks(id(), space.get(), &chunks) < 0) throw damage("unreadable chunks", "a list of chunks");
  const std::uint64_t wanted = (size_ - 1) / chunk_ + 1;
  if (chunks < wanted)
    throw damage(fmt::format("{} items, but {} chunks", size_, chunks), fmt::format("{} chunks", wanted));
}

void Column::require_integers() const {
  if (kind_ == Kind::other) throw damage("values that are no integers of up to 64 bits", "integers");
}

void Column::read_integers(std::uint64_t first, std::span<std::int64_t> out) const {
  read(first, out.size(), is_unsigned() ? H5T_NATIVE_UINT64 : H5T_NATIVE_INT64, out.data());
}

void Column::read(std::uint64_t first, std::uint64_t count, hid_t memory_type, void* out) const {
  const Session session;
  const hsize_t start = first, length = count;
  const Handle file_space(H5Dget_space(id()), H5Sclose);
  const Handle memory_space(H5Screate_simple(1, &length, nullptr), H5Sclose);
  if (H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, &start, nullptr, &length, nullptr) < 0 ||
      H5Dread(id(), memory_type, memory_space.get(), file_space.get(), H5P_DEFAULT, out) < 0)
    throw unreadable(first, first + count - 1);
}

// Names a filter that is not built in: the library does not.
Error Column::unreadable(std::uint64_t first, std::uint64_t last) const {
  const Handle properties(H5Dget_create_plist(id()), H5Pclose);
  for (int i = 0; i < H5Pget_nfilters(properties.get()); ++i) {
    unsigned flags = 0, config = 0;
    std::size_t values = 0;
    std::array<char, 64> name{};
    const H5Z_filter_t filter = H5Pget_filter2(properties.get(), static_cast<unsigned>(i), &flags, &values, nullptr,
                                               name.size() - 1, name.data(), &config);
    if (filter >= 0 && H5Zfilter_avail(filter) <= 0)
      return damage(fmt::format("data under HDF5 filter {} ({})", filter, shortened(name.data(), 40)),
                    "gzip or blosc (h5repack writes them again), or the filter's plugin on HDF5_PLUGIN_PATH");
  }
  return damage(fmt::format("unreadable items {} to {}", first, last), "readable items");
}

Error Column::damage(const std::string& got, const std::string& wanted) const {
  return bad_input(path_.string(), name_, got, wanted);
}

std::optional<std::string> text_attribute(hid_t object, const char* name) {
  const Session session;
  if (H5Aexists(object, name) <= 0) return {};
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  if (H5Tget_class(type.get()) != H5T_STRING || H5Sget_simple_extent_npoints(space.get()) != 1) return {};
  if (H5Tis_variable_str(type.get()) > 0) {
    char* text = nullptr;
    const Handle memory(H5Tcopy(H5T_C_S1), H5Tclose);
    H5Tset_size(memory.get(), H5T_VARIABLE);
    H5Tset_cset(memory.get(), H5Tget_cset(type.get()));
    if (H5Aread(attribute.get(), memory.get(), static_cast<void*>(&text)) < 0 || !text) return {};
    std::string out = text;
    H5free_memory(text);
    return out;
  }
  const std::size_t size = H5Tget_size(type.get());
  if (size > (1u << 16)) return {};
  std::string out(size, '\0');
  if (H5Aread(attribute.get(), type.get(), out.data()) < 0) return {};
  return out.substr(0, out.find('\0'));
}

bool is_unsigned(hid_t integer_type) { return H5Tget_sign(integer_type) == H5T_SGN_NONE; }

namespace {

// The integer of `type` in the bits from `read`, if an int64 can hold it.
template <class Read>
std::optional<std::int64_t> one_integer(hid_t type, hid_t space, Read&& read) {
  std::int64_t value = 0;
  if (H5Tget_class(type) != H5T_INTEGER || H5Tget_size(type) > sizeof value ||
      H5Sget_simple_extent_npoints(space) != 1 ||
      read(is_unsigned(type) ? H5T_NATIVE_UINT64 : H5T_NATIVE_INT64, &value) < 0 || (is_unsigned(type) && value < 0))
    return {};
  return value;
}

}  // namespace

std::optional<std::int64_t> integer_dataset(const Handle& file, const char* name) {
  const Session session;
  if (missing_link(file.get(), name)) return {};
  const Handle access = access_within_file();
  const Handle dataset(H5Dopen2(file.get(), name, access.get()), H5Dclose);
  const Handle space(H5Dget_space(dataset.get()), H5Sclose);
  const Handle type(H5Dget_type(dataset.get()), H5Tclose);
  const Handle properties(H5Dget_create_plist(dataset.get()), H5Pclose);
  if (H5Pget_layout(properties.get()) == H5D_VIRTUAL || H5Pget_external_count(properties.get()) != 0) return {};
  return one_integer(type.get(), space.get(), [&](hid_t memory_type, void* value) {
    return H5Dread(dataset.get(), memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, value);
  });
}

std::optional<std::int64_t> integer_attribute(hid_t object, const char* name) {
  const Session session;
  if (H5Aexists(object, name) <= 0) return {};
  const Handle attribute(H5Aopen(object, name, H5P_DEFAULT), H5Aclose);
  const Handle space(H5Aget_space(attribute.get()), H5Sclose);
  const Handle type(H5Aget_type(attribute.get()), H5Tclose);
  return one_integer(type.get(), space.get(),
                     [&](hid_t memory_type, void* value) { return H5Aread(attribute.get(), memory_type, value); });
}

void write_attribute(hid_t object, const char* name, const std::string& text) {
  const Session session;
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  H5Tset_size(type.get(), H5T_VARIABLE);
  H5Tset_cset(type.get(), H5T_CSET_UTF8);
  const Handle attribute(H5Acreate2(object, name, type.get(), space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  const char* value = text.c_str();
  H5Awrite(attribute.get(), type.get(), static_cast<const void*>(&value));
}

void write_attribute(hid_t object, const char* name, std::int64_t value) {
  const Session session;
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const Handle attribute(H5Acreate2(object, name, H5T_STD_I64LE, space.get(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  H5Awrite(attribute.get(), H5T_NATIVE_INT64, &value);
}

Output::Output(std::filesystem::path path) : path_(std::move(path)), partial_(path_) {
  const Session session;
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_file_locking(access.get(), false, true);  // PartialFile has locked it
  const std::string name = platform::name_for_libraries(partial_.partial_path());
  file_ = Handle(H5Fcreate(name.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, access.get()), H5Fclose);
  if (!file_) throw bad_output(path_.string(), std::strerror(errno));
}

namespace {

// Without timestamps, so that the same items make the same bytes.
Handle dataset_properties() {
  Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_obj_track_times(properties.get(), false);
  return properties;
}

Handle copy_of(hid_t type) {
  const Session session;
  return {H5Tcopy(type), H5Tclose};
}

}  // namespace

void Output::write_scalar(const char* name, std::int64_t value) {
  const Session session;
  const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
  const Handle properties = dataset_properties();
  const Handle dataset(H5Dcreate2(id(), name, H5T_STD_I64LE, space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT),
                       H5Dclose);
  check(dataset && H5Dwrite(dataset.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, &value) >= 0);
}

void Output::commit() {
  const Session session;
  check(H5Fflush(id(), H5F_SCOPE_GLOBAL) >= 0 && file_.close() >= 0);
  partial_.commit();
}

void Output::check(bool done) const {
  if (!done) throw bad_output(path_.string(), "HDF5 cannot write it (disk full?)");
}

Group::Group(const Output& file, const char* name) {
  const Session session;
  group_ = Handle(H5Gcreate2(file.id(), name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
  file.check(bool(group_));
}

Handle type_of(std::uint8_t) { return copy_of(H5T_NATIVE_UINT8); }
Handle type_of(std::uint16_t) { return copy_of(H5T_NATIVE_UINT16); }
Handle type_of(std::int64_t) { return copy_of(H5T_NATIVE_INT64); }
Handle type_of(std::uint64_t) { return copy_of(H5T_NATIVE_UINT64); }

GrowingDataset::GrowingDataset(const Output& file, const char* name, Handle type, const DatasetOptions& options)
    : file_(file), type_(std::move(type)) {
  const Session session;
  const hsize_t empty = 0, unlimited = H5S_UNLIMITED, chunk = options.chunk;
  const Handle space(H5Screate_simple(1, &empty, &unlimited), H5Sclose);
  const Handle properties = dataset_properties();
  H5Pset_chunk(properties.get(), 1, &chunk);
  if (options.gzip) {
    H5Pset_shuffle(properties.get());
    H5Pset_deflate(properties.get(), 1);
  }
  if (options.filter != H5Z_FILTER_NONE) H5Pset_filter(properties.get(), options.filter, H5Z_FLAG_OPTIONAL, 0, nullptr);
  dataset_ = Handle(H5Dcreate2(file.id(), name, type_.get(), space.get(), H5P_DEFAULT, properties.get(), H5P_DEFAULT),
                    H5Dclose);
  file.check(bool(dataset_));
}

void GrowingDataset::append(const void* items, std::size_t count) {
  const Session session;
  const hsize_t start = size_, length = count, size = size_ + count;
  file_.check(H5Dset_extent(dataset_.get(), &size) >= 0);
  const Handle file_space(H5Dget_space(dataset_.get()), H5Sclose);
  const Handle memory_space(H5Screate_simple(1, &length, nullptr), H5Sclose);
  file_.check(H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, &start, nullptr, &length, nullptr) >= 0 &&
              H5Dwrite(dataset_.get(), type_.get(), memory_space.get(), file_space.get(), H5P_DEFAULT, items) >= 0);
  size_ = size;
}

void GrowingDataset::append_chunk(std::span<const std::byte> encoded, std::size_t count) {
  const Session session;
  const hsize_t start = size_, size = size_ + count;
  file_.check(H5Dset_extent(dataset_.get(), &size) >= 0 &&
              H5Dwrite_chunk(dataset_.get(), H5P_DEFAULT, 0, &start, encoded.size(), encoded.data()) >= 0);
  size_ = size;
}

void GrowingDataset::finish() { file_.check(dataset_.close() >= 0); }

}  // namespace pecs::events::hdf5
