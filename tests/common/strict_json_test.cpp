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

TEST(StrictJson, ErrorsHaveFilePlaceGotAndWanted) {
  EXPECT_EQ(error_of(R"({"a": 1})", [](auto& o) { o.number("a"); }), "");
  EXPECT_EQ(error_of(R"({"a": 7})", [](auto& o) { o.number("a", {0, 1}); }),
            "f.json: a: got 7, wanted a number in [0, 1]");
  EXPECT_EQ(error_of(R"({"a": "x"})", [](auto& o) { o.number("a"); }), "f.json: a: got \"x\", wanted a finite number");
  EXPECT_EQ(error_of("{}", [](auto& o) { o.number("a"); }), "f.json: a: got nothing, wanted a value");
  EXPECT_EQ(error_of(R"({"s": [{"r": null}]})", [](auto& o) { o.objects("s")[0].number("r"); }),
            "f.json: s[0].r: got nothing, wanted a value");
}

TEST(StrictJson, RejectsUnknownKeysButNotComments) {
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

// Names go into shaders, pages and terminals: a line feed in one would end a comment.
TEST(StrictJson, TextHasNoControlCharacters) {
  for (const char* escape : {"\\n", "\\u0000", "\\u001b", "\\u007f", "\\u0085", "\\r"})
    EXPECT_NE(error_of(std::string(R"({"name": "a)") + escape + R"(b"})", [](auto& o) { o.text("name"); })
                  .find("f.json: name: got \"a"),
              std::string::npos)
        << escape;
  EXPECT_EQ(error_of(R"({"name": "Büro 15 mm — f/2.8"})", [](auto& o) { o.text("name"); }), "");
}

TEST(StrictJson, RejectsAmbiguousContent) {
  const auto line = [](const std::string& text) { return error_of(text, [](auto&) {}); };
  EXPECT_EQ(line(R"({"a": 1, "b": {"c": [1, {"d": 1, "d": 2}]}})"),
            "f.json: b.c[1].d: got a duplicate key, wanted each key once");
  EXPECT_EQ(line("{\n\"a\": 1e999}"), "f.json: line 2 column 10: got 1e999, wanted a number of at most 1.8e308");
  EXPECT_EQ(line(std::string("\xff\xfe{\0}\0", 6)), "f.json: byte 0: got UTF-16, wanted UTF-8");
  EXPECT_EQ(line("{\"a\": \"\xff\"}"), "f.json: line 1 column 8: got bytes that are not UTF-8, wanted valid JSON");
  const auto nested = [](int levels) { return std::string(levels, '[') + std::string(levels, ']'); };
  EXPECT_EQ(line(nested(101)).substr(0, 14), "f.json: [0][0]");
  EXPECT_EQ(pecs::parse_json(nested(100), "f.json").dump(), nested(100));
}

TEST(StrictJson, ReadsWhatTheLibraryReads) {
  const std::string text =
      R"([null, true, -1, 18446744073709551615, 1.5e-3, "\u00e9", {"a": [], "b": {"a": {}}}, [[1], 2]])";
  EXPECT_EQ(pecs::parse_json(text, "f.json"), pecs::Json::parse(text));
}
