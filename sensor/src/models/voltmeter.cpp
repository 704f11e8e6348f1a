// DVS-Voltmeter: Lin, Ma, Guo, Wen, "DVS-Voltmeter: Stochastic Process-Based Event Simulator for Dynamic Vision
// Sensors", ECCV 2022. Between two frames the pixel's voltage is a Brownian motion with drift mu and scale sigma (Eq.
// 10, 11); the threshold that it reaches first, and the time, are drawn event by event (Algorithm 1). Thresholds are
// 1: k1 to k6 contain the camera's sensitivity. Uses no values of the chip.
#include "models/frame_by_frame.h"
#include "pecs/sensor/random.h"

namespace pecs::sensor {
namespace {

// The paper's camera DAVIS346; time in us, light in grey values.
constexpr ModelParameter kVoltmeterParameters[] = {
    {"k1", "1", 5.265, 0, 1e3, "threshold units per relative change of light (Eq. 10)"},
    {"k2", "grey", 20, 1e-3, 1e3, "dark light"},
    {"k3", "grey^.5/us^.5", 1e-4, 0, 1, "photon noise", true},
    {"k4", "1/us", 1e-7, -1e-3, 1e-3, "leak", true},
    {"k5", "1/(us grey)", 5e-9, -1e-3, 1e-3, "leak by light", true},
    {"k6", "1/us^.5", 1e-5, 1e-12, 1, "leak noise", true},
};

class Voltmeter : public PixelModel {
 public:
  explicit Voltmeter(const ModelSetup& s)
      : grey_per_unit_(s.per_unit),
        k1_(s.at("k1")),
        k2_(s.at("k2")),
        k3_(s.at("k3")),
        k4_(s.at("k4")),
        k5_(s.at("k5")),
        k6_(s.at("k6")),
        seed_(s.seed),
        grey_(s.pixels()),
        residual_(s.pixels()) {}

  void advance(const FrameBatch& batch, PixelRange range, EventSlots& events) override {
    each_frame(
        batch, range, grey_per_unit_, [&](std::uint32_t k, const FramePlane& frame) { grey_[k] = frame.grey(k, 0); },
        [&](std::uint32_t k, const FramePlane& frame, const FrameInterval& t) {
          const float grey = frame.grey(k, grey_[k]);
          step(k, grey, t, events);
          grey_[k] = grey;
        });
  }

 private:
  void step(std::uint32_t pixel, float grey, const FrameInterval& t, EventSlots& events) {
    const double mean = (static_cast<double>(grey) + grey_[pixel]) / 2,
                 change = static_cast<double>(grey) - grey_[pixel];
    const double mu = k1_ * change / (t.end_us - t.begin_us) / (mean + k2_) + k4_ + k5_ * mean;  // Eq. 10
    const double sigma = k3_ * std::sqrt(mean) / (mean + k2_) + k6_;                             // Eq. 11
    double at_us = t.begin_us, residual = residual_[pixel];
    for (std::int64_t draw = 0;; ++draw) {
      const Random4 r = random4(seed_, pixel, t.index << 20 | draw, Purpose::model);
      const double up = 1 - residual, down = 1 + residual;
      const bool on = uniform(r[0]) <= first_is_on(mu, sigma, up, down);
      const double distance = on ? up : down;
      const double dt_us = hitting_time(distance, std::abs(mu), sigma, gaussian(r[1]), uniform(r[2]));
      if (!(at_us + dt_us < t.end_us)) {
        residual += (on ? distance : -distance) * (t.end_us - at_us) / dt_us;
        break;
      }
      at_us += dt_us;
      residual = 0;
      events.add(event_key(std::llround(at_us), pixel, on));
    }
    residual_[pixel] = residual;
  }

  // Probability that the motion reaches `up` above before `down` below: (1 - e^-2mB) / (1 - e^-2m(A+B)), m =
  // mu/sigma^2.
  static double first_is_on(double mu, double sigma, double up, double down) {
    const double m = 2 * mu / (sigma * sigma);
    if (m == 0) return down / (up + down);
    if (m > 0) return std::expm1(-m * down) / std::expm1(-m * (up + down));
    return 1 - std::expm1(m * up) / std::expm1(m * (up + down));
  }

  // First passage over `distance`, given that it happens: inverse Gaussian (Michael, Schucany, Haas 1976), the same for
  // drift towards and away; Levy without drift.
  static double hitting_time(double distance, double drift, double sigma, double normal, double u) {
    const double shape = distance * distance / (sigma * sigma);
    if (drift == 0) return shape / (normal * normal);
    const double mean = distance / drift, y = mean * normal * normal;
    const double x = mean - 2 * mean * y / (y + std::sqrt(y * (4 * shape + y)));  // without cancellation
    return u <= mean / (mean + x) ? x : mean * mean / x;
  }

  double grey_per_unit_, k1_, k2_, k3_, k4_, k5_, k6_;
  std::uint64_t seed_;
  std::vector<float> grey_;
  std::vector<double> residual_;  // voltage since the last event
};

}  // namespace

extern const ModelEntry kModel_voltmeter{
    "voltmeter", "Lin, Ma, Guo, Wen, ECCV 2022", kVoltmeterParameters, {}, make_model<Voltmeter>};

}  // namespace pecs::sensor
