#include "ecf.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace pecs::events::ecf {
namespace {

class Cursor {
 public:
  explicit Cursor(std::span<const std::byte> block) : block_(block) {}
  template <class T>
  T take() {
    if (block_.size() - offset_ < sizeof(T))
      throw Damage{offset_, "the end of the block", fmt::format("{} more bytes", sizeof(T))};
    T value;
    std::memcpy(&value, block_.data() + offset_, sizeof(T));
    offset_ += sizeof(T);
    return value;
  }
  std::size_t offset() const { return offset_; }

 private:
  std::span<const std::byte> block_;
  std::size_t offset_ = 0;
};

// End of a run of `count` that begins at `i`, checked against `n`.
std::size_t run_end(const Cursor& in, std::size_t i, std::size_t count, std::size_t n) {
  if (count > n - i)
    throw Damage{in.offset(), fmt::format("a run of {} events", count), fmt::format("at most {}", n - i)};
  return i + count;
}

void decode_times(Cursor& in, std::vector<Event>& out) {
  auto t = in.take<std::uint64_t>();
  std::uint64_t step = 0;
  unsigned step_bits = 0;
  for (std::size_t i = 0; i < out.size();) {
    const auto byte = in.take<std::uint8_t>();
    const unsigned dt = byte >> 4;
    std::size_t count = byte & 0xf;
    if (dt == 0xf) {
      if (step_bits >= 64) throw Damage{in.offset(), "a step in time of more than 64 bits", "at most 64"};
      step |= std::uint64_t{count} << step_bits;
      step_bits += 4;
      continue;
    }
    t += step + dt;
    step = step_bits = 0;
    if (count == 0xf) count = in.take<std::uint16_t>();
    for (const std::size_t end = run_end(in, i, count, out.size()); i < end; ++i)
      out[i].t_us = static_cast<std::int64_t>(t);
  }
}

void decode_y(Cursor& in, std::vector<Event>& out) {
  for (std::size_t i = 0; i < out.size();) {
    const auto word = in.take<std::uint16_t>();
    std::size_t count = word & 0x1f;
    if (count == 0x1f) count = in.take<std::uint16_t>();
    for (const std::size_t end = run_end(in, i, count, out.size()); i < end; ++i) out[i].y = word >> 5;
  }
}

void decode_x_masks(Cursor& in, std::vector<Event>& out) {
  for (std::size_t i = 0; i < out.size();) {
    const auto word = in.take<std::uint16_t>();
    const auto x = static_cast<std::uint16_t>(word >> 5);
    out[i++].x = x;
    for (int k = 0; k < 5; ++k)
      if ((word >> (4 - k) & 1) && i < out.size()) out[i++].x = static_cast<std::uint16_t>(x + 1 + k);
  }
}

void decode_p(Cursor& in, std::vector<Event>& out) {
  for (std::size_t i = 0; i < out.size();) {
    const auto byte = in.take<std::uint8_t>();
    std::size_t count = byte & 0x7f;
    if (count == 0x7f) count = in.take<std::uint16_t>();
    for (const std::size_t end = run_end(in, i, count, out.size()); i < end; ++i) out[i].p = byte >> 7;
  }
}

void decode_x_p(Cursor& in, std::vector<Event>& out) {
  for (std::size_t i = 0; i < out.size(); i += 4) {
    const unsigned a = in.take<std::uint16_t>(), b = in.take<std::uint16_t>(), c = in.take<std::uint16_t>();
    const unsigned packed[4] = {a >> 4, (a & 0xf) | (b >> 8) << 4, (b & 0xff) | (c >> 12) << 8, c & 0xfff};
    for (std::size_t k = 0; k < std::min<std::size_t>(4, out.size() - i); ++k) {
      out[i + k].x = static_cast<std::uint16_t>(packed[k] >> 1);
      out[i + k].p = packed[k] & 1;
    }
  }
}

void decode_y_x_p(Cursor& in, std::vector<Event>& out) {
  for (std::size_t i = 0; i < out.size(); i += 4) {
    const auto a = in.take<std::uint32_t>(), b = in.take<std::uint32_t>(), c = in.take<std::uint32_t>();
    const std::uint32_t packed[4] = {a >> 8, (a & 0xff) | (b >> 16) << 8, (b & 0xffff) | (c >> 24) << 16, c & 0xffffff};
    for (std::size_t k = 0; k < std::min<std::size_t>(4, out.size() - i); ++k) {
      out[i + k].y = packed[k] >> 12 & 0x7ff;
      out[i + k].x = packed[k] >> 1 & 0x7ff;
      out[i + k].p = packed[k] & 1;
    }
  }
}

template <class T>
void put(std::vector<std::byte>& out, T value) {
  const auto* bytes = reinterpret_cast<const std::byte*>(&value);
  out.insert(out.end(), bytes, bytes + sizeof(T));
}

// Calls put(first event of the run, its length) for every run of equal keys.
template <class Key, class Put>
void for_each_run(std::span<const Event> events, Key&& key, Put&& put_run) {
  for (std::size_t i = 0; i < events.size();) {
    std::size_t end = i + 1;
    while (end < events.size() && key(events[end]) == key(events[i])) ++end;
    put_run(events[i], end - i);
    i = end;
  }
}

void encode_times(std::span<const Event> events, std::vector<std::byte>& out) {
  std::int64_t t_us = events.empty() ? 0 : events[0].t_us;
  put(out, t_us);
  for_each_run(
      events, [](const Event& e) { return e.t_us; },
      [&](const Event& e, std::size_t count) {
        auto dt = static_cast<std::uint64_t>(e.t_us) - static_cast<std::uint64_t>(t_us);
        t_us = e.t_us;
        if (dt >= 0xf)
          for (; dt > 0; dt >>= 4) put(out, static_cast<std::uint8_t>(0xf0 | (dt & 0xf)));
        put(out, static_cast<std::uint8_t>(dt << 4 | std::min<std::size_t>(count, 0xf)));
        if (count >= 0xf) put(out, static_cast<std::uint16_t>(count));
      });
}

void encode_y(std::span<const Event> events, std::vector<std::byte>& out) {
  for_each_run(
      events, [](const Event& e) { return e.y; },
      [&](const Event& e, std::size_t count) {
        put(out, static_cast<std::uint16_t>(e.y << 5 | std::min<std::size_t>(count, 0x1f)));
        if (count >= 0x1f) put(out, static_cast<std::uint16_t>(count));
      });
}

// Calls put(word) for every x and mask of those that follow it within 5 pixels, rising.
template <class Put>
void for_each_x_mask(std::span<const Event> events, Put&& put_word) {
  for (std::size_t i = 0; i < events.size();) {
    const unsigned x = events[i].x;
    unsigned word = x << 5, last = x;
    for (++i; i < events.size() && events[i].x > last && events[i].x <= x + 5; ++i) {
      last = events[i].x;
      word |= 1u << (5 - (last - x));
    }
    put_word(static_cast<std::uint16_t>(word));
  }
}

void encode_p(std::span<const Event> events, std::vector<std::byte>& out) {
  for_each_run(
      events, [](const Event& e) { return e.p; },
      [&](const Event& e, std::size_t count) {
        put(out, static_cast<std::uint8_t>(e.p << 7 | std::min<std::size_t>(count, 0x7f)));
        if (count >= 0x7f) put(out, static_cast<std::uint16_t>(count));
      });
}

unsigned x_p(const Event& e) { return unsigned{e.x} << 1 | e.p; }

void encode_x_p(std::span<const Event> events, std::vector<std::byte>& out) {
  for (std::size_t i = 0; i < events.size(); i += 4) {
    unsigned v[4] = {};
    for (std::size_t k = 0; k < std::min<std::size_t>(4, events.size() - i); ++k) v[k] = x_p(events[i + k]);
    put(out, static_cast<std::uint16_t>(v[0] << 4 | (v[1] & 0xf)));
    put(out, static_cast<std::uint16_t>(v[1] >> 4 << 8 | (v[2] & 0xff)));
    put(out, static_cast<std::uint16_t>(v[2] >> 8 << 12 | v[3]));
  }
}

void encode_y_x_p(std::span<const Event> events, std::vector<std::byte>& out) {
  for (std::size_t i = 0; i < events.size(); i += 4) {
    std::uint32_t v[4] = {};
    for (std::size_t k = 0; k < std::min<std::size_t>(4, events.size() - i); ++k)
      v[k] = std::uint32_t{events[i + k].y} << 12 | x_p(events[i + k]);
    put(out, v[0] << 8 | (v[1] & 0xff));
    put(out, v[1] >> 8 << 16 | (v[2] & 0xffff));
    put(out, v[2] >> 16 << 24 | v[3]);
  }
}

}  // namespace

