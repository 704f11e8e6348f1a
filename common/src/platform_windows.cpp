// Windows; platform.cpp is that of the other systems.
#include <fcntl.h>
#include <io.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <stdexcept>
#include <string_view>

#include "on_windows.h"
#include "pecs/error.h"

namespace pecs::platform {
namespace fs = std::filesystem;
namespace {

constexpr DWORD kPipeBytes = 1 << 16;

fs::path file_of(HMODULE module) {
  std::wstring name(MAX_PATH, L'\0');
  for (;;) {
    const DWORD length = ::GetModuleFileNameW(module, name.data(), static_cast<DWORD>(name.size()));
    if (length < name.size()) return name.substr(0, length);
    name.resize(2 * name.size());
  }
}

// The command line that CommandLineToArgvW and the C runtime take apart into these words.
std::wstring command_line(const std::vector<std::string>& words) {
  std::wstring line;
  for (const std::string& word : words) {
    line += line.empty() ? L"\"" : L" \"";
    std::size_t backslashes = 0;
    for (const wchar_t c : wide(word)) {
      if (c == L'"') line.append(backslashes + 1, L'\\');  // those before a quote count twice
      backslashes = c == L'\\' ? backslashes + 1 : 0;
      line += c;
    }
    line.append(backslashes, L'\\') += L'"';
  }
  return line;
}

// Starts words, of which the first is replaced by `program`; it ends with this process. The handle of the process;
// throws the reason.
HANDLE start(const std::string& program, std::vector<std::string> words, HANDLE input, HANDLE output) {
  // The job ends its processes when this one's handle to it is closed, and only the end of this one closes it.
  static const HANDLE job = [] {
    JOBOBJECT_EXTENDED_LIMIT_INFORMATION limits{};
    limits.BasicLimitInformation.LimitFlags = JOB_OBJECT_LIMIT_KILL_ON_JOB_CLOSE;
    const HANDLE made = ::CreateJobObjectW(nullptr, nullptr);
    ::SetInformationJobObject(made, JobObjectExtendedLimitInformation, &limits, sizeof limits);
    return made;
  }();
  words.front() = program;
  std::wstring line = command_line(words);
  STARTUPINFOW about{};
  about.cb = sizeof about;
  about.dwFlags = STARTF_USESTDHANDLES;
  about.hStdInput = input;
  about.hStdOutput = output;
  about.hStdError = ::GetStdHandle(STD_ERROR_HANDLE);
  PROCESS_INFORMATION made{};
  if (!::CreateProcessW(nullptr, line.data(), nullptr, nullptr, TRUE, CREATE_SUSPENDED, nullptr, nullptr, &about,
                        &made))
    throw std::runtime_error(last_error());
  ::AssignProcessToJobObject(job, made.hProcess);
  ::ResumeThread(made.hThread);
  ::CloseHandle(made.hThread);
  return made.hProcess;
}

std::atomic<bool> waits_for_program = false;  // which gets the same signals, and ends as it likes

BOOL WINAPI end_at_once(DWORD event) {
  if (waits_for_program) return TRUE;
  constexpr char kLine[] = "pecs: interrupted\n";
  DWORD written = 0;
  ::WriteFile(::GetStdHandle(STD_ERROR_HANDLE), kLine, sizeof kLine - 1, &written, nullptr);
  const ExitCode code = event == CTRL_C_EVENT ? ExitCode::interrupted : ExitCode::terminated;
  ::TerminateProcess(::GetCurrentProcess(), static_cast<UINT>(code));
  return TRUE;
}

}  // namespace

std::string message_of(unsigned long code) {
  wchar_t* text = nullptr;
  const DWORD length =
      ::FormatMessageW(FORMAT_MESSAGE_ALLOCATE_BUFFER | FORMAT_MESSAGE_FROM_SYSTEM | FORMAT_MESSAGE_IGNORE_INSERTS,
                       nullptr, code, 0, reinterpret_cast<wchar_t*>(&text), 0, nullptr);
  std::string message = length ? narrow({text, length}) : "error " + std::to_string(code);
  ::LocalFree(text);
  while (!message.empty() && std::string_view(".\r\n ").find(message.back()) != std::string_view::npos)
    message.pop_back();
  return message;
}

std::vector<std::string> arguments(int, char**) {
  int count = 0;
  wchar_t** const words = ::CommandLineToArgvW(::GetCommandLineW(), &count);
  std::vector<std::string> out;
  for (int i = 1; i < count; ++i) out.push_back(narrow(words[i]));
  ::LocalFree(words);
  return out;
}

std::optional<std::string> environment(const char* name) {
  const wchar_t* value = ::_wgetenv(wide(name).c_str());
  return value ? std::optional(narrow(value)) : std::nullopt;
}

void set_environment(const char* name, const std::string& value) {
  ::_wputenv_s(wide(name).c_str(), wide(value).c_str());
}

bool stderr_is_terminal() {
  // Progress is drawn by escape sequences.
  DWORD mode = 0;
  const HANDLE console = ::GetStdHandle(STD_ERROR_HANDLE);
  return ::GetConsoleMode(console, &mode) && ::SetConsoleMode(console, mode | ENABLE_VIRTUAL_TERMINAL_PROCESSING);
}

fs::path own_binary() {
  HMODULE module = nullptr;
  constexpr DWORD kHow = GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT;
  ::GetModuleHandleExW(kHow, reinterpret_cast<const wchar_t*>(&own_binary), &module);
  std::error_code error;
  const fs::path path = file_of(module), whole = fs::canonical(path, error);
  return error ? path : whole;
}

fs::path own_program() { return file_of(nullptr); }

std::vector<std::string> python_places() { return {".venv/Scripts/python.exe", "Scripts/python.exe", "python.exe"}; }

std::string become(const std::string& program, std::vector<std::string> words) {
  // Windows replaces no process: this one waits, and ends as the program does.
  try {
    waits_for_program = true;
    const Handle process(
        start(program, std::move(words), ::GetStdHandle(STD_INPUT_HANDLE), ::GetStdHandle(STD_OUTPUT_HANDLE)));
    ::WaitForSingleObject(process.get(), INFINITE);
    DWORD code = 1;
    ::GetExitCodeProcess(process.get(), &code);
    std::fflush(nullptr);
    ::ExitProcess(code);
  } catch (const std::exception& e) {
    waits_for_program = false;
    return e.what();
  }
}

// The stream is a named pipe: the anonymous ones of Windows have one direction.
Child::Child(const std::string& program, std::vector<std::string> words) {
  static std::atomic<int> number = 0;
  const std::wstring name =
      L"\\\\.\\pipe\\pecs-" + std::to_wstring(::GetCurrentProcessId()) + L"-" + std::to_wstring(number++);
  const auto fail = [&](const std::string& why) { return Error(ExitCode::internal, program + ": " + why); };
  Handle ours(::CreateNamedPipeW(name.c_str(), PIPE_ACCESS_DUPLEX | FILE_FLAG_FIRST_PIPE_INSTANCE,
                                 PIPE_TYPE_BYTE | PIPE_REJECT_REMOTE_CLIENTS, 1, kPipeBytes, kPipeBytes, 0, nullptr));
  if (!ours.get()) throw fail(last_error());
  SECURITY_ATTRIBUTES inherited{sizeof(SECURITY_ATTRIBUTES), nullptr, TRUE};
  const Handle theirs(
      ::CreateFileW(name.c_str(), GENERIC_READ | GENERIC_WRITE, 0, &inherited, OPEN_EXISTING, 0, nullptr));
  if (!theirs.get()) throw fail(last_error());
  try {
    process_ = reinterpret_cast<std::intptr_t>(
        start(program, std::move(words), theirs.get(), ::GetStdHandle(STD_ERROR_HANDLE)));
  } catch (const std::exception& e) {
    throw fail(e.what());
  }
  stream_ = Descriptor(::_open_osfhandle(reinterpret_cast<std::intptr_t>(ours.release()), _O_BINARY | _O_RDWR));
}

Child::~Child() {
  stream_ = Descriptor();
  if (process_ == -1) return;
  const Handle process(reinterpret_cast<HANDLE>(process_));
  ::WaitForSingleObject(process.get(), INFINITE);
}

bool Child::write(const void* bytes, std::size_t count) {
  const HANDLE stream = reinterpret_cast<HANDLE>(::_get_osfhandle(stream_.number()));
  for (const char* next = static_cast<const char*>(bytes); count > 0;) {
    DWORD sent = 0;
    if (!::WriteFile(stream, next, static_cast<DWORD>(std::min<std::size_t>(count, kPipeBytes)), &sent, nullptr))
      return false;
    next += sent, count -= sent;
  }
  return true;
}

bool Child::read(void* bytes, std::size_t count) {
  const HANDLE stream = reinterpret_cast<HANDLE>(::_get_osfhandle(stream_.number()));
  for (char* next = static_cast<char*>(bytes); count > 0;) {
    DWORD got = 0;
    if (!::ReadFile(stream, next, static_cast<DWORD>(std::min<std::size_t>(count, kPipeBytes)), &got, nullptr) ||
        got == 0)
      return false;
    next += got, count -= got;
  }
  return true;
}

bool succeeds_in_child(const std::function<void()>&, unsigned) { return false; }  // Windows copies no process

void open_standard_descriptors() {
  int number = 0;
  do {
    number = ::_wopen(L"NUL", _O_RDWR | _O_BINARY);
  } while (number >= 0 && number <= 2);
  if (number >= 0) ::_close(number);
  for (const int standard : {0, 1, 2}) ::_setmode(standard, _O_BINARY);  // lines end as on other systems
  ::SetConsoleOutputCP(CP_UTF8);
}

void take_signals() { ::SetConsoleCtrlHandler(end_at_once, TRUE); }

const void* symbol_of(const char* library, const char* symbol) {
  const HMODULE opened = ::LoadLibraryW(wide(library).c_str());
  const auto found = opened ? ::GetProcAddress(opened, symbol) : nullptr;
  if (!found) throw Error(ExitCode::internal, std::string(library) + ": " + symbol + ": " + last_error());
  return reinterpret_cast<const void*>(found);
}

void ask_for_huge_pages(void*, std::size_t) {}  // Windows has them for privileged users alone

}  // namespace pecs::platform
