#include "pecs/lens/prescription.h"

#include <gtest/gtest.h>

#include <fstream>
#include <functional>

#include "lenses.h"
#include "pecs/error.h"
#include "pecs/lens/first_order.h"
#include "pecs/strict_json.h"

namespace pecs::lens {
namespace {

struct EveryPrescription : tests::EveryLens {};

TEST_P(EveryPrescription, Loads) {
  const Prescription lens = load_prescription(GetParam());
  EXPECT_GE(lens.surfaces.size(), 2u);
  EXPECT_LT(lens.stop, lens.surfaces.size());
  EXPECT_EQ(lens.sha256.size(), 64u);
  const FirstOrder f = first_order(lens, kLambdaD);
  EXPECT_NEAR(f.efl_mm / lens.nominal_efl_mm.value_or(f.efl_mm), 1.0, 0.01);
}
PECS_EVERY_LENS(EveryPrescription);

Json good() {
  return parse_json(R"({"name": "singlet", "stop_index": 0, "surfaces": [
    {"type": "stop", "radius": null, "thickness": 1, "medium_after": {"name": "air"}, "semi_diameter": 5},
    {"type": "sphere", "radius": 25.84, "thickness": 4, "medium_after": {"name": "N-BK7", "catalog": "Schott"},
     "semi_diameter": 12.7},
    {"type": "plane", "radius": null, "thickness": 47.36, "medium_after": {"name": "air"}, "semi_diameter": 12.7}]})",
                    "good");
}

struct Bad {
  const char* name;
  std::function<std::string(Json)> text;  // of the file
  std::vector<std::string> said;          // in the error
};

std::string edited(Json json, const std::string& pointer, const Json& value) {
  json[Json::json_pointer(pointer)] = value;
  return json.dump();
}

const Bad kBad[] = {
    {"Truncated", [](const Json& j) { return j.dump().substr(0, 200); }, {"line 1", "end of the file"}},
    {"NoStop",
     [](Json j) {
       j.erase("stop_index");
       return j.dump();
     },
     {"stop_index", "got nothing"}},
    {"StopOutside", [](const Json& j) { return edited(j, "/stop_index", 7); }, {"stop_index", "7"}},
    {"NotANumber",
     [](const Json& j) {
       std::string t = j.dump();
       return t.replace(t.find("25.84"), 5, "NaN");
     },
     {"line 1"}},
    {"NegativeThickness",
     [](const Json& j) { return edited(j, "/surfaces/1/thickness", -4); },
     {"surfaces[1].thickness"}},
    {"Crossing",
     [](const Json& j) { return edited(j, "/surfaces/1/thickness", 0.1); },
     {"surfaces[1].thickness", "crossing"}},
    {"RadiusBelowSemiDiameter",
     [](const Json& j) { return edited(j, "/surfaces/1/radius", 12.0); },
     {"surfaces[1].semi_diameter"}},
    {"ZeroRadius", [](const Json& j) { return edited(j, "/surfaces/1/radius", 0); }, {"surfaces[1].radius"}},
    {"UnknownGlass",
     [](const Json& j) { return edited(j, "/surfaces/1/medium_after/name", "N-NOSUCH"); },
     {"surfaces[1].medium_after", "N-NOSUCH"}},
    {"NameWithoutIndex",
     [](const Json& j) { return edited(j, "/surfaces/1/medium_after", {{"name", "X1"}}); },
     {"surfaces[1].medium_after", "X1"}},
    {"WrongIndex",
     [](const Json& j) { return edited(j, "/surfaces/1/medium_after/nd", 1.6); },
     {"surfaces[1].medium_after.nd"}},
    {"GlassBeforeTheFilm",
     [](const Json& j) { return edited(j, "/surfaces/2/medium_after", {{"nd", 1.5}}); },
     {"surfaces[2].medium_after"}},
    {"UnknownKey",
     [](const Json& j) { return edited(j, "/surfaces/1/thicknes", 1); },
     {"surfaces[1].thicknes", "unknown key"}},
    {"UnknownType",
     [](const Json& j) { return edited(j, "/surfaces/1/type", "toroid"); },
     {"surfaces[1].type", "toroid"}},
    {"PowerZero",
     [](const Json& j) {
       Json k = j;
       k["surfaces"][1]["type"] = "asphere";
       return edited(k, "/surfaces/1/even_coeffs", {{"x", 1}});
     },
     {"surfaces[1].even_coeffs"}},
    {"NoSurfaces", [](const Json& j) { return edited(j, "/surfaces", Json::array()); }, {"surfaces", "0 surfaces"}},
    {"Inches", [](const Json& j) { return edited(j, "/units", "inch"); }, {"units", "inch"}},
    {"Huge", [](const Json&) { return std::string(100u << 20, ' '); }, {"bytes"}},
};

struct BadLens : testing::TestWithParam<Bad> {};

TEST_P(BadLens, IsRefusedInOneLineThatNamesThePlace) {
  const auto file = std::filesystem::path(testing::TempDir()) / ("bad_lens_" + std::string(GetParam().name) + ".json");
  std::ofstream(file) << GetParam().text(good());
  const auto load = [&] { load_prescription(file.string()); };
  EXPECT_TRUE(pecs::tests::error_of(load).starts_with(file.string()));
  for (const std::string& word : GetParam().said) pecs::tests::expect_error(load, ExitCode::bad_input, word);
  std::filesystem::remove(file);
}
INSTANTIATE_TEST_SUITE_P(Cases, BadLens, testing::ValuesIn(kBad),
                         [](const auto& param_info) { return std::string(param_info.param.name); });

// A ray along the axis passes every centred system, so a diverging lens is detected by its other rays.
TEST(Prescription, ALensThatThrowsNoImage) {
  const auto file = std::filesystem::path(testing::TempDir()) / "diverging_lens.json";
  std::ofstream(file) << edited(good(), "/surfaces/1/radius", -25.84);
  const Prescription lens = load_prescription(file.string());
  const auto focus = [&] { best_focus(lens, std::vector{550.0}, std::nullopt, lens.stop_diameter_mm()); };
  pecs::tests::expect_error(focus, ExitCode::bad_input, "wanted a lens that converges");
  EXPECT_TRUE(pecs::tests::error_of(focus).starts_with(file.string() + ": "));
  std::filesystem::remove(file);
}

TEST(Prescription, TheGoodOneIsGood) {
  const auto file = std::filesystem::path(testing::TempDir()) / "good_lens.json";
  std::ofstream(file) << good().dump();
  EXPECT_NEAR(first_order(load_prescription(file.string()), kLambdaD).efl_mm, 25.84 / 0.5168000345, 1e-6);
  std::filesystem::remove(file);
}

TEST(Prescription, WavelengthOutsideTheGlass) {
  const Prescription lens = load_prescription("pecs_lab_15mm");
  EXPECT_NE(pecs::tests::error_of([&] { lens.indices(1040); }).find("surfaces[0].medium_after: got 1040 nm"),
            std::string::npos);
}

}  // namespace
}  // namespace pecs::lens
