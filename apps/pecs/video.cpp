// pecs video -o FILE: encodes the pictures of `pecs reconstruct` (python/pecs/learning/video.py). Standard input is the
// line "WIDTH HEIGHT FPS", then "P" and 8 bits of grey per pixel for each picture, then "E".
#include <fmt/format.h>

#include <iostream>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "commands.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/input/video_file.h"

namespace pecs::app {
namespace {

void run(const std::string& output) {
  std::ios::sync_with_stdio(false);
  int width = 0, height = 0;
  double fps = 0;
  if (!(std::cin >> width >> height >> fps) || width < 1 || height < 1 || std::cin.get() != '\n')
    throw bad_input("standard input", "line 1", "no size", "WIDTH HEIGHT FPS");
  input::VideoFile video(output, fps);
  cv::Mat grey(height, width, CV_8U), bgr;
  int mark = 0;
  for (int frame = 0; (mark = std::cin.get()) == 'P'; ++frame) {
    if (!std::cin.read(grey.ptr<char>(), static_cast<std::streamsize>(grey.total())))
      throw bad_input("standard input", fmt::format("picture {}", frame), "its end",
                      fmt::format("{}x{} pixels", width, height));
    cv::cvtColor(grey, bgr, cv::COLOR_GRAY2BGR);
    video.write(bgr);
  }
  if (mark != 'E') throw bad_input("standard input", "", "its end", "E behind the last picture");
  video.close();
}

}  // namespace

void add_video(CLI::App& app, Console&) {
  const auto output = std::make_shared<std::string>();
  auto* command = app.add_subcommand("video", "encode the grey pictures of standard input as a video");
  add_output(*command, "-o,--output", *output, "file to write: .mp4")->required();
  add_examples(*command, {"(echo 64 48 25; printf P; head -c 3072 /dev/urandom; printf E) | pecs video -o noise.mp4"});
  command->callback([output] { run(*output); });
}

}  // namespace pecs::app
