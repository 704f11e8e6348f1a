#include "pecs/sensor/sense.h"

#include <fmt/format.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>
#include <tbb/task_group.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <iterator>
#include <utility>

#include "light_kernel.h"
#include "models/pecs/pixels.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/files.h"
#include "pecs/progress.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/sensor.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {
namespace {

constexpr std::size_t kFrameBytes = std::size_t{32} << 20;  // planes of one batch; two batches are held
constexpr std::size_t kLoopBytes = std::size_t{128} << 20;  // planes of a band of rows of a looped stack

// Values that no light has, by pixel and frame.
struct BadValues {
  std::atomic<std::int64_t> not_finite{0}, negative{0};
};

// Decodes frames to photocurrent [fA], without dark current.
class PhotocurrentReader {
 public:
  PhotocurrentReader(const FrameSource& stack, const std::vector<double>& amperes) : stack_(stack) {
    for (const double a : amperes) femtoamperes_.push_back(static_cast<float>(a * 1e15));
  }

  // Rows [begin, end) of a frame into `plane`. Not finite stays so: the pixel holds its last value. Negative light is
  // 0.
  void read(std::int64_t frame, int begin, int end, float* plane) {
    const auto width = static_cast<std::size_t>(stack_.info().width);
    stack_.read_rows(
        frame,
        [&](int y, int rows, std::span<const float> values) {
          const std::size_t n = width * static_cast<std::size_t>(rows);
          float* out = plane + static_cast<std::size_t>(y - begin) * width;
          if (weighted_sum(femtoamperes_, values.data(), {out, n})) count_bad(values.data(), n, out);
        },
        begin, end);
  }
  const BadValues& bad() const { return bad_; }

 private:
  void count_bad(const float* values, std::size_t n, float* out) {
    for (std::size_t i = 0; i < n; ++i) {
      bool negative = false, not_finite = false;
      for (std::size_t b = 0; b < femtoamperes_.size(); ++b) {
        negative |= values[b * n + i] < 0;
        not_finite |= !std::isfinite(values[b * n + i]);
      }
      if (not_finite) {
        out[i] = std::numeric_limits<float>::quiet_NaN();
        ++bad_.not_finite;
      } else if (negative) {
        out[i] = std::max(out[i], 0.0f);
        ++bad_.negative;
      }
    }
  }

  const FrameSource& stack_;
  std::vector<float> femtoamperes_;
  BadValues bad_;
};

// Light of the first frame, for the record.
class LightStatistics {
 public:
  void add(std::span<const float> plane) {
    for (const float i : plane)
      if (std::isfinite(i)) values_.push_back(i);
  }
  Json report(const Chip& chip) {
    Json light;
    if (values_.empty()) values_.push_back(0);
    for (const auto& [name, part] : {std::pair{"p05", 0.05}, {"median", 0.5}, {"p95", 0.95}}) {
      const auto at = values_.begin() + static_cast<std::ptrdiff_t>(part * static_cast<double>(values_.size() - 1));
      std::ranges::nth_element(values_, at);
      const double a = 1e-15 * *at;
      light["photocurrent_a"][name] = a;
      light["corner_hz"][name] = chip.corner_hz_per_a * (a + chip.dark_current_a);
    }
    return light;
  }

 private:
  std::vector<float> values_;
};

// Causes of the events, in their order: a NumPy file of bytes.
class LabelFile {
 public:
  void add(std::span<const Cause> causes) { causes_.insert(causes_.end(), causes.begin(), causes.end()); }
  void write(const std::filesystem::path& path) const {
    std::string header = fmt::format("{{'descr': '|u1', 'fortran_order': False, 'shape': ({},), }}", causes_.size());
    header.resize((10 + header.size() + 1 + 63) / 64 * 64 - 11, ' ');
    AtomicFile file(path);
    file.write(std::string("\x93NUMPY\x01\x00", 8));
    const auto size = static_cast<std::uint16_t>(header.size() + 1);
    file.write(std::string{static_cast<char>(size & 0xff), static_cast<char>(size >> 8)});
    file.write(header + "\n");
    file.write(std::as_bytes(std::span(causes_)));
    file.commit();
  }

