#include "talk.h"

#include <fmt/format.h>

namespace pecs::app {

void Talk::add_verbose_to(CLI::App& command) {
  command.add_flag("--verbose", verbose, "also say what was used, and how long it took");
}

void Talk::add_to(CLI::App& command) {
  CLI::Option* none = command.add_flag("--quiet", quiet, "no progress");
  add_verbose_to(command);
  none->excludes(command.get_option("--verbose"));
}

void Talk::record(const std::filesystem::path& output, const RunRecord& record) const {
  write_run_record(output, record);
  if (!verbose) return;
  for (const auto& [key, value] : record.config.items())
    fmt::print(stderr, "{}: {}: {}\n", record.command, key,
               value.is_string() ? value.get<std::string>() : text_of(value));
  for (const auto& input : record.inputs) fmt::print(stderr, "{}: input: {}\n", record.command, input.string());
  const std::chrono::duration<double> took_s = std::chrono::steady_clock::now() - begin;
  fmt::print(stderr, "{}: {} after {:.3f} s\n", record.command, output.string(), took_s.count());
}

}  // namespace pecs::app
