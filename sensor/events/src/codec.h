#pragma once
// Parts that formats share: the loop of their readers over events or blocks, and the entry in the registry.
#include <algorithm>
#include <cstring>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "extent.h"
#include "pecs/events/format.h"

namespace pecs::events {

// Base class of readers. A reader has bool next(Event&), false at the end, and sets info_ and extent_ when it opens.
template <class Derived>
class EventReader : public Reader {
 public:
  const StreamInfo& info() const final { return info_; }

  std::size_t read(std::span<Event> out) final {
    std::size_t n = 0;
    while (n < out.size() && static_cast<Derived*>(this)->next(out[n])) ++n;
    if (n < out.size()) extent_->end();
    return n;
  }

 protected:
  StreamInfo info_;
  std::optional<Extent> extent_;
};

// Base class of readers of files that are stored in blocks.
class BlockReader : public EventReader<BlockReader> {
 public:
  bool next(Event& event) {
    if (used_ == block_.size()) {
      if (!next_block()) return false;
      used_ = 0;
    }
    event = block_[used_++];
    return true;
  }

 protected:
  // Reads the next events of the file, from first_ on, into block_ (at least one); false at the end.
  virtual bool next_block() = 0;

  std::uint64_t first_ = 0;  // event of the next block
  std::vector<Event> block_;

 private:
  std::size_t used_ = 0;
};

inline bool begins_with(std::span<const std::byte> head, std::string_view magic) {
  return head.size() >= magic.size() && std::memcmp(head.data(), magic.data(), magic.size()) == 0;
}

// Throws bad_input if the times of the reader's first events contradict `assumed`, the unit of a file that states none.
void check_assumed_unit(Reader& reader, const std::filesystem::path& path, TimeUnit assumed);

// A reader is made from the path, or from the path and the options if they matter to it. One with
// std::optional<TimeUnit> assumed_unit() may lack the unit of its times, and assume one.
template <class FileReader>
std::unique_ptr<Reader> open_file(const std::filesystem::path& path, const ReadOptions& options) {
  if constexpr (std::is_constructible_v<FileReader, const std::filesystem::path&, const ReadOptions&>) {
    auto reader = std::make_unique<FileReader>(path, options);
    if constexpr (requires { reader->assumed_unit(); })
      if (const auto unit = reader->assumed_unit()) {
        FileReader first_events(path, options);
        check_assumed_unit(first_events, path, *unit);
      }
    return reader;
  } else {
    return std::make_unique<FileReader>(path);
  }
}

// The entry of a format; its writer is made from a path and a StreamInfo.
template <class FileReader, class FileWriter>
Codec make_codec(std::string name, std::string description, std::string extension, const Limits& limits,
                 decltype(Codec::sniff) sniff) {
  return {.name = std::move(name),
          .description = std::move(description),
          .extensions = {std::move(extension)},
          .sniff = std::move(sniff),
          .open_reader = open_file<FileReader>,
          .open_writer = [](const auto& path, const auto& info) { return std::make_unique<FileWriter>(path, info); },
          .limits = limits,
          .takes_time_unit = requires(const FileReader& reader) { reader.assumed_unit(); }};
}

}  // namespace pecs::events
