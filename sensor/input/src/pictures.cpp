#include "pecs/input/pictures.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <mutex>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <span>

#include "linear.h"
#include "pecs/error.h"
#include "pecs/events/format.h"
#include "pecs/input/media.h"
#include "pecs/input/motion_estimate.h"
#include "picture_header.h"
#include "rolling_shutter.h"

namespace pecs::input {
namespace {

void check_pixel_aspect(double aspect, const std::string& name) {
  if (std::abs(aspect - 1) > 1e-3)
    throw bad_input(name, "pixel aspect", fmt::format("{:.4g}", aspect), "1 (square pixels: resample it)");
}

// Refuses the curves of ITU-T H.273 (table 3) that are not nearly that of sRGB.
void check_transfer(int transfer, const std::string& name) {
  static const std::map<int, std::string> kOthers{{8, "linear light"},           {9, "logarithmic values"},
                                                  {10, "logarithmic values"},    {16, "PQ (high dynamic range)"},
                                                  {17, "gamma 2.6 (SMPTE 428)"}, {18, "HLG (high dynamic range)"}};
  if (const auto other = kOthers.find(transfer); other != kOthers.end())
    throw bad_input(name, "transfer curve", other->second, "BT.709 or sRGB: convert it, or state --colorspace");
}

// From B'G'R' to Y'PbPr (ITU-R BT.601, BT.709 and BT.2020, by their weights of R and B).
cv::Matx33d luma_and_differences(double red, double blue) {
  const double green = 1 - red - blue, pb = 0.5 / (1 - blue), pr = 0.5 / (1 - red);
  return {blue, green, red, 0.5, -pb * green, -pb * red, -pr * blue, -pr * green, 0.5};
}

// OpenCV decodes all video by the matrix of BT.601. Mends B'G'R' of video of another one; empty: none.
std::optional<cv::Matx33d> mend_of_matrix(int matrix) {
  const cv::Matx33d decoded = luma_and_differences(0.299, 0.114);
  if (matrix == 1) return luma_and_differences(0.2126, 0.0722).inv() * decoded;  // numbers of ITU-T H.273
  if (matrix == 7) return luma_and_differences(0.212, 0.087).inv() * decoded;
  if (matrix == 9) return luma_and_differences(0.2627, 0.0593).inv() * decoded;
  return {};
}

namespace fs = std::filesystem;

constexpr double kRounding_ms = 1;  // containers' time bases are as coarse as this
constexpr int kBlock = 8;
constexpr int kDark = 5;  // sRGB: up to this value, the next one is 20 % brighter
constexpr double kMuchDark = 0.05, kBlocky = 1.2;

const std::string kPictures[] = {".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp", ".webp", ".pgm", ".ppm"};

class Pictures : public sensor::FrameSource {
 public:
  // From a row of the frames to the next one, of a shutter that takes so long for all rows of the file.
  double row_us(double rolling_shutter_us) const {
    const double rows = std::max(1, of_file_.height - 1);
    return rolling_shutter_us / rows * used_.height / info_.height;
  }
  const sensor::StackInfo& info() const override { return info_; }
  std::int64_t frames() const override { return static_cast<std::int64_t>(info_.times_ns.size()); }
  std::string name() const override { return path_.string(); }
  sensor::SourceReport report() const override {
    sensor::SourceReport out;
    if (!is_8_bit_) return out;
    out.results["first_picture"] = {{"dark_share", dark_share_}, {"block_edges", block_edges_}};
    if (dark_share_ > kMuchDark)
      out.warnings.push_back(fmt::format(
          "{}: {:.0f} % of the first picture are so dark (8-bit values up to {}) that a step of the file changes the "
          "light by 20 % or more, which causes events; pictures of 16 bits have finer steps",
          name(), 100 * dark_share_, kDark));
    if (block_edges_ > kBlocky)
      out.warnings.push_back(
          fmt::format("{}: differences at the edges of blocks of 8 pixels are {:.2f} times those anywhere within: "
                      "compression, which causes events where blocks change; use a higher quality",
                      name(), block_edges_));
    return out;
  }

