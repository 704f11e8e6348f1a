#include "sense/repeats.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <limits>
#include <numbers>

namespace pecs::sensor {
namespace {

constexpr std::int64_t kDecideEvery_us = 4 * Repeats::kWindow_us;

struct Place {
  std::uint64_t key;  // pixel and polarity, then time
  std::uint32_t index;
  auto operator<=>(const Place&) const = default;
};
constexpr int kTimeBits = 64 - kKeyTimeShift;

std::vector<Place> by_pixel(std::span<const events::Event> events, int width) {
  std::vector<Place> places;
  places.reserve(events.size());
  for (const events::Event& e : events) {
    const std::uint64_t pixel = std::uint64_t{e.y} * static_cast<std::uint64_t>(width) + e.x;
    places.push_back({(2 * pixel + e.p) << kTimeBits | static_cast<std::uint64_t>(e.t_us),
                      static_cast<std::uint32_t>(places.size())});
  }
  tbb::parallel_sort(places);
  return places;
}

std::uint64_t distance(const Place& a, const Place& b) { return a.key > b.key ? a.key - b.key : b.key - a.key; }

// Index in `among` of the nearest event of the same pixel and polarity within the window, for each of `of`;
// among.size() if there is none. The earlier one of two that are equally near.
std::vector<std::size_t> nearest(const std::vector<Place>& of, const std::vector<Place>& among) {
  std::vector<std::size_t> found;
  found.reserve(of.size());
  std::size_t next = 0;  // first not before the event
  for (const Place& place : of) {
    while (next < among.size() && among[next].key < place.key) ++next;
    std::size_t best = among.size();
    for (const std::size_t i : {next - 1, next}) {  // next - 1 wraps around at 0
      if (i >= among.size() || among[i].key >> kTimeBits != place.key >> kTimeBits) continue;
      if (distance(among[i], place) > static_cast<std::uint64_t>(Repeats::kWindow_us)) continue;
      if (best == among.size() || distance(among[i], place) < distance(among[best], place)) best = i;
    }
    found.push_back(best);
  }
  return found;
}

}  // namespace

void Repeats::match(LabelledEvents& first, LabelledEvents& second, std::int64_t until_us, bool last) {
  waiting_.events.insert(waiting_.events.end(), first.events.begin(), first.events.end());
  waiting_.causes.insert(waiting_.causes.end(), first.causes.begin(), first.causes.end());
  others_.insert(others_.end(), second.events.begin(), second.events.end());
  for (LabelledEvents* events : {&first, &second}) {
    events->events.clear();
    events->causes.clear();
  }
  const std::int64_t before_us = last ? std::numeric_limits<std::int64_t>::max() : until_us - 2 * kWindow_us;
  if (!last && before_us < decided_us_ + kDecideEvery_us) return;
  decide(before_us);
  decided_us_ = before_us;

  const auto known = std::ranges::lower_bound(waiting_.events, before_us, {}, &events::Event::t_us);
  const auto count = known - waiting_.events.begin();
  first.events.assign(waiting_.events.begin(), known);
  waiting_.events.erase(waiting_.events.begin(), known);
  if (waiting_.causes.empty()) return;
  first.causes.assign(waiting_.causes.begin(), waiting_.causes.begin() + count);
  waiting_.causes.erase(waiting_.causes.begin(), waiting_.causes.begin() + count);
}

void Repeats::decide(std::int64_t before_us) {
  const std::size_t old = past_.size();
  std::vector<events::Event> all = past_;
  all.insert(all.end(), waiting_.events.begin(), waiting_.events.end());
  const std::vector<Place> a = by_pixel(all, width_), b = by_pixel(others_, width_);
  const std::vector<std::size_t> b_of_a = nearest(a, b), a_of_b = nearest(b, a);
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (a[i].index < old) continue;
    const events::Event& e = all[a[i].index];
    if (e.t_us >= before_us) continue;
    const std::size_t partner = b_of_a[i];
    const bool found = partner < b.size() && a_of_b[partner] == i;
    events_ += counts(e);
    if (found) {
      pairs_ += counts(e);
      if (counts(e)) ++differences_[distance(a[i], b[partner])];
    } else {
      alone_ += counts(e);
      Cause* cause = waiting_.causes.empty() ? nullptr : &waiting_.causes[a[i].index - old];
      if (cause && *cause == Cause::signal) *cause = Cause::render;
    }
  }
  for (std::size_t i = 0; i < b.size(); ++i) {
    const events::Event& e = others_[b[i].index];
    if (e.t_us < decided_us_ || e.t_us >= before_us || !counts(e)) continue;
    const std::size_t partner = a_of_b[i];
    ++events_;
    alone_ += partner >= a.size() || b_of_a[partner] != i;
  }
  const auto is_old = [&](const events::Event& e) { return e.t_us < before_us - 2 * kWindow_us; };
  past_.clear();
  for (const events::Event& e : all)
    if (e.t_us < before_us && !is_old(e)) past_.push_back(e);
  std::erase_if(others_, is_old);
}

Json Repeats::report() const {
  std::int64_t below = 0;
  std::size_t median = 0;
  while (median < differences_.size() && 2 * (below += differences_[median]) < pairs_) ++median;
  return {{"share", events_ ? Json(share()) : Json()},
          {"time_us", pairs_ ? Json(static_cast<double>(median) / std::numbers::sqrt2) : Json()},
          {"window_us", kWindow_us}};
}

}  // namespace pecs::sensor
