#pragma once
// JSON that is checked as it is read: every getter names file and key when a value is missing, of the wrong type, not
// finite or out of range, and done() rejects keys that were not read. Keys that start with '_' are comments.
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace pecs {

using Json = nlohmann::json;

// Parses; errors contain file, line and column. Rejects, besides invalid JSON: duplicate keys, numbers beyond the range
// of a double, more than 100 levels, a byte order mark, more than max_bytes.
Json parse_json_file(const std::filesystem::path& path, std::size_t max_bytes = std::size_t{4} << 20);
Json parse_json(const std::string& text, const std::string& file);

// Like dump(), but replaces bytes that are not UTF-8 (of file names) instead of throwing.
std::string text_of(const Json& json, int indent = -1);

// The value; null without one.
template <class T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json();
}

struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
};

class JsonObject {
 public:
  // `place` is the path inside the file ("surfaces[3]"); empty at the top.
  JsonObject(const Json& json, std::string file, std::string place = "");

  bool has(const std::string& key);  // present and not null
  double number(const std::string& key, Range range = {});
  double number_or(const std::string& key, double fallback, Range range = {});
  std::optional<double> maybe_number(const std::string& key, Range range = {});
  std::int64_t integer(const std::string& key, std::int64_t min, std::int64_t max);
  std::int64_t integer_or(const std::string& key, std::int64_t fallback, std::int64_t min, std::int64_t max);
  bool boolean_or(const std::string& key, bool fallback);
  std::string text(const std::string& key);
  std::string text_or(const std::string& key, const std::string& fallback);
  std::string one_of(const std::string& key, const std::vector<std::string>& allowed);
  std::vector<double> numbers(const std::string& key, Range range = {});
  JsonObject object(const std::string& key);
  std::vector<JsonObject> objects(const std::string& key);  // an array of objects
  const Json& any(const std::string& key);                  // without checks; null when absent

  void done() const;  // throws for a key that was not read
  [[noreturn]] void fail(const std::string& key, const std::string& got, const std::string& wanted) const;
  const std::string& file() const { return file_; }
  const std::string& place() const { return place_; }

 private:
  const Json& required(const std::string& key);
  std::string where(const std::string& key) const;
  double checked(const std::string& key, const Json& value, Range range) const;

  const Json* json_;
  std::string file_, place_;
  std::set<std::string> asked_;
};

}  // namespace pecs
