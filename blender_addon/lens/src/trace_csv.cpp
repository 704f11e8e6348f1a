#include "pecs/lens/trace_csv.h"

#include <fmt/format.h>

#include <charconv>
#include <istream>

#include "pecs/error.h"

namespace pecs::lens {
namespace {

// x,y,z,dx,dy,dz from one line; throws bad_input.
Ray parse_ray(const std::string& name, const std::string& line, std::size_t line_number) {
  double v[6];
  const char *at = line.data(), *end = at + line.size();
  for (int i = 0; i < 6; ++i) {
    while (at < end && *at == ' ') ++at;
    const auto [next, ec] = std::from_chars(at, end, v[i]);
    const bool last = i == 5;
    const bool ends_well =
        last ? (next == end || *next == ',' || *next == '\r' || *next == ' ') : (next < end && *next == ',');
    if (ec != std::errc() || !std::isfinite(v[i]) || !ends_well)
      throw bad_input(name, fmt::format("line {}", line_number), '"' + line.substr(0, 60) + '"', "x,y,z,dx,dy,dz");
    at = next + 1;
  }
  const Vec3 d{v[3], v[4], v[5]};
  if (!(dot(d, d) > 0) || d.z == 0)
    throw bad_input(name, fmt::format("line {}", line_number), "a direction across the axis or zero",
                    "dz > 0 or dz < 0");
  return {{v[0], v[1], v[2]}, normalized(d)};
}

}  // namespace

void trace_csv(std::istream& in, const std::string& name, std::FILE* out, const Tracer& tracer, Tracer::Clip clip,
               double to_z_mm) {
  fmt::print(out, "x,y,z,dx,dy,dz,status\n");
  std::string line;
  for (std::size_t number = 1; std::getline(in, line); ++number) {
    if (line.empty() || line == "\r" || line[0] == '#' || (number == 1 && line.starts_with("x"))) continue;
    const Ray ray = parse_ray(name, line, number);
    Traced t = ray.d.z > 0 ? tracer.to_film(ray, clip) : tracer.to_scene(ray, clip);
    if (t.fate == Fate::ok) t.ray.p = t.ray.at_z(to_z_mm);
    fmt::print(out, "{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{:.17g},{}\n", t.ray.p.x, t.ray.p.y, t.ray.p.z, t.ray.d.x,
               t.ray.d.y, t.ray.d.z, fate_text(t));
  }
}

}  // namespace pecs::lens
