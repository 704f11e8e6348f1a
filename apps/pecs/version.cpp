// pecs --version --verbose: details for bug reports.
#include "pecs/version.h"

#include <fmt/format.h>
#include <hwy/targets.h>

#include <thread>

#include "commands.h"
#include "libraries.h"
#include "pecs/data_dir.h"
#include "pecs/error.h"
#include "pecs/platform.h"

namespace pecs::app {
namespace {

// The instruction set of Highway's kernels: the best of those that are compiled in and that this machine has (the
// lowest bit).
std::string instruction_set() {
  const std::int64_t usable = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(usable & -usable);
}

std::string data_place() {
  try {
    return data_dir("lens_data").parent_path().string();
  } catch (const Error& e) {
    return e.what();
  }
}

}  // namespace

void add_version(CLI::App& app) {
  const auto text = [&app] {
    std::string out = fmt::format("pecs {}", kVersion);
    if (!app.count("--verbose")) return out;
    const auto row = [&](const char* name, const std::string& value) { out += fmt::format("\n{:<14}{}", name, value); };
    row("build", kCompiler);
    row("libraries", kLibraries);
    row("instructions", instruction_set());
    row("threads", fmt::format("{}", std::thread::hardware_concurrency()));
    row("program", platform::own_program().string());
    row("data", data_place());
    return out;
  };
  app.set_version_flag("--version", text,
                       "show the version and exit; with --verbose also build, libraries and instruction set");
}

}  // namespace pecs::app