 private:
  std::vector<Cause> causes_;
};

// What went to the file.
struct Counts {
  std::int64_t events = 0, on = 0, first_us = 0, last_us = 0;
  void add(std::span<const events::Event> batch) {
    if (batch.empty()) return;
    if (events == 0) first_us = batch.front().t_us;
    last_us = batch.back().t_us;
    events += static_cast<std::int64_t>(batch.size());
    on += std::ranges::count(batch, 1, &events::Event::p);
  }
};

// The first frame's spectra, to draw bands by and to say what the draw costs.
struct FirstFrame {
  explicit FirstFrame(const FrameSource& stack)
      : pixels(static_cast<std::size_t>(stack.info().width) * static_cast<std::size_t>(stack.info().height)),
        mean(stack.info().bands.size()) {
    values.resize(mean.size() * pixels);
    const auto width = static_cast<std::size_t>(stack.info().width);
    stack.read_rows(0, [&](int y, int rows, std::span<const float> block) {
      const std::size_t n = width * static_cast<std::size_t>(rows);
      for (std::size_t b = 0; b < mean.size(); ++b)
        for (std::size_t i = 0; i < n; ++i) {
          const float v = block[b * n + i];
          if (std::isfinite(v) && v > 0) mean[b] += values[b * pixels + static_cast<std::size_t>(y) * width + i] = v;
        }
    });
    for (double& m : mean) m /= static_cast<double>(pixels);
  }
  // RMS over the pixels of ln of the ratio of two weighted sums, their mean ratio taken out.
  double log_difference(const std::vector<double>& a, const std::vector<double>& b) const {
    double n = 0, sum = 0, square = 0;
    for (std::size_t i = 0; i < pixels; ++i) {
      double x = 0, y = 0;
      for (std::size_t k = 0; k < mean.size(); ++k) {
        x += a[k] * values[k * pixels + i];
        y += b[k] * values[k * pixels + i];
      }
      if (!(x > 0 && y > 0)) continue;
      const double d = std::log(x / y);
      n += 1;
      sum += d;
      square += d * d;
    }
    return n > 0 ? std::sqrt(std::max(0.0, square / n - sum / n * (sum / n))) : 0;
  }
  std::size_t pixels;
  std::vector<double> mean;
  std::vector<float> values;
};

struct Run {
  const SenseOptions& options;
  const FrameSource& stack;
  const Chip& chip;
  PhotocurrentReader& light;
  LightStatistics statistics{};
  events::Writer& writer;
  Counts counts{};
  LabelFile labels{};
  ModelChoice model{};
  std::int64_t dropped = 0;

  // The events of [from, to), counted from `from`.
  void write(LabelledEvents& found, std::int64_t from_us, std::int64_t to_us) {
    auto& all = found.events;
    const auto place = [&](std::int64_t t) { return std::ranges::lower_bound(all, t, {}, &events::Event::t_us); };
    const auto a = place(from_us), b = std::max(a, place(to_us));
    for (auto e = a; e != b; ++e) e->t_us -= from_us;
    if (options.labels)
      labels.add(
          std::span(found.causes).subspan(static_cast<std::size_t>(a - all.begin()), static_cast<std::size_t>(b - a)));
    counts.add({a, b});
    writer.write({a, b});
    found.events.clear();
    found.causes.clear();
  }

  // The other simulators' pixels see pictures: something must be white.
  void find_white(std::span<const float> plane) {
    if (model.name == "pecs" || model.white_fa > 0) return;
    std::vector<float> values;
    for (const float v : plane)
      if (std::isfinite(v)) values.push_back(v);
    if (!values.empty()) {
      const auto at = values.begin() + static_cast<std::ptrdiff_t>(0.995 * static_cast<double>(values.size() - 1));
      std::ranges::nth_element(values, at);
      model.white_fa = *at;
    }
    if (!(model.white_fa > 0)) throw bad_input(stack.name(), "first frame", "no light", "--white-a");
  }

