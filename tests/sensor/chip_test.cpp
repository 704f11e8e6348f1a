// Every profile in sensor/chips loads; damage and wrong overrides are refused by name.
#include "pecs/sensor/chip.h"

#include <gtest/gtest.h>

#include <fstream>

#include "pecs/error.h"
#include "shared.h"

namespace pecs::sensor {
namespace {

std::string refusal(const std::string& chip, const std::vector<std::string>& overrides = {}) {
  try {
    load_chip(chip, overrides);
  } catch (const Error& e) {
    return e.what();
  }
  return "";
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
  EXPECT_NE(refusal("nope").find("imx636"), std::string::npos);
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
  EXPECT_NE(with([](Json& j) { j["values"]["noise_std"]["interval"] = {0.5, 0.6}; }).find("no interval"),
            std::string::npos);
  EXPECT_NE(with([](Json& j) { j["values"].erase("leak_rate_hz"); }).find("leak_rate_hz"), std::string::npos);
  EXPECT_NE(with([](Json& j) { j["relative_qe"]["lambda_nm"][3] = 1; }).find("relative_qe.lambda_nm"),
            std::string::npos);
}

}  // namespace pecs::sensor
