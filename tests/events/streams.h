#pragma once
// Event streams that formats get wrong: corners, wraps, gaps, bursts in one row, nothing at all.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <vector>

#include "pecs/error.h"
#include "pecs/events/format.h"
#include "shared.h"

namespace pecs::tests {

struct NamedStream {
  std::string name;
  events::Stream stream;
};

inline std::vector<events::Event> random_events(std::size_t n, int width, int height, std::int64_t t0_us,
                                                std::int64_t mean_step_us, unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_int_distribution<int> x(0, width - 1), y(0, height - 1), p(0, 1);
  std::geometric_distribution<std::int64_t> step(1.0 / (1.0 + static_cast<double>(mean_step_us)));
  std::vector<events::Event> out;
  std::int64_t t_us = t0_us;
  while (out.size() < n) {
    out.push_back({t_us += step(random), static_cast<std::uint16_t>(x(random)), static_cast<std::uint16_t>(y(random)),
                   static_cast<std::uint8_t>(p(random))});
  }
  return out;
}

// Several events of one row at one time, as a row arbiter makes them: rising, falling and repeated columns.
inline std::vector<events::Event> row_bursts(int width, int height, unsigned seed) {
  std::mt19937_64 random(seed);
  std::vector<events::Event> out;
  for (std::int64_t t_us = 10; t_us < 4000; t_us += 7) {
    const auto y = static_cast<std::uint16_t>(random() % static_cast<unsigned>(height));
    const auto p = static_cast<std::uint8_t>(random() % 2);
    const unsigned keep = 1 + static_cast<unsigned>(random() % 3);
    for (int x = static_cast<int>(random() % static_cast<unsigned>(width)); x < width; ++x)
      if (random() % keep == 0) out.push_back({t_us, static_cast<std::uint16_t>(x), y, p});
    out.push_back({t_us, static_cast<std::uint16_t>(width - 1), y, p});
    out.push_back({t_us, 0, y, p});
  }
  return out;
}

inline std::vector<NamedStream> streams_for(const events::Limits& limits) {
  const events::StreamInfo hd{1280, 720, ""}, vga{640, 480, ""}, tiny{7, 3, ""};
  const std::int64_t minute_us = 60'000'000;
  std::vector<NamedStream> all = {
      {"empty", {hd, {}}},
      {"one_at_zero", {hd, {{0, 0, 0, 0}}}},
      {"corners", {hd, {{0, 0, 0, 1}, {0, 1279, 0, 1}, {0, 1279, 719, 0}, {5, 0, 719, 1}, {5, 1279, 719, 1}}}},
      {"random", {vga, random_events(20'000, 640, 480, 0, 3, 1)}},
      {"sparse", {hd, random_events(2'000, 1280, 720, 1'000'000, 20'000, 2)}},
      {"row_bursts", {hd, row_bursts(1280, 720, 3)}},
      {"narrow", {tiny, random_events(1'000, 7, 3, 0, 1, 4)}},
      {"same_pixel_twice", {vga, {{9, 3, 3, 1}, {9, 3, 3, 1}, {9, 3, 3, 0}}}},
  };
  // Every wrap of 2^24 us (EVT3), 2^32 us (DAT) and 2^34 us (EVT2) crossed by a step of 1 us, and jumped in a long gap.
  NamedStream wraps{"wraps", {hd, {}}};
  for (const std::int64_t wrap : {std::int64_t{1} << 12, std::int64_t{1} << 24, std::int64_t{2} << 24,
                                  std::int64_t{1} << 32, std::int64_t{1} << 34, std::int64_t{3} << 34})
    for (const std::int64_t t_us : {wrap - 1, wrap, wrap + 1}) wraps.stream.events.push_back({t_us, 1279, 3, 1});
  NamedStream gaps{"gaps", {hd, {{0, 5, 5, 1}}}};
  for (int i = 1; i <= 13; ++i)
    gaps.stream.events.push_back({7 * minute_us * i + i, 1279, 719, static_cast<std::uint8_t>(i % 2)});
  NamedStream late{"late_start", {hd, {{100 * minute_us + 4095, 1279, 0, 1}}}};
  for (NamedStream* s : {&wraps, &gaps, &late}) {
    std::int64_t last_us = 0;
    std::erase_if(s->stream.events, [&](const events::Event& e) {
      if (e.t_us > limits.t_max_us || e.t_us - last_us >= limits.max_gap_us) return true;
      last_us = e.t_us;
      return false;
    });
    all.push_back(*s);
  }
  return all;
}

// Every format that is both read and written.
inline std::vector<const events::Codec*> two_way() {
  std::vector<const events::Codec*> out;
  for (const events::Codec& c : events::codecs())
    if (c.open_reader && c.open_writer) out.push_back(&c);
  return out;
}

inline std::string format_name(const testing::TestParamInfo<const events::Codec*>& test) {
  std::string name = test.param->name;
  std::ranges::replace(name, '-', '_');
  return name;
}

class TempFolder {
 public:
  TempFolder() {
    static int count = 0;
    path_ = std::filesystem::temp_directory_path() /
            ("pecs_formats_" + std::to_string(::getpid()) + "_" + std::to_string(count++));
    std::filesystem::create_directories(path_);
  }
  ~TempFolder() { std::filesystem::remove_all(path_); }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

inline std::vector<char> bytes_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

inline void write_bytes(const std::filesystem::path& path, const std::vector<char>& bytes) {
  std::ofstream(path, std::ios::binary).write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
}

}  // namespace pecs::tests
