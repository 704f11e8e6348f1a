#pragma once
// Photocurrent in the order of time, batch by batch.
#include <tbb/task_group.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace pecs::sensor {

constexpr std::size_t kBatchBytes = std::size_t{32} << 20;  // planes that are held before they are worked on

// Work that is done ahead. What it throws, wait() throws; nobody hears it when it is dropped.
class Ahead {
 public:
  Ahead() = default;
  Ahead(const Ahead&) = delete;
  Ahead& operator=(const Ahead&) = delete;
  ~Ahead() noexcept {
    group_.cancel();
    try {
      group_.wait();
    } catch (...) {
      return;  // of what nobody asked for
    }
  }
  template <class Work>
  void run(Work&& work) {
    group_.run(std::forward<Work>(work));
  }
  void wait() { group_.wait(); }

 private:
  tbb::task_group group_;
};

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
};

}  // namespace pecs::sensor
