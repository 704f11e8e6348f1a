// An EXR file as a frame of a stack, and as another program's without stack.json.
#include <fstream>

#include "fuzz.h"
#include "pecs/sensor/stack.h"
#include "stacks.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace pecs;
  static const fuzz::MemoryFolder foreign, own;
  [[maybe_unused]] static const bool written = (fuzz::write_stack(own.path()), true);
  for (const std::string& folder : {own.path(), foreign.path()}) {
    std::ofstream(folder + "/frame_000000.exr", std::ios::binary) << fuzz::text(data, size);
    fuzz::try_to([&] {
      const sensor::StackReader reader(folder, {1000, {}, {}});
      if (reader.read_frame(0).size() > 4096 * (size + 1)) fuzz::defect("more pixels than bytes can say");
    });
  }
  return 0;
}
