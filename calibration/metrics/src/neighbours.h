#pragma once
// The nearest of many points in three dimensions, exactly: a KD-tree with leaves of 16 points, asked for 16
// neighbouring queries at once. A part of the tree is looked at if its box is nearer to one of them than what that one
// has found.
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace pecs::metrics {

using Point = std::array<float, 3>;

inline constexpr std::size_t kTogether = 16;

// Points that lie near each other, by coordinate.
struct alignas(64) PointGroup {
  float at[3][kTogether];  // behind the last one it is repeated
  std::size_t count;
};

class Neighbours {
 public:
  void add(const Point& point) { points_.push_back(point); }
  bool empty() const { return points_.empty(); }
  // After the last point. Points may change places.
  void build();

  // The points, in no order that is told.
  std::span<const PointGroup> groups() const { return leaves_; }

  // d2: squared distances below which a nearer point is sought; become those found. Any thread may call it.
  void nearest(const PointGroup& queries, std::span<float, kTogether> d2) const;

  struct Box {
    float low[3], high[3];
  };
  // Inner nodes: the second child lies at `second`, the first one behind its parent. Leaves: -1 - index.
  struct Node {
    Box box;
    std::int32_t second;
    int axis;  // along which the children part
  };

 private:
  void build(std::size_t node, std::size_t first_leaf, std::size_t end_leaf, Box around);
  std::vector<Point> points_;
  std::vector<PointGroup> leaves_;
  std::vector<Node> nodes_;
};

}  // namespace pecs::metrics
