// Metavision HDF5: /CD/events, a dataset of {x u16, y u16, p i16, t i64} in chunks of 16384 under the ECF filter
// (ecf.h), the last chunk as short as its events; /CD/indexes, {id, ts} for every 2 ms from the first event on,
// uncompressed: entry 0 is {0, -1}, entry k the number and time (since the first event) of the first event in the last
// period before k that has any; its attribute "offset" is minus the first event's time. /EXT_TRIGGER is the same for
// triggers. Attributes are text: root "version", "geometry" = "1280x720", "format", "sensor_generation", ….
#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "checked_writer.h"
#include "codec.h"
#include "ecf.h"
#include "event_columns.h"
#include "hdf5_file.h"
#include "raw_header.h"

namespace pecs::events {
namespace {

constexpr const char* kEvents = "/CD/events";
constexpr std::size_t kBlockEvents = 16384;
constexpr std::array<const char*, 4> kMembers = {"t", "x", "y", "p"};  // as EventColumns has them

struct MetavisionEvent {
  std::uint16_t x, y;
  std::int16_t p;
  std::int64_t t;
};
static_assert(sizeof(MetavisionEvent) == 16);

hdf5::Handle event_type() {
  hdf5::Handle type(H5Tcreate(H5T_COMPOUND, sizeof(MetavisionEvent)), H5Tclose);
  H5Tinsert(type.get(), "x", HOFFSET(MetavisionEvent, x), H5T_NATIVE_USHORT);
  H5Tinsert(type.get(), "y", HOFFSET(MetavisionEvent, y), H5T_NATIVE_USHORT);
  H5Tinsert(type.get(), "p", HOFFSET(MetavisionEvent, p), H5T_NATIVE_SHORT);
  H5Tinsert(type.get(), "t", HOFFSET(MetavisionEvent, t), H5T_NATIVE_LLONG);
  return type;
}

class MetavisionReader final : public BlockReader {
 public:
  explicit MetavisionReader(const std::filesystem::path& path)
      : path_(path),
        file_(hdf5::open_file(path)),
        events_(file_, path, kEvents),
        values_(path.string(), {"/CD/events.t", "/CD/events.x", "/CD/events.y", "/CD/events.p"}) {
    const hdf5::Session session;
    find_members();
    // The attributes correspond to the lines of a RAW header.
    std::string header;
    for (const char* key : {"format", "geometry", "sensor_name", "sensor_generation"})
      if (const auto value = hdf5::text_attribute(file_.get(), key)) header += fmt::format("% {} {}\n", key, *value);
    info_ = parse_raw_header(std::as_bytes(std::span(header))).info;
    extent_.emplace(info_, 65536);

    const hdf5::Handle properties(H5Dget_create_plist(events_.id()), H5Pclose);
    unsigned flags = 0, config = 0;
    std::size_t values = 0;
    ecf_ = events_.chunk() > 0 && H5Pget_nfilters(properties.get()) == 1 &&
           H5Pget_filter2(properties.get(), 0, &flags, &values, nullptr, 0, nullptr, &config) == ecf::kFilter;
    if (ecf_ && events_.chunk() > ecf::kMaxEvents)
      throw events_.damage(fmt::format("chunks of {} events", events_.chunk()),
                           fmt::format("at most {}", ecf::kMaxEvents));
  }

 private:
  bool next_block() override {
    if (first_ >= events_.size()) return false;
    const hdf5::Session session;
    const std::size_t wanted = std::min<std::uint64_t>(ecf_ ? events_.chunk() : kBlockEvents, events_.size() - first_);
    if (!ecf_ || !read_ecf(wanted)) read_plain(wanted);
    first_ += wanted;
    return true;
  }