  std::string options_for(int width, int height) const override {
    if (width <= 0 || height <= 0) return "--size or --crop";
    const std::string crop = crop_for({width, height});
    return fmt::format("{}{}--size {}x{}, or a smaller --size", crop, crop.empty() ? "" : " ", width, height);
  }

  void read_rows(std::int64_t index, const sensor::RowSink& sink, int begin, int end) const override {
    if (end == 0) end = info_.height;
    const cv::Mat picture = frame(index);
    if (picture.size() != of_file_ || linear_.bands_of(picture).size() != info_.bands.size())
      throw bad_input(path_.string(), fmt::format("frame {}", index),
                      fmt::format("{}x{}, {} bands", picture.cols, picture.rows, linear_.bands_of(picture).size()),
                      fmt::format("{}x{}, {} bands as the first", of_file_.width, of_file_.height, info_.bands.size()));
    const cv::Size size(info_.width, info_.height);
    if (used_.size() == size) return sink(begin, end - begin, linear_(picture(used_).rowRange(begin, end)));
    std::vector<float> values = linear_(picture(used_)), out;
    const bool shrinks = size.width < used_.width && size.height < used_.height;
    for (float* band = values.data(); band < values.data() + values.size(); band += used_.area()) {
      cv::Mat resampled;
      cv::resize(cv::Mat(used_.size(), CV_32F, band), resampled, size, 0, 0,
                 shrinks ? cv::INTER_AREA : cv::INTER_LINEAR);
      const cv::Mat rows = resampled.rowRange(begin, end);
      out.insert(out.end(), rows.begin<float>(), rows.end<float>());
    }
    sink(begin, end - begin, out);
  }

 protected:
  Pictures(fs::path path, const PictureOptions& options)
      : path_(std::move(path)),
        linear_(options),
        is_srgb_by_default_(!options.colour_space),
        crop_(options.crop),
        size_(options.size) {}
  virtual cv::Mat frame(std::int64_t index) const = 0;

  void describe(const cv::Mat& first) {
    is_8_bit_ = first.depth() == CV_8U;
    if (is_8_bit_) look_at(first);
    info_.quantity = sensor::Quantity::relative;
    of_file_ = first.size();
    used_ = crop_ ? cv::Rect(crop_->x, crop_->y, crop_->width, crop_->height) : cv::Rect({0, 0}, of_file_);
    if ((used_ & cv::Rect({0, 0}, of_file_)) != used_ || used_.empty())
      throw bad_input(path_.string(), "--crop", fmt::format("{},{},{},{}", used_.x, used_.y, used_.width, used_.height),
                      fmt::format("X,Y,WIDTH,HEIGHT within {}x{}", of_file_.width, of_file_.height));
    std::tie(info_.width, info_.height) = size_.value_or(std::pair(used_.width, used_.height));
    check_aspect();
    if (std::max(of_file_.width, of_file_.height) > sensor::kMaxSide)
      throw bad_input(path_.string(), "size", fmt::format("{}x{}", of_file_.width, of_file_.height),
                      fmt::format("at most {0}x{0}", sensor::kMaxSide));
    info_.bands = linear_.bands_of(first);
  }

