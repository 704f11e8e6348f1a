#pragma once
// Turns C++ into C: no exception leaves, text is handed over with malloc.
#include <cstdlib>
#include <cstring>
#include <exception>
#include <string>
#include <type_traits>

#include "pecs.h"
#include "pecs/error.h"

namespace pecs::capi {

inline void set_error(pecs_error* error, ExitCode code, const char* message) {
  if (!error) return;
  error->code = static_cast<int>(code);
  std::strncpy(error->message, message, sizeof(error->message) - 1);
  error->message[sizeof(error->message) - 1] = '\0';
}

// Runs f() and returns its value; on an exception fills `error` and returns `failed`.
template <class F, class R = std::invoke_result_t<F>>
R guard(pecs_error* error, R failed, F&& f) noexcept {
  set_error(error, ExitCode::ok, "");
  try {
    return f();
  } catch (const std::exception& e) {
    const Error line = as_error(e);
    set_error(error, line.code(), line.what());
  } catch (...) {
    set_error(error, ExitCode::internal, "unknown exception");
  }
  return failed;
}

inline char* hand_over(const std::string& text) {
  char* out = static_cast<char*>(std::malloc(text.size() + 1));
  if (!out) throw std::bad_alloc();
  std::memcpy(out, text.c_str(), text.size() + 1);
  return out;
}

}  // namespace pecs::capi
