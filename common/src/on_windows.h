#pragma once
// Windows, and its text: UTF-16 there, UTF-8 in all of PECS.
#ifndef NOMINMAX
#define NOMINMAX
#endif
#include <windows.h>

#include <filesystem>
#include <string>
#include <utility>

#include "pecs/platform.h"

namespace pecs::platform {

inline std::wstring wide(const std::string& text) { return std::filesystem::path(text).wstring(); }
inline std::string narrow(const std::wstring& text) { return std::filesystem::path(text).string(); }
std::string message_of(unsigned long code);  // of GetLastError()
inline std::string last_error() { return message_of(::GetLastError()); }

class Handle {
 public:
  explicit Handle(HANDLE handle) : handle_(handle == INVALID_HANDLE_VALUE ? nullptr : handle) {}
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() {
    if (handle_) ::CloseHandle(handle_);
  }
  HANDLE get() const { return handle_; }
  HANDLE release() { return std::exchange(handle_, nullptr); }

 private:
  HANDLE handle_;
};

}  // namespace pecs::platform
