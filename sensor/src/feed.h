#pragma once
// Photocurrent in the order of time, batch by batch.
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace pecs::sensor {

class Feed {
 public:
  virtual ~Feed() = default;
  struct Batch {
    std::vector<const float*> planes;  // [fA], by the pixel's index in the whole picture; valid until the next batch
    std::vector<double> t_us;
    bool last = false;
  };
  // Empty after the last one.
  virtual std::optional<Batch> next() = 0;
  virtual std::int64_t steps() const = 0;  // of the timeline, given so far

  static constexpr std::size_t kBatchBytes = std::size_t{32} << 20;  // planes of one batch
};

}  // namespace pecs::sensor
