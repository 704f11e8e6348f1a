// A picture in a folder, or a video, through OpenCV.
#include "pecs/input/pictures.h"

#include <fstream>

#include "fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace pecs;
  static const fuzz::MemoryFolder folder;
  const std::filesystem::path file = folder.path() + (fuzz::kKind == "video" ? "/a.mp4" : "/a.png");
  std::ofstream(file, std::ios::binary) << fuzz::text(data, size);
  fuzz::try_to([&] {
    input::PictureOptions options;
    options.times.fps = 100;
    options.flow = false;
    const auto frames = input::open_pictures(file.extension() == ".mp4" ? file : file.parent_path(), options);
    for (std::int64_t i = 0; i < std::min<std::int64_t>(frames->frames(), 4); ++i)
      frames->read_rows(i, [](int, int, std::span<const float>) {});
  });
  return 0;
}