  void look_at(const cv::Mat& first) {
    cv::Mat grey;
    cv::transform(first, grey, cv::Mat(1, first.channels(), CV_32F, cv::Scalar(1.0 / first.channels())));
    dark_share_ = cv::countNonZero(grey <= kDark) / static_cast<double>(grey.total());
    // Mean differences from column to column, and from row to row, by their place in blocks. Sharp edges of the scene
    // lie at all places.
    grey.convertTo(grey, CV_32F);
    std::array<double, kBlock> differences{};
    for (const cv::Mat& turned : {grey, cv::Mat(grey.t())})
      for (std::size_t place = 0; place < kBlock; ++place) {
        double sum = 0;
        int number = 0;
        for (int x = static_cast<int>(place ? place : kBlock); x < turned.cols; x += kBlock, ++number)
          sum += cv::norm(turned.col(x), turned.col(x - 1), cv::NORM_L1) / turned.rows;
        differences[place] += number ? sum / number : 0;
      }
    const double elsewhere = *std::ranges::max_element(std::span(differences).subspan(1));
    block_edges_ = elsewhere > 0 ? differences[0] / elsewhere : 1;
  }
  // "--crop X,Y,W,H" of the middle with the aspect ratio of `wanted`, to 1 %; empty where all that is used has it.
  std::string crop_for(cv::Size wanted) const {
    const double wide = wanted.width / static_cast<double>(wanted.height);
    if (std::abs(wide * used_.height / used_.width - 1) <= 0.01) return "";
    const int width = std::min(used_.width, static_cast<int>(std::lround(used_.height * wide)));
    const int height = std::min(used_.height, static_cast<int>(std::lround(used_.width / wide)));
    return fmt::format("--crop {},{},{},{}", used_.x + (used_.width - width) / 2, used_.y + (used_.height - height) / 2,
                       width, height);
  }
  // Pixels stay square.
  void check_aspect() const {
    if (const std::string crop = crop_for({info_.width, info_.height}); !crop.empty())
      throw bad_input(
          path_.string(), "--size", fmt::format("{}x{}", info_.width, info_.height),
          fmt::format("the aspect ratio of {}x{}; the middle has it with {}", used_.width, used_.height, crop));
  }

  fs::path path_;
  Linear linear_;
  bool is_srgb_by_default_;
  std::optional<sensor::RoiWindow> crop_;
  std::optional<std::pair<int, int>> size_;
  bool is_8_bit_ = false;
  double dark_share_ = 0, block_edges_ = 1;  // of the first picture
  cv::Size of_file_;
  cv::Rect used_;  // of the file's pictures
  sensor::StackInfo info_;
};

class Folder final : public Pictures {
 public:
  Folder(const fs::path& path, const PictureOptions& options)
      : Pictures(path, options), files_(sensor::frame_files(path, kPictures, options.times)) {
    if (files_.empty()) throw not_found(path.string(), "holds no EXR files and no pictures");
    describe(frame(0));
    info_.times_ns = options.times.of(static_cast<std::int64_t>(files_.size()), path.string());
  }
  std::string layout() const override { return "pictures"; }

 private:
  cv::Mat frame(std::int64_t index) const override {
    const fs::path& file = files_.at(static_cast<std::size_t>(index));
    cv::Mat picture =
        media().read_picture(file.string(), cv::IMREAD_ANYCOLOR | cv::IMREAD_ANYDEPTH);  // turned as EXIF has it
    if (picture.empty()) throw bad_input(file.string(), "", "no picture that OpenCV can read", "PNG, TIFF, JPEG, …");
    const PictureHeader header = picture_header(file);
    check_pixel_aspect(header.pixel_aspect, file.string());
    if (header.alpha) check_opaque(file);
    const auto reject = [&](const char* what, const std::string& got, const char* wanted) {
      throw bad_input(file.string(), what, got, wanted);
    };
    if (header.pages) reject("", "several pictures", "one (a file for each frame)");
    if (header.white_is_zero && picture.depth() != CV_8U) reject("photometric", "white is 0", "black is 0");
    const bool integer = picture.depth() == CV_8U || picture.depth() == CV_16U;
    const double usual = integer ? 2.2 : 1;  // of sRGB, about; floats are linear
    constexpr double kSame = 0.05;
    if (is_srgb_by_default_) check_transfer(header.transfer, file.string());
    if (is_srgb_by_default_ && header.transfer == 2 && header.gamma > 0 && std::abs(header.gamma - usual) > kSame)
      reject("transfer curve", fmt::format("gamma {:.3g}", header.gamma),
             integer ? "2.2, or --colorspace (gamma:G, linear, srgb)" : "1, or --colorspace (gamma:G, linear, srgb)");
    if (is_srgb_by_default_ && header.other_primaries && picture.channels() == 3)
      reject("primaries", "others than sRGB's", "sRGB's (convert the pictures), or --colorspace");
    if (header.turned) reject("Exif", "an orientation", "WebP pictures that are turned themselves");
    if (const int depth = picture.depth(); depth != CV_8U && depth != CV_16U && depth != CV_32F && depth != CV_64F)
      reject("values", cv::depthToString(depth), "unsigned integers of 8 or 16 bits, or floating point");
    if (const int white = picture.depth() == CV_8U ? 255 : 65535; header.white > 0 && header.white != white)
      picture.convertTo(picture, CV_16U, 65535.0 / header.white);
    return picture;
  }

