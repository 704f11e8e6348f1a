#include "pecs/lens/pupil.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <numbers>

namespace pecs::lens {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr int kNodes = 33, kMaxNodes = 129;
constexpr double kMargin = 1.0005, kWiden = 1.0005, kNegligible = 1e-5;  // part of a pupil's area
constexpr double kAtEdge = 1e-10;                                        // of a fill

// Gauss-Legendre on [0, 1], 8 nodes.
constexpr std::array<std::array<double, 2>, 8> kGauss{{{0.019855071751231884, 0.05061426814518813},
                                                       {0.10166676129318664, 0.11119051722668724},
                                                       {0.2372337950418355, 0.15685332293894363},
                                                       {0.4082826787521751, 0.18134189168918099},
                                                       {0.5917173212478249, 0.18134189168918099},
                                                       {0.7627662049581645, 0.15685332293894363},
                                                       {0.8983332387068134, 0.11119051722668724},
                                                       {0.9801449282487681, 0.05061426814518813}}};

// fill - 1 along a line of the direction plane: the ray passes where it is <= 0.
class Probe {
 public:
  Probe(const Tracer& tracer, double film_z, double r)
      : tracer_(tracer), film_{r, 0, film_z}, plane_(tracer.rear_z_mm()) {}
  double operator()(double x, double y) const {
    return tracer_.fill_to_scene({film_, normalized(Vec3{x, y, plane_} - film_)}) - 1.0;
  }

 private:
  const Tracer& tracer_;
  Vec3 film_;
  double plane_;
};

// The edge between a passing and a blocked parameter: false position where the fill is finite, otherwise bisection.
template <class F>
double find_edge(const F& f, double in, double f_in, double out, double f_out) {
  const double accuracy = 1e-10 * std::max(1e-3, std::abs(out - in));
  int side = 0;
  for (int i = 0; i < 100 && std::abs(out - in) > accuracy; ++i) {
    double t = 0.5;
    if (std::isfinite(f_out) && i % 8 != 7) t = std::clamp(f_in / (f_in - f_out), 1e-9, 1.0 - 1e-9);
    const double mid = in + t * (out - in), f_mid = f(mid);
    if (std::abs(f_mid) < kAtEdge) return mid;
    if (f_mid < 0) {
      in = mid;
      f_in = f_mid;
      if (side == -1) f_out *= 0.5;  // Illinois
      side = -1;
    } else {
      out = mid;
      f_out = f_mid;
      if (side == +1) f_in *= 0.5;
      side = +1;
    }
  }
  return in;
}

// Position of the minimum of a function with one minimum.
template <class F>
double golden_section(double low, double high, int steps, const F& f) {
  constexpr double kGolden = 0.6180339887498949;
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low), fa = f(a), fb = f(b);
  for (int i = 0; i < steps; ++i) {
    if (fa <= fb) {
      high = b;
      b = a;
      fb = fa;
      a = high - kGolden * (high - low);
      fa = f(a);
    } else {
      low = a;
      a = b;
      fa = fb;
      b = low + kGolden * (high - low);
      fb = f(b);
    }
  }
  return 0.5 * (low + high);
}

// The lowest fill on the meridional line; the pupil is symmetric, so it meets this line when there is one.
double find_inside(const Probe& probe, double reach) {
  double best_x = 0, best = std::numeric_limits<double>::infinity(), step = 0;
  for (const int steps : {32, 512}) {
    step = 2 * reach / steps;
    for (int i = 0; i <= steps; ++i) {
      const double x = -reach + i * step, f = probe(x, 0);
      if (f < best) {
        best = f;
        best_x = x;
      }
    }
    if (best <= -0.5) return best_x;
  }
  const double mid = golden_section(best_x - step, best_x + step, 60, [&](double x) { return probe(x, 0); });
  return probe(mid, 0) < best ? mid : best_x;
}

// Edge from an inside point along (cos, sin): steps out until blocked, then closes in.
double edge_distance(const Probe& probe, double x0, double f0, double cos, double sin, double first, double reach) {
  const auto f = [&](double s) { return probe(x0 + s * cos, s * sin); };
  double in = 0, f_in = f0, out = first;
  for (double f_out = f(out);; f_out = f(out)) {
    if (f_out > 0) return find_edge(f, in, f_in, out, f_out);
    in = out;
    f_in = f_out;
    if (out > 4 * reach) return out;
    out *= 1.5;
  }
}

}  // namespace

