// Pixel models of the caller's.
#include "guard.h"
#include "handles.h"

namespace pecs::capi {
namespace {

class CallersModel : public sensor::UserModel {
 public:
  CallersModel(const pecs_model& model, std::string name, const Json& setup)
      : model_(model), name_(std::move(name)), state_(model.begin(text_of(setup).c_str(), model.user)) {
    if (!state_) throw Error(ExitCode::bad_input, "model " + name_ + ": begin failed");
  }
  CallersModel(const CallersModel&) = delete;
  CallersModel& operator=(const CallersModel&) = delete;
  ~CallersModel() override {
    if (state_ && model_.end) model_.end(state_);
  }
  std::span<const sensor::UserEvent> interval(std::span<const float> planes, std::span<const double, 2> t_us) override {
    static_assert(sizeof(sensor::UserEvent) == 5 * sizeof(double));
    const double* events = nullptr;
    const std::int64_t count = model_.interval(state_, planes.data(), t_us.data(), &events);
    if (count < 0 || (count > 0 && !events))
      throw Error(ExitCode::bad_input, fmt::format("model {}: failed at {} to {} us", name_, t_us[0], t_us[1]));
    return {reinterpret_cast<const sensor::UserEvent*>(events), static_cast<std::size_t>(count)};
  }

 private:
  pecs_model model_;
  std::string name_;
  void* state_;
};

}  // namespace

void use_model(const pecs_model* model, sensor::ModelChoice& choice) {
  if (!model) return;
  given(model->begin, "begin"), given(model->interval, "interval");
  choice.user = std::make_shared<sensor::UserModelEntry>(sensor::UserModelEntry{
      model->takes_light != 0, model->tells_causes != 0, [model = *model, name = choice.name](const Json& setup) {
        return std::make_unique<CallersModel>(model, name, setup);
      }});
}

}  // namespace pecs::capi
