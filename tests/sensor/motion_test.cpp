// Light carried along motion, on scenes whose light is known at every instant.
#include "pecs/sensor/motion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include "clip.h"
#include "light/moving_light.h"
#include "motion/kernel.h"
#include "pecs/error.h"

namespace pecs::sensor {
namespace {

constexpr int kWidth = 150, kHeight = 90;
constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
using Plane = std::vector<float>;

std::size_t at(int x, int y) { return static_cast<std::size_t>(y) * kWidth + x; }

struct Point2 {
  double x, y;
};

// A smooth texture, seen by points as they lie at the start.
float texture(double x, double y) {
  return static_cast<float>(std::exp(0.4 * std::sin(0.5 * x + 0.2 * y) + 0.3 * std::cos(0.3 * y - 0.25 * x)));
}

// What is seen: where the point at (x, y) at instant t was at the start, and where a point of the start is at t.
struct Motion {
  std::function<Point2(double, double, double)> start_from, now_from;
};

Plane each(const std::function<float(int, int)>& value) {
  Plane out;
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x) out.push_back(value(x, y));
  return out;
}

Plane light(const Motion& m, double t) {
  return each([&](int x, int y) {
    const Point2 p = m.start_from(x, y, t);
    return texture(p.x, p.y);
  });
}

// The layer, of one surface.
Plane layer(const Motion& m) {
  Plane out(kMotionChannels * kPixels);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (std::size_t side = 0; side < 2; ++side) {
        const double from = side ? 1 : 0;
        const Point2 p = m.start_from(x, y, from);
        std::vector<double> values;
        for (const double part : {0.25, 0.5, 0.75, 1.0}) {
          const Point2 to = m.now_from(p.x, p.y, side ? 1 - part : part);
          values.insert(values.end(), {to.x - x, to.y - y});
        }
        values.insert(values.end(), {1, 1});
        for (std::size_t c = 0; c < values.size(); ++c)
          out[(values.size() * side + c) * kPixels + at(x, y)] = static_cast<float>(values[c]);
      }
  return out;
}

Plane carry(const Carrier& carrier, const Plane& a, const Plane& b, double s, CarrySide side = CarrySide::both) {
  Plane out(kPixels);
  const float *first = a.data(), *second = b.data();
  float* to = out.data();
  CarriedLight(carrier, {&first, 1}, {&second, 1}).planes({&s, 1}, {&to, 1}, CarriedLight::kWhole, side);
  return out;
}

// Largest |ln| of the ratio, a frame of `border` pixels left out.
double worst(const Plane& got, const Plane& wanted, int border) {
  double most = 0;
  for (int y = border; y < kHeight - border; ++y)
    for (int x = border; x < kWidth - border; ++x) {
      const std::size_t i = at(x, y);
      const double off = std::abs(std::log(got[i] / wanted[i]));
      most = std::isfinite(off) ? std::max(most, off) : std::numeric_limits<double>::infinity();
    }
  return most;
}

Motion translation(double dx, double dy) {
  return {[=](double x, double y, double t) { return Point2{x - dx * t, y - dy * t}; },
          [=](double x, double y, double t) { return Point2{x + dx * t, y + dy * t}; }};
}

Motion rotation(double angle) {
  const auto turned = [](double x, double y, double by) {
    const double dx = x - 70, dy = y - 40;
    return Point2{70 + std::cos(by) * dx - std::sin(by) * dy, 40 + std::sin(by) * dx + std::cos(by) * dy};
  };
  return {[=](double x, double y, double t) { return turned(x, y, -angle * t); },
          [=](double x, double y, double t) { return turned(x, y, angle * t); }};
}

// There and back, as a trembling hand moves.
Motion tremor(double dx, double px) {
  const auto moved = [=](double t) { return dx * t + px * std::sin(3 * t); };
  return {[=](double x, double y, double t) { return Point2{x - moved(t), y + 0.5 * moved(t)}; },
          [=](double x, double y, double t) { return Point2{x + moved(t), y - 0.5 * moved(t)}; }};
}

bool same_bits(const Plane& a, const Plane& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}

TEST(Motion, TheEndsAreTheKeyframes) {
  const Motion m = rotation(0.2);
  const Carrier carrier(layer(m), kWidth, kHeight);
  Plane a = light(m, 0), b = light(m, 1);
  a[7] = kNaN;
  b[9] = 0;
  EXPECT_TRUE(same_bits(carry(carrier, a, b, 0), a));
  EXPECT_TRUE(same_bits(carry(carrier, a, b, 1), b));
}

TEST(Motion, ATextureIsCarriedSharp) {
  for (const auto& [dx, dy] : {std::pair{0.3, 0.0}, {4.5, -2.25}, {-13.7, 6.1}}) {
    const Motion m = translation(dx, dy);
    const Carrier carrier(layer(m), kWidth, kHeight);
    EXPECT_NEAR(carrier.longest_path_px(), std::hypot(dx, dy), 1e-4);
    for (const double s : {0.1, 0.5, 0.77}) {
      EXPECT_LT(worst(carry(carrier, light(m, 0), light(m, 1), s), light(m, s), 16), 0.012) << dx << " at " << s;
      // Frozen, the light would be far off.
      if (std::abs(dx) > 4) {
        EXPECT_GT(worst(light(m, 0), light(m, s), 16), 0.1);
      }
    }
  }
}

// Two tones that meet at a straight line through (70, 40) at the start; means over pixels from 16x16 points of each.
// width_px: over which one changes into the other, at least kSharp.
constexpr double kSharp = 1.0 / 16;
Plane edge(const Motion& m, double t, double angle, double width_px) {
  return each([&](int x, int y) {
    double sum = 0;
    for (int k = 0; k < 256; ++k) {
      const Point2 p = m.start_from(x + (k % 16 - 7.5) / 16, y + (k / 16 - 7.5) / 16, t);
      const double d = std::cos(angle) * (p.x - 70) + std::sin(angle) * (p.y - 40);
      sum += 1 + 11 * std::clamp(d / width_px + 0.5, 0.0, 1.0);
    }
    return static_cast<float>(sum / 256);
  });
}

double rms(const Plane& got, const Plane& wanted, int border) {
  double sum = 0;
  for (int y = border; y < kHeight - border; ++y)
    for (int x = border; x < kWidth - border; ++x) sum += std::pow(std::log(got[at(x, y)] / wanted[at(x, y)]), 2);
  return std::sqrt(sum / ((kWidth - 2 * border) * (kHeight - 2 * border)));
}

TEST(Motion, AnEdgeIsCarriedSharp) {
  for (const Motion& m : {translation(4.3, -2.25), translation(-13.7, 6.1), rotation(0.4)}) {
    const Carrier carrier(layer(m), kWidth, kHeight);
    for (const double angle : {0.0, 0.3, 0.8, 1.57, 4.0}) {
      const Plane a = edge(m, 0, angle, kSharp), b = edge(m, 1, angle, kSharp);
      for (const double s : {0.1, 0.37}) {
        const Plane truth = edge(m, s, angle, kSharp), got = carry(carrier, a, b, s);
        EXPECT_LT(rms(got, truth, 16), 0.004) << angle << " at " << s;   // interpolation: 0.03
        EXPECT_LT(worst(got, truth, 16), 0.25) << angle << " at " << s;  // interpolation: 0.8
      }
    }
  }
}

TEST(Motion, ABlurredEdgeStaysBlurred) {
  const Motion m = translation(4.3, -2.25);
  const Carrier carrier(layer(m), kWidth, kHeight);
  for (const auto& [width_px, most] : {std::pair{0.3, 0.003}, {0.6, 0.008}, {1.0, 0.015}, {2.0, 0.015}, {4.0, 0.006}})
    EXPECT_LT(rms(carry(carrier, edge(m, 0, 0.3, width_px), edge(m, 1, 0.3, width_px), 0.37),
                  edge(m, 0.37, 0.3, width_px), 16),
              most)
        << width_px;
}

TEST(Motion, TheOutlineOfADiskThatTurnsStays) {
  const auto inside = [](double x, double y) { return std::hypot(x - 70, y - 40) < 22.3; };
  Plane moves = layer(rotation(0.4));
  for (std::size_t c = 0; c < kMotionChannels; ++c)
    for (int i = 0; i < static_cast<int>(kPixels); ++i)
      if (!inside(i % kWidth, i / kWidth)) moves[c * kPixels + static_cast<std::size_t>(i)] = c % 10 < 8 ? 0 : 2;
  const Plane seen = each([&](int x, int y) {
    double sum = 0;
    for (int k = 0; k < 256; ++k) sum += inside(x + (k % 16 - 7.5) / 16, y + (k / 16 - 7.5) / 16) ? 4 : 1;
    return static_cast<float>(sum / 256);
  });
  const Carrier carrier(moves, kWidth, kHeight);
  for (const double s : {0.1, 0.37, 0.5}) EXPECT_LT(rms(carry(carrier, seen, seen, s), seen, 8), 0.005) << s;
}

TEST(Motion, PathsBend) {
  for (const auto& [m, most] : {std::pair{rotation(0.3), 0.008}, {tremor(3, 1.5), 0.012}}) {
    const Carrier carrier(layer(m), kWidth, kHeight);
    for (const double s : {0.1, 0.25, 0.5, 0.9})
      EXPECT_LT(worst(carry(carrier, light(m, 0), light(m, 1), s), light(m, s), 26), most) << s;
  }
}

TEST(Motion, StillStaysStill) {
  const Plane still(kMotionChannels * kPixels, 0.0f);
  const Carrier carrier(still, kWidth, kHeight);
  EXPECT_EQ(carrier.longest_path_px(), 0);
  const Plane a = light(translation(0, 0), 0);
  EXPECT_TRUE(same_bits(carry(carrier, a, a, 0.3), a));
}

// Columns up to 60 move down by 16 pixels, the others by one.
struct TwoSpeeds {
  static double down(double x) { return x < 60 ? 16 : 1; }
  const Motion motion{[](double x, double y, double t) { return Point2{x, y - down(x) * t}; },
                      [](double x, double y, double t) { return Point2{x, y + down(x) * t}; }};
  const Plane first = spared(light(motion, 0)), second = spared(light(motion, 1));

