#pragma once
#include <memory>

#include "pecs/events/format.h"

namespace pecs::events {

// `reader` with what the user states: the size, where the file has none (bad_input for another one, and for events
// outside it); events that are earlier than one before them moved or dropped, and counted. Sorting reads the whole file
// into memory.
std::unique_ptr<Reader> as_stated(std::unique_ptr<Reader> reader, const std::filesystem::path& path,
                                  const ReadOptions& options);

}  // namespace pecs::events