  // False if the chunk was stored without the filter (which is optional).
  bool read_ecf(std::size_t wanted) {
    const hsize_t at = first_;
    unsigned filters_off = 0;
    haddr_t address = HADDR_UNDEF;
    hsize_t bytes = 0;
    if (H5Dget_chunk_info_by_coord(events_.id(), &at, &filters_off, &address, &bytes) < 0 || address == HADDR_UNDEF)
      throw events_.damage(fmt::format("no chunk for event {}", first_), "one");
    if (filters_off != 0) return false;
    const std::string place = fmt::format("byte {}", address);
    // Upper bound of the encoded size.
    const std::size_t most = 16 + events_.chunk() * 16;
    if (bytes > most)
      throw bad_input(path_.string(), place, fmt::format("a chunk of {} bytes", bytes),
                      fmt::format("at most {}", most));
    stored_.resize(bytes);
    std::uint32_t mask = 0;
    if (H5Dread_chunk(events_.id(), H5P_DEFAULT, &at, &mask, stored_.data()) < 0)
      throw bad_input(path_.string(), place, "an unreadable chunk", fmt::format("{} bytes", bytes));
    try {
      ecf::decode(stored_, events_.chunk(), block_);
    } catch (const ecf::Damage& damage) {
      throw bad_input(path_.string(), fmt::format("byte {}", address + damage.offset), damage.got, damage.wanted);
    }
    if (block_.size() < wanted)
      throw bad_input(path_.string(), place, fmt::format("a chunk of {} events", block_.size()),
                      fmt::format("{}", wanted));
    block_.resize(wanted);
    for (std::size_t i = 0; i < wanted; ++i)
      if (!extent_->add(block_[i]))
        throw events_.damage(fmt::format("event {} at pixel ({}, {})", first_ + i, block_[i].x, block_[i].y),
                             extent_->wanted());
    return true;
  }

  void read_plain(std::size_t wanted) {
    block_.resize(wanted);
    values_.read(first_, 0, *extent_, block_, [&](auto c, std::span<std::int64_t> values) {
      // A memory type with one member reads that member only.
      const hdf5::Handle type(H5Tcreate(H5T_COMPOUND, sizeof(std::int64_t)), H5Tclose);
      H5Tinsert(type.get(), kMembers[c], 0, unsigned_[c] ? H5T_NATIVE_UINT64 : H5T_NATIVE_INT64);
      events_.read(first_, wanted, type.get(), values.data());
      return unsigned_[c];
    });
  }

  void find_members() {
    const hdf5::Handle type(H5Dget_type(events_.id()), H5Tclose);
    for (const auto c : EventColumns::kAll) {
      const int at = H5Tget_class(type.get()) == H5T_COMPOUND ? H5Tget_member_index(type.get(), kMembers[c]) : -1;
      const hdf5::Handle member(at < 0 ? -1 : H5Tget_member_type(type.get(), static_cast<unsigned>(at)), H5Tclose);
      if (!member || H5Tget_class(member.get()) != H5T_INTEGER || H5Tget_size(member.get()) > sizeof(std::int64_t))
        throw events_.damage(fmt::format("no integer {} of up to 64 bits", kMembers[c]), "items of x, y, p and t");
      unsigned_[c] = hdf5::is_unsigned(member.get());
    }
  }

