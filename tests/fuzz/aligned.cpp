// aligned.json and the scene.json of its folder, divided by a line "---".
#include <fstream>

#include "fuzz.h"
#include "pecs/calibration/lab_scene.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace pecs;
  static const fuzz::MemoryFile aligned;
  static const fuzz::MemoryFolder folder;
  constexpr std::string_view kDivider = "\n---\n";
  const std::string_view text = fuzz::text(data, size);
  const std::size_t at = std::min(text.find(kDivider), text.size());
  aligned.hold(text.substr(0, at));
  std::ofstream(folder.path() + "/scene.json", std::ios::binary)
      << text.substr(std::min(at + kDivider.size(), text.size()));
  fuzz::try_to([&] {
    calibration::LabScene scene = calibration::load_lab_scene(folder.path());
    scene.name = "scene";
    calibration::apply_aligned(scene, aligned.path());
  });
  return 0;
}
