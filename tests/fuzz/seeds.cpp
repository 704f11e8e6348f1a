// fuzz_seeds FOLDER: the corpora that the fuzzers begin with, FOLDER/<target>/…, made by our own writers.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <random>

#include "pecs/data_dir.h"
#include "pecs/events/format.h"
#include "pecs/lens/exchange.h"
#include "pecs/lens/prescription.h"
#include "stacks.h"

namespace {

using namespace pecs;
namespace fs = std::filesystem;

// AEDAT 2.0: an ON event, an external event, a frame's sample.
const std::string kSamples(
    "\x10\x01\x08\x00\x00\x00\x00\x05\x10\x01\x04\x00\x00\x00\x00\x06\x80\x01\x08\x00\x00\x00\x00\x07", 24);

void put(const fs::path& path, std::string_view text) {
  fs::create_directories(path.parent_path());
  std::ofstream(path, std::ios::binary) << text;
}

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

// Sparse events, a burst in one row, a long gap.
std::vector<events::Event> stream(int width, int height) {
  std::mt19937 random(1);
  std::vector<events::Event> out;
  std::int64_t t_us = 3;
  for (int i = 0; i < 60; ++i)
    out.push_back({t_us += random() % 300, static_cast<std::uint16_t>(random() % static_cast<unsigned>(width)),
                   static_cast<std::uint16_t>(random() % static_cast<unsigned>(height)),
                   static_cast<std::uint8_t>(random() % 2)});
  for (int x = 0; x < width; x += 2) out.push_back({t_us, static_cast<std::uint16_t>(x), 1, 1});
  out.push_back({t_us + 20'000'000, 0, 0, 0});
  return out;
}

void put_events(const fs::path& folder) {
  for (const events::Codec& codec : events::codecs()) {
    if (!codec.open_writer) continue;
    for (const auto& [name, width, height] : {std::tuple("vga", 640, 480), std::tuple("tiny", 40, 3)}) {
      fs::create_directories(folder / codec.name);
      const auto writer =
          codec.open_writer(folder / codec.name / (name + codec.extensions.front()), {width, height, "IMX636"});
      writer->write(stream(width, height));
      writer->close();
    }
  }
  // These make what they try of the input's bytes.
  for (const char* name : {"dsec", "metavision-hdf5", "motion", "sensor", "sense"}) {
    fs::remove_all(folder / name);
    std::mt19937 random(2);
    for (int i = 0; i < 16; ++i) {
      std::string bytes(400, '\0');
      std::ranges::generate(bytes, [&] { return static_cast<char>(random() % (i % 2 ? 256 : 4)); });
      put(folder / name / std::to_string(i), bytes);
    }
  }
}

void put_pictures(const fs::path& folder) {
  cv::Mat picture(24, 32, CV_8UC3);
  cv::theRNG().fill(picture, cv::RNG::UNIFORM, 0, 256);
  for (const char* ending : {"png", "jpg", "tiff", "webp", "ppm", "bmp"}) {
    std::vector<unsigned char> bytes;
    cv::imencode(std::string(".") + ending, picture, bytes);
    put(folder / "picture" / ending, {reinterpret_cast<const char*>(bytes.data()), bytes.size()});
  }
  fs::create_directories(folder / "video");
  cv::VideoWriter video((folder / "video/own.mp4").string(), cv::VideoWriter::fourcc('m', 'p', '4', 'v'), 100,
                        {32, 24});
  for (int i = 0; i < 4; ++i) video.write(picture + cv::Scalar::all(8 * i));
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw Error(ExitCode::usage, "fuzz_seeds: wanted a folder");
  const fs::path folder = argv[1];
  put_events(folder);
  put_pictures(folder);
  fs::create_directories(folder / "stack");
  fuzz::write_stack(folder / "stack");
  put(folder / "frame/own.exr", text_of(folder / "stack/frame_000000.exr"));
  fs::remove_all(folder / "stack");
  put(folder / "stack_json/own.json", fuzz::stack_json().dump());
  for (const auto& [target, room] : {std::pair("chip", "sensor/chips"), std::pair("lens", "lens_data/lenses")})
    for (const auto& entry : fs::directory_iterator(data_dir(room)))
      if (entry.path().extension() == ".json") put(folder / target / entry.path().filename(), text_of(entry.path()));
  put(folder / "spectrum/own.csv", text_of(data_dir("lens_data/spectra") / "d65.csv"));
  put(folder / "options/own.json",
      R"({"chip": "imx636", "set": {"leak_rate_hz": 0.5}, "no_noise": false, "seed": 3, "threads": 2, "model": "v2e",)"
      R"( "param": {"cutoff_hz": 200}, "readout": "ideal", "fnumber": 2.8, "gain": 2.0, "fps": 100, "white_a": 1e-12,)"
      R"( "bands": "mc:8", "motion": true, "warmup_loops": 1, "start_us": 10, "duration_us": 1000})");
  put(folder / "aedat2/own.aedat2",
      "#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346blue\r\n" + kSamples);
  put(folder / "times/own.txt", "0 # us\n33.25\n1e3\n");
  put(folder / "zemax/own.zmx", text_of(data_dir("tests/lens/lenses") / "singlet.zmx"));
  put(folder / "pbrt/own.dat", lens::export_pbrt(lens::load_prescription("double_gauss_100mm_f3p1"), 550, 40));
  for (const char* scene : {"rotating_disk", "board"})
    put(folder / "aligned" / scene,
        R"({"scene": "scene", "camera": {"rotation_deg": [90, 0.5, 0]}, "parameters": {"rpm": 300}})"
        "\n---\n" +
            text_of(data_dir("scenes") / scene / "scene.json"));
  return 0;
} catch (const std::exception& e) {
  std::cerr << e.what() << '\n';
  return static_cast<int>(as_error(e).code());
}
