// A user's model as one of PECS's: whole pictures, interval by interval. What it returns is checked.
#include <fmt/format.h>

#include <array>

#include "models/frame_by_frame.h"
#include "pecs/error.h"

namespace pecs::sensor {
namespace {

class CheckedModel : public PixelModel {
 public:
  CheckedModel(const ModelSetup& s, const ModelChoice& choice)
      : name_("model " + choice.name),
        width_(s.width),
        height_(s.height),
        takes_light_(choice.user->takes_light),
        most_cause_(choice.user->tells_causes ? static_cast<double>(Cause::hot) : 0),
        per_unit_(takes_light_ ? s.per_unit * 1e-15 : s.per_unit),
        planes_(2 * s.pixels()),
        model_(choice.user->begin({{"width", s.width},
                                   {"height", s.height},
                                   {"seed", s.seed},
                                   {"chip", chip_to_json(s.chip)},
                                   {"parameters", s.parameters}})) {}

  void survey(const FrameBatch& batch, PixelRange range) override {
    const FramePlane frame(batch, 0, per_unit_);
    float* const before = planes_.data();
    float* const now = before + planes_.size() / 2;
    for (std::uint32_t k = range.first; k < range.end; ++k) {
      before[k] = now[k];
      now[k] = takes_light_ ? frame.value(k, before[k]) : frame.grey(k, before[k]);
    }
  }

  void advance(const FrameBatch& batch, PixelRange, EventSlots& events) override {
    if (batch.first_frame == 0) return;
    if (failed_) throw Error(ExitCode::usage, name_ + ": it failed before; open another sensor");
    failed_ = true;
    const FrameInterval t = interval_before(batch, 0);
    const std::span<const UserEvent> found = model_->interval(planes_, std::array{t.begin_us, t.end_us});
    for (std::size_t i = 0; i < found.size(); ++i) events.add(key_of(found[i], i, t));
    failed_ = false;
  }

 private:
  EventKey key_of(const UserEvent& e, std::size_t index, const FrameInterval& t) const {
    const auto check = [&](const char* what, double value, double least, double most, bool whole) {
      if (value >= least && value <= most && (!whole || value == std::floor(value))) return;
      throw bad_input(name_, fmt::format("event {} of {} to {} us: {}", index, t.begin_us, t.end_us, what),
                      fmt::format("{}", value),
                      fmt::format("{} in [{}, {}]", whole ? "a whole number" : "a number", least, most));
    };
    check("t", e.t_us, t.begin_us, t.end_us + UserModel::kMostDelay_us, false);
    check("x", e.x, 0, width_ - 1, true);
    check("y", e.y, 0, height_ - 1, true);
    check("p", e.on, 0, 1, true);
    check("cause", e.cause, 0, most_cause_, true);
    return event_key(std::llround(e.t_us), static_cast<std::uint32_t>(e.y * width_ + e.x), e.on != 0,
                     static_cast<Cause>(e.cause));
  }

  std::string name_;
  int width_, height_;
  bool takes_light_;
  double most_cause_, per_unit_;
  std::vector<float> planes_;  // at the begin and end of the interval
  std::unique_ptr<UserModel> model_;
  bool failed_ = false;
};

}  // namespace

std::unique_ptr<PixelModel> make_user_model(const ModelSetup& setup, const ModelChoice& choice) {
  return std::make_unique<CheckedModel>(setup, choice);
}

}  // namespace pecs::sensor
