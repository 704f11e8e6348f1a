#include "pecs/strict_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs {
namespace {

constexpr std::size_t kMaxDepth = 100;
constexpr std::size_t kShownBytes = 40;

std::string excerpt(const Json& value) { return shortened(value.dump(), kShownBytes); }

std::string range_text(Range range) {
  if (std::isinf(range.min) && std::isinf(range.max)) return "a finite number";
  if (std::isinf(range.max)) return fmt::format("a number >= {}", range.min);
  if (std::isinf(range.min)) return fmt::format("a number <= {}", range.max);
  return fmt::format("a number in [{}, {}]", range.min, range.max);
}

// Builds the value. Rejects content that readers interpret differently or that is unusable: duplicate keys, numbers
// that no double represents, unlimited nesting.
class StrictBuilder : public nlohmann::json_sax<Json> {
 public:
  StrictBuilder(const std::string& text, const std::string& file) : text_(text), file_(file) {}
  Json take() { return std::move(root_); }

  bool null() override { return put({}); }
  bool boolean(bool value) override { return put(value); }
  bool number_integer(number_integer_t value) override { return put(value); }
  bool number_unsigned(number_unsigned_t value) override { return put(value); }
  bool number_float(number_float_t value, const string_t&) override { return put(value); }
  bool string(string_t& value) override { return put(std::move(value)); }
  bool binary(binary_t&) override { return false; }  // not in text
  bool start_object(std::size_t) override { return open(Json::object()); }
  bool start_array(std::size_t) override { return open(Json::array()); }
  bool end_object() override { return close(); }
  bool end_array() override { return close(); }
  bool key(string_t& value) override {
    key_ = std::move(value);
    if (open_.back().json->contains(key_)) throw bad_input(file_, place(), "a duplicate key", "each key once");
    return true;
  }

  bool parse_error(std::size_t byte, const std::string& token, const Json::exception& e) override {
    const std::string_view before = std::string_view(text_).substr(0, byte > 0 ? byte - 1 : 0);
    const std::size_t line = 1 + static_cast<std::size_t>(std::ranges::count(before, '\n'));
    const std::size_t column = before.size() - (before.rfind('\n') + 1) + 1;
    const std::string where = fmt::format("line {} column {}", line, column);
    if (dynamic_cast<const Json::out_of_range*>(&e))
      throw bad_input(file_, where, shortened(token, kShownBytes), "a number of at most 1.8e308");
    if (std::string_view(e.what()).find("UTF-8") != std::string_view::npos)
      throw bad_input(file_, where, "bytes that are not UTF-8", "valid JSON");
    throw bad_input(file_, where, byte > text_.size() ? "the end of the file" : "text that is not JSON", "valid JSON");
  }

 private:
  struct Level {
    Json* json;
    std::string key;  // in the level above, when that is an object
  };

  // The place of the next value.
  std::string place() const {
    std::string out;
    for (std::size_t i = 0; i < open_.size(); ++i) {
      const Json& json = *open_[i].json;
      const bool last = i + 1 == open_.size();
      if (json.is_array())
        out += fmt::format("[{}]", last ? json.size() : json.size() - 1);
      else
        out += (out.empty() ? "" : ".") + shortened(last ? key_ : open_[i + 1].key, kShownBytes);
    }
    return shortened(out, 4 * kShownBytes);
  }
  Json* slot(Json value) {
    if (open_.empty()) return &(root_ = std::move(value));
    Json& parent = *open_.back().json;
    if (!parent.is_array()) return &(parent[key_] = std::move(value));
    parent.push_back(std::move(value));
    return &parent.back();
  }
  bool put(Json value) {
    slot(std::move(value));
    return true;
  }
  bool open(Json value) {
    if (open_.size() == kMaxDepth)
      throw bad_input(file_, place(), fmt::format("more than {} levels", kMaxDepth),
                      fmt::format("at most {}", kMaxDepth));
    open_.push_back({slot(std::move(value)), key_});
    return true;
  }
  bool close() {
    open_.pop_back();
    return true;
  }

  const std::string& text_;
  const std::string& file_;
  Json root_;
  std::vector<Level> open_;
  std::string key_;
};

}  // namespace

Json parse_json(const std::string& text, const std::string& file) {
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff")) throw bad_input(file, "byte 0", "UTF-16", "UTF-8");
  StrictBuilder builder(text, file);
  Json::sax_parse(text, &builder);
  return builder.take();
}

Json parse_json_file(const std::filesystem::path& path, std::size_t max_bytes) {
  return parse_json(read_text(path, max_bytes), path.string());
}

