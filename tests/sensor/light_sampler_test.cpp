// The light of a source at any time against the scene itself; tests/python/sensor/test_light.py has the rest.
#include "pecs/sensor/light_sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "pecs/error.h"
#include "pecs/sensor/motion.h"
#include "sense/feed.h"

namespace pecs::sensor {
namespace {

using Plane = std::vector<float>;

// A texture that moves by 6 px an interval to the right, in two bands; after the last frame it begins again.
class Moving : public FrameSource {
 public:
  static constexpr int kWidth = 70, kHeight = 40, kStep_px = 6;
  static constexpr std::size_t kPixels = std::size_t{kWidth} * kHeight;
  Moving() {
    info_.width = kWidth, info_.height = kHeight;
    info_.bands = {{500, 1}, {600, 1}};
    info_.times_ns = {1'000'000, 2'000'000, 4'000'000};  // the first is not at 0
  }
  static float texture(double x, int y) {
    return static_cast<float>(std::exp(0.5 * std::sin(0.3 * x) + 0.3 * std::cos(0.2 * x + 0.4 * y)));
  }
  // At so many steps after the first frame.
  static Plane light(double steps) {
    Plane out;
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x) out.push_back(texture(x - kStep_px * steps, y));
    return out;
  }
  const StackInfo& info() const override { return info_; }
  std::int64_t frames() const override { return std::ssize(info_.times_ns); }
  std::string name() const override { return "moving"; }
  std::string layout() const override { return "test"; }
  void read_rows(std::int64_t index, const RowSink& sink, int begin, int end) const override {
    const Plane plane = light(static_cast<double>(index));
    for (int y = begin; y < (end ? end : kHeight); ++y) {
      Plane row(plane.begin() + static_cast<std::ptrdiff_t>(y) * kWidth,
                plane.begin() + static_cast<std::ptrdiff_t>(y + 1) * kWidth);
      row.resize(std::size_t{2} * kWidth, 3);
      sink(y, 1, row);
    }
  }
  bool has_motion() const override { return true; }
  void read_motion(std::int64_t, const RowSink& sink) const override {
    for (int y = 0; y < kHeight; ++y) {
      Plane row;
      for (const float quarter : {1.5f, -1.5f}) {
        for (const float v : {quarter, 0.0f, 2 * quarter, 0.0f, 3 * quarter, 0.0f, 4 * quarter, 0.0f, 1.0f, 1.0f})
          row.insert(row.end(), kWidth, v);
      }
      sink(y, 1, row);
    }
  }