  std::filesystem::path path_;
  hdf5::Handle file_;
  hdf5::Column events_;
  bool ecf_ = false;
  std::vector<std::byte> stored_;
  EventColumns values_;
  std::array<bool, 4> unsigned_{};  // of t, x, y and p in the file
};

struct Index {
  std::uint64_t id;
  std::int64_t ts_us;
};

hdf5::Handle index_type() {
  hdf5::Handle type(H5Tcreate(H5T_COMPOUND, sizeof(Index)), H5Tclose);
  H5Tinsert(type.get(), "id", HOFFSET(Index, id), H5T_NATIVE_UINT64);
  H5Tinsert(type.get(), "ts", HOFFSET(Index, ts_us), H5T_NATIVE_INT64);
  return type;
}

hdf5::Handle trigger_type() {
  hdf5::Handle type(H5Tcreate(H5T_COMPOUND, 24), H5Tclose);
  H5Tinsert(type.get(), "p", 0, H5T_NATIVE_SHORT);
  H5Tinsert(type.get(), "t", 8, H5T_NATIVE_LLONG);
  H5Tinsert(type.get(), "id", 16, H5T_NATIVE_SHORT);
  return type;
}

constexpr Limits kMetavisionLimits = {.t_min_us = 0, .max_gap_us = 86'400'000'000, .max_size = 2048};
constexpr std::int64_t kIndexPeriodUs = 2000;
constexpr std::size_t kIndexChunk = 1024;

class MetavisionWriter final : public CheckedWriter {
 public:
  MetavisionWriter(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kMetavisionLimits),
        file_(path),
        cd_(file_, "/CD"),
        triggers_(file_, "/EXT_TRIGGER"),
        events_(file_, kEvents, event_type(), {.chunk = kBlockEvents, .filter = ecf::kFilter}),
        indexes_(file_, "/CD/indexes", index_type(), {.chunk = kIndexChunk}) {
    hdf5::GrowingDataset(file_, "/EXT_TRIGGER/events", trigger_type(), {.chunk = kIndexChunk}).finish();
    hdf5::GrowingDataset(file_, "/EXT_TRIGGER/indexes", index_type(), {.chunk = kIndexChunk}).finish();
    const auto attribute = [&](const char* name, const std::string& text) {
      hdf5::write_attribute(file_.id(), name, text);
    };
    attribute("version", "1.0");
    attribute("format", fmt::format("EVT3;height={};width={}", size.height, size.width));
    attribute("geometry", fmt::format("{}x{}", size.width, size.height));
    attribute("plugin_integrator_name", "Prophesee");
    if (!size.camera.empty()) attribute("sensor_name", size.camera);
    if (size.camera == "IMX636") attribute("sensor_generation", "4.2");
  }

 private:
  void put(std::span<const Event> events) override {
    if (count() == 0) {
      first_us_ = events[0].t_us;
      hdf5::write_attribute(indexes_.id(), "offset", std::to_string(-first_us_));
    }
    std::uint64_t id = count();
    for (const Event& e : events) {
      const std::int64_t ts_us = e.t_us - first_us_, period = ts_us / kIndexPeriodUs;
      if (period > period_) {
        for (; period_ < period; ++period_) put_index(first_of_period_);
        first_of_period_ = {id, ts_us};
      }
      ++id;
      block_.push_back(e);
      if (block_.size() == kBlockEvents) put_block();
    }
  }

  void finish() override {
    if (count() > 0) put_index(first_of_period_);
    if (!index_block_.empty()) indexes_.append(index_block_.data(), index_block_.size());
    if (!block_.empty()) put_block();
    events_.finish();
    indexes_.finish();
    cd_.finish();
    triggers_.finish();
    file_.commit();
  }

  void put_index(const Index& index) {
    index_block_.push_back(index);
    if (index_block_.size() < kIndexChunk) return;
    indexes_.append(index_block_.data(), index_block_.size());
    index_block_.clear();
  }

  void put_block() {
    stored_.clear();
    ecf::encode(block_, stored_);
    events_.append_chunk(stored_, block_.size());
    block_.clear();
  }

  hdf5::Output file_;
  hdf5::Group cd_, triggers_;
  hdf5::GrowingDataset events_, indexes_;
  std::int64_t first_us_ = 0, period_ = -1;
  Index first_of_period_{0, -1};
  std::vector<Index> index_block_;
  std::vector<Event> block_;
  std::vector<std::byte> stored_;
};

}  // namespace

Codec make_metavision_hdf5() {
  return make_codec<MetavisionReader, MetavisionWriter>(
      "metavision-hdf5", "Metavision HDF5 (ECF compression)", ".hdf5", kMetavisionLimits,
      [](const auto& path, auto head) { return hdf5::is_hdf5(head) && hdf5::has_paths(path, {kEvents}); });
}

}  // namespace pecs::events
