#include <fmt/format.h>

#include <filesystem>

#include "command_tree.h"
#include "pecs/files.h"
#include "pecs/version.h"

namespace pecs::app {
namespace {

// Text as man(7) takes it.
std::string roff(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '\\' || c == '-') out += '\\';
    if (c == '\\')
      out += 'e';
    else
      out += c;
    if (c == '\n') out += "\\&";
  }
  return out.starts_with('.') || out.starts_with('\'') ? "\\&" + out : out;
}

std::string entry(const CLI::Option& option) {
  const std::string value = option.get_positional() ? "" : value_of(option);
  std::string names = heading_of(option);
  names.resize(names.size() - value.size());
  return fmt::format(".TP\n\\fB{}\\fR{}\n{}\n", roff(names), roff(value), roff(sentence(said_of(option))));
}

// The examples of --help.
std::string examples_of(const CLI::App& app) {
  const std::string text = app.get_footer();
  const std::size_t first = text.find('\n');
  return first == text.npos ? "" : fmt::format(".PP\nExamples:\n.nf\n{}\n.fi\n", roff(text.substr(first + 1)));
}

std::string usage_of(const CLI::App& app, const std::string& name) {
  std::string out = fmt::format("\\fB{}\\fR", roff(name));
  const bool below = !commands_of(app).empty();
  if (app.get_prefix_command()) return out + " ...";
  out += " [\\fIoptions\\fR]";
  for (const CLI::Option* option : app.get_options([](const CLI::Option* o) { return o->get_positional(); }))
    out +=
        fmt::format(fmt::runtime(option->get_required() ? " \\fI{}\\fR" : " [\\fI{}\\fR]"), roff(option->get_name()));
  return below ? out + " [\\fIcommand\\fR ...]" : out;
}

// Options of a command and of those below it.
std::string options_of(const CLI::App& app, const std::string& name, const char* heading) {
  std::string out;
  if (app.get_prefix_command()) return fmt::format(".SH OPTIONS\n\\fB{} \\-\\-help\\fR lists them.\n", roff(name));
  for (const CLI::Option* option : app.get_options()) out += entry(*option);
  out = fmt::format("{}\n{}{}", heading, out, examples_of(app));
  for (const CLI::App* command : commands_of(app)) {
    const std::string full = name + " " + command->get_name();
    out += fmt::format(".SH {}\n{}\n.PP\n{}\n", roff(full), usage_of(*command, full),
                       roff(sentence(command->get_description())));
    out += options_of(*command, full, ".PP");
  }
  return out;
}

std::string page(const CLI::App& app, const std::string& name, const std::string& others) {
  const std::string title = CLI::detail::find_and_replace(name, " ", "-");
  return fmt::format(".TH \"{}\" 1 \"\" \"PECS {}\" \"User Commands\"\n.SH NAME\n{} \\- {}\n.SH SYNOPSIS\n{}\n{}",
                     roff(title), kVersion, roff(title), roff(app.get_description()), usage_of(app, name), others);
}

void write(const std::filesystem::path& path, const std::string& text) {
  AtomicFile file(path);
  file.write(text);
  file.commit();
}

}  // namespace

void write_man_pages(const CLI::App& app, const std::string& folder) {
  std::filesystem::create_directories(folder);
  std::string commands = ".SH COMMANDS\n";
  for (const CLI::App* command : commands_of(app)) {
    const std::string name = "pecs-" + command->get_name();
    commands += fmt::format(".TP\n\\fB{}\\fR(1)\n{}\n", roff(name), roff(sentence(command->get_description())));
    write(std::filesystem::path(folder) / (name + ".1"),
          page(*command, "pecs " + command->get_name(),
               options_of(*command, "pecs " + command->get_name(), ".SH OPTIONS") + ".SH SEE ALSO\n\\fBpecs\\fR(1)\n"));
  }
  std::string options = ".SH OPTIONS\n";
  for (const CLI::Option* option : app.get_options()) options += entry(*option);
  write(
      std::filesystem::path(folder) / "pecs.1",
      page(app, "pecs",
           commands + options +
               ".SH EXIT STATUS\n0 when all went well; the other codes are in exit_codes.md of the documentation.\n"));
}

}  // namespace pecs::app