  // Batch by batch: one is sensed while the next is decoded.
  void stream() {
    const StackInfo& info = stack.info();
    const auto width = static_cast<std::size_t>(info.width), height = static_cast<std::size_t>(info.height);
    const std::int64_t frames = stack.frames();
    const auto threads = static_cast<std::size_t>(tbb::this_task_arena::max_concurrency());
    const auto batch = static_cast<std::int64_t>(std::clamp(kFrameBytes / (width * height * sizeof(float)),
                                                            std::min<std::size_t>(threads, 16), std::size_t{64}));
    const std::int64_t origin_us = options.start_us;
    const std::int64_t end_us =
        options.duration_us ? origin_us + *options.duration_us : std::numeric_limits<std::int64_t>::max();

    Progress progress("sense", static_cast<std::uint64_t>(frames), options.quiet, options.progress);
    std::array<std::vector<std::vector<float>>, 2> planes;
    for (auto& half : planes) half.assign(static_cast<std::size_t>(std::min(batch, frames)), {});
    const auto decode = [&](std::int64_t first) {
      auto& half = planes[static_cast<std::size_t>(first / batch % 2)];
      for (std::int64_t i = first + batch; i < std::min(frames, first + 2 * batch); ++i) stack.will_read(i);
      tbb::parallel_for(first, std::min(frames, first + batch), [&](std::int64_t i) {
        auto& plane = half[static_cast<std::size_t>(i - first)];
        plane.resize(width * height);
        light.read(i, 0, info.height, plane.data());
      });
    };

    decode(0);
    statistics.add(planes[0][0]);
    find_white(planes[0][0]);
    Sensor sensor(chip, info.width, info.height, options.seed, 1.0, model,
                  {!options.ideal_readout, options.labels.has_value()});
    LabelledEvents events;
    for (std::int64_t first = 0; first < frames; first += batch) {
      const std::int64_t end = std::min(frames, first + batch);
      tbb::task_group next;
      if (end < frames) next.run([&] { decode(end); });
      std::vector<const float*> pointers;
      std::vector<double> t_us;
      for (std::int64_t i = first; i < end; ++i) {
        pointers.push_back(
            planes[static_cast<std::size_t>(first / batch % 2)][static_cast<std::size_t>(i - first)].data());
        t_us.push_back(static_cast<double>(info.times_ns[static_cast<std::size_t>(i)] - info.times_ns[0]) * 1e-3);
      }
      sensor.push(pointers, t_us, end == frames, events);
      write(events, origin_us, end_us);
      next.wait();
      progress.at(static_cast<std::uint64_t>(end));
    }
    dropped = sensor.dropped();
  }

