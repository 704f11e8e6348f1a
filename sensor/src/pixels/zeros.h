#pragma once
// Memory for large arrays.
#include <cstddef>
#include <cstdlib>
#include <memory>
#include <new>

#include "pecs/platform.h"

namespace pecs::sensor {

// Zero-initialised numbers. Pages of large arrays are placed on the NUMA node of the thread that first writes to them.
class Zeros {
 public:
  Zeros() = default;
  explicit Zeros(std::size_t count) : memory_(static_cast<float*>(std::calloc(count, sizeof(float)))) {
    if (!memory_) throw std::bad_alloc();
    platform::ask_for_huge_pages(memory_.get(), count * sizeof(float));
  }
  float* data() const { return memory_.get(); }

 private:
  struct Free {
    void operator()(float* memory) const { std::free(memory); }
  };
  std::unique_ptr<float, Free> memory_;
};

}  // namespace pecs::sensor