std::string text_of(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

JsonObject::JsonObject(const Json& json, std::string file, std::string place)
    : json_(&json), file_(std::move(file)), place_(std::move(place)) {
  if (!json.is_object()) throw bad_input(file_, place_, excerpt(json), "an object");
}

std::string JsonObject::where(const std::string& key) const {
  return (place_.empty() ? "" : place_ + ".") + shortened(key, kShownBytes);
}

void JsonObject::fail(const std::string& key, const std::string& got, const std::string& wanted) const {
  throw bad_input(file_, where(key), got, wanted);
}

const Json& JsonObject::any(const std::string& key) {
  static const Json null;
  asked_.insert(key);
  const auto it = json_->find(key);
  return it == json_->end() ? null : *it;
}

bool JsonObject::has(const std::string& key) { return !any(key).is_null(); }

const Json& JsonObject::required(const std::string& key) {
  const Json& value = any(key);
  if (value.is_null()) fail(key, "nothing", "a value");
  return value;
}

double JsonObject::checked(const std::string& key, const Json& value, Range range) const {
  if (!value.is_number()) fail(key, excerpt(value), range_text(range));
  const double x = value.get<double>();
  if (!std::isfinite(x) || x < range.min || x > range.max) fail(key, excerpt(value), range_text(range));
  return x;
}

double JsonObject::number(const std::string& key, Range range) { return checked(key, required(key), range); }

double JsonObject::number_or(const std::string& key, double fallback, Range range) {
  return has(key) ? number(key, range) : fallback;
}

std::optional<double> JsonObject::maybe_number(const std::string& key, Range range) {
  if (!has(key)) return std::nullopt;
  return number(key, range);
}

std::int64_t JsonObject::integer(const std::string& key, std::int64_t min, std::int64_t max) {
  const Json& value = required(key);
  const std::string wanted = fmt::format("an integer in [{}, {}]", min, max);
  if (!value.is_number_integer()) fail(key, excerpt(value), wanted);
  if (value.is_number_unsigned() &&
      value.get<std::uint64_t>() > static_cast<std::uint64_t>(std::max<std::int64_t>(max, 0)))
    fail(key, excerpt(value), wanted);
  const auto x = value.get<std::int64_t>();
  if (x < min || x > max) fail(key, excerpt(value), wanted);
  return x;
}

std::int64_t JsonObject::integer_or(const std::string& key, std::int64_t fallback, std::int64_t min, std::int64_t max) {
  return has(key) ? integer(key, min, max) : fallback;
}

bool JsonObject::boolean_or(const std::string& key, bool fallback) {
  if (!has(key)) return fallback;
  const Json& value = any(key);
  if (!value.is_boolean()) fail(key, excerpt(value), "true or false");
  return value.get<bool>();
}

std::string JsonObject::text(const std::string& key) {
  const Json& value = required(key);
  if (!value.is_string()) fail(key, excerpt(value), "text");
  std::string text = value.get<std::string>();
  // Names enter shaders, pages, records and terminals.
  if (printable(text) != text) fail(key, excerpt(value), "text without control characters");
  return text;
}

std::string JsonObject::text_or(const std::string& key, const std::string& fallback) {
  return has(key) ? text(key) : fallback;
}

std::string JsonObject::one_of(const std::string& key, const std::vector<std::string>& allowed) {
  const std::string value = text(key);
  for (const std::string& a : allowed)
    if (a == value) return value;
  fail(key, excerpt(value), fmt::format("one of {}", fmt::join(allowed, ", ")));
}

std::vector<double> JsonObject::numbers(const std::string& key, Range range) {
  const Json& value = required(key);
  if (!value.is_array()) fail(key, excerpt(value), "a list of numbers");
  std::vector<double> out;
  out.reserve(value.size());
  for (std::size_t i = 0; i < value.size(); ++i) out.push_back(checked(fmt::format("{}[{}]", key, i), value[i], range));
  return out;
}

JsonObject JsonObject::object(const std::string& key) { return {required(key), file_, where(key)}; }

std::vector<JsonObject> JsonObject::objects(const std::string& key) {
  const Json& value = required(key);
  if (!value.is_array()) fail(key, excerpt(value), "a list of objects");
  std::vector<JsonObject> out;
  for (std::size_t i = 0; i < value.size(); ++i)
    out.emplace_back(value[i], file_, fmt::format("{}[{}]", where(key), i));
  return out;
}

void JsonObject::done() const {
  for (const auto& [key, value] : json_->items()) {
    if (key.starts_with('_') || asked_.contains(key)) continue;
    throw bad_input(file_, where(key), "an unknown key", fmt::format("one of {}", fmt::join(asked_, ", ")));
  }
}

}  // namespace pecs
