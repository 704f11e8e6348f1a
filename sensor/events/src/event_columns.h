#pragma once
// Converts integer columns t, x, y, p to events. Checks every value's range, so that none is truncated or wrapped;
// errors name dataset and index.
#include <array>
#include <span>
#include <string>
#include <vector>

#include "extent.h"

namespace pecs::events {

class EventColumns {
 public:
  enum Column { t, x, y, p };
  static constexpr std::array kAll = {t, x, y, p};
  // `names` of the four datasets, as in errors.
  EventColumns(std::string file, std::array<std::string, 4> names) : file_(std::move(file)), names_(std::move(names)) {}

  // Reads events from the one with index `first` on, as many as `out` has; p of -1 becomes 0, and t grows by
  // `offset` and is converted from `unit`. read_values(column, values) reads a column's next values, unsigned ones as
  // their bits, and returns whether they are unsigned.
  template <class ReadValues>
  void read(std::uint64_t first, std::int64_t offset, Extent& extent, std::span<Event> out,
            const ReadValues& read_values, TimeUnit unit = TimeUnit::us) {
    for (const Column column : kAll) {
      values_[column].resize(out.size());
      if (read_values(column, std::span(values_[column]))) refuse_wrapped(column, first);
    }
    take(first, offset, unit, extent, out);
  }

 private:
  // Throws for unsigned values beyond int64, which are now negative.
  void refuse_wrapped(Column column, std::uint64_t first) const;
  void take(std::uint64_t first, std::int64_t offset, TimeUnit unit, Extent& extent, std::span<Event> out) const;
  [[noreturn]] void refuse(Column column, std::uint64_t index, const std::string& got, const std::string& wanted) const;

  std::string file_;
  std::array<std::string, 4> names_;
  std::array<std::vector<std::int64_t>, 4> values_;
};

}  // namespace pecs::events