  static Plane spared(Plane plane) {
    plane.resize(kPixels + motion::kSpare);
    return plane;
  }
  std::unique_ptr<LightInterval> interval(std::size_t lights, double length_us = 1e6,
                                          double step_px = Carrier::kStep_px) const {
    auto out = std::make_unique<LightInterval>();
    LightInterval& in = *out;
    in.first.assign(lights, first.data());
    in.second.assign(lights, second.data());
    in.carrier.emplace(layer(motion), kWidth, kHeight);
    in.carried.emplace(*in.carrier, in.first, in.second);
    const std::vector<double> instants = in.carrier->instants(length_us, step_px);
    in.instants.insert(in.instants.end(), instants.begin(), instants.end());
    return out;
  }
  // Planes at all instants. interpolated: where that is allowed.
  static std::vector<Plane> planes(const LightInterval& in, int subpixels, bool interpolated) {
    const int width = kWidth / subpixels, height = kHeight / subpixels;
    MovingLight moving(width, height, subpixels, std::vector<const Mosaic*>(in.first.size()));
    std::vector<Plane> out;
    const auto keep = [&](std::size_t, std::span<const float* const> some) {
      for (const float* plane : some) out.emplace_back(plane, plane + width * height);
      return true;
    };
    EXPECT_TRUE(interpolated ? moving.along(in, keep) : moving.planes(in, in.instants, {0, height}, keep));
    return out;
  }
};

TEST(Motion, SlowPartsAreInterpolated) {
  const TwoSpeeds scene;
  for (const int subpixels : {1, 2}) {
    const std::unique_ptr<LightInterval> interval = scene.interval(1);
    const LightInterval& in = *interval;
    const int width = kWidth / subpixels;
    const std::vector<Plane> all = TwoSpeeds::planes(in, subpixels, false),
                             some = TwoSpeeds::planes(in, subpixels, true);
    ASSERT_EQ(some.size(), in.instants.size());
    float fast = 0, slow = 0;
    for (std::size_t k = 0; k < all.size(); ++k)
      for (std::size_t i = 0; i < all[k].size(); ++i) {
        const int x = static_cast<int>(i) % width * subpixels, y = static_cast<int>(i) / width * subpixels;
        if (y < 4 || y >= kHeight - 4 || x >= kWidth - 4) continue;  // light at the picture's border is less exact
        float& most = x < 64 ? fast : slow;
        most = std::max(most, std::abs(std::log(some[k][i] / all[k][i])));
      }
    EXPECT_EQ(fast, 0);
    EXPECT_GT(slow, 0);
    EXPECT_LT(slow, 1e-3);
  }
}

TEST(Motion, PlanesFarApartAreNotInterpolated) {
  const TwoSpeeds scene;
  for (const auto& [length_us, step_px] : {std::pair{8.0, Carrier::kStep_px}, {1e6, 2.0}}) {  // 2 pixels apart
    const std::unique_ptr<LightInterval> interval = scene.interval(1, length_us, step_px);
    ASSERT_EQ(interval->instants.size(), 8u);
    const std::vector<Plane> all = TwoSpeeds::planes(*interval, 1, false), some = TwoSpeeds::planes(*interval, 1, true);
    for (std::size_t k = 0; k < all.size(); ++k) EXPECT_TRUE(same_bits(some[k], all[k])) << k;
  }
}

TEST(Motion, WhatIsInterpolatedDependsOnNoOtherLight) {
  const TwoSpeeds scene;
  const std::vector<Plane> one = TwoSpeeds::planes(*scene.interval(1), 1, true);
  const std::vector<Plane> many = TwoSpeeds::planes(*scene.interval(100), 1, true);  // smaller batches
  for (std::size_t k = 0; k < one.size(); ++k) EXPECT_TRUE(same_bits(one[k], many[100 * k + 99])) << k;
}

TEST(Motion, WhatPicturesCorrectIsNotInterpolated) {
  const TwoSpeeds scene;
  const std::unique_ptr<LightInterval> interval = scene.interval(1);
  LightInterval& in = *interval;
  Plane rendered(kPixels, kNaN);
  rendered[at(140, 70)] = 2 * scene.first[at(140, 70)];
  in.residuals.resize(1);
  in.residuals[0].add(0.5, rendered, std::span(scene.first).first(kPixels));
  in.residuals[0].close();
  const std::vector<Plane> all = TwoSpeeds::planes(in, 1, false), some = TwoSpeeds::planes(in, 1, true);
  for (std::size_t k = 0; k < all.size(); ++k) EXPECT_EQ(some[k][at(140, 70)], all[k][at(140, 70)]) << k;
}

// A block of 30 x 20 pixels of another light before a still texture.
struct Block {
  static bool inside(double x, double y, double t) { return x >= 40 + 20 * t && x < 70 + 20 * t && y >= 30 && y < 50; }
  static Plane light(double t) {
    return each([=](int x, int y) { return inside(x, y, t) ? 8 * texture(x - 20 * t, y + 9) : texture(x, y); });
  }
  static Plane layer() {
    Plane out;
    for (const double from : {0.0, 1.0})
      for (int c = 0; c < 10; ++c) {
        const Plane one = each([&](int x, int y) {
          const bool front = inside(x, y, from);
          const float end = front ? (from == 0 ? 20.0f : -20.0f) : 0.0f, part = static_cast<float>(c / 2 + 1) / 4;
          return c >= 8 ? (front ? 1.0f : 2.0f) : c % 2 == 0 ? part * end : 0.0f;
        });
        out.insert(out.end(), one.begin(), one.end());
      }
    return out;
  }
};

TEST(Motion, LightStaysBetweenThatOfThePicturesAround) {  // of a block at rest, warped as if it moved
  const Carrier carrier(Block::layer(), kWidth, kHeight);
  const Plane a = Block::light(0), b = Block::light(1);
  Residuals residuals;
  for (const double s : {0.25, 0.5, 0.75}) residuals.add(s, a, carry(carrier, a, b, s));
  residuals.close();
  for (const double s : {0.35, 0.45, 0.6, 0.7}) {
    Plane plane = carry(carrier, a, b, s);
    residuals.apply(s, a.data(), b.data(), plane.data(), 0, kPixels);
    double most = 0;
    for (std::size_t k = 0; k < kPixels; ++k) most = std::max(most, std::abs(std::log(plane[k] / double{a[k]})));
    EXPECT_LT(most, 0.6) << s;  // the warped texture leaves its range by that; the edge of the block by ln 8
  }
}

TEST(Motion, WhatIsNearerHides) {
  const Carrier carrier(Block::layer(), kWidth, kHeight);
  const Plane a = Block::light(0), b = Block::light(1);
  for (const double s : {0.1, 0.5, 0.65}) {  // whole pixels: the block is at its place exactly
    const Plane got = carry(carrier, a, b, s), truth = Block::light(s);
    double most = 0;
    int beside = 0;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) {
        const std::size_t i = at(x, y);
        const bool edge = Block::inside(x - 1, y, s) != Block::inside(x + 1, y, s) ||
                          Block::inside(x, y - 1, s) != Block::inside(x, y + 1, s) ||
                          Block::inside(x - 1, y - 1, s) != Block::inside(x + 1, y + 1, s) ||
                          Block::inside(x - 1, y + 1, s) != Block::inside(x + 1, y - 1, s);
        const double off = std::abs(std::log(got[i] / truth[i]));
        if (edge)
          beside += off > 0.05;
        else
          most = std::max(most, off);
      }
    EXPECT_LT(most, 0.002) << s;
    EXPECT_LE(beside, 80) << s;
  }
}

