extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/pixdesc.h>
}

#include <cstdlib>
#include <limits>
#include <memory>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/highgui.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/video/tracking.hpp>
#include <opencv2/videoio.hpp>
#include <string_view>

#include "pecs/input/media.h"

namespace pecs::input {
namespace {

cv::Mat read_picture(const std::string& path, int imread_flags) {
  try {
    return cv::imread(path, imread_flags);
  } catch (const cv::Exception&) {
    return {};
  }
}

std::vector<std::uint8_t> png_of(const cv::Mat& picture) {
  std::vector<std::uint8_t> png;
  cv::imencode(".png", picture, png);
  return png;
}

VideoFrames frames_of(const std::shared_ptr<cv::VideoCapture>& capture) {
  if (!capture->isOpened()) return {};
  const double wide = capture->get(cv::CAP_PROP_SAR_NUM), high = capture->get(cv::CAP_PROP_SAR_DEN);
  return {[capture](cv::Mat& frame) { return capture->read(frame); }, capture->get(cv::CAP_PROP_FPS),
          wide > 0 && high > 0 ? wide / high : 1};
}

template <auto Free>
struct Freed {
  template <class T>
  void operator()(T* pointer) const {
    Free(&pointer);
  }
};

// OpenCV 4.6 knows no time of the last frames of a video with B frames.
VideoIndex index_video(const std::string& path) {
  av_log_set_level(AV_LOG_QUIET);
  VideoIndex out;
  AVFormatContext* opened = nullptr;
  if (avformat_open_input(&opened, path.c_str(), nullptr, nullptr) < 0) return out;
  const std::unique_ptr<AVFormatContext, Freed<avformat_close_input>> file(opened);
  if (avformat_find_stream_info(file.get(), nullptr) < 0) return out;
  unsigned index = 0;  // OpenCV takes the first one
  while (index < file->nb_streams && file->streams[index]->codecpar->codec_type != AVMEDIA_TYPE_VIDEO) ++index;
  if (index == file->nb_streams) return out;
  const AVStream& stream = *file->streams[index];
  out.transfer = stream.codecpar->color_trc;
  out.matrix = stream.codecpar->color_space;
  out.interlaced = stream.codecpar->field_order > AV_FIELD_PROGRESSIVE;
  if (const AVPixFmtDescriptor* kind = av_pix_fmt_desc_get(static_cast<AVPixelFormat>(stream.codecpar->format)))
    out.misread_range = stream.codecpar->color_range == AVCOL_RANGE_JPEG && kind->nb_components >= 3 &&
                        !(kind->flags & AV_PIX_FMT_FLAG_RGB) && !std::string_view(kind->name).starts_with("yuvj");
  const AVCodec* codec = avcodec_find_decoder(stream.codecpar->codec_id);
  const std::unique_ptr<AVCodecContext, Freed<avcodec_free_context>> decoder(avcodec_alloc_context3(codec));
  avcodec_parameters_to_context(decoder.get(), stream.codecpar);
  decoder->thread_count = 0;  // all cores
  if (avcodec_open2(decoder.get(), codec, nullptr) < 0) return out;
  const std::unique_ptr<AVPacket, Freed<av_packet_free>> packet(av_packet_alloc());
  const std::unique_ptr<AVFrame, Freed<av_frame_free>> frame(av_frame_alloc());
  for (bool ended = false; !ended;) {
    ended = av_read_frame(file.get(), packet.get()) < 0;
    if (!ended && packet->stream_index != static_cast<int>(index)) {
      av_packet_unref(packet.get());
      continue;
    }
    avcodec_send_packet(decoder.get(), ended ? nullptr : packet.get());
    av_packet_unref(packet.get());
    while (avcodec_receive_frame(decoder.get(), frame.get()) >= 0) {
      const std::int64_t time = frame->best_effort_timestamp;
      out.times_ms.push_back(time == AV_NOPTS_VALUE ? std::numeric_limits<double>::quiet_NaN()
                                                    : 1e3 * static_cast<double>(time) * av_q2d(stream.time_base));
    }
  }
  return out;
}

// PECS reports errors itself.
void quiet() {
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);
  cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
}

VideoFrames open_video(const std::string& path) {
  quiet();
  return frames_of(std::make_shared<cv::VideoCapture>(path, cv::CAP_FFMPEG));
}

std::function<void(const cv::Mat&)> video_writer(const std::string& path, const std::string& codec, double fps,
                                                 int width, int height) {
  quiet();
  const int fourcc = cv::VideoWriter::fourcc(codec.at(0), codec.at(1), codec.at(2), codec.at(3));
  const auto writer = std::make_shared<cv::VideoWriter>(path, cv::CAP_FFMPEG, fourcc, fps, cv::Size(width, height));
  if (!writer->isOpened()) return {};
  return [writer](const cv::Mat& frame) { writer->write(frame); };
}

constexpr int kLeastFlowPx = 8, kLeastLongPx = 12;  // DIS refuses pictures whose sides are shorter

// At half of the pictures' resolution, as the preset does, with twice its smoothing: flow of the full resolution cost 4
// times as much, and gave worse events.
cv::Mat optical_flow(const cv::Mat& from, const cv::Mat& to) {
  if (std::min(from.cols, from.rows) < kLeastFlowPx || std::max(from.cols, from.rows) < kLeastLongPx)
    return cv::Mat::zeros(from.size(), CV_32FC2);
  const auto dis = cv::DISOpticalFlow::create(cv::DISOpticalFlow::PRESET_MEDIUM);
  dis->setPatchStride(4);
  dis->setVariationalRefinementIterations(10);
  cv::Mat flow;
  dis->calc(from, to, flow);
  return flow;
}

// Without a toolbar.
void open_window(const char* name) { cv::namedWindow(name, cv::WINDOW_AUTOSIZE | cv::WINDOW_GUI_NORMAL); }

int show(const char* window, const cv::Mat& picture, int wait_ms) {
  cv::imshow(window, picture);
  return cv::waitKey(wait_ms);
}

}  // namespace
}  // namespace pecs::input

extern "C" __attribute__((visibility("default"))) const pecs::input::Media pecs_media{
    pecs::input::read_picture, pecs::input::png_of,       pecs::input::open_video,  pecs::input::index_video,
    pecs::input::video_writer, pecs::input::optical_flow, pecs::input::open_window, pecs::input::show};
