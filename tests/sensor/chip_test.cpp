// Every profile in sensor/chips loads; damage and wrong overrides are refused by name.
#include "pecs/sensor/chip.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>

#include "pecs/error.h"
#include "pecs/sensor/lux.h"
#include "shared.h"

namespace pecs::sensor {
namespace {

std::string refusal(const std::string& chip, const std::vector<std::string>& overrides = {}) {
  return pecs::tests::error_of([&] { load_chip(chip, overrides); });
}

}  // namespace

TEST(Chip, EveryProfileLoads) {
  int n = 0;
  for (const auto& entry : std::filesystem::directory_iterator(tests::source_dir() / "sensor/chips")) {
    const Chip chip = load_chip(entry.path().string());
    EXPECT_EQ(chip.name, entry.path().stem());
    EXPECT_GT(chip.contrast_threshold_on, 0);
    ++n;
  }
  EXPECT_GE(n, 2);
}

TEST(Chip, OverridesAreChecked) {
  EXPECT_EQ(load_chip("ideal", {"contrast_threshold_on=0.5"}).contrast_threshold_on, 0.5);
  EXPECT_NE(refusal("ideal", {"contrast_treshold_on=0.5"}).find("unknown key"), std::string::npos);
  EXPECT_NE(refusal("ideal", {"contrast_threshold_on=-1"}).find("[0.001, 5]"), std::string::npos);
  EXPECT_NE(refusal("ideal", {"contrast_threshold_on=1x"}).find("got 1x"), std::string::npos);
  EXPECT_NE(refusal("ideal", {"contrast_threshold_on"}), "");
  for (const char* pixels : {"width", "height", "readout_vector_px"})
    EXPECT_NE(refusal("ideal", {pixels + std::string("=2.5")}).find("wanted a whole number"), std::string::npos);
  EXPECT_NE(refusal("nope").find("imx636"), std::string::npos);
}

// Against the published table, at its points and between them.
TEST(Chip, BiasesScaleThresholds) {
  const Chip plain = load_chip("imx636");
  const auto on = [&](double offset) {
    return load_chip("imx636", {}, {{"diff_on", offset}}).contrast_threshold_on / plain.contrast_threshold_on;
  };
  EXPECT_EQ(on(0), 1);
  EXPECT_NEAR(on(35), 1.58, 1e-9);
  EXPECT_NEAR(on(-64), 0.44, 1e-9);
  EXPECT_NEAR(on(52.5), std::sqrt(1.58 * 3.04), 1e-9);
  for (double a = -64; a < 70; a += 1) EXPECT_LT(on(a), on(a + 1)) << a;
  const Chip off = load_chip("imx636", {}, {{"diff_off", 95}, {"fo", 0}, {"hpf", 0}});
  EXPECT_NEAR(off.contrast_threshold_off / plain.contrast_threshold_off, 3.15, 1e-9);
  EXPECT_EQ(off.contrast_threshold_on, plain.contrast_threshold_on);
  EXPECT_TRUE(off.warnings.empty());
  const auto doubtful = load_chip("imx636", {}, {{"diff_on", 105}}).warnings;
  ASSERT_EQ(doubtful.size(), 1u);
  EXPECT_NE(doubtful[0].find("doubtful"), std::string::npos);
}

TEST(Chip, BiasesThatCannotBeMapped) {
  const auto said = [](const BiasSettings& biases, const std::vector<std::string>& overrides = {},
                       const char* chip = "imx636") -> std::string {
    ExitCode code{};
    const std::string line = pecs::tests::error_of([&] { load_chip(chip, overrides, biases); }, &code);
    EXPECT_EQ(code, ExitCode::usage);
    return line;
  };
  EXPECT_NE(said({{"fo", 10}}).find("--set amplifier_cutoff_hz"), std::string::npos);
  EXPECT_NE(said({{"refr", 10}}).find("--set refractory_period_s"), std::string::npos);
  EXPECT_NE(said({{"hpf", 10}}).find("set it to 0"), std::string::npos);
  EXPECT_NE(said({{"pr", 10}}).find("unknown; imx636 has diff, diff_off"), std::string::npos);
  EXPECT_NE(said({{"diff_on", 141}}).find("[-85, 140]"), std::string::npos);
  EXPECT_NE(said({{"diff_on", 110}}).find("[-64, 105]"), std::string::npos);
  EXPECT_NE(said({{"diff_on", 10}}, {"contrast_threshold_on=.3"}).find("give one"), std::string::npos);
  EXPECT_NE(said({{"diff_on", 10}}, {}, "davis346").find("davis346"), std::string::npos);
}

TEST(Chip, BiasFiles) {
  const auto folder = std::filesystem::path(testing::TempDir());
  std::vector<std::string> ignored;
  const auto read = [&](const char* name, const char* text) {
    std::ofstream(folder / name) << text;
    return read_bias_file(folder / name, ignored);
  };
  const BiasSettings wanted = {{"diff_on", 35}, {"diff_off", -10}, {"fo", 0}};
  EXPECT_EQ(read("a.bias", "% gen 4.1\n35 % bias_diff_on\r\n\n-10 % bias_diff_off   % v\n0 % bias_fo\n"), wanted);
  EXPECT_EQ(read("a.json", R"({"ll_biases_state": {"bias": [{"name": "bias_diff_on", "value": 35},
    {"name": "bias_diff_off", "value": -10}, {"name": "bias_fo", "value": 0}]},
    "afk_state": {"enabled": true}, "event_rate_control_state": {"enabled": false}})"),
            wanted);
  EXPECT_EQ(ignored, std::vector<std::string>{"afk_state"});
  for (const char* wrong : {"0 % bias_fo\n35 bias_diff_on\n", "0 % bias_fo\nx % bias_fo\n", "0 % bias_fo\n3 %\n",
                            "0 % bias_fo\n3 % bias_\n"})
    pecs::tests::expect_error([&] { read("a.bias", wrong); }, ExitCode::bad_input, "a.bias: line 2");
  EXPECT_THROW(read("a.bias", "1 % bias_fo\n2 % bias_fo\n"), Error);
  EXPECT_THROW(read("a.json", R"({"roi_state": {}})"), Error);
  EXPECT_THROW(read_bias_file(folder / "none.bias", ignored), Error);
}

