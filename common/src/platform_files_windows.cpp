// Files of Windows; platform_files.cpp is that of the other systems.
#include <fcntl.h>
#include <io.h>

#include <atomic>
#include <cerrno>
#include <cstring>

#include "on_windows.h"
#include "pecs/error.h"

namespace pecs::platform {
namespace fs = std::filesystem;
namespace {

// Others may read, write, rename and remove a file that is open here, as on other systems.
constexpr DWORD kShareAll = FILE_SHARE_READ | FILE_SHARE_WRITE | FILE_SHARE_DELETE;

HANDLE handle_of(const Descriptor& file) { return reinterpret_cast<HANDLE>(::_get_osfhandle(file.number())); }

Descriptor descriptor_of(HANDLE handle) {
  return Descriptor(::_open_osfhandle(reinterpret_cast<std::intptr_t>(handle), _O_BINARY | _O_RDWR));
}

bool is_same_file(HANDLE a, HANDLE b) {
  BY_HANDLE_FILE_INFORMATION of_a{}, of_b{};
  return ::GetFileInformationByHandle(a, &of_a) && ::GetFileInformationByHandle(b, &of_b) &&
         of_a.dwVolumeSerialNumber == of_b.dwVolumeSerialNumber && of_a.nFileIndexHigh == of_b.nFileIndexHigh &&
         of_a.nFileIndexLow == of_b.nFileIndexLow;
}

// A byte behind the end of every file: a lock of Windows keeps others from reading and writing what it covers.
bool lock(HANDLE file) {
  OVERLAPPED at{};
  at.OffsetHigh = 0x7fffffff;
  return ::LockFileEx(file, LOCKFILE_EXCLUSIVE_LOCK | LOCKFILE_FAIL_IMMEDIATELY, 0, 1, 0, &at) != 0 ||
         ::GetLastError() != ERROR_LOCK_VIOLATION;
}

// A scanner for viruses opens new files for a moment.
std::string renamed(const fs::path& from, const fs::path& to) {
  constexpr int kTries = 20, kPause_ms = 50;
  for (int i = 0;; ++i) {
    if (::MoveFileExW(from.c_str(), to.c_str(), MOVEFILE_REPLACE_EXISTING)) return "";
    const DWORD code = ::GetLastError();
    if ((code != ERROR_SHARING_VIOLATION && code != ERROR_ACCESS_DENIED) || i == kTries) return message_of(code);
    ::Sleep(kPause_ms);
  }
}

}  // namespace

Descriptor::~Descriptor() {
  if (number_ >= 0) ::_close(number_);
}

Descriptor claim(const fs::path& file, const fs::path& path) {
  const auto refuse = [&](const std::string& why) { return bad_output(path.string(), why); };
  constexpr DWORD kAttributes = FILE_ATTRIBUTE_NORMAL | FILE_FLAG_OPEN_REPARSE_POINT;
  for (;;) {
    if (const DWORD found = ::GetFileAttributesW(file.c_str()); found != INVALID_FILE_ATTRIBUTES) {
      if (found & FILE_ATTRIBUTE_REPARSE_POINT) throw refuse(file.string() + " is a symbolic link");
      if (found & FILE_ATTRIBUTE_DIRECTORY) throw refuse(file.string() + " is not a regular file");
    }
    Handle opened(::CreateFileW(file.c_str(), GENERIC_READ | GENERIC_WRITE, kShareAll, nullptr, OPEN_ALWAYS,
                                kAttributes, nullptr));
    if (!opened.get()) throw refuse(last_error());
    if (::GetFileType(opened.get()) != FILE_TYPE_DISK) throw refuse(file.string() + " is not a regular file");
    if (!lock(opened.get())) throw refuse("another process is writing it");
    // Another process renamed it between open and lock: it is a finished output now.
    const Handle named(::CreateFileW(file.c_str(), 0, kShareAll, nullptr, OPEN_EXISTING, kAttributes, nullptr));
    if (!is_same_file(opened.get(), named.get())) continue;
    FILE_END_OF_FILE_INFO empty{};
    if (!::SetFileInformationByHandle(opened.get(), FileEndOfFileInfo, &empty, sizeof empty))
      throw refuse(last_error());
    return descriptor_of(opened.release());
  }
}

std::FILE* open_to_read(const fs::path& path) { return ::_wfopen(path.c_str(), L"rb"); }

std::FILE* open_stream(const fs::path& path) { return ::_wfopen(path.c_str(), L"wb"); }

std::FILE* open_again(const Descriptor& file, const char* mode) {
  const int number = ::_dup(file.number());
  return number < 0 ? nullptr : ::_fdopen(number, mode);
}

std::FILE* open_unnamed(const fs::path& beside) {
  static std::atomic<int> number = 0;
  const std::wstring name =
      beside.wstring() + L"." + std::to_wstring(::GetCurrentProcessId()) + L"." + std::to_wstring(number++);
  Handle file(::CreateFileW(name.c_str(), GENERIC_READ | GENERIC_WRITE | DELETE, kShareAll, nullptr, CREATE_NEW,
                            FILE_ATTRIBUTE_TEMPORARY | FILE_FLAG_DELETE_ON_CLOSE, nullptr));
  if (!file.get()) {
    errno = ::GetLastError() == ERROR_PATH_NOT_FOUND ? ENOENT : EACCES;
    return nullptr;
  }
  return open_again(descriptor_of(file.release()), "w+b");
}

std::string rename_complete(const Descriptor& file, const fs::path& from, const fs::path& to) {
  if (!::FlushFileBuffers(handle_of(file))) return last_error();
  return renamed(from, to);
}

std::string rename_complete(const fs::path& from, const fs::path& to) {
  std::error_code none;
  if (fs::is_directory(from, none)) return renamed(from, to);  // a folder cannot be flushed
  Handle file(::CreateFileW(from.c_str(), GENERIC_READ | GENERIC_WRITE, kShareAll, nullptr, OPEN_EXISTING,
                            FILE_FLAG_OPEN_REPARSE_POINT, nullptr));
  if (!file.get()) return last_error();
  return rename_complete(descriptor_of(file.release()), from, to);
}

std::string name_for_libraries(const fs::path& path) {
  if (::GetACP() == CP_UTF8) return path.string();
  BOOL lacks = FALSE;
  const std::wstring wide = path.wstring();
  std::string name(4 * wide.size() + 1, 0);
  const int bytes = ::WideCharToMultiByte(CP_ACP, WC_NO_BEST_FIT_CHARS, wide.c_str(), static_cast<int>(wide.size()),
                                          name.data(), static_cast<int>(name.size()), nullptr, &lacks);
  if (lacks || bytes <= 0)
    throw Error(ExitCode::unsupported,
                path.string() + ": name: got letters that the system's code page lacks, wanted others");
  name.resize(static_cast<std::size_t>(bytes));
  return name;
}

void will_read(const fs::path&) {}  // Windows reads ahead itself, within a file

}  // namespace pecs::platform
