#pragma once
// Turns C++ into C: no exception leaves, NULL is refused, text is handed over with malloc.
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <ranges>
#include <string>
#include <type_traits>

#include "pecs.h"
#include "pecs/error.h"
#include "pecs/strict_json.h"

namespace pecs::capi {

inline void set_error(pecs_error* error, ExitCode code, const char* message) {
  if (!error) return;
  error->code = static_cast<int>(code);
  std::strncpy(error->message, message, sizeof(error->message) - 1);
  error->message[sizeof(error->message) - 1] = '\0';
}

// Runs f() and returns its value; on an exception fills `error` and returns -1 or NULL.
template <class F, class R = std::invoke_result_t<F>>
R guard(pecs_error* error, F&& f) noexcept {
  set_error(error, ExitCode::ok, "");
  try {
    return f();
  } catch (const std::exception& e) {
    const Error line = as_error(e);
    set_error(error, line.code(), line.what());
  } catch (...) {
    set_error(error, ExitCode::internal, "unknown exception");
  }
  if constexpr (std::is_pointer_v<R>)
    return nullptr;
  else
    return R{-1};
}

// The object behind a pointer of the caller.
template <class T>
T& given(T* pointer, const char* name) {
  if (!pointer) throw Error(ExitCode::usage, fmt::format("{}: got NULL", name));
  return *pointer;
}

// Options that may be left out altogether.
inline Json options_from(const char* json) { return json ? parse_json(json, "options") : Json::object(); }

inline char* hand_over(const std::string& text) {
  char* out = static_cast<char*>(std::malloc(text.size() + 1));
  if (!out) throw std::bad_alloc();
  std::memcpy(out, text.c_str(), text.size() + 1);
  return out;
}

inline char* hand_over(const Json& json) { return hand_over(text_of(json)); }

inline void check_count(std::int64_t count) {
  if (count < 0) throw Error(ExitCode::usage, fmt::format("count: got {}, wanted 0 or more", count));
}

inline void need_room(std::int64_t count, std::int64_t capacity) {
  if (count < 0 || capacity < count)
    throw Error(ExitCode::usage, fmt::format("capacity: got {}, wanted at least {}", capacity, count));
}

// Fills an array of the caller.
template <std::ranges::sized_range R, class T>
std::int64_t copy_out(const R& values, T* out, std::int64_t capacity) {
  const auto count = static_cast<std::int64_t>(std::ranges::size(values));
  need_room(count, capacity);
  if (count) std::ranges::copy(values, &given(out, "out"));
  return count;
}

}  // namespace pecs::capi
