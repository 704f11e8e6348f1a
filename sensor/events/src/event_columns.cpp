#include "event_columns.h"

#include <fmt/format.h>

#include "pecs/error.h"

namespace pecs::events {

void EventColumns::refuse(Column column, std::uint64_t index, const std::string& got, const std::string& wanted) const {
  throw bad_input(file_, fmt::format("{}[{}]", names_[column], index), got, wanted);
}

void EventColumns::refuse_wrapped(Column column, std::uint64_t first) const {
  const auto& values = values_[column];
  const auto bad = std::ranges::find_if(values, [](std::int64_t value) { return value < 0; });
  if (bad != values.end())
    refuse(column, first + static_cast<std::uint64_t>(bad - values.begin()),
           std::to_string(static_cast<std::uint64_t>(*bad)), fmt::format("at most {}", INT64_MAX));
}

void EventColumns::take(std::uint64_t first, std::int64_t offset, TimeUnit unit, Extent& extent,
                        std::span<Event> out) const {
  for (std::size_t i = 0; i < out.size(); ++i) {
    const std::int64_t x_value = values_[x][i], y_value = values_[y][i], p_value = values_[p][i];
    Event& e = out[i];
    std::int64_t time = 0;
    if (__builtin_add_overflow(values_[t][i], offset, &time))
      refuse(t, first + i, fmt::format("{} and an offset of {}", values_[t][i], offset), "a sum of 64 bits");
    const auto t_us = to_us(time, unit);
    if (!t_us) refuse(t, first + i, fmt::format("{} {}", time, name_of(unit)), "a time of 64 bits in us");
    e.t_us = *t_us;
    e.x = static_cast<std::uint16_t>(x_value);
    e.y = static_cast<std::uint16_t>(y_value);
    e.p = p_value > 0;
    if (x_value < 0 || x_value >= extent.width())
      refuse(x, first + i, std::to_string(x_value), fmt::format("0 to {}", extent.width() - 1));
    if (y_value < 0 || y_value >= extent.height())
      refuse(y, first + i, std::to_string(y_value), fmt::format("0 to {}", extent.height() - 1));
    if (p_value < -1 || p_value > 1) refuse(p, first + i, std::to_string(p_value), "-1, 0 or 1");
    extent.add(e);
  }
}

}  // namespace pecs::events
