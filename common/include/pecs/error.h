#pragma once
// Errors: one line that says file, place, got, wanted; one enum of exit codes (docs/exit_codes.md).
#include <stdexcept>
#include <string>

namespace pecs {

enum class ExitCode : int {
  ok = 0,
  internal = 1,      // a defect of ours
  usage = 2,         // the command line is wrong
  not_found = 3,     // an input is missing or cannot be opened
  bad_input = 4,     // an input was read and is wrong
  bad_output = 5,    // an output cannot be written (no permission, disk full, exists)
  unsupported = 6,   // valid, but this build or version cannot do it
  interrupted = 130  // stopped by SIGINT/SIGTERM; what was finished is kept
};

// what() is the line to print, without "pecs: " before it.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& line) : std::runtime_error(line), code_(code) {}
  ExitCode code() const noexcept { return code_; }

 private:
  ExitCode code_;
};

// "FILE: PLACE: got GOT, wanted WANTED" (place may be empty).
Error bad_input(const std::string& file, const std::string& place, const std::string& got, const std::string& wanted);
// "FILE: cannot be opened: REASON"
Error not_found(const std::string& file, const std::string& reason);
// "FILE: cannot be written: REASON"
Error bad_output(const std::string& file, const std::string& reason);

}  // namespace pecs
