#pragma once
// Memory for large arrays.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

#ifdef __linux__
#include <sys/mman.h>
#endif

namespace pecs::sensor {

inline constexpr std::size_t kHugePage = std::size_t{2} << 20;

// Requests huge pages where some fit: fewer page faults and TLB misses. Most Linux systems use them only on request.
// Does not touch `memory`.
inline void ask_for_huge_pages([[maybe_unused]] void* memory, [[maybe_unused]] std::size_t bytes) {
#ifdef __linux__
  const auto begin = reinterpret_cast<std::uintptr_t>(memory);
  const std::uintptr_t first = (begin + kHugePage - 1) / kHugePage * kHugePage;
  const std::uintptr_t end = (begin + bytes) / kHugePage * kHugePage;
  if (first < end) madvise(static_cast<std::byte*>(memory) + (first - begin), end - first, MADV_HUGEPAGE);
#endif
}

// Zero-initialised numbers. Pages of large arrays are placed on the NUMA node of the thread that first writes to them.
class Zeros {
 public:
  Zeros() = default;
  explicit Zeros(std::size_t count) : memory_(static_cast<float*>(std::calloc(count, sizeof(float)))) {
    if (!memory_) throw std::bad_alloc();
    ask_for_huge_pages(memory_.get(), count * sizeof(float));
  }
  float* data() const { return memory_.get(); }

 private:
  struct Free {
    void operator()(float* memory) const { std::free(memory); }
  };
  std::unique_ptr<float, Free> memory_;
};

}  // namespace pecs::sensor