  // A transparent picture has no light without a background.
  static void check_opaque(const fs::path& file) {
    const cv::Mat picture = media().read_picture(file.string(), cv::IMREAD_UNCHANGED);
    cv::Mat alpha = cv::Mat::zeros(1, 1, CV_8U);  // a transparent grey value, which OpenCV does not read
    if (picture.channels() == 4) cv::extractChannel(picture, alpha, 3);
    const double full = alpha.depth() == CV_8U ? 255 : alpha.depth() == CV_16U ? 65535 : 1;
    double least = 0;
    cv::minMaxIdx(alpha, &least);
    if (least < full)
      throw bad_input(file.string(), "alpha", fmt::format("{:.3g}", least / full),
                      "1 everywhere (opaque: put a background behind the picture)");
  }

  std::vector<fs::path> files_;
};

// Frames are decoded in order; frames that precede the requested one are kept in memory for other threads.
class Video final : public Pictures {
 public:
  Video(const fs::path& path, const PictureOptions& options) : Pictures(path, options) {
    open();
    cv::Mat first;
    const VideoIndex index = media().index_video(path.string());
    mend_ = mend_of_matrix(index.matrix);
    interlaced_ = index.interlaced;
    if (!read(first)) throw bad_input(path.string(), "", "no video that OpenCV can read", "a video");
    describe(first);
    check_pixel_aspect(video_.pixel_aspect, path.string());
    if (index.misread_range)
      throw bad_input(path.string(), "range", "full range, which OpenCV reads as limited range",
                      "limited range (ffmpeg -i IN -vf scale=out_range=tv OUT)");
    if (is_srgb_by_default_) check_transfer(index.transfer, path.string());
    set_times(options.times, index.times_ms);
    open();
  }
  sensor::SourceReport report() const override {
    sensor::SourceReport out = Pictures::report();
    if (interlaced_)
      out.warnings.push_back(name() +
                             ": interlaced, so that the rows of a frame are of two times, which causes events "
                             "at edges that move; deinterlace it (ffmpeg -i IN -vf bwdif OUT)");
    return out;
  }
  std::string layout() const override { return variable_ ? "video of variable frame rate" : "video"; }

 private:
  // The frames' own times if they differ from the nominal rate by more than containers round. Their number in any case:
  // containers' own counts are often wrong.
  void set_times(sensor::FrameTimes times, const std::vector<double>& own_ms) {
    if (!times.fps && !times.file_us) {
      for (std::size_t i = 0; i < own_ms.size(); ++i)
        variable_ |= std::abs(own_ms[i] - own_ms[0] - static_cast<double>(i) * 1e3 / video_.fps) > kRounding_ms;
      times.fps = video_.fps;
    }
    if (!variable_) {
      info_.times_ns = times.of(std::ssize(own_ms), path_.string());
      return;
    }
    for (std::size_t i = 0; i < own_ms.size(); ++i) {
      if (std::isnan(own_ms[i]) || (i > 0 && own_ms[i] <= own_ms[i - 1]))
        throw bad_input(path_.string(), fmt::format("time of frame {}", i),
                        std::isnan(own_ms[i]) ? "none" : fmt::format("{} ms", own_ms[i]),
                        "one after the frame before (or --times FILE)");
      info_.times_ns.push_back(std::llround((own_ms[i] - own_ms[0]) * 1e6));
    }
  }

