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
  // `names` of the four datasets, as in errors.
  EventColumns(std::string file, std::array<std::string, 4> names) : file_(std::move(file)), names_(std::move(names)) {}

  // Makes room for the next `count` values of every column.
  void resize(std::size_t count) {
    for (auto& column : values_) column.resize(count);
  }
  std::span<std::int64_t> values(Column column) { return values_[column]; }
  // Throws for values(column) that were unsigned and beyond int64, and are now negative. first: index of the first
  // value.
  void refuse_wrapped(Column column, std::uint64_t first) const;
  // Converts the values to events; p of -1 becomes 0. Adds `offset_us` to t.
  void take(std::uint64_t first, std::int64_t offset_us, Extent& extent, std::span<Event> out) const;

 private:
  [[noreturn]] void refuse(Column column, std::uint64_t index, const std::string& got, const std::string& wanted) const;

  std::string file_;
  std::array<std::string, 4> names_;
  std::array<std::vector<std::int64_t>, 4> values_;
};

}  // namespace pecs::events
