#include "pecs/lens/image_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "pecs/error.h"
#include "pecs/lens/field.h"

namespace pecs::lens {
namespace {

constexpr int kRadialNodes = 96;  // over the film radius
constexpr int kLayers = 7;        // over the height of a tilted film
constexpr double kBeyond = 1.1;   // extent of the table relative to the farthest corner

// Lagrange's weights of the nodes first, first + 1, first + 2, first + 3 at `x`.
std::array<double, 4> cubic_weights(double x, double first) {
  const double t = x - first;
  return {(t - 1) * (t - 2) * (t - 3) / -6, t * (t - 2) * (t - 3) / 2, t * (t - 1) * (t - 3) / -2,
          t * (t - 1) * (t - 2) / 6};
}

// The root of an increasing f between low and high, f(low) <= 0 <= f(high), by false position (Illinois).
template <class F>
double rising_root(F&& f, double low, double high) {
  double at_low = f(low), at_high = f(high), x = low;
  for (int i = 0, side = 0; i < 100 && at_low != 0 && high - low > 1e-13; ++i) {
    x = (low * at_high - high * at_low) / (at_high - at_low);
    const double y = f(x);
    if (std::abs(y) < 1e-15) return x;
    (y < 0 ? low : high) = x;
    (y < 0 ? at_low : at_high) = y;
    const int now = y < 0 ? -1 : 1;
    if (now == side) (y < 0 ? at_high : at_low) /= 2;
    side = now;
  }
  return at_low == 0 ? low : x;
}

}  // namespace

FilmAxes film_axes(double tilt_x_deg, double tilt_y_deg) {
  const double x = tilt_x_deg * std::numbers::pi / 180, y = tilt_y_deg * std::numbers::pi / 180;
  return {{std::cos(y), 0, -std::sin(y)},
          {std::sin(x) * std::sin(y), std::cos(x), std::sin(x) * std::cos(y)},
          {-std::cos(x) * std::sin(y), std::sin(x), -std::cos(x) * std::cos(y)}};
}

ImageMap::ImageMap(const Prescription& lens, const ImageSetting& setting)
    : setting_(setting), axes_(film_axes(setting.film_tilt_x_deg, setting.film_tilt_y_deg)) {
  if (setting_.focus_bands_nm.empty()) setting_.focus_bands_nm = {setting_.lambda_nm};
  double corner_mm = 0;
  for (const double x : {0, setting.width_px})
    for (const double y : {0, setting.height_px}) {
      const FilmPoint p = film_point({x, y});
      corner_mm = std::max(corner_mm, std::hypot(p.x, p.y));
      max_dz_mm_ = std::max(max_dz_mm_, kBeyond * std::abs(p.dz));
    }
  tabulate(lens, kBeyond * corner_mm);
}

void ImageMap::tabulate(const Prescription& lens, double max_r_mm) {
  const ImageSetting& s = setting_;
  const Tracer tracer(lens, s.lambda_nm, s.stop_diameter_mm);
  const Focus focus = best_focus(lens, s.focus_bands_nm, s.focus_m, s.stop_diameter_mm);
  double mean_nm = 0;
  for (const double band : s.focus_bands_nm) mean_nm += band / static_cast<double>(s.focus_bands_nm.size());
  const double pupil_z = first_order(lens, mean_nm, s.stop_diameter_mm).entrance_pupil_z_mm;
  if (!std::isfinite(pupil_z)) throw Error(ExitCode::unsupported, lens.file + ": the entrance pupil lies at infinity");

  step_mm_ = max_r_mm / kRadialNodes;
  layers_.assign(max_dz_mm_ > 0 ? kLayers : 1, {Chief{}});
  std::size_t nodes = kRadialNodes + 1;
  for (std::size_t k = 0; k < layers_.size(); ++k) {
    const double dz = layers_.size() == 1 ? 0 : max_dz_mm_ * (2.0 * static_cast<double>(k) / (kLayers - 1) - 1);
    double last_angle = 0;
    for (std::size_t i = 1; i < nodes; ++i) {
      const double r = static_cast<double>(i) * step_mm_;
      const auto ray = chief_ray(tracer, lens.stop, focus.film_z_mm + dz, r);
      const double angle = ray ? std::atan2(-ray->d.x, -ray->d.z) : 0;
      if (angle <= last_angle) break;
      last_angle = angle;
      const double offset = -ray->p.x * std::cos(angle) + (ray->p.z - pupil_z) * std::sin(angle);
      layers_[k].push_back({angle / r, offset / r});
    }
    nodes = layers_[k].size();
  }
  if (nodes < 8) throw bad_input(lens.file, "surfaces", "no chief rays near the axis", "a lens that forms a picture");
  for (auto& layer : layers_) {
    layer.resize(nodes);
    layer[0] = {(4 * layer[1].angle_per_mm - layer[2].angle_per_mm) / 3,
                (4 * layer[1].offset_per_mm - layer[2].offset_per_mm) / 3};
  }
}

ImageMap::FilmPoint ImageMap::film_point(Pixel pixel) const {
  // The image on the film is upside down.
  const double across = (0.5 * setting_.width_px - pixel.x) * setting_.pixel_pitch_mm;
  const double along = (pixel.y - 0.5 * setting_.height_px) * setting_.pixel_pitch_mm;
  const Vec3 p = across * axes_.right + along * axes_.up;
  return {setting_.film_shift_x_mm + p.x, setting_.film_shift_y_mm + p.y, p.z};
}

bool ImageMap::reaches(double r_mm, double dz_mm) const {
  return r_mm <= step_mm_ * static_cast<double>(layers_[0].size() - 1) && std::abs(dz_mm) <= max_dz_mm_ + 1e-12;
}

ImageMap::Chief ImageMap::in_layer(std::size_t layer, double r_mm) const {
  const auto& nodes = layers_[layer];
  const double x = r_mm / step_mm_;
  const int first = std::min(static_cast<int>(x) - 1, static_cast<int>(nodes.size()) - 4);
  const auto weights = cubic_weights(x, first);
  Chief out;
  for (int i = 0; i < 4; ++i) {
    const Chief& c = nodes[static_cast<std::size_t>(std::abs(first + i))];
    out.angle_per_mm += weights[i] * c.angle_per_mm;
    out.offset_per_mm += weights[i] * c.offset_per_mm;
  }
  return out;
}

ImageMap::Chief ImageMap::at(double r_mm, double dz_mm) const {
  if (layers_.size() == 1) return in_layer(0, r_mm);
  const double x = (kLayers - 1) * (0.5 + 0.5 * std::clamp(dz_mm / max_dz_mm_, -1.0, 1.0));
  const int first = std::clamp(static_cast<int>(x) - 1, 0, kLayers - 4);
  const auto weights = cubic_weights(x, first);
  Chief out;
  for (int i = 0; i < 4; ++i) {
    const Chief c = in_layer(static_cast<std::size_t>(first) + static_cast<std::size_t>(i), r_mm);
    out.angle_per_mm += weights[i] * c.angle_per_mm;
    out.offset_per_mm += weights[i] * c.offset_per_mm;
  }
  return out;
}

// By Newton's steps on the cubic of `in_layer` that surrounds the root.
double ImageMap::radius_at(double angle) const {
  const auto& nodes = layers_[0];
  const int last = static_cast<int>(nodes.size()) - 2;
  const auto value = [&](int node) { return nodes[static_cast<std::size_t>(std::abs(node))].angle_per_mm; };
  const auto is_beyond = [&](int node) { return step_mm_ * node * value(node) >= angle; };
  int low = std::min(static_cast<int>(angle / (step_mm_ * value(0))), last);
  while (low > 0 && is_beyond(low)) --low;
  while (low < last && !is_beyond(low + 1)) ++low;
  const int first = std::min(low - 1, static_cast<int>(nodes.size()) - 4);
  const double a = value(first), b = value(first + 1), c = value(first + 2), d = value(first + 3);
  const double d1 = b - a, d2 = (c - 2 * b + a) / 2, d3 = (d - 3 * c + 3 * b - a) / 6;  // Newton's form
  double x = low + 0.5;
  for (int i = 0; i < 3; ++i) {
    const double u = x - first, angle_per_mm = a + u * (d1 + (u - 1) * (d2 + (u - 2) * d3));
    const double slope = d1 + (2 * u - 1) * d2 + (3 * u * u - 6 * u + 2) * d3;
    x -= (x * angle_per_mm - angle / step_mm_) / (angle_per_mm + x * slope);
  }
  return x * step_mm_;
}

std::optional<Ray> ImageMap::ray_from_pixel(Pixel pixel) const {
  const FilmPoint film = film_point(pixel);
  const double r = std::hypot(film.x, film.y);
  if (!reaches(r, film.dz)) return std::nullopt;
  if (r == 0) return Ray{{}, {0, 0, 1}};
  const Chief chief = at(r, film.dz);
  const double angle = r * chief.angle_per_mm, offset = r * chief.offset_per_mm;
  const double right = -film.x / r, down = film.y / r;  // across the lens, in camera axes
  const double sine = std::sin(angle), cosine = std::cos(angle);
  return Ray{{offset * cosine * right, offset * cosine * down, -offset * sine}, {sine * right, sine * down, cosine}};
}

std::optional<Vec3> ImageMap::direction_from_pixel(Pixel pixel) const {
  const auto ray = ray_from_pixel(pixel);
  if (!ray) return std::nullopt;
  return ray->d;
}

std::optional<Pixel> ImageMap::pixel_from_direction(Vec3 direction) const {
  const ImageSetting& s = setting_;
  const double across = std::hypot(direction.x, direction.y), angle = std::atan2(across, direction.z);
  const double ux = across > 0 ? -direction.x / across : 1, uy = across > 0 ? direction.y / across : 0;
  // Along the film's trace in the meridional plane, dz is a line in r.
  const double per_x = -axes_.ahead.x / axes_.ahead.z, per_y = -axes_.ahead.y / axes_.ahead.z;
  const auto dz_at = [&](double r) {
    return per_x * (r * ux - s.film_shift_x_mm) + per_y * (r * uy - s.film_shift_y_mm);
  };
  const auto excess = [&](double r) { return r * at(r, dz_at(r)).angle_per_mm - angle; };
  const double last_mm = step_mm_ * static_cast<double>(layers_[0].size() - 1);
  const bool is_flat = layers_.size() == 1;
  if (!((is_flat ? last_mm * layers_[0].back().angle_per_mm - angle : excess(last_mm)) >= 0)) return std::nullopt;
  const double r = is_flat ? radius_at(angle) : rising_root(excess, 0, last_mm), dz = dz_at(r);
  if (!reaches(r, dz)) return std::nullopt;
  const Vec3 on_film{r * ux - s.film_shift_x_mm, r * uy - s.film_shift_y_mm, dz};
  return Pixel{0.5 * s.width_px - dot(on_film, axes_.right) / s.pixel_pitch_mm,
               0.5 * s.height_px + dot(on_film, axes_.up) / s.pixel_pitch_mm};
}

}  // namespace pecs::lens
