#pragma once
// Base class of readers of files that are stored in blocks.
#include <algorithm>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "extent.h"
#include "pecs/events/format.h"

namespace pecs::events {

class BlockReader : public Reader {
 public:
  const StreamInfo& info() const final { return info_; }

  std::size_t read(std::span<Event> out) final {
    std::size_t n = 0;
    while (n < out.size()) {
      if (used_ == block_.size()) {
        if (!next_block()) {
          extent_->end();
          break;
        }
        used_ = 0;
      }
      const std::size_t take = std::min(out.size() - n, block_.size() - used_);
      std::ranges::copy(std::span(block_).subspan(used_, take), out.begin() + static_cast<std::ptrdiff_t>(n));
      used_ += take;
      n += take;
    }
    return n;
  }

 protected:
  // Reads the next events of the file, from first_ on, into block_; false at the end.
  virtual bool next_block() = 0;

  StreamInfo info_;
  std::optional<Extent> extent_;
  std::uint64_t first_ = 0;  // event of the next block
  std::vector<Event> block_;

 private:
  std::size_t used_ = 0;
};

}  // namespace pecs::events
