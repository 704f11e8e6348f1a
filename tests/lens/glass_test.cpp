#include "pecs/lens/glass.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "pecs/strict_json.h"
#include "shared.h"

namespace pecs::lens {
namespace {

TEST(Glass, CatalogueIndexOfNBk7) {  // Schott's data sheet
  const auto bk7 = catalog_glass("Schott", "N-BK7");
  ASSERT_TRUE(bk7);
  EXPECT_NEAR(bk7->n(587.5618), 1.51680, 5e-6);
  EXPECT_NEAR(bk7->n(486.1327), 1.52238, 5e-6);
  EXPECT_NEAR(bk7->n(1013.98), 1.50731, 5e-6);
  EXPECT_NEAR(bk7->vd(), 64.17, 0.01);
}

TEST(Glass, EveryFileLoadsAndDispersesNormally) {
  int count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(tests::source_dir() / "lens_data/glasses")) {
    if (entry.path().extension() != ".json") continue;
    const Glass glass = Glass::from_file(entry.path());
    EXPECT_GT(glass.n(450), glass.n(550)) << entry.path();
    EXPECT_GT(glass.n(550), glass.n(700)) << entry.path();
    ++count;
  }
  EXPECT_GE(count, 20);
}

TEST(Glass, AgreesWithTheDatabaseThatItCameFrom) {
  PECS_NEEDS_SHARED("lenses/_glass_sellmeier.json");
  const Json json = parse_json_file(tests::shared_dir() / "lenses/_glass_sellmeier.json");
  int count = 0;
  for (const auto& [key, glass_json] : json["glasses"].items()) {
    const std::string catalog = key.substr(0, key.find('/')), name = key.substr(key.rfind('/') + 1);
    const auto glass = catalog_glass(catalog, name);
    ASSERT_TRUE(glass) << key;
    for (const auto& [um, n] : glass_json["n_check"].items()) {
      EXPECT_NEAR(glass->n(1000 * std::stod(um)), n.get<double>(), 1e-9) << key;
      ++count;
    }
  }
  EXPECT_GT(count, 100);
}

TEST(Glass, FallbackMeetsNdVdAndTheNormalLine) {
  const Glass glass = Glass::from_nd_vd(1.62, 60.3, "x");
  EXPECT_NEAR(glass.nd(), 1.62, 1e-12);
  EXPECT_NEAR(glass.vd(), 60.3, 1e-9);
  const double partial = (glass.n(kLambdaG) - glass.n(kLambdaF)) / (glass.n(kLambdaF) - glass.n(kLambdaC));
  EXPECT_NEAR(partial, 0.6438 - 0.001682 * 60.3, 1e-9);
}

TEST(Glass, FallbackIsCloseToAnOrdinaryGlass) {
  const auto real = catalog_glass("Schott", "N-BK7");
  ASSERT_TRUE(real);
  const Glass fallback = Glass::from_nd_vd(real->nd(), real->vd(), "");
  for (const double nm : {400.0, 450.0, 700.0, 900.0, 1000.0}) EXPECT_NEAR(fallback.n(nm), real->n(nm), 2e-3) << nm;
}

TEST(Glass, NamesAreMatchedOnlyWhenTheNumbersAgree) {
  EXPECT_TRUE(matching_glass("N-BK7", 1.5168, 64.2));
  EXPECT_FALSE(matching_glass("N-BK7", 1.52, 64.2));
  EXPECT_FALSE(catalog_glass("Schott", "N-NOSUCH"));
}

}  // namespace
}  // namespace pecs::lens
