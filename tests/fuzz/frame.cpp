// An EXR file as a frame of a stack, and as another program's without stack.json.
#include <filesystem>
#include <fstream>

#include "fuzz.h"
#include "pecs/sensor/stack.h"
#include "stacks.h"

namespace {

std::string new_folder() {
  std::string name = "/dev/shm/pecs_fuzz_XXXXXX";
  if (!::mkdtemp(name.data())) pecs::fuzz::defect("no folder in /dev/shm");
  return name;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace pecs;
  static const std::string foreign = new_folder(), own = [] {
    const std::string folder = new_folder();
    fuzz::write_stack(folder);
    return folder;
  }();
  for (const std::string& folder : {own, foreign}) {
    std::ofstream(folder + "/frame_000000.exr", std::ios::binary) << fuzz::text(data, size);
    fuzz::try_to([&] {
      const sensor::StackReader reader(folder, {1000, {}});
      if (reader.read_frame(0).size() > 4096 * (size + 1)) fuzz::defect("more pixels than bytes can say");
    });
  }
  return 0;
}
