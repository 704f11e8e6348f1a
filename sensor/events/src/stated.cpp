#include "stated.h"

#include <fmt/format.h>

#include <algorithm>

namespace pecs::events {
namespace {

class Sized final : public Reader {
 public:
  Sized(std::unique_ptr<Reader> reader, const std::filesystem::path& path, const ReadOptions& options)
      : reader_(std::move(reader)), path_(path), info_(reader_->info()) {
    if (info_.width > 0 && (info_.width != options.width || info_.height != options.height))
      throw bad_input(path.string(), "size", fmt::format("{}x{}", options.width, options.height),
                      fmt::format("{}x{}, as the file states", info_.width, info_.height));
    info_.width = options.width;
    info_.height = options.height;
  }
  const StreamInfo& info() const override { return info_; }
  std::string place() const override { return reader_->place(); }
  std::size_t read(std::span<Event> out) override {
    const std::size_t n = reader_->read(out);
    for (const Event& e : out.first(n))
      if (e.x >= info_.width || e.y >= info_.height)
        throw bad_input(path_.string(), reader_->place(), fmt::format("an event at pixel ({}, {})", e.x, e.y),
                        fmt::format("inside {}x{}", info_.width, info_.height));
    return n;
  }

 private:
  std::unique_ptr<Reader> reader_;
  std::filesystem::path path_;
  StreamInfo info_;
};

class Ordered : public Reader {
 public:
  explicit Ordered(std::unique_ptr<Reader> reader) : reader_(std::move(reader)) {}
  const StreamInfo& info() const final { return reader_->info(); }
  std::uint64_t late() const final { return late_; }

 protected:
  bool is_late(const Event& e) {
    if (e.t_us < latest_us_) return ++late_;
    latest_us_ = e.t_us;
    return false;
  }
  std::unique_ptr<Reader> reader_;

 private:
  std::int64_t latest_us_ = INT64_MIN;
  std::uint64_t late_ = 0;
};

class Dropped final : public Ordered {
 public:
  using Ordered::Ordered;
  std::size_t read(std::span<Event> out) override {
    std::size_t kept = 0, n = 1;
    while (kept == 0 && n > 0) {
      n = reader_->read(out);
      const auto end = std::remove_if(out.begin(), out.begin() + static_cast<std::ptrdiff_t>(n),
                                      [&](const Event& e) { return is_late(e); });
      kept = static_cast<std::size_t>(end - out.begin());
    }
    return kept;
  }
  std::string place() const override { return reader_->place(); }
};

class Sorted final : public Ordered {
 public:
  using Ordered::Ordered;
  std::size_t read(std::span<Event> out) override {
    if (!read_all_) {
      std::vector<Event> block(1 << 16);
      while (const std::size_t n = reader_->read(block)) {
        for (const Event& e : std::span(block).first(n)) is_late(e);
        events_.insert(events_.end(), block.begin(), block.begin() + static_cast<std::ptrdiff_t>(n));
      }
      if (late() > 0) std::ranges::stable_sort(events_, {}, &Event::t_us);
      read_all_ = true;
    }
    const std::size_t n = std::min(out.size(), events_.size() - used_);
    std::copy_n(events_.begin() + static_cast<std::ptrdiff_t>(used_), n, out.begin());
    used_ += n;
    return n;
  }

 private:
  std::vector<Event> events_;
  std::size_t used_ = 0;
  bool read_all_ = false;
};

}  // namespace

std::unique_ptr<Reader> as_stated(std::unique_ptr<Reader> reader, const std::filesystem::path& path,
                                  const ReadOptions& options) {
  if (options.width > 0) reader = std::make_unique<Sized>(std::move(reader), path, options);
  if (options.late == ReadOptions::Late::drop) return std::make_unique<Dropped>(std::move(reader));
  if (options.late == ReadOptions::Late::sort) return std::make_unique<Sorted>(std::move(reader));
  return reader;
}

}  // namespace pecs::events
