#pragma once
// The size of the pixel array while a file is read: from the file (then events outside it are errors), or measured.
#include <fmt/format.h>

#include <algorithm>
#include <string>

#include "pecs/events/format.h"

namespace pecs::events {

class Extent {
 public:
  // `limit`: the greatest width and height that the format holds. A width without a height is no size.
  Extent(StreamInfo& info, int limit) : info_(info), given_(info.width > 0 && info.height > 0), limit_(limit) {
    if (!given_) info_.width = info_.height = 0;
  }
  bool add(const Event& e) {  // false: outside
    width_ = std::max(width_, e.x + 1);
    height_ = std::max(height_, e.y + 1);
    return e.x < width() && e.y < height();
  }
  void end() {
    if (given_) return;
    info_.width = width_;
    info_.height = height_;
  }
  bool is_given() const { return given_; }
  // Upper bounds of the pixel coordinates, exclusive.
  int width() const { return given_ ? info_.width : limit_; }
  int height() const { return given_ ? info_.height : limit_; }
  std::string wanted() const { return fmt::format("inside {}x{}", width(), height()); }

 private:
  StreamInfo& info_;
  bool given_;
  int limit_, width_ = 0, height_ = 0;
};

}  // namespace pecs::events