TEST(Motion, AStillBackgroundStaysStillBesideWhatMoves) {
  const Carrier carrier(Block::layer(), kWidth, kHeight);
  const Plane a = Block::light(0), b = Block::light(1), got = carry(carrier, a, b, 0.4);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      if (x < 37 || x > 93 || y < 27 || y > 53) {
        const std::size_t i = at(x, y);
        ASSERT_EQ(got[i], a[i]) << x << ' ' << y;
      }
}

TEST(Motion, OneKeyframeAloneDoesNotKnowWhatItHides) {
  const Carrier carrier(Block::layer(), kWidth, kHeight);
  const Plane a = Block::light(0), b = Block::light(1);
  const Plane first = carry(carrier, a, b, 0.5, CarrySide::first),
              second = carry(carrier, a, b, 0.5, CarrySide::second);
  EXPECT_TRUE(std::isnan(first[at(44, 40)]));   // the block was here
  EXPECT_TRUE(std::isnan(second[at(85, 40)]));  // and comes here
  EXPECT_EQ(first[at(85, 40)], a[at(85, 40)]);
  EXPECT_EQ(second[at(44, 40)], b[at(44, 40)]);
  EXPECT_NEAR(first[at(65, 40)], 8 * texture(55, 49), 1e-3);
}

TEST(Motion, WithoutMotionBothAreBlendedAtThePixel) {
  const Motion m = translation(6, 0);
  Plane motion = layer(m);
  for (std::size_t c = 0; c < kMotionChannels; ++c)
    for (int y = 40; y < 60; ++y)
      for (int x = 50; x < 80; ++x) motion[c * kPixels + at(x, y)] = kNaN;
  const Plane a = light(m, 0), b = light(m, 1);
  const Plane got = carry(Carrier(motion, kWidth, kHeight), a, b, 0.25);
  for (int y = 42; y < 58; ++y)
    for (int x = 60; x < 70; ++x) {
      const std::size_t i = at(x, y);
      ASSERT_NEAR(got[i], std::pow(a[i], 0.75) * std::pow(b[i], 0.25), 1e-5);
    }
  EXPECT_LT(worst(Plane(got.begin(), got.begin() + at(0, 37)), light(m, 0.25), 53), 0.01);
}

