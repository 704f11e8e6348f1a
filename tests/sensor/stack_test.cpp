// Foreign and damaged EXR files; tests/python/sensor/test_stack.py has the rest.
#include "pecs/sensor/stack.h"

#include <ImfChannelList.h>
#include <ImfCompression.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfOutputFile.h>
#include <gtest/gtest.h>
#include <half.h>

#include <fstream>

#include "pecs/error.h"
#include "pecs/sensor/photocurrent.h"
#include "pecs/sensor/sense.h"
#include "shared.h"

namespace pecs::sensor {
namespace {

namespace fs = std::filesystem;

class Stack : public testing::Test {
 protected:
  void SetUp() override {
    dir_ = fs::path(testing::TempDir()) / testing::UnitTest::GetInstance()->current_test_info()->name();
    fs::remove_all(dir_);
    fs::create_directories(dir_);
  }
  std::string refusal() const {
    return pecs::tests::error_of([&] { StackReader(dir_, {100, {}, {}}).read_frame(0); });
  }
  fs::path frame() const { return dir_ / "frame_000000.exr"; }

  fs::path dir_;
};

// A half-float picture of another program: data window off the origin, any compression.
void write_half(const fs::path& path, Imf::Compression compression, int width, int height, const char* channel) {
  Imf::Header header({{5, 7}, {4 + width, 6 + height}}, {{5, 7}, {4 + width, 6 + height}});
  header.compression() = compression;
  header.channels().insert(channel, Imf::Channel(Imf::HALF));
  header.channels().insert("A", Imf::Channel(Imf::HALF));
  std::vector<half> values;
  for (int i = 0; i < width * height; ++i) values.push_back(half(static_cast<float>(i % 512)));
  Imf::OutputFile file(path.string().c_str(), header);
  const auto stride = sizeof(half) * static_cast<std::size_t>(width);
  char* base = reinterpret_cast<char*>(values.data()) - 5 * static_cast<std::ptrdiff_t>(sizeof(half)) -
               7 * static_cast<std::ptrdiff_t>(stride);
  Imf::FrameBuffer buffer;
  for (const char* name : {channel, "A"}) buffer.insert(name, Imf::Slice(Imf::HALF, base, sizeof(half), stride));
  file.setFrameBuffer(buffer);
  file.writePixels(height);
}

}  // namespace

TEST_F(Stack, ReadsEveryCompressionOfOthers) {
  for (const Imf::Compression c : {Imf::NO_COMPRESSION, Imf::RLE_COMPRESSION, Imf::ZIPS_COMPRESSION,
                                   Imf::ZIP_COMPRESSION, Imf::PIZ_COMPRESSION, Imf::PXR24_COMPRESSION}) {
    write_half(frame(), c, 40, 75, "S0.550nm");
    const StackReader reader(dir_, {100, {}, {}});
    ASSERT_EQ(reader.info().bands.size(), 1u);
    EXPECT_EQ(reader.info().bands[0].lambda_nm, 550);
    const auto values = reader.read_frame(0);
    ASSERT_EQ(values.size(), 3000u);
    for (std::size_t i = 0; i < values.size(); ++i) ASSERT_EQ(values[i], static_cast<float>(i % 512)) << c;
    std::vector<float> rows;
    reader.read_rows(
        0, [&](int, int, std::span<const float> v) { rows.insert(rows.end(), v.begin(), v.end()); }, 13, 50);
    constexpr std::ptrdiff_t width = 40;
    EXPECT_TRUE(std::equal(rows.begin(), rows.end(), values.begin() + 13 * width, values.begin() + 50 * width));
  }
}

TEST_F(Stack, RefusesOtherChannels) {
  write_half(frame(), Imf::ZIP_COMPRESSION, 4, 4, "R");
  EXPECT_NE(refusal().find("S0.<wavelength>nm"), std::string::npos);
}

TEST_F(Stack, RefusesATruncatedFileAtAnyLength) {
  write_half(frame(), Imf::ZIP_COMPRESSION, 40, 75, "S0.550nm");
  std::ifstream in(frame(), std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(in), {}};
  for (std::size_t n = 0; n < whole.size(); n += 41) {
    std::ofstream(frame(), std::ios::binary) << whole.substr(0, n);
    ASSERT_NE(refusal(), "") << n;
  }
}

TEST_F(Stack, RefusesAnAttributeLongerThanTheFile) {  // OpenEXR allocates what is declared
  write_half(frame(), Imf::ZIP_COMPRESSION, 40, 75, "S0.550nm");
  std::ifstream in(frame(), std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::size_t at = bytes.find(std::string("chlist\0", 7)) + 7;
  bytes.replace(at, 4, "\xff\xff\xff\x70");
  std::ofstream(frame(), std::ios::binary) << bytes;
  EXPECT_NE(refusal().find("got attribute channels of 1895825407 bytes"), std::string::npos) << refusal();
}

TEST_F(Stack, RefusesAnAttributeOfAnotherLengthThanItsTypes) {  // the rest would be read as attributes
  write_half(frame(), Imf::ZIP_COMPRESSION, 40, 75, "S0.550nm");
  std::ifstream in(frame(), std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(in), {}};
  for (const std::string type : {"box2i", "lineOrder", "float", "v2f", "chlist"}) {
    std::string bytes = whole;
    const std::size_t at =
        bytes.find(type + '\0', bytes.find(type + '\0') + (type == "lineOrder" ? 10 : 0)) + type.size();
    ++bytes[at + 1];
    std::ofstream(frame(), std::ios::binary) << bytes;
    EXPECT_NE(refusal().find(type == "chlist" ? "wanted parts of that" : "wanted its type's length"), std::string::npos)
        << type << refusal();
  }
}

TEST_F(Stack, RefusesPixelsThatTheFileCannotHold) {
  write_half(frame(), Imf::ZIP_COMPRESSION, 40, 75, "S0.550nm");
  std::ifstream in(frame(), std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  for (std::size_t at = 0; (at = bytes.find(std::string("box2i\0", 6), at)) != std::string::npos; ++at)
    bytes[at + 6 + 4 + 8 + 1] = '\x1f';  // the greatest x: 7936 and more
  std::ofstream(frame(), std::ios::binary) << bytes;
  EXPECT_NE(refusal().find("dataWindow: got "), std::string::npos) << refusal();
}

TEST_F(Stack, RefusesAGiantHeaderBeforeAllocating) {
  write_half(frame(), Imf::ZIP_COMPRESSION, 40, 75, "S0.550nm");
  std::fstream file(frame(), std::ios::in | std::ios::out | std::ios::binary);
  const std::string whole{std::istreambuf_iterator<char>(file), {}};
  for (const char* window : {"dataWindow", "displayWindow"}) {
    const auto at = whole.find(window) + std::string(window).size() + 1 + 6 + 4;  // name\0 box2i\0 size
    const std::int32_t box[4] = {5, 7, 5 + 16383, 7 + 16383};
    file.clear();
    file.seekp(static_cast<std::streamoff>(at));
    file.write(reinterpret_cast<const char*>(box), sizeof box);
  }
  file.close();
  EXPECT_NE(refusal(), "");
}

TEST_F(Stack, RadianceKnowsItsFNumber) {
  Json json = {{"pecs_stack", 1}, {"quantity", "radiance"}, {"width", 5}, {"height", 3}, {"pixel_pitch_m", 1e-5}};
  json["bands"] = {{{"lambda_nm", 550}, {"weight_nm", 1}}};
  json["times_ns"] = {0};
  for (const char* key : {"scene", "render", "versions"}) json[key] = Json::object();
  EXPECT_FALSE(parse_stack_info(json, "s").fnumber);
  json["fnumber"] = 4;
  EXPECT_EQ(parse_stack_info(json, "s").fnumber, 4);
  const Chip chip = load_chip("imx636");
  const auto amperes = [&](const PhotocurrentOptions& o) {
    return amperes_per_unit(chip, parse_stack_info(json, "s"), o)[0];
  };
  EXPECT_EQ(amperes({}), amperes({4.0, {}, {}}));
  EXPECT_NEAR(amperes({8.0, {}, {}}) / amperes({}), 0.25, 1e-12);
  json["quantity"] = "irradiance";
  EXPECT_THROW(parse_stack_info(json, "s"), Error);
}

// So that keys of `pecs sense --view` are read where nothing moves.
TEST_F(Stack, AStillSceneIsWatched) {
  Json json = {{"pecs_stack", 1}, {"quantity", "irradiance"}, {"width", 5}, {"height", 3}, {"pixel_pitch_m", 1e-5}};
  json["bands"] = {{{"lambda_nm", 550}, {"weight_nm", 1}}};
  for (int i = 0; i < 300; ++i) json["times_ns"].push_back(1'000'000 * i);
  json["period_ns"] = nullptr;
  for (const char* key : {"scene", "render", "versions"}) json[key] = Json::object();
  const StackWriter writer(dir_, json);
  for (int i = 0; i < 300; ++i) writer.write_frame(i, std::vector<float>(15, 1e-3f));
  SenseOptions options;
  options.stack = dir_;
  options.output = dir_ / "events.raw";
  options.no_noise = options.quiet = true;
  int calls = 0, last = 1 << 30;
  options.watch = [&](std::span<const events::Event> events) {
    EXPECT_TRUE(events.empty());
    return ++calls < last;
  };
  sense(options);
  EXPECT_GT(calls, 2);
  calls = 0;
  last = 2;
  EXPECT_EQ(sense(options).results["events"], 0);
  EXPECT_EQ(calls, 2);
}

}  // namespace pecs::sensor
