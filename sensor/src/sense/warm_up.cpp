#include "sense/warm_up.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

#include "light/float_math.h"

namespace pecs::sensor {
namespace {

constexpr double kStep_us = 500;     // between planes
constexpr std::size_t kPlanes = 16;  // of a batch
constexpr float kTouch = 1e-4f;      // of ln I: the direction of pixels whose light is at kMostChange

}  // namespace

bool WarmUp::operator()(const LightBatch& light) {
  if (is_warm_ || length_us_ <= 0) return run_(light);
  const bool was_held = first_.has_value();
  if (!was_held) first_ = copy_of(light, 0);
  if (!was_held && light.planes.size() == 1 && !light.last) return true;
  is_warm_ = true;
  const std::size_t second = was_held || light.planes.size() == 1 ? 0 : 1;
  if (!warm(*first_, copy_of(light, second))) return false;
  if (was_held) {
    LightBatch held{{first_->light[0].data()}, {first_->t_us}, first_->steps, false};
    if (first_->light.size() > 1) held.again.push_back(first_->light[1].data());
    if (!run_(held)) return false;
  }
  first_.reset();
  return run_(light);
}

WarmUp::Plane WarmUp::copy_of(const LightBatch& light, std::size_t plane) const {
  Plane copy{light.t_us[plane], light.steps, {}};
  for (const auto* of : {&light.planes, &light.again})
    if (!of->empty()) copy.light.emplace_back((*of)[plane], (*of)[plane] + pixels_);
  return copy;
}

bool WarmUp::warm(const Plane& first, const Plane& second) {
  const std::size_t lights = first.light.size();
  const auto count = static_cast<std::size_t>(std::ceil(length_us_ / kStep_us));
  std::vector<std::vector<float>> per_us(lights, std::vector<float>(pixels_));  // change of ln I
  for (std::size_t k = 0; k < lights && second.t_us > first.t_us; ++k)
    for (std::size_t i = 0; i < pixels_; ++i) {
      const float change = log_of(second.light[k][i] / first.light[k][i]);
      per_us[k][i] = std::isfinite(change) ? change / static_cast<float>(second.t_us - first.t_us) : 0;
    }
  std::vector<std::vector<float>> planes(kPlanes * lights, std::vector<float>(pixels_));
  for (std::size_t begin = 0; begin < count; begin += kPlanes) {
    LightBatch batch;
    const std::size_t size = std::min(kPlanes, count - begin);
    for (std::size_t k = 0; k < size; ++k) {
      batch.planes.push_back(planes[lights * k].data());
      if (lights > 1) batch.again.push_back(planes[lights * k + 1].data());
      batch.t_us.push_back(length_us_ * static_cast<double>(begin + k) / static_cast<double>(count));
    }
    tbb::parallel_for(std::size_t{0}, size * lights, [&](std::size_t plane) {
      const std::size_t k = plane / lights, of = plane % lights;
      const auto before_us = static_cast<float>(length_us_ - batch.t_us[k]);
      for (std::size_t i = 0; i < pixels_; ++i) {
        const float slope = per_us[of][i];
        float change = std::clamp(slope * before_us, -kMostChange, kMostChange);
        if (begin + k == 0) change += slope > 0 ? kTouch : slope < 0 ? -kTouch : 0;
        planes[plane][i] = first.light[of][i] * (change == 0 ? 1 : exp_of(-change));
      }
    });
    if (!before_(batch)) return false;
  }
  return true;
}

}  // namespace pecs::sensor
