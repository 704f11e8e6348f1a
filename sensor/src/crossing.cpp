#include "pecs/sensor/crossing.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "pecs/sensor/photoreceptor.h"

namespace pecs::sensor {
namespace {

// q(s) = level in [a, b], where q is monotone and crosses it: Newton, kept in the bracket.
double solve(const Cubic& q, double level, double a, double b) {
  const double at_a = q.at(a), at_b = q.at(b);
  const bool rising = at_b > at_a;
  double s = a + (b - a) * std::clamp((level - at_a) / (at_b - at_a), 0.0, 1.0);
  for (int i = 0; i < 60 && b - a > 1e-12; ++i) {
    const double f = q.at(s) - level;
    ((f < 0) == rising ? a : b) = s;
    const double slope = q.c1 + s * (2 * q.c2 + s * 3 * q.c3);
    double next = s - f / slope;
    if (!(next > a && next < b)) next = (a + b) / 2;
    if (std::abs(next - s) < 1e-5) return next;  // the next step would be some 1e-10
    s = next;
  }
  return s;
}

}  // namespace

Cubic hermite(double v0, double v1, double m0, double m1) {
  return {v0, m0, 3 * (v1 - v0) - 2 * m0 - m1, 2 * (v0 - v1) + m0 + m1};
}

Crossing first_crossing(const Cubic& q, double from, double low, double high) {
  const double start = q.at(from);
  if (start >= high) return {from, true};
  if (start <= low) return {from, false};

  // Monotone pieces end where 3 c3 s^2 + 2 c2 s + c1 = 0.
  double ends[3];
  int pieces = 0;
  const double root2 = q.c2 * q.c2 - 3 * q.c3 * q.c1;
  if (root2 > 0) {
    const double t = -(q.c2 + std::copysign(std::sqrt(root2), q.c2));
    double r0 = q.c3 != 0 ? t / (3 * q.c3) : 2, r1 = t != 0 ? q.c1 / t : 2;
    if (r0 > r1) std::swap(r0, r1);
    for (const double r : {r0, r1})
      if (r > from && r < 1) ends[pieces++] = r;
  }
  ends[pieces++] = 1;

  double a = from;
  for (int i = 0; i < pieces; ++i) {
    const double end = q.at(ends[i]);
    if (end >= high) return {solve(q, high, a, ends[i]), true};
    if (end <= low) return {solve(q, low, a, ends[i]), false};
    a = ends[i];
  }
  return {2, false};
}

void find_events(const PixelConstants& k, PixelInterval& p, EventSlots& events) {
  const LogLight light{p.l0, p.l1, p.m0, p.m1};
  std::optional<Receptor> receptor;
  if (k.a_per_us > 0) receptor.emplace(light, k.a_per_us * p.h_us, p.w0);
  const double drift = p.n1 - p.n0 + k.leak_per_us * p.h_us;  // per interval, added to V
  double blind_until = p.blind_us;                            // from the interval's start
  // Noise at a time within the interval; the drift holds the leak too.
  const auto noise_at = [&](double dt_us) { return p.n0 + (p.n1 - p.n0) * dt_us / p.h_us; };
  const auto mark = [&](double dt_us) {
    if (p.mark) *p.mark = {p.t0_us + dt_us, static_cast<float>(noise_at(dt_us))};
  };
  const auto cause = [&](double dt_us, bool on) {
    const double sign = on ? 1 : -1;
    const double noise = sign * (noise_at(dt_us) - p.mark->noise);
    const double leak = sign * k.leak_per_us * (p.t0_us + dt_us - p.mark->t_us);
    const double signal = (on ? p.threshold_on : p.threshold_off) - noise - leak;
    return signal >= std::max(noise, leak) ? Cause::signal : leak > noise ? Cause::leak : Cause::noise;
  };
  auto background = p.background.begin();

  for (double from = 0; from < 1;) {
    // V over this step, as a cubic.
    const Receptor::Step r = receptor ? receptor->next() : Receptor::Step{0, 1, p.l0, p.l1, p.m0, p.m1};
    from = r.s1;
    const double n0 = p.n0 + drift * r.s0, n1 = p.n0 + drift * r.s1;
    const Cubic q = hermite(r.v0 + n0, r.v1 + n1, r.m0 + n1 - n0, r.m1 + n1 - n0);
    const double start = r.s0 * p.h_us, end = r.s1 * p.h_us, h = end - start;

    double s = 0;
    if (p.blind_us > 0) {
      if (blind_until >= end) continue;
      s = std::max(0.0, (blind_until - start) / h);
      p.reference = q.at(s);
      p.blind_us = 0;
      mark(start + s * h);
    }
    while (true) {
      Crossing next = first_crossing(q, s, p.reference - p.threshold_off, p.reference + p.threshold_on);
      while (background != p.background.end() && background->t_us - p.t0_us < start + s * h) ++background;
      Cause why = Cause::signal;
      const bool by_noise = background != p.background.end() && background->t_us - p.t0_us < end &&
                            (background->t_us - p.t0_us - start) / h < next.s;
      if (by_noise) {
        next = {(background->t_us - p.t0_us - start) / h, background->on};
        why = background->cause;
        ++background;
      }
      if (next.s > 1) break;
      if (p.mark && !by_noise) why = cause(start + next.s * h, next.on);
      events.add(event_key(std::llround(p.t0_us + start + next.s * h), p.pixel, next.on, p.mark ? why : Cause::signal));
      // The reference is V when the refractory period ends.
      if (k.refractory_us > 0) {
        blind_until = start + next.s * h + k.refractory_us;
        if (blind_until >= end) {
          p.blind_us = blind_until;
          break;
        }
        s = (blind_until - start) / h;
        p.reference = q.at(s);
        mark(blind_until);
      } else {
        p.reference = q.at(next.s);
        s = next.s;
        mark(start + s * h);
      }
    }
  }
  if (p.blind_us > 0) p.blind_us = std::max(blind_until - p.h_us, 1e-6);
  p.reference -= k.leak_per_us * p.h_us;
  if (receptor) p.w1 = receptor->w();
}

}  // namespace pecs::sensor
