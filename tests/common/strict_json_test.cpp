#include "pecs/strict_json.h"

#include <gtest/gtest.h>

#include "pecs/error.h"

namespace {

std::string error_of(const std::string& text, const std::function<void(pecs::JsonObject&)>& use) {
  try {
    const pecs::Json json = pecs::parse_json(text, "f.json");
    pecs::JsonObject object(json, "f.json");
    use(object);
    object.done();
  } catch (const pecs::Error& e) {
    return e.what();
  }
  return "";
}

}  // namespace

TEST(StrictJson, SaysFilePlaceGotWanted) {
  EXPECT_EQ(error_of(R"({"a": 1})", [](auto& o) { o.number("a"); }), "");
  EXPECT_EQ(error_of(R"({"a": 7})", [](auto& o) { o.number("a", {0, 1}); }),
            "f.json: a: got 7, wanted a number in [0, 1]");
  EXPECT_EQ(error_of(R"({"a": "x"})", [](auto& o) { o.number("a"); }), "f.json: a: got \"x\", wanted a finite number");
  EXPECT_EQ(error_of("{}", [](auto& o) { o.number("a"); }), "f.json: a: got nothing, wanted a value");
  EXPECT_EQ(error_of(R"({"s": [{"r": null}]})", [](auto& o) { o.objects("s")[0].number("r"); }),
            "f.json: s[0].r: got nothing, wanted a value");
}

TEST(StrictJson, RefusesUnknownKeysButNotComments) {
  EXPECT_EQ(error_of(R"({"a": 1, "_why": 2})", [](auto& o) { o.number("a"); }), "");
  EXPECT_EQ(error_of(R"({"a": 1, "b": 2})", [](auto& o) { o.number("a"); }),
            "f.json: b: got an unknown key, wanted one of a");
}

TEST(StrictJson, PlacesSyntaxErrors) {
  EXPECT_EQ(error_of("{\n \"a\": ,}", [](auto&) {}),
            "f.json: line 2 column 7: got text that is not JSON, wanted valid JSON");
  EXPECT_EQ(error_of("{\"a\": [1, 2", [](auto&) {}).substr(0, 14), "f.json: line 1");
}

TEST(StrictJson, IntegersDoNotOverflow) {
  EXPECT_NE(error_of(R"({"a": 18446744073709551615})", [](auto& o) { o.integer("a", 0, 10); }), "");
  EXPECT_NE(error_of(R"({"a": 1.5})", [](auto& o) { o.integer("a", 0, 10); }), "");
}