  // A periodic stack again and again: band by band of rows, whose frames fit into memory.
  void loop() {
    const StackInfo& info = stack.info();
    const auto width = static_cast<std::size_t>(info.width);
    const std::int64_t frames = stack.frames();
    const double period_us = static_cast<double>(*info.period_ns) * 1e-3;
    const double origin_us = options.warmup_loops * period_us + static_cast<double>(options.start_us);
    const double duration_us = options.duration_us ? static_cast<double>(*options.duration_us) : period_us;
    const auto loops = static_cast<std::int64_t>(std::ceil((origin_us + duration_us) / period_us));
    const std::int64_t total = loops * frames + 2;  // the last interval of the window needs two frames more
    const auto from_us = static_cast<std::int64_t>(std::llround(origin_us));
    const std::int64_t to_us = from_us + static_cast<std::int64_t>(std::llround(duration_us));

    if (static_cast<double>(to_us) > kMostTime_us)
      throw bad_input(stack.name(), "loops", fmt::format("{} us", to_us), fmt::format("at most {} us", kMostTime_us));

    const std::size_t row_bytes = width * static_cast<std::size_t>(frames) * sizeof(float);
    int rows = static_cast<int>(std::min<std::size_t>(kLoopBytes / row_bytes, static_cast<std::size_t>(info.height)));
    if (rows == 0)
      throw bad_input(stack.name(), "period_ns", fmt::format("{} frames of {} columns", frames, width),
                      fmt::format("a row's loop of at most {} MiB", kLoopBytes >> 20));
    if (rows > 16 && rows < info.height) rows -= rows % 16;  // whole blocks of the file

    PecsPixels pixels(chip, info.width, info.height, options.seed, 1.0, options.labels.has_value());
    EventSorter order(info.width, options.labels.has_value());
    Progress progress("sense", static_cast<std::uint64_t>(info.height), options.quiet, options.progress);
    std::vector<float> cache(row_bytes / sizeof(float) * static_cast<std::size_t>(rows));
    std::vector<std::vector<EventKey>> found;
    for (int y = 0; y < info.height; y += rows) {
      const int end = std::min(info.height, y + rows);
      const std::size_t plane = width * static_cast<std::size_t>(end - y);
      tbb::parallel_for(std::int64_t{0}, frames, [&](std::int64_t i) {
        light.read(i, y, end, cache.data() + static_cast<std::size_t>(i) * plane);
      });
      statistics.add(std::span(cache).first(plane));

      const auto first = static_cast<std::uint32_t>(width * static_cast<std::size_t>(y));
      const auto last = static_cast<std::uint32_t>(first + plane);
      const std::uint32_t first_block = first / PecsPixels::kBlock,
                          blocks = (last + PecsPixels::kBlock - 1) / PecsPixels::kBlock;
      found.resize(std::max<std::size_t>(found.size(), blocks));
      tbb::parallel_for(first_block, blocks, [&](std::uint32_t block) {
        const std::uint32_t a = std::max(first, block * PecsPixels::kBlock);
        const std::uint32_t b = std::min(last, (block + 1) * PecsPixels::kBlock);
        EventSlots all;
        std::vector<double> recent;
        for (std::int64_t k = 0; k < total; k += 64) {
          FrameBatch batch{k, {}, recent, false};
          for (std::int64_t i = k; i < std::min(total, k + 64); ++i) {
            const auto frame = static_cast<std::size_t>(i % frames);
            // Indexed by the chip's pixel: points to where pixel 0 would be.
            batch.planes.push_back(cache.data() + frame * plane - first);
            batch.t_us.push_back(static_cast<double>(i / frames) * period_us +
                                 static_cast<double>(info.times_ns[frame] - info.times_ns[0]) * 1e-3);
          }
          pixels.advance(batch, a, b - a, all);
          recent.assign(batch.t_us.end() - 2, batch.t_us.end());
          std::ranges::copy_if(all[0], std::back_inserter(found[block]),
                               [&](EventKey key) { return key_time_us(key) >= from_us && key_time_us(key) < to_us; });
          all[0].clear();
        }
      });
      progress.at(static_cast<std::uint64_t>(end));
    }
    std::vector<double> slots_us;
    for (int i = 0; i < 256; ++i) slots_us.push_back(origin_us + duration_us * i / 256);
    order.begin(slots_us);
    for (auto& keys : found) {
      for (const EventKey key : keys) order.part(0).add(key);
      keys = {};
    }
    LabelledEvents fired, sent;
    order.take(to_us, 0, fired);
    if (options.ideal_readout || is_ideal_readout(chip)) {
      sent = std::move(fired);
    } else {
      Readout readout(chip, info.width, info.height, options.seed);
      readout.push(fired, true, sent);
      dropped = readout.dropped();
    }
    write(sent, from_us, to_us);
  }
};

}  // namespace

namespace {
Json white_photocurrent(const LightOptions& light, const StackInfo& info) {
  if (info.quantity != Quantity::relative || light.gain) return {};
  return light.photocurrent_a.value_or(kDefaultWhite_a);
}
}  // namespace

