#pragma once
// Columns of integers t, x, y, p become events here and nowhere else: each value in its range, so that none is cut or
// wrapped on the way; the first one that is not is named with dataset and index.
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

  // The room for the next `count` values of every column.
  void resize(std::size_t count) {
    for (auto& column : values_) column.resize(count);
  }
  std::span<std::int64_t> values(Column column) { return values_[column]; }
  // Refuses those of values(column) that were unsigned and beyond int64, now negative. `first` is the index of the
  // first.
  void refuse_wrapped(Column column, std::uint64_t first) const;
  // The values as events; p of -1 is 0. `offset_us` is added to t.
  void take(std::uint64_t first, std::int64_t offset_us, Extent& extent, std::span<Event> out) const;

 private:
  [[noreturn]] void refuse(Column column, std::uint64_t index, const std::string& got, const std::string& wanted) const;

  std::string file_;
  std::array<std::string, 4> names_;
  std::array<std::vector<std::int64_t>, 4> values_;
};

}  // namespace pecs::events
