#pragma once
// Frames as PNG in the layout of the Event Camera Dataset (Mueggler et al., IJRR 2017): images/frame_00000000.png, and
// images.txt with lines "t_s images/frame_00000000.png", t_s being the middle of the exposure. exposures.csv has begins
// and ends.
#include <cstdint>
#include <filesystem>
#include <string>

#include "pecs/events/format.h"

namespace pecs::sensor {

class FrameFolder {
 public:
  // The folder is written as "<folder>.partial" and renamed by close(). Throws bad_output where it exists.
  FrameFolder(std::filesystem::path folder, int width, int height);
  // Grey PNG: 8 bits of a frame of up to 8, else 16, of which the frame's are the upper ones.
  void write(const events::Frame& frame);
  void close();

 private:
  std::filesystem::path folder_, partial_;
  std::uint32_t width_, height_;
  int frames_ = 0;
  std::string times_, exposures_ = "index,start_us,end_us\n";
};

}  // namespace pecs::sensor
