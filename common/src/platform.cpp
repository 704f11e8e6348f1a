#include "pecs/platform.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>
#ifdef __APPLE__
#include <mach-o/dyld.h>
#endif

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <utility>

#include "pecs/error.h"

namespace pecs::platform {
namespace fs = std::filesystem;
namespace {

#ifdef __APPLE__
constexpr int kStream = SOCK_STREAM, kNoSignal = 0;
#else
constexpr int kStream = SOCK_STREAM | SOCK_CLOEXEC, kNoSignal = MSG_NOSIGNAL;
#endif

extern "C" void end_at_once(int signal) {
  constexpr char kLine[] = "pecs: interrupted\n";
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, kLine, sizeof kLine - 1);
  ::_exit(static_cast<int>(signal == SIGINT ? ExitCode::interrupted : ExitCode::terminated));
}

}  // namespace

std::vector<std::string> arguments(int argc, char** argv) { return {argv + std::min(argc, 1), argv + argc}; }

std::optional<std::string> environment(const char* name) {
  const char* value = std::getenv(name);
  return value ? std::optional<std::string>(value) : std::nullopt;
}

void set_environment(const char* name, const std::string& value) { ::setenv(name, value.c_str(), 1); }

std::vector<std::string> python_places() { return {".venv/bin/python", "bin/python3"}; }

bool stderr_is_terminal() { return ::isatty(STDERR_FILENO) != 0; }

fs::path own_binary() {
  Dl_info info{};
  if (::dladdr(reinterpret_cast<const void*>(&own_binary), &info) == 0 || !info.dli_fname) return {};
  std::error_code error;
  fs::path path = fs::canonical(info.dli_fname, error);
  return error ? own_program() : path;
}

fs::path own_program() {
  std::error_code error;
#ifdef __APPLE__
  std::uint32_t size = 0;
  ::_NSGetExecutablePath(nullptr, &size);
  std::string path(size, '\0');
  return ::_NSGetExecutablePath(path.data(), &size) == 0 ? fs::canonical(path.c_str(), error) : fs::path();
#else
  return fs::read_symlink("/proc/self/exe", error);
#endif
}

Child::Child(const std::string& program, std::vector<std::string> words) {
  int ends[2];
  if (::socketpair(AF_UNIX, kStream, 0, ends) != 0)
    throw Error(ExitCode::internal, program + ": " + std::strerror(errno));
#ifdef __APPLE__
  for (const int end : ends) {
    const int on = 1;
    ::fcntl(end, F_SETFD, FD_CLOEXEC);
    ::setsockopt(end, SOL_SOCKET, SO_NOSIGPIPE, &on, sizeof on);
  }
#endif
  stream_ = Descriptor(ends[0]);
  const Descriptor theirs(ends[1]);
  process_ = ::fork();
  if (process_ < 0) throw Error(ExitCode::internal, program + ": " + std::strerror(errno));
  if (process_ > 0) return;
  if (::dup2(theirs.number(), STDIN_FILENO) >= 0 && ::dup2(STDERR_FILENO, STDOUT_FILENO) >= 0)
    become(program, std::move(words));
  ::_exit(127);
}

Child::~Child() {
  stream_ = Descriptor();
  if (process_ > 0) ::waitpid(static_cast<pid_t>(process_), nullptr, 0);
}

bool Child::write(const void* bytes, std::size_t count) {
  for (const char* next = static_cast<const char*>(bytes); count > 0;) {
    const ssize_t sent = ::send(stream_.number(), next, count, kNoSignal);
    if (sent < 0 && errno == EINTR) continue;
    if (sent <= 0) return false;
    next += sent, count -= static_cast<std::size_t>(sent);
  }
  return true;
}

bool Child::read(void* bytes, std::size_t count) {
  for (char* next = static_cast<char*>(bytes); count > 0;) {
    const ssize_t got = ::recv(stream_.number(), next, count, 0);
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) return false;
    next += got, count -= static_cast<std::size_t>(got);
  }
  return true;
}

std::string become(const std::string& program, std::vector<std::string> words) {
  std::vector<char*> pointers;
  pointers.reserve(words.size() + 1);
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  ::execvp(program.c_str(), pointers.data());
  return std::strerror(errno);
}

bool succeeds_in_child(const std::function<void()>& work, unsigned limit_s) {
  const pid_t child = ::fork();
  if (child == 0) {
    ::alarm(limit_s);
    if (const int null = ::open("/dev/null", O_WRONLY); null >= 0) ::dup2(null, STDERR_FILENO);
    try {
      work();
    } catch (...) {
      ::_exit(1);
    }
    ::_exit(0);
  }
  int status = 1;
  return child > 0 && ::waitpid(child, &status, 0) == child && status == 0;
}

void open_standard_descriptors() {
  int fd = 0;
  do {
    fd = ::open("/dev/null", O_RDWR);
  } while (fd >= 0 && fd <= STDERR_FILENO);
  if (fd >= 0) ::close(fd);
}

void take_signals() {
  for (const int signal : {SIGINT, SIGTERM}) {
    struct sigaction action{};
    ::sigaction(signal, nullptr, &action);
    if (action.sa_handler == SIG_IGN) continue;  // nohup, or in the background
    action.sa_handler = end_at_once;
    ::sigaction(signal, &action, nullptr);
  }
  ::signal(SIGXFSZ, SIG_IGN);
}

const void* symbol_of(const char* library, const char* symbol) {
  void* opened = ::dlopen(library, RTLD_LAZY | RTLD_LOCAL);
  const void* found = opened ? ::dlsym(opened, symbol) : nullptr;
  if (!found) throw Error(ExitCode::internal, ::dlerror());
  return found;
}

void ask_for_huge_pages([[maybe_unused]] void* memory, [[maybe_unused]] std::size_t bytes) {
#ifdef MADV_HUGEPAGE
  const auto begin = reinterpret_cast<std::uintptr_t>(memory);
  const std::uintptr_t first = (begin + kHugePage - 1) / kHugePage * kHugePage;
  const std::uintptr_t end = (begin + bytes) / kHugePage * kHugePage;
  if (first < end) ::madvise(static_cast<std::byte*>(memory) + (first - begin), end - first, MADV_HUGEPAGE);
#endif
}

}  // namespace pecs::platform