Vec3 ExactPupil::edge_point(std::size_t j) const {
  const double angle = kPi * (static_cast<double>(j) + 0.5) / static_cast<double>(edge_mm.size());
  return {centre_x_mm + edge_mm[j] * std::cos(angle), edge_mm[j] * std::sin(angle), 0};
}

ExactPupil exact_pupil(const Tracer& tracer, double film_z_mm, double r_mm, int angles) {
  ExactPupil pupil;
  pupil.r_mm = r_mm;
  const Probe probe(tracer, film_z_mm, r_mm);
  // A ray may cross the plane outside the rear aperture when the rear surface bulges away from it.
  const double reach = 1.5 * tracer.rear_semi_diameter_mm();
  const double inside = find_inside(probe, reach), f_inside = probe(inside, 0);
  if (!(f_inside <= 0)) return pupil;
  const double first = 0.02 * reach;
  const double right = edge_distance(probe, inside, f_inside, 1, 0, first, reach);
  const double left = edge_distance(probe, inside, f_inside, -1, 0, first, reach);
  pupil.centre_x_mm = inside + 0.5 * (right - left);
  const double f_centre = probe(pupil.centre_x_mm, 0);

  const double distance = film_z_mm - tracer.rear_z_mm();
  double guess = std::max(1e-9, 0.55 * (left + right));
  pupil.edge_mm.resize(angles);
  for (int j = 0; j < angles; ++j) {
    const double angle = kPi * (j + 0.5) / angles, cos = std::cos(angle), sin = std::sin(angle);
    const double edge = f_centre <= 0 ? edge_distance(probe, pupil.centre_x_mm, f_centre, cos, sin, guess, reach) : 0;
    pupil.edge_mm[j] = edge;
    guess = std::max(1e-9, 1.02 * edge);
    pupil.area_mm2 += 0.5 * edge * edge;
    for (const auto& [t, w] : kGauss) {
      const double s = t * edge, x = pupil.centre_x_mm + s * cos - r_mm, y = s * sin;
      const double cos2 = distance * distance / (distance * distance + x * x + y * y);
      pupil.irradiance_per_radiance += w * edge * s * cos2 * cos2;
    }
  }
  const double per_angle = 2 * kPi / angles;  // both halves
  pupil.area_mm2 *= per_angle;
  pupil.irradiance_per_radiance *= per_angle / (distance * distance);
  return pupil;
}

double Ellipse::area_mm2() const { return kPi * a_mm * b_mm; }

Ellipse covering_ellipse(const ExactPupil& pupil) {
  if (pupil.area_mm2 <= 0) return {pupil.centre_x_mm, 0, 0};
  std::vector<Vec3> edge;
  double min_x = std::numeric_limits<double>::infinity(), max_x = -min_x;
  for (std::size_t j = 0; j < pupil.edge_mm.size(); ++j) {
    edge.push_back(pupil.edge_point(j));
    min_x = std::min(min_x, edge.back().x);
    max_x = std::max(max_x, edge.back().x);
  }
  // For a centre p and a ratio q = a/b the covering a is a maximum; its area a^2/q is quasi-convex in log q, and the
  // best area quasi-convex in p (both are projections of a convex problem): golden section within golden section.
  const auto covering_a = [&](double p, double q) {
    double a2 = 0;
    for (const Vec3& e : edge) a2 = std::max(a2, (e.x - p) * (e.x - p) + q * q * e.y * e.y);
    return std::sqrt(a2);
  };
  const auto log_area = [&](double p, double log_q) { return 2 * std::log(covering_a(p, std::exp(log_q))) - log_q; };
  const auto best_log_q = [&](double p) {
    return golden_section(-3, 3, 26, [&](double log_q) { return log_area(p, log_q); });
  };
  const double p = golden_section(min_x, max_x, 22, [&](double at) { return log_area(at, best_log_q(at)); });
  const double q = std::exp(best_log_q(p)), a = covering_a(p, q);
  return {p, a, a / q};
}

