#include "pecs/strict_json.h"

#include <fmt/format.h>

#include <cmath>

#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs {
namespace {

std::string recording(const Json& value) {
  std::string text = value.dump();
  return text.size() <= 40 ? text : text.substr(0, 37) + "...";
}

std::string range_text(Range range) {
  if (std::isinf(range.min) && std::isinf(range.max)) return "a finite number";
  if (std::isinf(range.max)) return fmt::format("a number >= {}", range.min);
  if (std::isinf(range.min)) return fmt::format("a number <= {}", range.max);
  return fmt::format("a number in [{}, {}]", range.min, range.max);
}

}  // namespace

Json parse_json(const std::string& text, const std::string& file) {
  try {
    return Json::parse(text, nullptr, true, /*ignore_comments=*/false);
  } catch (const Json::parse_error& e) {
    std::size_t line = 1, column = 1;
    for (std::size_t i = 0; i + 1 < e.byte && i < text.size(); ++i) {
      if (text[i] == '\n') {
        ++line;
        column = 1;
      } else {
        ++column;
      }
    }
    const bool at_end = e.byte > text.size();
    throw bad_input(file, fmt::format("line {} column {}", line, column),
                    at_end ? "the end of the file" : "text that is not JSON", "valid JSON");
  }
}

Json parse_json_file(const std::filesystem::path& path, std::size_t max_bytes) {
  return parse_json(read_text(path, max_bytes), path.string());
}

JsonObject::JsonObject(const Json& json, std::string file, std::string place)
    : json_(&json), file_(std::move(file)), place_(std::move(place)) {
  if (!json.is_object()) throw bad_input(file_, place_, recording(json), "an object");
}

std::string JsonObject::where(const std::string& key) const { return place_.empty() ? key : place_ + "." + key; }

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
  if (!value.is_number()) fail(key, recording(value), range_text(range));
  const double x = value.get<double>();
  if (!std::isfinite(x) || x < range.min || x > range.max) fail(key, recording(value), range_text(range));
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
  if (!value.is_number_integer()) fail(key, recording(value), wanted);
  if (value.is_number_unsigned() &&
      value.get<std::uint64_t>() > static_cast<std::uint64_t>(std::max<std::int64_t>(max, 0)))
    fail(key, recording(value), wanted);
  const auto x = value.get<std::int64_t>();
  if (x < min || x > max) fail(key, recording(value), wanted);
  return x;
}

std::int64_t JsonObject::integer_or(const std::string& key, std::int64_t fallback, std::int64_t min, std::int64_t max) {
  return has(key) ? integer(key, min, max) : fallback;
}

bool JsonObject::boolean_or(const std::string& key, bool fallback) {
  if (!has(key)) return fallback;
  const Json& value = any(key);
  if (!value.is_boolean()) fail(key, recording(value), "true or false");
  return value.get<bool>();
}

std::string JsonObject::text(const std::string& key) {
  const Json& value = required(key);
  if (!value.is_string()) fail(key, recording(value), "text");
  return value.get<std::string>();
}

std::string JsonObject::text_or(const std::string& key, const std::string& fallback) {
  return has(key) ? text(key) : fallback;
}

std::string JsonObject::one_of(const std::string& key, const std::vector<std::string>& allowed) {
  const std::string value = text(key);
  for (const std::string& a : allowed)
    if (a == value) return value;
  fail(key, '"' + value + '"', fmt::format("one of {}", fmt::join(allowed, ", ")));
}

std::vector<double> JsonObject::numbers(const std::string& key, Range range) {
  const Json& value = required(key);
  if (!value.is_array()) fail(key, recording(value), "a list of numbers");
  std::vector<double> out;
  out.reserve(value.size());
  for (std::size_t i = 0; i < value.size(); ++i) out.push_back(checked(fmt::format("{}[{}]", key, i), value[i], range));
  return out;
}

JsonObject JsonObject::object(const std::string& key) { return {required(key), file_, where(key)}; }

std::vector<JsonObject> JsonObject::objects(const std::string& key) {
  const Json& value = required(key);
  if (!value.is_array()) fail(key, recording(value), "a list of objects");
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
