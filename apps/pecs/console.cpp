#include "console.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "commands.h"
#include "help.h"
#include "usage.h"

namespace pecs::app {

void print_json(const Json& json, int indent) { fmt::print("{}\n", text_of(json, indent)); }

void Console::add_to(CLI::App& app) {
  if (app.get_prefix_command()) return;
  CLI::Option* none = app.add_flag("--quiet", quiet_, "nothing but errors and results");
  none->excludes(app.add_flag("--verbose", verbose_, "also what was used, and how long it took"));
  for (CLI::App* command : app.get_subcommands({})) add_to(*command);
}

void Console::warn(const std::string& line) const {
  if (!quiet_) fmt::print(stderr, "pecs: warning: {}\n", line);
}

void Console::record(const std::filesystem::path& output, RunRecord record) {
  record.arguments = arguments_;
  write_run_record(output, record);
  recorded_ = true;
  if (!verbose_) return;
  for (const auto& [key, value] : record.config.items())
    fmt::print(stderr, "{}: {}: {}\n", record.command, key,
               value.is_string() ? value.get<std::string>() : text_of(value));
  for (const auto& input : record.inputs) fmt::print(stderr, "{}: input: {}\n", record.command, input.string());
}

void Console::end(const CLI::App& app) const {
  if (!verbose_) return;
  const CLI::App& command = chosen_command(app);
  const std::string name = full_name(command);
  for (const CLI::Option* option : command.get_options()) {
    const bool is_flag = option->get_items_expected_max() == 0;
    const std::string value =
        option->count() && !is_flag ? fmt::format("{}", fmt::join(option->results(), " ")) : option->get_default_str();
    if (!recorded_ && !is_flag && !value.empty())
      fmt::print(stderr, "{}: {}: {}{}\n", name, option->get_single_name(), value, unit_of(*option));
  }
  const std::chrono::duration<double> took_s = std::chrono::steady_clock::now() - begin_;
  fmt::print(stderr, "{}: done after {:.3f} s\n", name, took_s.count());
}

}  // namespace pecs::app
