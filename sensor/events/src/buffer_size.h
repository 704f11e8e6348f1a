#pragma once
#include <cstddef>

namespace pecs::events {

// The size of a reader's buffer. Fuzzers' inputs are short: their build has smaller buffers, so that what stands across
// the end of one is read too.
constexpr std::size_t buffer_size(std::size_t usual, [[maybe_unused]] std::size_t fuzzed) {
#ifdef FUZZING_BUILD_MODE_UNSAFE_FOR_PRODUCTION
  return fuzzed;
#else
  return usual;
#endif
}

}  // namespace pecs::events
