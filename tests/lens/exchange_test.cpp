#include "pecs/lens/exchange.h"

#include <gtest/gtest.h>

#include <fstream>

#include "lenses.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/lens/first_order.h"

namespace pecs::lens {
namespace {

using tests::test_lens_dir;

std::filesystem::path write(const std::string& name, const std::string& text) {
  const auto path = std::filesystem::path(testing::TempDir()) / name;
  std::ofstream(path, std::ios::binary) << text;
  return path;
}

// A file of Zemax, with a part of its text replaced.
std::string zmx(const std::string& from = "", const std::string& to = "") {
  std::string text = read_text(test_lens_dir() / "singlet.zmx", 1 << 16);
  return text.replace(text.find(from), from.size(), to);
}

TEST(Zemax, OddNumbersAndBytesAreErrorsOrText) {  // found by fuzzing
  const auto refused = [](const std::string& text) {
    ExitCode code{};
    pecs::tests::error_of([&] { import_zmx(text, "f.zmx").dump(); }, &code);
    return code == ExitCode::bad_input;
  };
  EXPECT_TRUE(refused(zmx("DISZ 1\n  DIAM 5 0 0 0 1 \"\"\n",
                          "DISZ INFINITY\n  DIAM 5\nSURF 9\n  TYPE STANDARD\n  CURV 0\n  DISZ 1\n  DIAM 5\n")));
  EXPECT_TRUE(refused(zmx("CONI -0.5", "CONI INFINITY")));
  EXPECT_TRUE(refused(zmx("PARM 1 0", "PARM inf 0")));
  EXPECT_FALSE(refused(zmx("PARM 1 0", "PARM 1e30 0")));
  EXPECT_FALSE(refused(zmx("NAME a test", "NAME a \xb0 test")));
  EXPECT_FALSE(refused(zmx("GLAS N-BK7", "GLAS " + std::string(300, 'N'))));  // longer than a file name may be
}

TEST(Zemax, SingletWithAnAsphere) {
  const Prescription lens = load_prescription((test_lens_dir() / "singlet.zmx").string());
  EXPECT_EQ(lens.name, "a test");
  ASSERT_EQ(lens.surfaces.size(), 3u);  // the plane before the stop is dropped
  EXPECT_EQ(lens.stop, 0u);
  EXPECT_EQ(lens.surfaces[1].conic, -0.5);
  ASSERT_EQ(lens.surfaces[1].powers.size(), 5u);
  EXPECT_EQ(lens.surfaces[1].powers[4], 1e-7);
  EXPECT_EQ(lens.surfaces[1].after.source(), "Schott");
  EXPECT_NEAR(first_order(lens, kLambdaD).efl_mm, 50, 1e-3);
}

TEST(Zemax, Utf16AndUnits) {
  std::string wide = "\xFF\xFE";
  for (const char c : zmx("UNIT MM", "UNIT CM")) wide += {c, '\0'};
  const Prescription lens = load_prescription(write("wide.zmx", wide).string());
  EXPECT_NEAR(first_order(lens, kLambdaD).efl_mm, 500, 1e-2);
  EXPECT_NEAR(lens.surfaces[1].powers[4], 1e-10, 1e-20);
}

TEST(Zemax, WhatItCannotHoldIsRefusedByLine) {
  const auto refused = [](const std::string& from, const std::string& to, const std::string& said) {
    const auto path = write("bad.zmx", zmx(from, to));
    pecs::tests::expect_error([&] { load_prescription(path.string()); }, ExitCode::bad_input, said);
  };
  refused("EVENASPH", "BICONICX", "BICONICX");
  refused("MODE SEQ", "MODE NSC", "line 2");
  refused("GLAS N-BK7 0 0 1.5168 64.17", "GLAS N-NOSUCH 0 0 0 0", "N-NOSUCH");
  refused("  STOP\n", "", "STOP");
  refused("DISZ 4", "DISZ four", "four");
  refused("UNIT MM", "UNIT FT", "FT");
  for (const std::string key : {"CLAP 1 4 0", "OBSC 0 2 0", "SQAP 3 2", "OBDC 1 0"})
    refused("  DIAM 5", "  " + key + "\n  DIAM 5", "line 20: got aperture " + key.substr(0, 4));
}

TEST(Zemax, AperturesBlockLight) {
  const auto read = [](const std::string& from, const std::string& to) {
    return load_prescription(write("clap.zmx", zmx(from, to)).string());
  };
  EXPECT_EQ(read("DIAM 12.7 0 0 0 1 \"\"\nSURF 5", "DIAM 12.7\n  CLAP 0 6 0\nSURF 5").surfaces[2].semi_diameter_mm, 6);
  const Prescription baffle = read("DIAM 8 0 0 0 1 \"\"", "CLAP 0 4 0");  // the plane before the stop
  ASSERT_EQ(baffle.surfaces.size(), 4u);
  EXPECT_EQ(baffle.surfaces[0].semi_diameter_mm, 4);
  EXPECT_EQ(baffle.surfaces[1].z_mm, 10);
  const std::string aperture = "SURF 2\n  TYPE STANDARD\n  CLAP 0 3 0";
  const auto pupil_mm = [&](const std::string& enpd) {
    std::string text = zmx("SURF 2\n  TYPE STANDARD", aperture);
    text.replace(text.find("UNIT"), 0, enpd);
    return first_order(load_prescription(write("stop.zmx", text).string()), kLambdaD).entrance_pupil_diameter_mm;
  };
  EXPECT_NEAR(pupil_mm(""), 6, 1e-9);
  EXPECT_NEAR(pupil_mm("ENPD 12\n"), 6, 1e-9);
  EXPECT_NEAR(pupil_mm("ENPD 4\n"), 4, 1e-9);
}

TEST(Zemax, ConfigurationsAreNoted) {
  const auto notes = [](const std::string& to) {
    return load_prescription(write("mnum.zmx", zmx("GCAT", to + "\nGCAT")).string()).notes;
  };
  EXPECT_TRUE(notes("MNUM 1 1").empty());
  ASSERT_EQ(notes("MNUM 3 2").size(), 1u);
}

TEST(Pbrt, RoundTripKeepsTheRays) {
  const Prescription lens = load_prescription("dgauss_50mm_tronnier");
  const double bands[] = {kLambdaD};
  const std::string text = export_pbrt(lens, kLambdaD, best_focus(lens, bands, std::nullopt).film_z_mm);
  const Prescription back = load_prescription(write("dgauss.dat", text).string());
  ASSERT_EQ(back.surfaces.size(), lens.surfaces.size());
  EXPECT_EQ(back.stop, lens.stop);
  const Tracer a(lens, kLambdaD), b(back, kLambdaD);
  const Ray ray{{5, 3, -10}, normalized({0.1, -0.05, 1})};
  const Traced ta = a.to_film(ray), tb = b.to_film(ray);
  ASSERT_EQ(ta.fate, Fate::ok);
  EXPECT_NEAR(ta.ray.p.x, tb.ray.p.x, 1e-6);
  EXPECT_NEAR(ta.ray.d.y, tb.ray.d.y, 1e-8);
}

TEST(Pbrt, RefusesAspheresAndBadLines) {
  const Prescription asphere = load_prescription("cmount_16mm_f2p1");
  EXPECT_THROW(export_pbrt(asphere, kLambdaD, 25), Error);
  EXPECT_THROW(load_prescription(write("bad.dat", "10 2 1.5 8\n0 1 1\n").string()), Error);
  EXPECT_THROW(load_prescription(write("nostop.dat", "10 2 1.5 8\n-10 2 1 8\n").string()), Error);
}

}  // namespace
}  // namespace pecs::lens
