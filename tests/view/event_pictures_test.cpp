#include "pecs/view/event_pictures.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/videoio.hpp>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/page/page.h"
#include "pecs/text.h"
#include "random_events.h"

namespace pecs::view {
namespace {

using namespace page;

using events::Event;

events::Recording recording(std::vector<Event> events, int width = 64, int height = 48) {
  return events::recording_of({{width, height, ""}, std::move(events)}, "folder/x.raw", 0, INT64_MAX);
}

class Pictures : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  const std::filesystem::path folder_ =
      std::filesystem::path(testing::TempDir()) /
      (std::string("pecs_pictures_") + testing::UnitTest::GetInstance()->current_test_info()->name());
};

cv::Vec3b bgr(const events::Rgb& c) { return {c.b, c.g, c.r}; }

double contrast(const cv::Vec3b& a, const cv::Vec3b& b) { return cv::norm(cv::Vec3d(a) - cv::Vec3d(b)); }

TEST_F(Pictures, FrameShowsTheWindowsEventsAtTheirPixels) {
  const auto s = recording({{100, 3, 4, 1}, {150, 5, 6, 0}, {150, 7, 8, 1}, {150, 7, 8, 1}, {200, 9, 9, 1}});
  const cv::Mat frame = event_frame(s, 0, 100, kLight);  // times from the first event; the end is excluded
  ASSERT_EQ(frame.size(), cv::Size(64, 48));
  const auto at = [&](int x, int y) { return frame.at<cv::Vec3b>(y, x); };
  const cv::Vec3b paper = bgr(kLight.paper), on = bgr(kLight.on), off = bgr(kLight.off);
  EXPECT_EQ(at(0, 0), paper);
  EXPECT_EQ(at(9, 9), paper);
  EXPECT_LT(contrast(at(3, 4), on), contrast(at(3, 4), off));
  EXPECT_LT(contrast(at(5, 6), off), contrast(at(5, 6), on));
  EXPECT_LT(contrast(at(7, 8), on), contrast(at(3, 4), on));  // two events: nearer to the full colour
  int marked = 0;
  for (int y = 0; y < 48; ++y)
    for (int x = 0; x < 64; ++x) marked += at(x, y) != paper;
  EXPECT_EQ(marked, 3);
}

TEST_F(Pictures, BinningKeepsEveryEventOfACell) {
  const auto s = recording({{0, 62, 46, 1}, {1, 63, 47, 1}}, 65, 49);
  const cv::Mat frame = event_frame(s, 0, 10, kDark, 2);
  ASSERT_EQ(frame.size(), cv::Size(33, 25));
  EXPECT_NE(frame.at<cv::Vec3b>(23, 31), bgr(kDark.paper));
}

TEST_F(Pictures, PartOfARecordingAndAnEmptyPart) {
  const events::Stream stream{{64, 48, ""}, tests::random_events(1000, 1)};
  const auto part = events::recording_of(stream, "x.raw", 2000, 4000);
  EXPECT_GE(part.first_us, 2000);
  EXPECT_LE(part.span_us, 2000);
  EXPECT_EQ(part.events.front().t_us, 0);
  EXPECT_EQ(part.from_us, part.first_us - stream.events.front().t_us);
  EXPECT_THROW(events::recording_of(stream, "x.raw", 50'000, 60'000), Error);
  EXPECT_THROW(events::recording_of({{64, 48, ""}, {}}, "x.raw", 0, 10), Error);
}

TEST_F(Pictures, SheetHasAPanelForEachWindow) {
  const auto s = recording(tests::random_events(5000, 1));
  const cv::Mat one = contact_sheet(s, 500, 1, kLight), six = contact_sheet(s, 500, 6, kLight);
  EXPECT_GT(six.cols, 2.9 * one.cols);
  EXPECT_GT(six.rows, 1.8 * one.rows);
}

TEST_F(Pictures, VideoPlays) {
  const auto s = recording(tests::random_events(5000, 1));
  const auto info = write_video(s, folder_ / "x.mp4", {.fps = 25, .slow_motion = 100});
  EXPECT_EQ(info.frames, 25);  // 10 ms, 100 times slower
  cv::VideoCapture video((folder_ / "x.mp4").string());
  ASSERT_TRUE(video.isOpened());
  EXPECT_EQ(video.get(cv::CAP_PROP_FPS), 25);
  cv::Mat frame;
  int frames = 0;
  double darkest = 255;
  while (video.read(frame)) {
    ++frames;
    double low;
    cv::minMaxLoc(frame.reshape(1), &low, nullptr);
    darkest = std::min(darkest, low);
  }
  EXPECT_EQ(frames, 25);
  EXPECT_LT(darkest, 80);
  EXPECT_THROW(write_video(s, folder_ / "missing" / "x.mp4", {}), Error);
}

// Unpacks the events of a page.
std::vector<std::array<std::int64_t, 4>> events_of_page(const std::string& page) {
  const std::string open = "id=\"events\">";
  const auto begin = page.find(open) + open.size();
  std::vector<std::uint8_t> bytes;
  std::uint32_t word = 0;
  int bits = 0;
  const std::string digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  for (auto i = begin; page[i] != '<' && page[i] != '='; ++i) {
    word = word << 6 | static_cast<std::uint32_t>(digits.find(page[i]));
    bits += 6;
    if (bits < 8) continue;
    bits -= 8;
    bytes.push_back(static_cast<std::uint8_t>(word >> bits));
  }
  std::vector<std::array<std::int64_t, 4>> out;
  const auto number = [&](std::size_t at, int n) {
    std::int64_t value = 0;
    for (int k = n; k-- > 0;) value = value << 8 | bytes[at + k];
    return value;
  };
  for (std::size_t i = 0; i + 8 <= bytes.size(); i += 8)
    out.push_back({number(i, 4), number(i + 4, 2) & 0x7fff, number(i + 6, 2), number(i + 4, 2) >> 15});
  return out;
}

TEST_F(Pictures, PageContainsTheEventsAndNeedsNoNetwork) {
  const auto s = recording(tests::random_events(1001, 1));
  EXPECT_EQ(write_page(s, folder_ / "x.html", 5000), 1001U);
  const std::string page = read_text(folder_ / "x.html", 1 << 20);
  const auto events = events_of_page(page);
  ASSERT_EQ(events.size(), s.events.size());
  for (std::size_t i = 0; i < events.size(); ++i) {
    const Event& e = s.events[i];
    EXPECT_EQ(events[i], (std::array<std::int64_t, 4>{e.t_us, e.x, e.y, e.p}));
  }
  EXPECT_EQ(page.find("{{"), page.npos);
  EXPECT_EQ(page.find("http"), page.npos);
}

TEST_F(Pictures, PageAboveItsLimitContainsAFairSubset) {
  const auto s = recording(tests::random_events(20'000, 1));
  EXPECT_EQ(write_page(s, folder_ / "x.html", 2000), 2000U);
  const auto events = events_of_page(read_text(folder_ / "x.html", 1 << 20));
  ASSERT_EQ(events.size(), 2000U);
  int early = 0;
  for (const auto& e : events) early += e[0] < 5000;
  EXPECT_NEAR(early, 1000, 100);  // 4.5 standard deviations
  EXPECT_TRUE(std::is_sorted(events.begin(), events.end(), [](const auto& a, const auto& b) { return a[0] < b[0]; }));
}

TEST_F(Pictures, PageEscapesItsTexts) {
  const std::string evil = "<a&\"b\">";
  const Json series = {{"name", evil}, {"style", evil}, {"x", {0, 1, 2}}, {"y", {-1.5, nullptr, 2}}};
  const Json plot = element("plot", {{"plot", Json::array({series})}, {"x", evil}, {"y", evil}});
  const Json image = element("img", {{"src", evil}});
  const std::string page =
      page_of({{"title", evil}, {"body", Json::array({element("p", {}, evil, 0.25, 3), image, plot})}});
  EXPECT_EQ(page.find(evil), page.npos);
  EXPECT_NE(page.find("<p>&lt;a&amp;&quot;b&quot;&gt;0.253</p>\n<img src=\"&lt;a"), page.npos);
  EXPECT_EQ(page.find("</img>"), page.npos);
  EXPECT_THROW(page_of({{"title", ""}}), Error);
  for (const auto& [key, words] : {std::pair{"film_width_mm", "film width (mm)"},
                                   {"rms_px", "RMS (px)"},
                                   {"speed_most_m_s", "speed highest (m/s)"},
                                   {"on_share", "share of ON events"},
                                   {"corner_hz_p05", "corner (Hz), 5 % are below"},
                                   {"motion_median_px_s", "motion median (px/s)"},
                                   {"m", "m"},
                                   {"", ""},
                                   {"_s", "s"},
                                   {"left", "left"},
                                   {"<b>_hz", "&lt;b&gt; (Hz)"}})
    EXPECT_EQ(html_of(Json::array({"key", key})), words);
  EXPECT_THROW(page_of({{"title", ""}, {"body", Json::array({Json::array()})}}), Error);
}

}  // namespace
}  // namespace pecs::view