  StackInfo info_;
};

// Amperes so that chip 0 sees the texture, chip 1 both bands.
const std::vector<Response> kChips = {{{1e-12, 0}}, {{2e-12, 1e-12}}};

Plane at(LightSampler& light, std::vector<double> t_us) {
  Plane out(t_us.size() * light.values());
  light.at(t_us, out);
  return out;
}

Plane exposed(LightSampler& light, const Exposure& exposure) {
  Plane out(light.values());
  light.exposure(exposure, out);
  return out;
}

TEST(LightSampler, IsThatOfTheSceneThen) {
  const Moving source;
  LightSampler light(source, kChips);
  ASSERT_EQ(light.values(), 2 * Moving::kPixels);
  EXPECT_EQ(light.end_us(), 3000);
  const Plane found = at(light, {0, 300, 2000, 3000});
  const double steps[] = {0, 0.3, 1.5, 2};
  for (std::size_t k = 0; k < std::size(steps); ++k) {
    const Plane truth = Moving::light(steps[k]);
    for (int y = 4; y < Moving::kHeight - 4; ++y)
      for (int x = 14; x < Moving::kWidth - 14; ++x) {
        const auto i = static_cast<std::size_t>(y) * Moving::kWidth + static_cast<std::size_t>(x);
        const float *a = &found[2 * k * Moving::kPixels + i], *b = a + Moving::kPixels;
        ASSERT_NEAR(*a * 1e12f, truth[i], 0.004f * truth[i]) << k << ' ' << x << ' ' << y;
        ASSERT_NEAR(*b * 1e12f, 2 * truth[i] + 3, 0.01f * truth[i]) << k;
      }
  }
}

// Each pixel of a mosaic has the light that all pixels have behind its filter, also where light moves across pixels.
TEST(LightSampler, MosaicPicksTheLightOfEachPixelsFilter) {
  const Moving source;
  Chip chip = load_chip("ideal");
  chip.mosaic = std::make_shared<const Mosaic>(
      Mosaic{{{"A", {{500, 600}, {1, 0.25}}}, {"B", {{500, 600}, {0.5, 1}}}}, {{0, 1, 1}, {1, 1, 0}}});
  const std::vector<Response> mosaic = {{chip, source.info(), {2e-12, 1e-12}}, kChips[0]},
                              filters = {{{2e-12, 0.25e-12}}, {{1e-12, 1e-12}}};
  for (const bool along_motion : {true, false}) {
    LightSampler light(source, mosaic, along_motion), behind(source, filters, along_motion),
        alone(source, std::span(kChips).first(1), along_motion);
    const std::vector<double> t_us = {0, 310, 1000, 2500};
    const Plane all = at(light, t_us), of_filters = at(behind, t_us), without = at(alone, t_us);
    for (std::size_t k = 0; k < t_us.size(); ++k)
      for (std::size_t i = 0; i < Moving::kPixels; ++i) {
        const std::size_t x = i % Moving::kWidth, y = i / Moving::kWidth;
        const bool is_b = y % 2 == 0 ? x % 3 != 0 : x % 3 != 2;
        ASSERT_EQ(all[2 * k * Moving::kPixels + i], of_filters[(2 * k + is_b) * Moving::kPixels + i]) << x << " " << y;
        ASSERT_EQ(all[(2 * k + 1) * Moving::kPixels + i], without[k * Moving::kPixels + i]);
      }
    // Also rows that are exposed one after another.
    const Exposure rolling{100, 400, 7, 16};
    const Plane rows = exposed(light, rolling), rows_of_filters = exposed(behind, rolling);
    for (std::size_t i = 0; i < Moving::kPixels; ++i) {
      const std::size_t x = i % Moving::kWidth, y = i / Moving::kWidth;
      const bool is_b = y % 2 == 0 ? x % 3 != 0 : x % 3 != 2;
      ASSERT_EQ(rows[i], rows_of_filters[is_b * Moving::kPixels + i]) << x << " " << y;
    }
  }
  chip.mosaic = std::make_shared<const Mosaic>(Mosaic{{{"A", {{700, 800}, {1, 1}}}}, {{0}}});
  EXPECT_THROW(Response(chip, source.info(), {2e-12, 1e-12}), Error);
}

TEST(FeedMoving, LoopsAreTheSameHeldOrComputedAgain) {
  Moving source;
  source.info_.period_ns = 5'000'000;
  const Timeline timeline(source, {.warmup_loops = 2, .duration_us = 4000});
  PhotocurrentReader first(source, kChips[0]), second(source, kChips[1]);
  std::vector<Plane> planes;
  std::vector<std::vector<double>> t_us;
  for (const std::size_t loop_bytes : {kMovingLoopBytes, std::size_t{3 * Moving::kPixels * sizeof(float)}}) {
    planes.emplace_back(), t_us.emplace_back();
    const auto take = [&](const LightBatch& batch) {
      t_us.back().insert(t_us.back().end(), batch.t_us.begin(), batch.t_us.end());
      for (const auto* part : {&batch.planes, &batch.again})
        for (const float* plane : *part) planes.back().insert(planes.back().end(), plane, plane + Moving::kPixels);
      return true;
    };
    feed_moving(timeline, first, &second, take, loop_bytes);
  }
  EXPECT_GT(t_us[0].size(), 3 * 3 * 12);
  EXPECT_EQ(t_us[0], t_us[1]);
  EXPECT_EQ(planes[0], planes[1]);
}

}  // namespace
}  // namespace pecs::sensor
