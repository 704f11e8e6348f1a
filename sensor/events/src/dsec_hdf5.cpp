// DSEC HDF5 (dsec.ifi.uzh.ch): /events/t, x, y, p of equal length; /t_offset, added to every t; /ms_to_idx, for every
// millisecond ms of t the index of the first event with t >= 1000 ms (one more entry than there are begun milliseconds,
// so that a window may end with the last event). The published files are compressed by blosc (filter 32001), those of
// PECS by gzip, which every HDF5 library has. The layout has no size: PECS writes it to the attributes width and height
// of /events.
#include <blosc.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "buffer_size.h"
#include "checked_writer.h"
#include "codec.h"
#include "event_columns.h"
#include "hdf5_file.h"

namespace pecs::events {
namespace {

constexpr std::array kColumns = {"/events/t", "/events/x", "/events/y", "/events/p"};
constexpr H5Z_filter_t kBloscFilter = 32001;
constexpr std::size_t kBlock = buffer_size(1 << 16, 1 << 12);
constexpr std::size_t kMaxBloscBytes = std::size_t{1} << 28;

// The reading half of the blosc filter: a chunk is one blosc buffer.
std::size_t blosc_filter(unsigned flags, std::size_t, const unsigned*, std::size_t bytes, std::size_t* size,
                         void** buffer) {
  std::size_t unpacked = 0;
  if (!(flags & H5Z_FLAG_REVERSE) || blosc_cbuffer_validate(*buffer, bytes, &unpacked) != 0 ||
      unpacked > kMaxBloscBytes)
    return 0;
  void* out = H5allocate_memory(unpacked, false);
  if (!out) return 0;
  if (blosc_decompress_ctx(*buffer, out, unpacked, 1) != static_cast<int>(unpacked)) {
    H5free_memory(out);
    return 0;
  }
  H5free_memory(*buffer);
  *buffer = out;
  *size = unpacked;
  return unpacked;
}

void register_blosc() {
  const hdf5::Session session;
  if (H5Zfilter_avail(kBloscFilter) > 0) return;
  const H5Z_class2_t filter = {H5Z_CLASS_T_VERS, kBloscFilter, 0, 1, "blosc", nullptr, nullptr, blosc_filter};
  H5Zregister(&filter);
}

class DsecReader final : public BlockReader {
 public:
  DsecReader(const std::filesystem::path& path, const ReadOptions& options)
      : file_(hdf5::open_file(path)),
        unit_(options.time_unit),
        values_(path.string(), {kColumns[0], kColumns[1], kColumns[2], kColumns[3]}) {
    register_blosc();
    const hdf5::Session session;
    for (const char* name : kColumns) columns_.emplace_back(file_, path, name);
    for (const hdf5::Column& column : columns_) {
      if (column.size() != columns_[0].size())
        throw column.damage(fmt::format("{} values", column.size()), fmt::format("{}, as in t", columns_[0].size()));
      column.require_integers();
    }
    if (H5Lexists(file_.get(), "t_offset", H5P_DEFAULT) > 0) {
      const auto offset = hdf5::integer_dataset(file_, "/t_offset");
      if (!offset) throw bad_input(path.string(), "/t_offset", "no value that can be read", "one integer of 64 bits");
      t_offset_ = *offset;
    }
    const hdf5::Handle group(H5Gopen2(file_.get(), "/events", H5P_DEFAULT), H5Gclose);
    const auto width = hdf5::integer_attribute(group.get(), "width"),
               height = hdf5::integer_attribute(group.get(), "height");
    if (width && height && *width > 0 && *width <= 65536 && *height > 0 && *height <= 65536)
      info_ = {static_cast<int>(*width), static_cast<int>(*height), ""};
    extent_.emplace(info_, 65536);
    if (!unit_ && H5Lexists(file_.get(), "ms_to_idx", H5P_DEFAULT) > 0) check_index(path);
  }

  // PECS writes a size, and microseconds; ms_to_idx also states them.
  std::optional<TimeUnit> assumed_unit() const {
    return unit_ || has_index_ || info_.width > 0 ? std::nullopt : std::optional(TimeUnit::us);
  }