double missed_fraction(const ExactPupil& pupil, const Ellipse& ellipse) {
  if (pupil.area_mm2 <= 0) return 0;
  const double per_angle = 2 * kPi / static_cast<double>(pupil.edge_mm.size());
  double missed = 0;
  for (std::size_t j = 0; j < pupil.edge_mm.size(); ++j) {
    const double edge = pupil.edge_mm[j];
    const Vec3 e = pupil.edge_point(j);
    const double ex = (e.x - ellipse.p_mm) / ellipse.a_mm, ey = e.y / ellipse.b_mm;
    if (ex * ex + ey * ey <= 1) continue;
    // The part of the spoke beyond the ellipse, which contains the centre or misses the spoke.
    const double cx = (pupil.centre_x_mm - ellipse.p_mm) / ellipse.a_mm;
    const double dx = (e.x - pupil.centre_x_mm) / ellipse.a_mm, dy = e.y / ellipse.b_mm;
    const double a = dx * dx + dy * dy, b = cx * dx, c = cx * cx - 1, disc = b * b - a * c;
    const double t = disc > 0 ? std::clamp((-b + std::sqrt(disc)) / a, 0.0, 1.0) : 0.0;
    missed += 0.5 * edge * edge * (1 - t * t);
  }
  return missed * per_angle / pupil.area_mm2;
}

namespace {
// Value at x in [0, size-1] of evenly spaced samples.
template <class T, class Mix>
T interpolate(const std::vector<T>& samples, double x, const Mix& mix) {
  const double at = std::clamp(x, 0.0, static_cast<double>(samples.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), samples.size() - 2);
  return mix(samples[i], samples[i + 1], at - static_cast<double>(i));
}
double mix_number(double a, double b, double t) { return a + t * (b - a); }
Ellipse mix_ellipse(const Ellipse& a, const Ellipse& b, double t) {
  return {mix_number(a.p_mm, b.p_mm, t), mix_number(a.a_mm, b.a_mm, t), mix_number(a.b_mm, b.b_mm, t)};
}
}  // namespace

Ellipse PupilTable::ellipse_at(double r_mm) const {
  return interpolate(ellipses, r_mm / max_r_mm * static_cast<double>(ellipses.size() - 1), mix_ellipse);
}
double PupilTable::area_at(double r_mm) const {
  return interpolate(areas_mm2, r_mm / max_r_mm * static_cast<double>(areas_mm2.size() - 1), mix_number);
}

PupilTable pupil_table(const Tracer& tracer, double film_z_mm, double max_r_mm) {
  PupilTable table;
  table.lambda_nm = tracer.lambda_nm();
  table.film_z_mm = film_z_mm;
  table.max_r_mm = max_r_mm;
  // More nodes until the interpolated ellipses cover the pupils between them; the margin covers the last missing part.
  std::vector<ExactPupil> pupils;
  for (int nodes = kNodes;; nodes = 2 * nodes - 1) {
    const int per_node = nodes == kNodes ? 4 : 2, dense = (nodes - 1) * per_node + 1;
    std::vector<ExactPupil> coarser = std::move(pupils);
    const int stride = coarser.empty() ? dense : (dense - 1) / static_cast<int>(coarser.size() - 1);
    pupils.assign(dense, {});
    tbb::parallel_for(0, dense, [&](int i) {
      pupils[i] = !coarser.empty() && i % stride == 0 ? std::move(coarser[i / stride])
                                                      : exact_pupil(tracer, film_z_mm, max_r_mm * i / (dense - 1.0));
    });
    table.ellipses.assign(nodes, {});
    tbb::parallel_for(0, nodes,
                      [&](int i) { table.ellipses[i] = covering_ellipse(pupils[std::size_t(i) * per_node]); });
    // A film point without light gets its neighbour's ellipse, so that the interpolated ellipse still covers the pupil.
    for (int i = 1; i < nodes; ++i)
      if (table.ellipses[i].a_mm == 0) table.ellipses[i] = table.ellipses[i - 1];
    for (Ellipse& e : table.ellipses) {
      e.a_mm *= kMargin;
      e.b_mm *= kMargin;
    }
    table.areas_mm2.clear();
    table.irradiance.clear();
    for (const ExactPupil& pupil : pupils) {
      table.areas_mm2.push_back(pupil.area_mm2);
      table.irradiance.push_back(pupil.irradiance_per_radiance);
    }
    // Misses between the nodes are few and small at first: widen the two adjacent ellipses before adding nodes.
    std::vector<Ellipse> covering = table.ellipses;
    for (int round = 0; round < 8; ++round) {
      table.missed_fraction = 0;
      for (int i = 0; i < dense; ++i) {
        const double missed = missed_fraction(pupils[i], table.ellipse_at(pupils[i].r_mm));
        table.missed_fraction = std::max(table.missed_fraction, missed);
        if (missed <= kNegligible) continue;
        for (int node = i / per_node; node <= std::min(i / per_node + 1, nodes - 1); ++node) {
          covering[node].a_mm *= kWiden;
          covering[node].b_mm *= kWiden;
        }
      }
      if (table.missed_fraction <= kNegligible) return table;
      table.ellipses = covering;
    }
    if (nodes >= kMaxNodes) return table;
  }
}

