#include "read_arguments.h"

namespace pecs::app {

CLI::Option* add_time_unit(CLI::App& command, std::optional<TimeUnit>& unit, const char* help) {
  return command
      .add_option_function<std::string>(
          "--time-unit", [&unit](const std::string& name) { unit = time_unit_from(name); }, help)
      ->check(CLI::IsMember({"s", "ms", "us", "ns"}));
}

void add_read_options(CLI::App& command, events::ReadOptions& read) {
  command
      .add_option_function<std::vector<int>>(
          "--size",
          [&read](const std::vector<int>& size) {
            read.width = size.at(0);
            read.height = size.at(1);
          },
          "width and height of the sensor in pixels, if the file states none (default: measured)")
      ->expected(2)
      ->check(CLI::Range(1, 65536));
  add_time_unit(command, read.time_unit, "unit of the file's times, if it states none");
}

}  // namespace pecs::app
