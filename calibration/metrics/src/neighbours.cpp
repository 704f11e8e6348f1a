// Included once per instruction set by Highway's foreach_target.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "neighbours.cpp"
#include <hwy/foreach_target.h>
// then
#include <hwy/highway.h>

#include "neighbours.h"

HWY_BEFORE_NAMESPACE();
namespace pecs::metrics::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using F = hn::CappedTag<float, kTogether>;
using V = hn::Vec<F>;

// Whether the box is nearer to a query than its nearest point so far.
HWY_INLINE bool may_be_nearer(const Neighbours::Box& box, const PointGroup& queries, const float* d2) {
  const F f;
  for (std::size_t q = 0; q < kTogether; q += hn::Lanes(f)) {
    V sum = hn::Zero(f);
    for (int d = 0; d < 3; ++d) {
      const V at = hn::Load(f, queries.at[d] + q);
      const V outside = hn::Max(hn::Sub(hn::Set(f, box.low[d]), at), hn::Sub(at, hn::Set(f, box.high[d])));
      const V gap = hn::Max(outside, hn::Zero(f));
      sum = hn::Add(sum, hn::Mul(gap, gap));
    }
    if (!hn::AllFalse(f, hn::Lt(sum, hn::LoadU(f, d2 + q)))) return true;
  }
  return false;
}

// Uses the same operations in the same order as for the box, so that a box is never further away than a point in it.
HWY_INLINE void look_at(const PointGroup& points, const PointGroup& queries, float* d2) {
  const F f;
  for (std::size_t q = 0; q < kTogether; q += hn::Lanes(f)) {
    const V x = hn::Load(f, queries.at[0] + q), y = hn::Load(f, queries.at[1] + q), t = hn::Load(f, queries.at[2] + q);
    V nearest = hn::LoadU(f, d2 + q);
    for (std::size_t i = 0; i < kTogether; ++i) {
      const V dx = hn::Sub(x, hn::Set(f, points.at[0][i])), dy = hn::Sub(y, hn::Set(f, points.at[1][i]));
      const V dt = hn::Sub(t, hn::Set(f, points.at[2][i]));
      nearest = hn::Min(nearest, hn::Add(hn::Add(hn::Mul(dx, dx), hn::Mul(dy, dy)), hn::Mul(dt, dt)));
    }
    hn::StoreU(nearest, f, d2 + q);
  }
}

void Nearest(std::span<const Neighbours::Node> nodes, std::span<const PointGroup> leaves, const PointGroup& queries,
             float* d2) {
  std::int32_t waiting[64];
  std::size_t count = 0;
  waiting[count++] = 0;
  while (count > 0) {
    std::int32_t at = waiting[--count];
    for (;;) {
      const Neighbours::Node& node = nodes[static_cast<std::size_t>(at)];
      if (!may_be_nearer(node.box, queries, d2)) break;
      if (node.second < 0) {
        look_at(leaves[static_cast<std::size_t>(-1 - node.second)], queries, d2);
        break;
      }
      // Visits the child that is nearer to the first query first.
      const float query = queries.at[node.axis][0];
      const std::int32_t children[2] = {at + 1, node.second};
      const Neighbours::Box& lower = nodes[static_cast<std::size_t>(at) + 1].box;
      const Neighbours::Box& upper = nodes[static_cast<std::size_t>(node.second)].box;
      const bool is_upper = query - lower.high[node.axis] > upper.low[node.axis] - query;
      waiting[count++] = children[!is_upper];
      at = children[is_upper];
    }
  }
}

}  // namespace pecs::metrics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <array>

