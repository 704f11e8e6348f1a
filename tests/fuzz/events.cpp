// The reader of one format of event files: fuzz::kKind.
#include <algorithm>

#include "fuzz.h"
#include "pecs/events/format.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace pecs;
  static const fuzz::MemoryFile file;
  static const events::Codec& codec = *std::ranges::find(events::codecs(), fuzz::kKind, &events::Codec::name);
  file.hold(fuzz::text(data, size));
  fuzz::try_to([&] {
    const auto reader = events::open_reader(codec, file.path());
    std::vector<events::Event> block(1000);
    // The densest formats say eight bits an event and more; LZ4, Zstandard and DEFLATE pack a thousandfold.
    for (std::uint64_t all = 0; const std::size_t n = reader->read(block);)
      if ((all += n) > 32 + 5000 * size) fuzz::defect("more events than bytes can say");
    const events::StreamInfo& info = reader->info();
    if ((info.width > 0) != (info.height > 0)) fuzz::defect("half a size");
    reader->place();
  });
  fuzz::try_to([&] { codec.sniff(file.path(), std::as_bytes(std::span(data, std::min<std::size_t>(size, 1 << 16)))); });
  return 0;
}