TEST(Chip, PhotocurrentOfLux) {
  const double a = photocurrent_of_lux(load_chip("imx636"), 1)[0];
  EXPECT_NEAR(photocurrent_of_lux(load_chip("imx636"), 50)[0] / a, 50, 1e-9);
  EXPECT_NEAR(photocurrent_of_lux(load_chip("imx636", {"pixel_pitch_m=9.72e-6"}), 1)[0] / a, 4, 1e-9);
  EXPECT_EQ(lux_at_chip(100, 2, 0.5), 100 * 0.5 / 16);
}

// Its own values and parts replace the other's whole: a new value needs its own source.
TEST(Chip, ProfileBasedOnAnother) {
  const auto path = std::filesystem::path(testing::TempDir()) / "based.json";
  const auto with = [&](const Json& values, const char* base) {
    std::ofstream(path) << Json{{"pecs_chip", 1}, {"based_on", base}, {"name", "mine"}, {"values", values}};
    return refusal(path.string());
  };
  const Json noise = {{"value", 0.02}, {"unit", "ln"}, {"range", {0, 1}}, {"source", "mine"}};
  ASSERT_EQ(with({{"noise_std", noise}}, "imx636"), "");
  const Chip mine = load_chip(path.string()), base = load_chip("imx636");
  EXPECT_EQ(mine.name, "mine");
  EXPECT_EQ(mine.noise_std, 0.02);
  EXPECT_EQ(mine.sources.at("noise_std"), "mine");
  EXPECT_EQ(mine.refractory_period_s, base.refractory_period_s);
  EXPECT_EQ(mine.relative_qe.value, base.relative_qe.value);
  EXPECT_EQ(mine.biases.size(), base.biases.size());
  EXPECT_NE(with({{"noise_std", {{"value", 0.02}}}}, "imx636").find("values.noise_std"), std::string::npos);
  EXPECT_NE(with(Json::object(), "nosuch").find("nosuch"), std::string::npos);
  EXPECT_NE(with(Json::object(), "davis346_color").find("based_on"), std::string::npos);
}

TEST(Chip, DamageIsNamed) {
  const auto path = std::filesystem::path(testing::TempDir()) / "chip.json";
  const Json good = parse_json_file(tests::source_dir() / "sensor/chips/imx636.json");
  const auto with = [&](auto&& change) {
    Json bad = good;
    change(bad);
    std::ofstream(path) << bad.dump();
    return refusal(path.string());
  };
  EXPECT_EQ(with([](Json&) {}), "");
  EXPECT_NE(with([](Json& j) { j["values"]["speed"] = 1; }).find("values.speed: got an unknown key"),
            std::string::npos);
  EXPECT_NE(with([](Json& j) { j["values"]["noise_std"]["value"] = 7; }).find("values.noise_std.value"),
            std::string::npos);
  EXPECT_NE(with([](Json& j) { j["values"]["noise_std"]["unit"] = "V"; }).find("unit"), std::string::npos);
  EXPECT_EQ(with([](Json& j) { j["values"]["noise_std"]["interval"] = {0.01, 0.2}; }), "");
  EXPECT_NE(with([](Json& j) { j["values"]["noise_std"]["interval"] = {0.6, 0.5}; }).find("no interval"),
            std::string::npos);
  EXPECT_NE(with([](Json& j) { j["values"].erase("leak_rate_hz"); }).find("leak_rate_hz"), std::string::npos);
  const Json filter = {{"lambda_nm", {400, 700}}, {"value", {0.1, 0.9}}, {"source", "test"}};
  const auto mosaic = [&](const Json& pattern) {
    return with([&](Json& j) { j["mosaic"] = {{"pattern", pattern}, {"filters", {{"R", filter}, {"G", filter}}}}; });
  };
  EXPECT_EQ(mosaic({"RG", "GR"}), "");
  for (const Json& bad : {Json("RG"), Json::array(), Json{"RG", "R"}, Json{""}, Json{"R1"}, Json{"RG", 3}})
    EXPECT_NE(mosaic(bad).find("mosaic.pattern"), std::string::npos) << bad;
  EXPECT_NE(mosaic({"RB"}).find("mosaic.filters.B"), std::string::npos);
  EXPECT_NE(mosaic({"RR"}).find("mosaic.filters.G: got an unknown key"), std::string::npos);
  EXPECT_NE(with([](Json& j) { j["relative_qe"]["lambda_nm"][3] = 1; }).find("relative_qe.lambda_nm"),
            std::string::npos);
}

}  // namespace pecs::sensor