 private:
  // Throws bad_input if the last event of ms_to_idx is not the first one of its millisecond.
  void check_index(const std::filesystem::path& path) {
    const hdf5::Column index(file_, path, "/ms_to_idx");
    index.require_integers();
    const auto event_of = [&](std::uint64_t ms) {
      std::int64_t event = 0;
      index.read_integers(ms, {&event, 1});
      return event;
    };
    const auto events = static_cast<std::int64_t>(columns_[0].size());
    std::uint64_t ms = 0;
    for (std::uint64_t end = index.size(); end > ms + 1;) {
      const std::uint64_t middle = ms + (end - ms) / 2;
      (event_of(middle) < events ? ms : end) = middle;
    }
    const std::int64_t event = ms > 0 ? event_of(ms) : 0;
    if (event <= 0) return;
    std::int64_t around[2] = {};
    columns_[0].read_integers(static_cast<std::uint64_t>(event) - 1, around);
    const auto begin_us = static_cast<std::int64_t>(ms) * 1000;
    if (around[0] >= begin_us || around[1] < begin_us)
      throw columns_[0].damage(fmt::format("{} and {} around ms_to_idx[{}]", around[0], around[1], ms),
                               fmt::format("{} us between them; or {}", begin_us, kStateTheUnit));
    has_index_ = true;
  }

  bool next_block() override {
    const std::size_t size = std::min<std::uint64_t>(kBlock, columns_[0].size() - first_);
    if (size == 0) return false;
    block_.resize(size);
    const auto read = [&](auto c, std::span<std::int64_t> values) {
      columns_[c].read_integers(first_, values);
      return columns_[c].is_unsigned();
    };
    values_.read(first_, t_offset_, *extent_, block_, read, unit_.value_or(TimeUnit::us));
    first_ += size;
    return true;
  }

  hdf5::Handle file_;
  std::optional<TimeUnit> unit_;
  std::vector<hdf5::Column> columns_;  // t, x, y, p
  std::int64_t t_offset_ = 0;
  bool has_index_ = false;
  EventColumns values_;
};

// Without negative times; late streams begin near 0 by t_offset, so that ms_to_idx stays short.
constexpr Limits kDsecLimits = {.t_min_us = 0};
constexpr std::int64_t kHourUs = 3'600'000'000;
constexpr std::int64_t kLateUs = 3 * kHourUs;
constexpr std::int64_t kMaxSpanUs = 24 * kHourUs;  // 86 million entries of ms_to_idx

class DsecWriter final : public CheckedWriter {
 public:
  DsecWriter(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kDsecLimits, false),
        file_(path),
        group_(file_, "/events"),
        t_(file_, "/events/t"),
        x_(file_, "/events/x"),
        y_(file_, "/events/y"),
        p_(file_, "/events/p"),
        ms_to_idx_(file_, "/ms_to_idx") {
    if (size.width == 0) return;
    hdf5::write_attribute(group_.id(), "width", size.width);
    hdf5::write_attribute(group_.id(), "height", size.height);
  }

 private:
  void put(std::span<const Event> events) override {
    if (count() == 0 && events[0].t_us >= kLateUs) t_offset_us_ = events[0].t_us - events[0].t_us % 1000;
    std::uint64_t index = count();
    for (const Event& e : events) {
      const std::int64_t t_us = e.t_us - t_offset_us_;
      if (t_us > kMaxSpanUs)
        throw bad_input(path().string(), fmt::format("event {}", index), fmt::format("t = {} us", e.t_us),
                        fmt::format("at most {} us after the first event", kMaxSpanUs));
      for (; next_ms_ * 1000 <= t_us; ++next_ms_) ms_to_idx_.append(index);
      t_.append(t_us);
      x_.append(e.x);
      y_.append(e.y);
      p_.append(e.p);
      ++index;
    }
  }

  void finish() override {
    ms_to_idx_.append(count());
    t_.finish();
    x_.finish();
    y_.finish();
    p_.finish();
    ms_to_idx_.finish();
    group_.finish();
    file_.write_scalar("/t_offset", t_offset_us_);
    file_.commit();
  }

  hdf5::Output file_;
  hdf5::Group group_;
  hdf5::Appender<std::int64_t> t_;
  hdf5::Appender<std::uint16_t> x_, y_;
  hdf5::Appender<std::uint8_t> p_;
  hdf5::Appender<std::uint64_t> ms_to_idx_;
  std::int64_t t_offset_us_ = 0, next_ms_ = 0;
};

}  // namespace

Codec make_dsec_hdf5() {
  return make_codec<DsecReader, DsecWriter>("dsec", "DSEC HDF5 (events/t, x, y, p; t_offset; ms_to_idx)", ".h5",
                                            kDsecLimits, [](const auto& path, auto head) {
                                              return hdf5::is_hdf5(head) &&
                                                     hdf5::has_paths(path, {kColumns.begin(), kColumns.end()});
                                            });
}

}  // namespace pecs::events