SenseReport sense(const SenseOptions& options) {
  const Chip given = load_chip(options.chip, options.overrides);
  const Chip chip = options.no_noise ? without_noise(given) : given;
  const std::shared_ptr<const FrameSource> source =
      options.source ? options.source : std::make_shared<StackReader>(options.stack, options.times);
  const FrameSource& stack = *source;
  const StackInfo& info = stack.info();
  if (stack.frames() < static_cast<std::int64_t>(info.times_ns.size()))
    throw bad_input(options.stack.string(), "frames", fmt::format("{} so far", stack.frames()),
                    fmt::format("the {} of times_ns", info.times_ns.size()));
  if (stack.frames() < 2) throw bad_input(options.stack.string(), "frames", "1", "at least 2");
  check_fits(chip, info.width, info.height, options.stack.string());
  const bool looped = options.warmup_loops > 0 || (info.period_ns && options.duration_us);
  if (looped && !info.period_ns)
    throw bad_input(options.stack.string(), "period_ns", "nothing", "a period, for --warmup-loops");
  if (looped && options.model.name != "pecs")
    throw Error(ExitCode::usage,
                fmt::format("--model {}: got a loop of a periodic stack, wanted pecs", options.model.name));
  model_to_json(options.model);  // a wrong model or parameter is refused before any work

  std::vector<double> amperes = amperes_per_unit(chip, info, options.light);
  Json drawn;
  if (options.monte_carlo_bands > 0) {
    const FirstFrame first(stack);
    const std::vector<double> dense =
        std::exchange(amperes, monte_carlo(amperes, first.mean, options.monte_carlo_bands, options.seed));
    drawn = {{"samples", options.monte_carlo_bands},
             {"bands", std::ranges::count_if(amperes, [](double a) { return a > 0; })},
             {"of", amperes.size()},
             {"rms_error_of_ln_photocurrent", first.log_difference(amperes, dense)}};
  }
  PhotocurrentReader light(stack, amperes);
  events::StreamInfo stream_info{info.width, info.height, chip.name};
  const auto writer = events::open_writer(options.output, stream_info, options.format);
  Run run{options, stack, chip, light, {}, *writer, {}, {}, options.model};
  std::optional<tbb::global_control> limit;
  if (options.threads > 0)
    limit.emplace(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(options.threads));
  tbb::task_arena arena(options.threads > 0 ? options.threads : tbb::task_arena::automatic);
  arena.execute([&] { looped ? run.loop() : run.stream(); });
  writer->close();
  if (options.labels) run.labels.write(*options.labels);

  SenseReport report;
  const Counts& c = run.counts;
  const double seconds = static_cast<double>(c.last_us - c.first_us) * 1e-6;
  report.config = {{"chip", chip_to_json(chip)},
                   {"model", model_to_json(run.model)},
                   {"readout", options.ideal_readout ? "ideal" : "chip"},
                   {"input", stack.layout()},
                   {"bands", options.monte_carlo_bands ? fmt::format("mc:{}", options.monte_carlo_bands) : "all"},
                   {"gain", options.light.gain ? Json(*options.light.gain) : Json()},
                   {"white_photocurrent_a", white_photocurrent(options.light, info)},
                   {"seed", options.seed},
                   {"no_noise", options.no_noise},
                   {"warmup_loops", options.warmup_loops},
                   {"start_us", options.start_us},
                   {"duration_us", options.duration_us ? Json(*options.duration_us) : Json()},
                   {"fnumber", options.light.fnumber ? Json(*options.light.fnumber) : Json()},
                   {"fps", options.times.fps ? Json(*options.times.fps) : Json()}};
  report.results = run.statistics.report(chip);
  if (!drawn.is_null()) report.results["monte_carlo"] = drawn;
  report.results.update(
      {{"width", info.width},
       {"height", info.height},
       {"frames", stack.frames()},
       {"events", c.events},
       {"on_fraction", c.events ? Json(static_cast<double>(c.on) / static_cast<double>(c.events)) : Json()},
       {"dropped", run.dropped},
       {"t_first_us", c.first_us},
       {"t_last_us", c.last_us},
       {"rate_hz", seconds > 0 ? Json(static_cast<double>(c.events) / seconds) : Json()},
       {"bad_values", {{"not_finite", light.bad().not_finite.load()}, {"negative", light.bad().negative.load()}}}});
  return report;
}

}  // namespace pecs::sensor
