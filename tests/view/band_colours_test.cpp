#include "pecs/view/band_colours.h"

#include <gtest/gtest.h>

#include "pecs/data_dir.h"
#include "pecs/sensor/choose_bands.h"
#include "pecs/sensor/named_spectrum.h"

namespace pecs::view {
namespace {

using Triple = std::array<double, 3>;

std::vector<sensor::Band> bands_of(int n, double min_nm = 400, double max_nm = 700) {
  const Json chosen =
      sensor::choose_bands({{"n", n}, {"placement", "uniform"}, {"min_nm", min_nm}, {"max_nm", max_nm}});
  std::vector<sensor::Band> bands;
  for (const Json& b : chosen["bands"]) bands.push_back({b["lambda_nm"], b["weight_nm"]});
  return bands;
}

Triple colour(const std::vector<sensor::Band>& bands, const sensor::Spectrum& lamp, const auto& reflectance) {
  const auto rgb = rgb_of_bands(bands, lamp);
  Triple sum{};
  for (std::size_t k = 0; k < bands.size(); ++k)
    for (std::size_t c = 0; c < 3; ++c)
      sum[c] += rgb[k][c] * lamp.at(bands[k].lambda_nm) * reflectance(bands[k].lambda_nm);
  return sum;
}

TEST(BandColours, WhiteIsNeutralForAnyLampAndNumberOfBands) {
  for (const char* lamp : {"d65", "led_b3", "a", "blackbody:2856", "daylight:5000"})
    for (const int n : {1, 2, 3, 4, 6, 12, 31}) {
      const Triple c = colour(bands_of(n), sensor::named_spectrum(lamp), [](double) { return 1.0; });
      for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(c[i], 1, 0.01) << lamp << " " << n << " " << i;
    }
}

TEST(BandColours, TheSrgbPrimariesAreTheirOwnColours) {
  const auto rows = sensor::read_table(data_dir("lens_data/spectra") / "basis" / "srgb.csv", 4);
  for (std::size_t primary = 0; primary < 3; ++primary) {
    sensor::Spectrum s;
    for (const auto& row : rows) s.lambda_nm.push_back(row[0]), s.value.push_back(row[1 + primary]);
    for (const int n : {3, 6, 12, 31}) {
      const Triple c = colour(bands_of(n), sensor::named_spectrum("d65"), [&](double nm) { return s.at(nm); });
      for (std::size_t i = 0; i < 3; ++i) EXPECT_NEAR(c[i], i == primary, 0.02) << primary << " " << n;
    }
  }
}

TEST(BandColours, UninformativeBandsAreGrey) {
  const auto rgb = rgb_of_bands(bands_of(3, 850, 950), sensor::named_spectrum("blackbody:2856"));
  for (const Triple& c : rgb) {
    EXPECT_TRUE(std::isfinite(c[0]));
    EXPECT_NEAR(c[0], c[1], 1e-6 * std::abs(c[0]) + 1e-12);
    EXPECT_NEAR(c[0], c[2], 1e-6 * std::abs(c[0]) + 1e-12);
  }
}

}  // namespace
}  // namespace pecs::view
