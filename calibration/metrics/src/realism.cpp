#include "pecs/metrics/realism.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <random>

#include "patches.h"

namespace pecs::metrics {
namespace {

using events::Event;

constexpr int kFolds = 4, kLevels = 9, kDraws = 300;
constexpr double kLeastNamed = 0.55, kTie = 0.8;  // area of a cue that is named; share of the strongest one's excess
constexpr double kRidge = 3;
constexpr std::size_t kLeastPatches = 10;  // of a class in a fold

// A patch with its class (0: recording), its weight, and the block of its stream.
struct Row {
  const Patch* patch;
  int label;
  std::size_t block;
  double weight = 1;
};

// Logistic regression on features in bins, with a ridge: sixths of the patches, and quarters of the range, so that a
// value in a gap between the classes is in neither's bin.
class Regression {
 public:
  Regression(const std::vector<Row>& rows, const std::vector<int>& features) : features_(features) {
    for (const int f : features_) {
      std::vector<float> values;
      for (const Row& r : rows) values.push_back(r.patch->values[static_cast<std::size_t>(f)]);
      std::sort(values.begin(), values.end());
      std::vector<float> edges;
      for (std::size_t k = 1; k < 6; ++k) edges.push_back(values[values.size() * k / 6]);
      for (const float part : {0.25F, 0.5F, 0.75F}) edges.push_back(std::lerp(values.front(), values.back(), part));
      std::sort(edges.begin(), edges.end());
      edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
      edges_.push_back(edges);
    }
    const auto size = static_cast<Eigen::Index>(features_.size() * kLevels + 1);
    coefficients_ = Eigen::VectorXd::Zero(size);
    std::vector<std::vector<Eigen::Index>> at;
    for (const Row& r : rows) at.push_back(columns(*r.patch));
    for (int step = 0; step < 20; ++step) {  // Newton's, halved until the loss falls
      Eigen::VectorXd gradient = kRidge * coefficients_;
      Eigen::MatrixXd hessian = kRidge * Eigen::MatrixXd::Identity(size, size);
      for (std::size_t i = 0; i < rows.size(); ++i) {
        const double p = 1 / (1 + std::exp(-sum(at[i])));
        for (const auto a : at[i]) {
          gradient[a] += rows[i].weight * (p - rows[i].label);
          for (const auto b : at[i]) hessian(a, b) += rows[i].weight * p * (1 - p);
        }
      }
      const double before = loss(rows, at);
      Eigen::VectorXd change = hessian.llt().solve(gradient);
      coefficients_ -= change;
      while (loss(rows, at) > before && change.cwiseAbs().maxCoeff() > 1e-4) change /= 2, coefficients_ += change;
      if (change.cwiseAbs().maxCoeff() < 1e-3) break;
    }
  }

  double score(const Patch& patch) const { return sum(columns(patch)); }

 private:
  std::vector<Eigen::Index> columns(const Patch& patch) const {
    std::vector<Eigen::Index> at{0};
    for (std::size_t k = 0; k < features_.size(); ++k) {
      const auto bin =
          std::upper_bound(edges_[k].begin(), edges_[k].end(), patch.values[static_cast<std::size_t>(features_[k])]) -
          edges_[k].begin();
      at.push_back(1 + static_cast<Eigen::Index>(k) * kLevels + bin);
    }
    return at;
  }
  double sum(const std::vector<Eigen::Index>& at) const {
    return std::accumulate(at.begin(), at.end(), 0.0, [&](double s, auto a) { return s + coefficients_[a]; });
  }

  double loss(const std::vector<Row>& rows, const std::vector<std::vector<Eigen::Index>>& at) const {
    double all = kRidge / 2 * coefficients_.squaredNorm();
    for (std::size_t i = 0; i < rows.size(); ++i)
      all += rows[i].weight * std::log1p(std::exp(rows[i].label ? -sum(at[i]) : sum(at[i])));
    return all;
  }

