#include "pecs/metrics/earth_mover.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace pecs::metrics {

double earth_mover(std::span<const double> a, std::span<const double> b, double bin_width) {
  const double all_a = std::accumulate(a.begin(), a.end(), 0.0), all_b = std::accumulate(b.begin(), b.end(), 0.0);
  double ahead = 0, moved = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ahead += a[i] / all_a - b[i] / all_b;
    moved += std::abs(ahead) * bin_width;
  }
  return moved;
}

double earth_mover_of_sorted(std::span<const float> a, std::span<const float> b) {
  const auto n = static_cast<double>(a.size()), m = static_cast<double>(b.size());
  std::size_t i = 0, k = 0;
  double moved = 0, x = std::min(a[0], b[0]);
  while (i < a.size() || k < b.size()) {
    const double next = i == a.size() ? b[k] : k == b.size() ? a[i] : std::min(a[i], b[k]);
    moved += std::abs(static_cast<double>(i) / n - static_cast<double>(k) / m) * (next - x);
    x = next;
    while (i < a.size() && a[i] <= x) ++i;
    while (k < b.size() && b[k] <= x) ++k;
  }
  return moved;
}

}  // namespace pecs::metrics
