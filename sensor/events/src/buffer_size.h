#pragma once
#include <cstddef>

namespace pecs::events {

// The size of a reader's buffer. Fuzzer inputs are short: fuzzer builds use smaller buffers, so that items that cross
// the end of a buffer are tested.
constexpr std::size_t buffer_size(std::size_t usual, [[maybe_unused]] std::size_t fuzzed) {
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
  return fuzzed;
#else
  return usual;
#endif
}

}  // namespace pecs::events