  std::vector<int> features_;
  std::vector<std::vector<float>> edges_;
  Eigen::VectorXd coefficients_;
};

struct Scored {
  double score, weight;
  int label;
  std::size_t block;
};

// The area of rows in the order of their scores, with a factor for each block.
double area(const std::vector<Scored>& rows, const std::vector<double>& factors) {
  double below = 0, won = 0;
  std::array<double, 2> total{};
  for (std::size_t i = 0; i < rows.size();) {
    std::array<double, 2> tied{};
    const double score = rows[i].score;
    for (; i < rows.size() && rows[i].score == score; ++i)
      tied[static_cast<std::size_t>(rows[i].label)] += rows[i].weight * factors[rows[i].block];
    won += tied[1] * (below + tied[0] / 2);
    below += tied[0];
    total[0] += tied[0], total[1] += tied[1];
  }
  return won / (total[0] * total[1]);
}

// Trained on each quarter (half of time and sensor), judged on the opposite one.
Auc auc_of(const std::vector<Row>& rows, const std::vector<int>& features, std::size_t blocks, std::uint64_t seed) {
  std::array<std::vector<Row>, kFolds> folds;
  for (const Row& r : rows) folds[static_cast<std::size_t>(r.patch->fold)].push_back(r);
  std::array<std::vector<Scored>, kFolds> scored;
  for (std::size_t k = 0; k < kFolds; ++k) {
    const Regression trained(folds[kFolds - 1 - k], features);
    for (const Row& r : folds[k]) scored[k].push_back({trained.score(*r.patch), r.weight, r.label, r.block});
    std::stable_sort(scored[k].begin(), scored[k].end(), [](auto& a, auto& b) { return a.score < b.score; });
  }
  std::vector<double> factors(blocks, 1.0);
  const auto mean = [&] {
    double sum = 0;
    for (const auto& fold : scored) sum += area(fold, factors) / kFolds;
    return sum;
  };
  Auc auc{mean(), {}};
  std::mt19937_64 random(seed);
  std::vector<double> draws;
  for (int draw = 0; draw < kDraws; ++draw) {  // Bayesian bootstrap: exponential factors
    for (double& f : factors) f = -std::log((static_cast<double>(random() >> 11) + 0.5) * 0x1p-53);
    draws.push_back(mean());
  }
  std::sort(draws.begin(), draws.end());
  // Both directions of a half have the same blocks: their errors add up instead of averaging.
  const auto end = [&](double at) { return std::clamp(auc.value + std::numbers::sqrt2 * (at - auc.value), 0.0, 1.0); };
  auc.interval = {end(draws[kDraws / 40]), end(draws[kDraws - 1 - kDraws / 40])};
  return auc;
}

// Weights with which both classes of each fold sum up to half of its patches, and, if `matched`, have the same
// distribution of the number of events.
bool weigh(std::vector<Row>& rows, bool matched) {
  std::vector<float> rates;
  for (const Row& r : rows) rates.push_back(r.patch->values[0]);
  std::sort(rates.begin(), rates.end());
  const auto bin = [&](const Row& r) {
    if (!matched) return 0;
    const auto rank = std::lower_bound(rates.begin(), rates.end(), r.patch->values[0]) - rates.begin();
    return static_cast<int>(rank * 12 / static_cast<std::ptrdiff_t>(rates.size()));
  };
  std::map<std::pair<int, int>, std::array<double, 2>> counts;  // by fold and bin
  for (const Row& r : rows) ++counts[{r.patch->fold, bin(r)}][static_cast<std::size_t>(r.label)];
  std::array<std::array<double, 2>, kFolds> there{};
  for (Row& r : rows) {
    const auto& n = counts[{r.patch->fold, bin(r)}];
    const double least = std::min(n[0], n[1]), total = n[0] + n[1];
    r.weight = least > 0 ? (matched ? least : total / 2) / n[static_cast<std::size_t>(r.label)] : 0;
    there[static_cast<std::size_t>(r.patch->fold)][static_cast<std::size_t>(r.label)] += r.weight > 0;
  }
  std::erase_if(rows, [](const Row& r) { return r.weight == 0; });
  return std::all_of(there.begin(), there.end(),
                     [](const auto& n) { return static_cast<std::size_t>(std::min(n[0], n[1])) >= kLeastPatches; });
}

// Largest time of which all times from the first event are multiples.
std::int64_t tick_of(const std::vector<Event>& events) {
  std::int64_t tick = 0;
  for (const Event& e : events) tick = std::gcd(tick, e.t_us - events.front().t_us);
  return std::max<std::int64_t>(1, tick);
}

std::vector<int> range(int first, int count) {
  std::vector<int> out(static_cast<std::size_t>(count));
  std::iota(out.begin(), out.end(), first);
  return out;
}

// The strongest cues but rate that are not chance, at most two. What changes other cues as well stands before them in
// kCueGroups, and is named before them if its area's excess over chance is at
// least kTie of the strongest one's.
std::vector<std::string> named(std::vector<Cue> cues) {
  std::erase_if(
      cues, [](const Cue& c) { return c.name == "rate" || c.auc.interval.low <= 0.5 || c.auc.value < kLeastNamed; });
  std::vector<std::string> names;
  while (!cues.empty() && names.size() < 2) {
    const auto most = std::ranges::max(cues, {}, [](const Cue& c) { return c.auc.value; }).auc.value;
    const auto first =
        std::ranges::find_if(cues, [&](const Cue& c) { return c.auc.value - 0.5 >= kTie * (most - 0.5); });
    names.push_back(first->name);
    cues.erase(first);
  }
  return names;
}

// The recording against itself: a label is drawn for each block, ten times. The interval is that of one draw.
std::optional<Auc> floor_of(const std::vector<Patch>& patches, const std::vector<int>& features, std::uint64_t seed) {
  constexpr int kLabels = 10;
  std::mt19937_64 random(seed);
  double sum = 0, square = 0, n = 0;
  for (int draw = 0; draw < kLabels; ++draw) {
    std::map<std::uint32_t, int> labels;
    std::vector<Row> rows;
    for (const Patch& p : patches) {
      const auto [label, is_new] = labels.try_emplace(p.block, 0);
      if (is_new) label->second = static_cast<int>(random() >> 63);
      rows.push_back({&p, label->second, 0});
    }
    if (!weigh(rows, false)) continue;
    const double value = auc_of(rows, features, 1, 0).value;
    sum += value, square += value * value, ++n;
  }
  if (n < 2) return {};
  const double mean = sum / n, spread = 1.96 * std::sqrt(std::max(0.0, square - n * mean * mean) / (n - 1));
  return Auc{mean, {std::max(0.0, mean - spread), std::min(1.0, mean + spread)}};
}

Json json_of(const Auc& a) { return {{"auc", a.value}, {"interval", {a.interval.low, a.interval.high}}}; }

}  // namespace

std::optional<Realism> realism(const events::Stream& real, const events::Stream& sim, std::uint64_t seed) {
  if (real.events.empty() || sim.events.empty()) return {};
  const std::int64_t end_us = std::min(real.events.back().t_us, sim.events.back().t_us) + 1;
  const std::int64_t tick_us = std::max(tick_of(real.events), tick_of(sim.events));
  const auto patches = [&](const events::Stream& s) {
    std::vector<Event> events(
        s.events.begin(), std::find_if(s.events.begin(), s.events.end(), [&](auto& e) { return e.t_us >= end_us; }));
    std::sort(events.begin(), events.end(), [](const Event& a, const Event& b) {  // whatever the file's order
      return std::tie(a.t_us, a.y, a.x, a.p) < std::tie(b.t_us, b.y, b.x, b.p);
    });
    return patches_of(events, s.info.width, s.info.height, end_us, tick_us);
  };
  const auto real_patches = patches(real), sim_patches = patches(sim);

  std::vector<Row> rows;
  std::map<std::pair<int, std::uint32_t>, std::size_t> blocks;
  for (const Patch& p : real_patches)
    rows.push_back({&p, 0, blocks.try_emplace({0, p.block}, blocks.size()).first->second});
  for (const Patch& p : sim_patches)
    rows.push_back({&p, 1, blocks.try_emplace({1, p.block}, blocks.size()).first->second});

  Realism r;
  r.real_patches = real_patches.size(), r.sim_patches = sim_patches.size();
  std::vector<Row> matched = rows;
  if (!weigh(rows, false)) return {};
  r.matched = weigh(matched, true);
  if (!r.matched) matched = rows;
  const auto all = range(0, kFeatures);
  r.all = auc_of(rows, all, blocks.size(), seed);
  r.floor = floor_of(real_patches, all, seed);
  for (const CueGroup& g : kCueGroups) {
    const auto& used = g.first == 0 ? rows : matched;
    Cue cue{g.name, g.quantity, g.values, auc_of(used, range(g.first, g.count), blocks.size(), seed), 0, 0};
    std::array<double, 2> sum{}, weight{};
    for (const Row& row : used) {
      sum[static_cast<std::size_t>(row.label)] += row.weight * row.patch->values[static_cast<std::size_t>(g.first)];
      weight[static_cast<std::size_t>(row.label)] += row.weight;
    }
    cue.real = sum[0] / weight[0], cue.sim = sum[1] / weight[1];
    if (g.log10) cue.real = std::pow(10, cue.real), cue.sim = std::pow(10, cue.sim);
    r.cues.push_back(cue);
  }
  r.named = named(r.cues);
  return r;
}

std::vector<std::string> sentences(const Realism& r) {
  std::vector<std::string> found{fmt::format(
      "Realism: a classifier tells patches of the simulation from patches of the recording with an area under the "
      "curve of {:.2f} ({:.2f} to {:.2f}); 0.5 is chance, 1 is always. Recording against itself: {}.",
      r.all.value, r.all.interval.low, r.all.interval.high,
      r.floor ? fmt::format("{:.2f} ({:.2f} to {:.2f})", r.floor->value, r.floor->interval.low, r.floor->interval.high)
              : "too few patches")};
  for (const std::string& name : r.named) {
    const Cue& c = *std::ranges::find(r.cues, name, &Cue::name);
    found.push_back(
        fmt::format("{} cue: {} (area {:.2f}). Among patches{}, the {} is {:.3g} in the recording and "
                    "{:.3g} "
                    "in the simulation. To change: {}.",
                    found.size() == 1 ? "Strongest" : "Second", c.name, c.auc.value,
                    r.matched ? " of equal numbers of events" : "", c.quantity, c.real, c.sim, c.values));
  }
  const Cue& rate = r.cues.front();
  if (rate.auc.interval.low > 0.5)
    found.push_back(
        fmt::format("Patches have {:.3g} events in the recording and {:.3g} in the simulation (area {:.2f}). "
                    "To change: {}.",
                    rate.real, rate.sim, rate.auc.value, rate.values));
  else if (r.named.empty())
    found.emplace_back("No cue alone tells them apart.");
  if (!r.matched)
    found.emplace_back(
        "Numbers of events per patch hardly overlap, so that every cue may show the rate: change it first.");
  return found;
}

Json to_json(const Realism& r) {
  Json json = json_of(r.all);
  json["floor"] = r.floor ? json_of(*r.floor) : Json(nullptr);
  json["patches"] = {{"real", r.real_patches}, {"sim", r.sim_patches}};
  json["matched"] = r.matched;
  json["named"] = r.named;
  for (const Cue& c : r.cues) {
    Json cue = json_of(c.auc);
    cue["quantity"] = c.quantity, cue["values"] = c.values, cue["real"] = c.real, cue["sim"] = c.sim;
    json["cues"][c.name] = cue;
  }
  return json;
}

}  // namespace pecs::metrics
