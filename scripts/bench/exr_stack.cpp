// bench_exr_stack make FOLDER FRAMES WIDTH HEIGHT: a spectral stack of 6 half-float bands, ZIP: a textured board that
// moves,
//   with the noise of a render.
// bench_exr_stack read FOLDER THREADS: frames per second at which OpenEXR alone reads it, into the files' own half
//   floats: the faster of its own threads in one file at a time and of one file per thread. Prints JSON.
#include <ImfChannelList.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfInputFile.h>
#include <ImfOutputFile.h>
#include <ImfStringAttribute.h>
#include <ImfThreading.h>
#include <fmt/format.h>
#include <half.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <thread>
#include <vector>

namespace {

namespace fs = std::filesystem;
constexpr int kBands[] = {450, 500, 550, 600, 650, 700};

fs::path frame(const fs::path& folder, int i) { return folder / fmt::format("frame_{:06}.exr", i); }

struct Halves {
  Halves(int w, int h)
      : width(w), values(static_cast<std::size_t>(w) * static_cast<std::size_t>(h) * std::size(kBands)) {}
  Imf::FrameBuffer buffer() {
    Imf::FrameBuffer out;
    const std::size_t plane = values.size() / std::size(kBands), row = sizeof(half) * static_cast<std::size_t>(width);
    for (std::size_t b = 0; b < std::size(kBands); ++b)
      out.insert(fmt::format("S0.{}nm", kBands[b]),
                 Imf::Slice(Imf::HALF, reinterpret_cast<char*>(values.data() + b * plane), sizeof(half), row));
    return out;
  }
  int width;
  std::vector<half> values;
};

void make(const fs::path& folder, int frames, int width, int height) {
  fs::create_directories(folder);
  std::ofstream json(folder / "stack.json");
  json << R"({"pecs_stack":1,"quantity":"irradiance","pixel_pitch_m":4.86e-6,"period_ns":null,"lens":null,"scene":{},)"
       << R"("render":{},"versions":{},"width":)" << width << R"(,"height":)" << height << R"(,"bands":[)";
  for (const int nm : kBands)
    json << (nm == kBands[0] ? "" : ",") << fmt::format(R"({{"lambda_nm":{},"weight_nm":50}})", nm);
  json << R"(],"times_ns":[)";
  for (int i = 0; i < frames; ++i) json << (i ? "," : "") << i * 100000LL;
  json << "]}";

  std::minstd_rand random(1);
  std::normal_distribution<float> normal(1, 0.01f);
  std::vector<float> noise(1 << 20);
  for (float& n : noise) n = normal(random);
  Halves picture(width, height);
  for (int i = 0; i < frames; ++i) {
    Imf::Header header(width, height);
    header.compression() = Imf::ZIP_COMPRESSION;
    header.insert("pecsTimeNs", Imf::StringAttribute(std::to_string(i * 100000LL)));
    for (const int nm : kBands) header.channels().insert(fmt::format("S0.{}nm", nm), Imf::Channel(Imf::HALF));
    std::size_t at = 0;
    for (std::size_t b = 0; b < std::size(kBands); ++b)
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x, ++at) {
          const bool white =
              (static_cast<int>((static_cast<float>(x) + 0.3f * static_cast<float>(i)) / 80) + y / 80) % 2;
          // A still scene renders the same noise in every frame.
          picture.values[at] = half((white ? 0.04f : 0.004f) * noise[(at * 7 + (white ? 0 : 13)) & ((1 << 20) - 1)]);
        }
    Imf::OutputFile file(frame(folder, i).c_str(), header);
    file.setFrameBuffer(picture.buffer());
    file.writePixels(height);
  }
}

template <class Work>
double frames_per_s(int frames, Work&& work) {
  const auto start = std::chrono::steady_clock::now();
  work();
  return frames / std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void read_one(const fs::path& path, Halves& into, int threads) {
  Imf::InputFile file(path.c_str(), threads);
  const auto box = file.header().dataWindow();
  file.setFrameBuffer(into.buffer());
  file.readPixels(box.min.y, box.max.y);
}

void read(const fs::path& folder, int threads) {
  int frames = 0;
  while (fs::exists(frame(folder, frames))) ++frames;
  const auto box = Imf::InputFile(frame(folder, 0).c_str()).header().dataWindow();
  const int width = box.max.x + 1, height = box.max.y + 1;

  Imf::setGlobalThreadCount(threads);
  Halves shared(width, height);
  const double inside = frames_per_s(frames, [&] {
    for (int i = 0; i < frames; ++i) read_one(frame(folder, i), shared, threads);
  });
  Imf::setGlobalThreadCount(0);
  const double beside = frames_per_s(frames, [&] {
    std::atomic<int> next{0};
    std::vector<std::jthread> pool;
    for (int t = 0; t < threads; ++t)
      pool.emplace_back([&] {
        Halves own(width, height);
        for (int i = next++; i < frames; i = next++) read_one(frame(folder, i), own, 0);
      });
  });
  fmt::print("{{\"frames\": {}, \"openexr_threads_fps\": {:.3f}, \"file_per_thread_fps\": {:.3f}, \"fps\": {:.3f}}}\n",
             frames, inside, beside, std::max(inside, beside));
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> args(argv + 1, argv + argc);
  if (args.size() == 5 && args[0] == "make") {
    make(args[1], std::stoi(args[2]), std::stoi(args[3]), std::stoi(args[4]));
  } else if (args.size() == 3 && args[0] == "read") {
    read(args[1], std::stoi(args[2]));
  } else {
    fmt::print(stderr, "usage: bench_exr_stack make FOLDER FRAMES WIDTH HEIGHT | read FOLDER THREADS\n");
    return 2;
  }
}
