#include "pecs/sensor/event_labels.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "pecs/error.h"
#include "pecs/sensor/motion.h"

namespace pecs::sensor {
namespace {

using Labels = std::vector<std::int32_t>;

Labels read_labels(const StackReader& stack, const std::string& layer, std::int64_t frame) {
  const std::vector<float> values = stack.read_frame(frame, layer);
  Labels labels(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    const float v = values[i];
    if (std::isnan(v)) continue;
    if (!(v >= 0 && v <= 65535 && v == std::floor(v)))
      throw bad_input(stack.name(), fmt::format("layer {}", layer), fmt::format("{}", v), "whole numbers, 0 to 65535");
    labels[i] = static_cast<std::int32_t>(v);
  }
  return labels;
}

void check(std::span<const events::Event> events, const StackReader& stack, const std::string& name) {
  const StackInfo& info = stack.info();
  const Layer& layer = layer_of(info, name, stack.folder());
  if (layer.per_interval || layer.channels.size() != 1 || name == kLight)
    throw bad_input(stack.name(), fmt::format("layer {}", name), fmt::format("{} channels", layer.channels.size()),
                    "one channel, at instants");
  if (!stack.has_motion()) throw bad_input(stack.name(), "layers", "no motion", "a stack that has it");
  for (std::size_t i = 0; i < events.size(); ++i) {
    const events::Event& e = events[i];
    if (i && e.t_us < events[i - 1].t_us)
      throw bad_input("events", "t", fmt::format("{} after {}", e.t_us, events[i - 1].t_us), "the order of time");
    if (e.x >= info.width || e.y >= info.height)
      throw bad_input("events", "pixel", fmt::format("({}, {})", e.x, e.y),
                      fmt::format("one of {}x{}", info.width, info.height));
  }
}

}  // namespace

void event_labels(std::span<const events::Event> events, const StackReader& stack, const std::string& layer,
                  double begin_us, std::span<std::uint16_t> out) {
  check(events, stack, layer);
  const StackInfo& info = stack.info();
  const std::int64_t frames = stack.frames();
  const bool loops = info.period_ns && frames == std::ssize(info.times_ns);
  std::vector<double> bounds_us;  // of the intervals
  for (const std::int64_t t_ns : std::span(info.times_ns).first(static_cast<std::size_t>(frames)))
    bounds_us.push_back(1e-3 * static_cast<double>(t_ns - info.times_ns[0]));
  if (loops) bounds_us.push_back(1e-3 * static_cast<double>(*info.period_ns));
  // The middle one of a pixel's subpixels.
  const auto pixel = [&](const events::Event& e) {
    const int side = info.subpixels;
    return (e.y * side + side / 2) * info.file_width() + e.x * side + side / 2;
  };
  std::ranges::fill(out, std::uint16_t{0});
  const auto time_of = [&](const events::Event& e) { return static_cast<double>(e.t_us) - begin_us; };
  auto next = static_cast<std::size_t>(std::ranges::lower_bound(events, 0.0, {}, time_of) - events.begin());
  Labels first, second;
  std::int64_t held = -1;  // the frame of `second`
  while (bounds_us.size() > 1 && next < events.size()) {
    const double loop_us = loops ? std::floor(time_of(events[next]) / bounds_us.back()) * bounds_us.back() : 0;
    const double in_loop_us = time_of(events[next]) - loop_us;
    if (!loops && in_loop_us > bounds_us.back()) break;
    const auto above = std::upper_bound(bounds_us.begin() + 1, bounds_us.end(), in_loop_us) - bounds_us.begin() - 1;
    const std::int64_t frame = std::min<std::int64_t>(above, std::ssize(bounds_us) - 2);
    const double start = bounds_us[static_cast<std::size_t>(frame)];
    const double end = bounds_us[static_cast<std::size_t>(frame) + 1], length = end - start;
    const bool is_last = !loops && frame + 2 == frames;
    std::size_t behind = next + 1;
    const auto is_inside = [&](double t_us) { return t_us < end || (is_last && t_us == end); };
    while (behind < events.size() && is_inside(time_of(events[behind]) - loop_us)) ++behind;
    first = held == frame ? std::move(second) : read_labels(stack, layer, frame);
    second = read_labels(stack, layer, held = (frame + 1) % frames);
    const Carrier carrier(stack, frame);
    const auto parts = static_cast<double>(carrier.instants(length, Carrier::kStep_px * info.subpixels).size() + 1);
    std::vector<Carrier::Sight> sights;
    for (const events::Event& e : events.subspan(next, behind - next)) {
      const double part = std::clamp(std::floor((time_of(e) - loop_us - start) / length * parts), 0.0, parts - 1);
      sights.push_back({pixel(e), (part + 0.5) / parts});
    }
    Labels found(sights.size());
    carrier.labels(first.data(), second.data(), sights, found);
    std::ranges::transform(found, out.begin() + static_cast<std::ptrdiff_t>(next),
                           [](std::int32_t label) { return static_cast<std::uint16_t>(label); });
    next = behind;
  }
}

}  // namespace pecs::sensor