TEST(Motion, LightThatIsNoneIsTakenFromTheOtherKeyframe) {
  const Motion m = translation(3, 0);
  Plane a = light(m, 0);
  const Plane b = light(m, 1);
  for (int y = 40; y < 43; ++y) a[at(70, y)] = kNaN;
  const Plane got = carry(Carrier(layer(m), kWidth, kHeight), a, b, 0.5);
  EXPECT_LT(worst(got, light(m, 0.5), 16), 0.02);
}

TEST(Motion, WildNumbersDoNoHarm) {
  constexpr float kWild[] = {1e30f, -1e30f, std::numeric_limits<float>::infinity(), kNaN, -5, 0, 3e4f, 1e-30f, 2.5f};
  Plane motion = layer(rotation(0.2)), a = light(translation(0, 0), 0);
  for (std::size_t i = 0; i < motion.size(); i += 7) motion[i] = kWild[i / 7 % std::size(kWild)];
  for (std::size_t i = 0; i < a.size(); i += 11) a[i] = std::abs(kWild[i / 11 % std::size(kWild)]);
  const Carrier carrier(motion, kWidth, kHeight);
  EXPECT_LE(carrier.longest_path_px(), std::hypot(kWidth, kHeight));
  EXPECT_LE(carrier.instants(100).size(), 100);
  for (const double s : {1e-6, 0.3, 0.999}) {
    const Plane got = carry(carrier, a, a, s);
    EXPECT_TRUE(std::ranges::all_of(got, [](float v) { return v >= 0 || std::isnan(v); }));
    EXPECT_GT(std::ranges::count_if(got, [](float v) { return std::isfinite(v); }), 0.8 * kPixels);
  }
  for (const auto& [width, height] : {std::pair{1, 1}, {3, 2}, {1, 200}, {200, 1}}) {
    const Plane small(static_cast<std::size_t>(width * height), 2.0f);
    Plane out(small.size());
    const float* const light = small.data();
    float* const to = out.data();
    const double s = 0.5;
    const Carrier tiny(Plane(kMotionChannels * small.size(), 0.25f), width, height);
    CarriedLight(tiny, {&light, 1}, {&light, 1}).planes({&s, 1}, {&to, 1});
    EXPECT_TRUE(std::ranges::all_of(out, [](float v) { return std::abs(v - 2) < 1e-5f; })) << width << 'x' << height;
  }
}