void encode(std::span<const Event> events, std::vector<std::byte>& out) {
  // Size of y, x and p in each style.
  const std::size_t quads = (events.size() + 3) / 4;
  std::vector<std::byte> y, p;
  std::size_t x_masks = 0;
  encode_y(events, y);
  encode_p(events, p);
  for_each_x_mask(events, [&](std::uint16_t) { ++x_masks; });
  const std::size_t apart = y.size() + 2 * x_masks + p.size(), x_p_packed = y.size() + 6 * quads, packed = 12 * quads;
  const unsigned style = packed <= std::min(apart, x_p_packed) ? 2 : x_p_packed <= apart ? 1 : 0;

  put(out, static_cast<std::uint32_t>(events.size() << 2 | style));
  encode_times(events, out);
  if (style == 2) {
    encode_y_x_p(events, out);
    return;
  }
  out.insert(out.end(), y.begin(), y.end());
  if (style == 1) {
    encode_x_p(events, out);
    return;
  }
  for_each_x_mask(events, [&](std::uint16_t word) { put(out, word); });
  out.insert(out.end(), p.begin(), p.end());
}

void decode(std::span<const std::byte> block, std::size_t max_events, std::vector<Event>& out) {
  Cursor in(block);
  const auto head = in.take<std::uint32_t>();
  const std::size_t n = head >> 2;
  if (n > max_events) throw Damage{0, fmt::format("a block of {} events", n), fmt::format("at most {}", max_events)};
  out.resize(n);
  decode_times(in, out);
  if (head & 2) {
    decode_y_x_p(in, out);
    return;
  }
  decode_y(in, out);
  if (head & 1) {
    decode_x_p(in, out);
    return;
  }
  decode_x_masks(in, out);
  decode_p(in, out);
}

}  // namespace pecs::events::ecf
