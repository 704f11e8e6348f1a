#include <fmt/format.h>
#include <fmt/ranges.h>

#include "command_tree.h"

namespace pecs::app {
namespace {

// Words for a command line that is at `app`: a path such as "pecs/lens" is one word of the scripts' `case`.
struct Place {
  std::string path;
  const CLI::App* app = nullptr;
};

void collect(const CLI::App& app, const std::string& path, std::vector<Place>& places) {
  places.push_back({path, &app});
  for (const CLI::App* command : commands_of(app)) collect(*command, path + "/" + command->get_name(), places);
}

std::vector<const CLI::Option*> options_of(const CLI::App& app) {
  return app.get_options([](const CLI::Option* option) { return !option->get_positional(); });
}

bool takes_value(const CLI::Option& option) { return option.get_items_expected_max() > 0; }

std::string quoted(std::string text) {
  for (std::size_t at = 0; (at = text.find('\'', at)) != std::string::npos; at += 4) text.replace(at, 1, "'\\''");
  return "'" + text + "'";
}

// The part that bash and zsh share: $place, and what may stand there.
std::string cases(const std::vector<Place>& places) {
  std::string walk = "    case \"$place/$word\" in\n      ", words, values;
  std::vector<std::string> paths;
  for (const Place& p : places)
    if (p.path != "pecs") paths.push_back(p.path);
  walk += fmt::format("{}) place=\"$place/$word\" ;;\n    esac\n", fmt::join(paths, "|"));
  for (const Place& p : places) {
    std::vector<std::string> options, commands;
    for (const CLI::Option* option : options_of(*p.app)) {
      const std::vector<std::string> names = names_of(*option);
      options.insert(options.end(), names.begin(), names.end());
      const std::vector<std::string> choices = choices_of(*option);
      if (choices.empty()) continue;
      for (const std::string& name : names)
        values += fmt::format("    {}:{}) values=\"{}\" ;;\n", p.path, name, fmt::join(choices, " "));
    }
    for (const CLI::App* command : commands_of(*p.app)) commands.push_back(command->get_name());
    words += fmt::format("    {}) options=\"{}\" commands=\"{}\" ;;\n", p.path, fmt::join(options, " "),
                         fmt::join(commands, " "));
  }
  return fmt::format(
      "  for word in \"${{before[@]}}\"; do\n{}  done\n  case \"$place\" in\n{}  esac\n  case \"$place:$last\" in\n{}  "
      "esac\n",
      walk, words, values);
}

std::string bash(const std::vector<Place>& places) {
  return fmt::format(R"(# bash completion of pecs; made by `pecs completion bash`
_pecs() {{
  local word place=pecs options="" commands="" values="" last="${{COMP_WORDS[COMP_CWORD-1]}}"
  local before=("${{COMP_WORDS[@]:1:COMP_CWORD-1}}") now="${{COMP_WORDS[COMP_CWORD]}}"
{}  if [ -n "$values" ]; then
    COMPREPLY=($(compgen -W "$values" -- "$now"))
  elif [[ "$now" == -* ]]; then
    COMPREPLY=($(compgen -W "$options" -- "$now"))
  else
    COMPREPLY=($(compgen -W "$commands" -- "$now") $(compgen -f -- "$now"))
  fi
}}
complete -o filenames -F _pecs pecs
)",
                     cases(places));
}

std::string zsh(const std::vector<Place>& places) {
  return fmt::format(R"(#compdef pecs
# zsh completion of pecs; made by `pecs completion zsh`
_pecs() {{
  local word place=pecs options="" commands="" values="" last="${{words[CURRENT-1]}}"
  local -a before=("${{(@)words[2,CURRENT-1]}}")
{}  if [[ -n "$values" ]]; then
    compadd -- ${{=values}}
  elif [[ "$PREFIX" == -* ]]; then
    compadd -- ${{=options}}
  else
    [[ -z "$commands" ]] || compadd -- ${{=commands}}
    _files
  fi
}}
if [[ "$funcstack[1]" == _pecs ]]; then _pecs "$@"; else compdef _pecs pecs; fi
)",
                     cases(places));
}

std::string fish(const std::vector<Place>& places) {
  std::string out = "# fish completion of pecs; made by `pecs completion fish`\n";
  for (const Place& p : places) {
    std::vector<std::string> seen;
    const std::vector<std::string> path = CLI::detail::split(p.path, '/');
    for (std::size_t i = 1; i < path.size(); ++i) seen.push_back("__fish_seen_subcommand_from " + path[i]);
    std::vector<std::string> below;
    for (const CLI::App* command : commands_of(*p.app)) below.push_back(command->get_name());
    if (!below.empty()) seen.push_back(fmt::format("not __fish_seen_subcommand_from {}", fmt::join(below, " ")));
    const std::string where =
        seen.empty() ? "" : fmt::format(" -n {}", quoted(fmt::format("{}", fmt::join(seen, "; and "))));
    for (const CLI::App* command : commands_of(*p.app))
      out += fmt::format("complete -c pecs{} -a {} -d {}\n", where, command->get_name(),
                         quoted(command->get_description()));
    for (const CLI::Option* option : options_of(*p.app)) {
      std::string names;
      for (const std::string& name : option->get_snames()) names += " -s " + name;
      if (!option->get_lnames().empty()) names += " -l " + option->get_lnames().front();
      const std::vector<std::string> choices = choices_of(*option);
      const std::string value = !choices.empty()
                                    ? fmt::format(" -x -a {}", quoted(fmt::format("{}", fmt::join(choices, " "))))
                                : takes_value(*option) ? " -r"
                                                       : "";
      out += fmt::format("complete -c pecs{}{}{} -d {}\n", where, names, value, quoted(option->get_description()));
    }
  }
  return out;
}

}  // namespace

std::string completion(const CLI::App& app, const std::string& shell) {
  std::vector<Place> places;
  collect(app, "pecs", places);
  return shell == "bash" ? bash(places) : shell == "zsh" ? zsh(places) : fish(places);
}

}  // namespace pecs::app
