// `pecs sense --model FILE.py:NAME`: Python runs the model in a process of its own (python/pecs/_model.py, which
// describes the messages).
#include <fmt/format.h>

#include <cstring>

#include "commands.h"
#include "pecs/error.h"
#include "pecs/platform.h"

namespace pecs::app {
namespace {

class PythonModels {
 public:
  PythonModels(std::string model, bool verbose)
      : model_(std::move(model)),
        python_(python()),
        child_(python_, words(verbose)),
        traits_(parse_json(text(answer()), model_)) {}

  sensor::UserModelEntry entry(const std::shared_ptr<PythonModels>& self) const {
    return {traits_.at("takes_light"), traits_.at("tells_causes"),
            [self](const Json& setup) { return std::make_unique<Instance>(self, setup); }};
  }

 private:
  class Instance : public sensor::UserModel {
   public:
    Instance(std::shared_ptr<PythonModels> models, const Json& setup) : models_(std::move(models)) {
      const std::string json = text_of(setup);
      models_->send({json.data(), json.size()});
      models_->answer();
      number_ = ++models_->begun_;
    }
    std::span<const sensor::UserEvent> interval(std::span<const float> planes,
                                                std::span<const double, 2> t_us) override {
      std::vector<char> head(1 + sizeof number_ + t_us.size_bytes(), 'i');
      std::memcpy(&head[1], &number_, sizeof number_);
      std::memcpy(&head[1 + sizeof number_], t_us.data(), t_us.size_bytes());
      models_->send(head, {reinterpret_cast<const char*>(planes.data()), planes.size_bytes()});
      const std::span<const char> rows = models_->answer();
      events_.resize(rows.size() / sizeof(sensor::UserEvent));
      std::memcpy(events_.data(), rows.data(), rows.size());
      return events_;
    }

   private:
    std::shared_ptr<PythonModels> models_;
    std::int64_t number_ = 0;
    std::vector<sensor::UserEvent> events_;
  };

  std::vector<std::string> words(bool verbose) const {
    std::vector<std::string> out = {python_, "-m", "pecs._model", model_};
    if (verbose) out.emplace_back("--verbose");
    return out;
  }

  void send(std::span<const char> first, std::span<const char> second = {}) {
    const auto size = static_cast<std::int64_t>(first.size() + second.size());
    if (!child_.write(&size, sizeof size) || !child_.write(first.data(), first.size()) ||
        !child_.write(second.data(), second.size()))
      throw ended();
  }

  // The last message, without its first byte if that is '='.
  std::span<const char> answer() {
    std::int64_t size = 0;
    if (!child_.read(&size, sizeof size)) throw ended();
    message_.resize(static_cast<std::size_t>(size));
    if (!child_.read(message_.data(), message_.size())) throw ended();
    if (message_[0] == '=') return std::span(message_).subspan(1);
    const Json json = parse_json(text(message_), model_);
    if (json.contains("error")) throw Error(ExitCode{json.at("code").get<int>()}, json.at("error").get<std::string>());
    return message_;
  }

  static std::string text(std::span<const char> bytes) { return {bytes.begin(), bytes.end()}; }

  Error ended() const {
    return {ExitCode::not_found, fmt::format("--model {}: {} ended; wanted a Python that has pecs (PECS_PYTHON), and "
                                             "a model that does not end it",
                                             model_, python_)};
  }

  std::string model_, python_;
  platform::Child child_;
  std::vector<char> message_;
  Json traits_;
  std::int64_t begun_ = 0;
};

}  // namespace

std::optional<std::string> python_file(const std::string& model) {
  const auto end = model.rfind(".py:");
  return end == std::string::npos ? std::nullopt : std::optional(model.substr(0, end + 3));
}

std::shared_ptr<const sensor::UserModelEntry> python_model(const std::string& model, bool verbose) {
  const auto models = std::make_shared<PythonModels>(model, verbose);
  return std::make_shared<sensor::UserModelEntry>(models->entry(models));
}

}  // namespace pecs::app