TEST(Motion, LightStaysLight) {
  const Motion m = rotation(0.1);
  const auto steps = [&](double t) {  // of 1 to 1000, and nothing
    Plane out = light(m, t);
    for (float& v : out) v = v > 1.3f ? 1000.0f : v < 0.8f ? 0.0f : 1.0f;
    return out;
  };
  const Plane got = carry(Carrier(layer(m), kWidth, kHeight), steps(0), steps(1), 0.4);
  EXPECT_TRUE(std::ranges::all_of(got, [](float v) { return v >= 0 && v <= 1250; }));
}

TEST(Motion, OpticalFlowDoes) {
  const Motion m = translation(5, -3);
  const Plane all = layer(m);
  for (const std::size_t channels : {2, 4}) {
    Plane flow;
    for (const std::size_t c : {6, 7, 16, 17})
      if (flow.size() < channels * kPixels)
        flow.insert(flow.end(), all.begin() + static_cast<std::ptrdiff_t>(c * kPixels),
                    all.begin() + static_cast<std::ptrdiff_t>((c + 1) * kPixels));
    const Plane got = carry(Carrier(flow, kWidth, kHeight), light(m, 0), light(m, 1), 0.4);
    EXPECT_LT(worst(got, light(m, 0.4), 10), 0.01) << channels;
  }
  EXPECT_THROW(Carrier(Plane(3 * kPixels), kWidth, kHeight), Error);
  EXPECT_THROW(Carrier(Plane(kPixels * 2 - 1), kWidth, kHeight), Error);
}

