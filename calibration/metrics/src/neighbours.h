#pragma once
// Exact nearest neighbours in three dimensions: a KD-tree with leaves of 16 points, traversed for 16 neighbouring
// queries at once. A subtree is visited if its box is nearer to one of them than that query's nearest point so far.
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace pecs::metrics {

using Point = std::array<float, 3>;

inline constexpr std::size_t kTogether = 16;

// Neighbouring points, by coordinate.
struct alignas(64) PointGroup {
  float at[3][kTogether];  // the last point is repeated to fill the group
  std::size_t count;
};

class Neighbours {
 public:
  void add(const Point& point) { points_.push_back(point); }
  bool empty() const { return points_.empty(); }
  // Call after the last add(). Reorders the points.
  void build();

  // The points, in unspecified order.
  std::span<const PointGroup> groups() const { return leaves_; }

  // d2: on entry the squared distances below which to search, on return those of the nearest points. Thread-safe.
  void nearest(const PointGroup& queries, std::span<float, kTogether> d2) const;

  struct Box {
    float low[3], high[3];
  };
  // Inner nodes: the first child follows its parent, the second one is at `second`. Leaves: -1 - index.
  struct Node {
    Box box;
    std::int32_t second;
    int axis;  // of the split
  };

 private:
  void build(std::size_t node, std::size_t first_leaf, std::size_t end_leaf, Box around);
  std::vector<Point> points_;
  std::vector<PointGroup> leaves_;
  std::vector<Node> nodes_;
};

}  // namespace pecs::metrics