namespace pecs::metrics {
namespace {

constexpr std::size_t kAlone = 512;  // leaves below which a subtree is built by one task

// Number of nodes of a full binary tree.
std::size_t nodes_of(std::size_t leaves) { return 2 * leaves - 1; }

// Moves the points for which `goes` is true to the front; returns their end. Branchless, because the outcome is not
// predictable.
template <class Goes>
Point* part(Point* begin, Point* end, const Goes& goes) {
  Point* to = begin;
  for (Point* from = begin; from != end; ++from) {
    const Point point = *from;
    *from = *to;
    *to = point;
    to += goes(point);
  }
  return to;
}

// std::nth_element by one coordinate, in half its time: the pivot is the sample's value of the wanted rank.
void select(Point* begin, Point* const nth, Point* end, int axis) {
  constexpr std::ptrdiff_t kSample = 64, kFew = 24;
  while (end - begin > kFew) {
    std::array<float, kSample> sample;
    const std::ptrdiff_t count = std::min(kSample, (end - begin) / 8);
    for (std::ptrdiff_t i = 0; i < count; ++i) sample[i] = begin[(end - begin) * (2 * i + 1) / (2 * count)][axis];
    const auto wanted = sample.begin() + count * (nth - begin) / (end - begin);
    std::nth_element(sample.begin(), wanted, sample.begin() + count);
    const float pivot = *wanted;
    Point* const less = part(begin, end, [&](const Point& p) { return p[axis] < pivot; });
    if (nth < less) {
      end = less;
      continue;
    }
    Point* const more = part(less, end, [&](const Point& p) { return p[axis] <= pivot; });
    if (nth < more) return;
    begin = more;
  }
  std::nth_element(begin, nth, end, [axis](const Point& a, const Point& b) { return a[axis] < b[axis]; });
}

}  // namespace

HWY_EXPORT(Nearest);

void Neighbours::build() {
  if (empty()) return;
  Box around{{points_[0][0], points_[0][1], points_[0][2]}, {points_[0][0], points_[0][1], points_[0][2]}};
  for (const Point& p : points_)
    for (std::size_t d = 0; d < 3; ++d) {
      around.low[d] = std::min(around.low[d], p[d]);
      around.high[d] = std::max(around.high[d], p[d]);
    }
  leaves_.resize((points_.size() + kTogether - 1) / kTogether);
  nodes_.resize(nodes_of(leaves_.size()));
  build(0, 0, leaves_.size(), around);
}

// around: a box that contains the points of these leaves.
void Neighbours::build(std::size_t node, std::size_t first_leaf, std::size_t end_leaf, Box around) {
  const auto begin = points_.begin() + static_cast<std::ptrdiff_t>(first_leaf * kTogether);
  const auto end = points_.begin() + static_cast<std::ptrdiff_t>(std::min(points_.size(), end_leaf * kTogether));
  if (end_leaf - first_leaf == 1) {
    PointGroup& leaf = leaves_[first_leaf];
    leaf.count = static_cast<std::size_t>(end - begin);
    for (std::size_t d = 0; d < 3; ++d) {
      for (std::size_t i = 0; i < kTogether; ++i) leaf.at[d][i] = begin[std::min(i, leaf.count - 1)][d];
      const auto [low, high] = std::ranges::minmax(leaf.at[d]);
      around.low[d] = low;
      around.high[d] = high;
    }
    nodes_[node] = {around, -1 - static_cast<std::int32_t>(first_leaf), 0};
    return;
  }
  // Splits the longest side at the median; all leaves but the last are full.
  int axis = 0;
  for (int d = 1; d < 3; ++d)
    if (around.high[d] - around.low[d] > around.high[axis] - around.low[axis]) axis = d;
  const std::size_t middle_leaf = (first_leaf + end_leaf) / 2, first = node + 1;
  const std::size_t second = first + nodes_of(middle_leaf - first_leaf);
  const auto middle = points_.begin() + static_cast<std::ptrdiff_t>(middle_leaf * kTogether);
  select(std::to_address(begin), std::to_address(middle), std::to_address(end), axis);
  Box below = around, above = around;
  below.high[axis] = above.low[axis] = (*middle)[axis];
  const auto lower = [&] { build(first, first_leaf, middle_leaf, below); };
  const auto upper = [&] { build(second, middle_leaf, end_leaf, above); };
  if (end_leaf - first_leaf > kAlone)
    tbb::parallel_invoke(lower, upper);
  else
    lower(), upper();
  const Box &a = nodes_[first].box, &b = nodes_[second].box;
  for (std::size_t d = 0; d < 3; ++d) {
    around.low[d] = std::min(a.low[d], b.low[d]);
    around.high[d] = std::max(a.high[d], b.high[d]);
  }
  nodes_[node] = {around, static_cast<std::int32_t>(second), axis};
}

void Neighbours::nearest(const PointGroup& queries, std::span<float, kTogether> d2) const {
  HWY_DYNAMIC_DISPATCH(Nearest)(nodes_, leaves_, queries, d2.data());
}

}  // namespace pecs::metrics
#endif
