#pragma once
// The size of the pixel array while a file is read: given by the file (then events outside are damage), or measured.
#include <algorithm>

#include "pecs/events/format.h"

namespace pecs::events {

class Extent {
 public:
  Extent(StreamInfo& info, int limit) : info_(info), given_(info.width > 0 && info.height > 0), limit_(limit) {}
  bool add(const Event& e) {  // false: outside
    if (given_) return e.x < info_.width && e.y < info_.height;
    width_ = std::max(width_, e.x + 1);
    height_ = std::max(height_, e.y + 1);
    return e.x < limit_ && e.y < limit_;
  }
  void end() {
    if (given_) return;
    info_.width = width_;
    info_.height = height_;
  }

 private:
  StreamInfo& info_;
  bool given_;
  int limit_, width_ = 0, height_ = 0;
};

}  // namespace pecs::events