TEST(Sensor, AnErrorInALaterFrameLosesNoEvents) {
  const Clip clip =
      make_clip(40, 30, 6, 1000, [](int x, int, double t) { return 1 + 0.9 * std::sin(0.3 * x - 2e-3 * t); });
  const Plane motion(std::size_t{3} * 40 * 30 * 6);
  std::vector<const float*> planes;
  for (const auto& frame : clip.frames) planes.push_back(frame.data());
  const std::span all(planes);
  const auto events_of = [&](bool with_errors) {
    Sensor sensor(load_chip("ideal"), clip.width, clip.height, 1, 100.0);
    LabelledEvents found, lost;
    sensor.push_moving(all.first(3), std::span(clip.t_us).first(3), motion.data(), 2, false, found);
    if (with_errors) {
      const double falling_us[] = {3000, 2500}, rising_us[] = {3000, 4000};
      EXPECT_THROW(sensor.push_moving(all.subspan(3, 2), falling_us, motion.data(), 2, false, lost), Error);
      EXPECT_THROW(sensor.push_moving(all.subspan(3, 2), rising_us, motion.data(), 3, false, lost), Error);
    }
    sensor.push_moving(all.subspan(3), std::span(clip.t_us).subspan(3), motion.data(), 2, true, found);
    return found.events;
  };
  EXPECT_GT(events_of(false).size(), 1000u);
  EXPECT_EQ(events_of(true), events_of(false));
}

}  // namespace
}  // namespace pecs::sensor
