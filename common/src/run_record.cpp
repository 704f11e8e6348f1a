#include "pecs/run_record.h"

#include "pecs/files.h"
#include "pecs/version.h"

namespace pecs {

void write_run_record(const std::filesystem::path& output, const RunRecord& record) {
  if (is_stream(output)) return;
  Json inputs = Json::array();
  for (const auto& input : record.inputs) {
    const auto hashed = std::filesystem::is_directory(input) ? input / "stack.json" : input;
    inputs.push_back({{"path", input.string()},
                      {"sha256", std::filesystem::exists(hashed) ? Json(sha256_of_file(hashed)) : Json()}});
  }
  const Json json = {{"pecs_version", kVersion}, {"command", record.command}, {"arguments", record.arguments},
                     {"config", record.config},  {"inputs", inputs},          {"output", output.string()},
                     {"results", record.results}};
  write_file(run_record_path(output), text_of(json, 2) + "\n");
}

}  // namespace pecs