namespace {
// f(layer) at dz, between the two nearest layers.
template <class F, class Mix>
auto between_layers(const PupilTables& tables, double dz_mm, const F& f, const Mix& mix) {
  if (tables.layers.size() == 1) return f(tables.layers.front());
  const double last = static_cast<double>(tables.layers.size() - 1);
  const double at = std::clamp(0.5 * (dz_mm / tables.max_dz_mm + 1) * last, 0.0, last);
  const auto k = std::min(static_cast<std::size_t>(at), tables.layers.size() - 2);
  return mix(f(tables.layers[k]), f(tables.layers[k + 1]), at - static_cast<double>(k));
}
}  // namespace

Ellipse PupilTables::ellipse_at(double r_mm, double dz_mm) const {
  return between_layers(*this, dz_mm, [&](const PupilTable& t) { return t.ellipse_at(r_mm); }, mix_ellipse);
}
double PupilTables::area_at(double r_mm, double dz_mm) const {
  return between_layers(*this, dz_mm, [&](const PupilTable& t) { return t.area_at(r_mm); }, mix_number);
}

PupilTables pupil_tables(const Tracer& tracer, double film_z_mm, double max_r_mm, double max_dz_mm) {
  PupilTables tables;
  tables.film_z_mm = film_z_mm;
  tables.max_r_mm = max_r_mm;
  tables.max_dz_mm = max_dz_mm;
  if (max_dz_mm == 0) {
    tables.layers.push_back(pupil_table(tracer, film_z_mm, max_r_mm));
    tables.e0 = tables.layers.front().e0();
    tables.missed_fraction = tables.layers.front().missed_fraction;
    return tables;
  }
  tables.e0 = exact_pupil(tracer, film_z_mm, 0).irradiance_per_radiance;
  constexpr int kLayers = 5, kMaxLayers = 33, kRadii = 17;
  for (int count = kLayers;; count = 2 * count - 1) {
    const std::vector<PupilTable> coarser = std::move(tables.layers);  // every second one of the new layers
    tables.layers.clear();
    for (int k = 0; k < count; ++k)
      tables.layers.push_back(!coarser.empty() && k % 2 == 0
                                  ? coarser[static_cast<std::size_t>(k) / 2]
                                  : pupil_table(tracer, film_z_mm + max_dz_mm * (2.0 * k / (count - 1) - 1), max_r_mm));
    double in_layers = 0;
    for (const PupilTable& layer : tables.layers) in_layers = std::max(in_layers, layer.missed_fraction);
    std::vector<double> missed(static_cast<std::size_t>(count - 1) * kRadii);
    tbb::parallel_for(std::size_t{0}, missed.size(), [&](std::size_t i) {
      const std::size_t between = i / kRadii;
      const double dz = max_dz_mm * ((2.0 * static_cast<double>(between) + 1) / (count - 1) - 1);
      const double r = max_r_mm * static_cast<double>(i % kRadii) / (kRadii - 1);
      missed[i] = missed_fraction(exact_pupil(tracer, film_z_mm + dz, r), tables.ellipse_at(r, dz));
    });
    const double in_between = *std::max_element(missed.begin(), missed.end());
    tables.missed_fraction = std::max(in_layers, in_between);
    // More layers do not mend what the layers themselves miss.
    if (in_between <= std::max(3 * kNegligible, in_layers) || count >= kMaxLayers) return tables;
  }
}

}  // namespace pecs::lens
