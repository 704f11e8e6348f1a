#include "pecs/program.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

#include "pecs/error.h"

namespace pecs {
namespace {

void fill_descriptors() {
  int fd = 0;
  do {
    fd = ::open("/dev/null", O_RDWR);
  } while (fd >= 0 && fd <= STDERR_FILENO);
  if (fd >= 0) ::close(fd);
}

extern "C" void end_at_once(int signal) {
  constexpr char kLine[] = "pecs: interrupted\n";
  [[maybe_unused]] const auto written = ::write(STDERR_FILENO, kLine, sizeof kLine - 1);
  ::_exit(static_cast<int>(signal == SIGINT ? ExitCode::interrupted : ExitCode::terminated));
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

int print_error(const char* name, const Error& e) {
  std::fprintf(stderr, "%s: %s\n", name, e.what());
  return static_cast<int>(e.code());
}

}  // namespace

int run_program(const char* name, const std::function<int()>& body) noexcept {
  fill_descriptors();
  take_signals();
  // OpenCV would print messages of its own on stderr.
  std::cerr.setstate(std::ios::failbit);
  int code = 0;
  try {
    code = body();
    std::cout.flush();
    if (std::fflush(stdout) != 0 || std::ferror(stdout)) throw bad_output("standard output", std::strerror(errno));
  } catch (const std::exception& e) {
    if (std::ferror(stdout)) return print_error(name, bad_output("standard output", std::strerror(errno)));
    return print_error(name, as_error(e));
  }
  return code;
}

}  // namespace pecs
