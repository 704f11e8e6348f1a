#pragma once
// "<output>.run.json": provenance of an output. Written last, so its presence means that the output is complete. None
// is written for an output that is a pipe or a device.
#include <filesystem>
#include <string>
#include <vector>

#include "pecs/strict_json.h"

namespace pecs {

struct RunRecord {
  std::string command;                             // the program's subcommand
  Json config;                                     // resolved, with all defaults
  std::vector<std::filesystem::path> inputs = {};  // hashed (sha256) when written; a folder by its stack.json
  Json results = Json::object();                   // counts, rates, …
  std::vector<std::string> arguments = {};         // as given
};

void write_run_record(const std::filesystem::path& output, const RunRecord& record);

}  // namespace pecs
