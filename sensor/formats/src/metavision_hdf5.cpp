// Metavision HDF5: /CD/events, a dataset of {x u16, y u16, p i16, t i64} in chunks of 16384 under the ECF filter
// (ecf.h), and /CD/indexes, one {id, ts} for every 2 ms, which a reader from front to back does not need. Root
// attributes are text: "geometry" = "1280x720", "format", "sensor_generation", ….
#include <fmt/format.h>

#include <algorithm>

#include "codecs.h"
#include "ecf.h"
#include "extent.h"
#include "hdf5_file.h"
#include "raw_header.h"

namespace pecs::events {
namespace {

constexpr const char* kEvents = "/CD/events";
constexpr std::size_t kMaxBlockEvents = 65535;  // in one ECF block
constexpr std::size_t kBlockEvents = 16384;

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

class MetavisionReader final : public Reader {
 public:
  explicit MetavisionReader(const std::filesystem::path& path)
      : path_(path), file_(hdf5::open_file(path)), events_(file_, path, kEvents) {
    const hdf5::Session session;
    // The attributes are the lines of a RAW header.
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
    if (ecf_ && events_.chunk() > kMaxBlockEvents)
      throw events_.damage(fmt::format("chunks of {} events", events_.chunk()),
                           fmt::format("at most {}", kMaxBlockEvents));
  }

  const StreamInfo& info() const override { return info_; }

  std::size_t read(std::span<Event> out) override {
    std::size_t n = 0;
    while (n < out.size()) {
      if (used_ == block_.size() && !next_block()) {
        extent_->end();
        break;
      }
      const std::size_t take = std::min(out.size() - n, block_.size() - used_);
      std::copy_n(block_.begin() + static_cast<std::ptrdiff_t>(used_), take,
                  out.begin() + static_cast<std::ptrdiff_t>(n));
      used_ += take;
      n += take;
    }
    return n;
  }

 private:
  bool next_block() {
    if (first_ >= events_.size()) return false;
    const hdf5::Session session;
    const std::size_t wanted = std::min<std::uint64_t>(ecf_ ? events_.chunk() : kBlockEvents, events_.size() - first_);
    if (!ecf_ || !read_ecf(wanted)) read_plain(wanted);
    for (std::size_t i = 0; i < block_.size(); ++i)
      if (!extent_->add(block_[i]))
        throw events_.damage(fmt::format("event {} at pixel ({}, {})", first_ + i, block_[i].x, block_[i].y),
                             fmt::format("inside {}x{}", info_.width, info_.height));
    first_ += wanted;
    used_ = 0;
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
    // The greatest that an encoder can make of so many events.
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
    return true;
  }

  void read_plain(std::size_t wanted) {
    plain_.resize(wanted);
    const hdf5::Handle type = event_type();
    events_.read(first_, wanted, type.get(), plain_.data());
    block_.resize(wanted);
    std::ranges::transform(plain_, block_.begin(), [](const MetavisionEvent& e) {
      return Event{e.t, e.x, e.y, static_cast<std::uint8_t>(e.p > 0)};
    });
  }

  std::filesystem::path path_;
  hdf5::Handle file_;
  hdf5::Column events_;
  StreamInfo info_;
  std::optional<Extent> extent_;
  bool ecf_ = false;
  std::uint64_t first_ = 0;  // event of the next block
  std::vector<std::byte> stored_;
  std::vector<MetavisionEvent> plain_;
  std::vector<Event> block_;
  std::size_t used_ = 0;
};

}  // namespace

Codec make_metavision_hdf5() {
  return {
      .name = "metavision-hdf5",
      .description = "Metavision HDF5 (ECF compression)",
      .extensions = {".hdf5"},
      .sniff = [](const std::filesystem::path& path,
                  std::span<const std::byte> head) { return hdf5::is_hdf5(head) && hdf5::has_paths(path, {kEvents}); },
      .open_reader = [](const auto& path) { return std::make_unique<MetavisionReader>(path); },
      .open_writer = {},
      .limits = {.max_size = 2048}};
}

}  // namespace pecs::events