  void open() const {
    video_ = media().open_video(path_.string());
    next_ = 0;
    early_.clear();
  }
  bool read(cv::Mat& picture) const {
    if (!video_.read || !video_.read(picture)) return false;
    if (mend_ && picture.channels() == 3) cv::transform(picture, picture, cv::Mat(*mend_));
    return true;
  }

  cv::Mat frame(std::int64_t index) const override {
    const std::scoped_lock lock(mutex_);
    if (const auto waiting = early_.find(index); waiting != early_.end()) {
      const cv::Mat picture = waiting->second;
      early_.erase(waiting);
      return picture;
    }
    if (index < next_) open();
    while (true) {
      cv::Mat picture;
      if (!read(picture)) throw bad_input(path_.string(), fmt::format("frame {}", next_), "the end", "a frame");
      if (next_++ == index) return picture;
      early_[next_ - 1] = picture.clone();
    }
  }

  mutable std::mutex mutex_;
  mutable VideoFrames video_;
  std::optional<cv::Matx33d> mend_;
  bool interlaced_ = false;
  bool variable_ = false;
  mutable std::int64_t next_ = 0;
  mutable std::map<std::int64_t, cv::Mat> early_;
};

// Rejects files that contain no light, such as scenes and recordings.
void reject_other_files(const fs::path& path) {
  std::vector<std::byte> head(4096);
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(head.data()), static_cast<std::streamsize>(head.size()));
  head.resize(static_cast<std::size_t>(file.gcount()));
  const std::string_view text(reinterpret_cast<const char*>(head.data()), head.size());
  if (text.starts_with("BLENDER") || path.extension() == ".blend")
    throw bad_input(path.string(), "", "a .blend", "a stack of it: render it first (python -m pecs_blender render)");
  for (const events::Codec& codec : events::codecs())
    if (codec.sniff && codec.sniff(path, head))
      throw bad_input(path.string(), "", fmt::format("events ({})", codec.name), "light: a stack, pictures or a video");
}

std::unique_ptr<sensor::FrameSource> with_shutter(std::unique_ptr<Pictures> pictures, const PictureOptions& options) {
  if (!options.rolling_shutter_us) return pictures;
  std::int64_t least_ns = std::numeric_limits<std::int64_t>::max();
  const auto& t_ns = pictures->info().times_ns;
  for (std::size_t i = 1; i < t_ns.size(); ++i) least_ns = std::min(least_ns, t_ns[i] - t_ns[i - 1]);
  if (*options.rolling_shutter_us * 1e3 > static_cast<double>(least_ns))
    throw Error(ExitCode::usage,
                fmt::format("--rolling-shutter: got {} us, wanted at most the {} us between frames of {}",
                            *options.rolling_shutter_us, static_cast<double>(least_ns) * 1e-3, pictures->name()));
  const double row_us = pictures->row_us(*options.rolling_shutter_us);
  return with_global_shutter(std::move(pictures), row_us);
}

}  // namespace

std::unique_ptr<sensor::FrameSource> open_pictures(const fs::path& path, const PictureOptions& options) {
  std::unique_ptr<Pictures> pictures;
  if (fs::is_directory(path)) {
    pictures = std::make_unique<Folder>(path, options);
  } else {
    reject_other_files(path);
    pictures = std::make_unique<Video>(path, options);
  }
  auto frames = with_shutter(std::move(pictures), options);
  return options.flow ? with_estimated_motion(std::move(frames)) : std::move(frames);
}

}  // namespace pecs::input
