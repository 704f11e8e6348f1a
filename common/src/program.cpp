#include "pecs/program.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <iostream>

#include "pecs/error.h"
#include "pecs/platform.h"

namespace pecs {
namespace {

int print_error(const char* name, const Error& e) {
  std::fprintf(stderr, "%s: %s\n", name, e.what());
  return static_cast<int>(e.code());
}

}  // namespace

int run_program(const char* name, const std::function<int()>& body) noexcept {
  platform::open_standard_descriptors();
  platform::take_signals();
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
