#pragma once
// Errors: one line with file, place, got and wanted; one enum of exit codes (docs/reference/exit_codes.md).
#include <stdexcept>
#include <string>
#include <string_view>

namespace pecs {

enum class ExitCode : int {
  ok = 0,
  internal = 1,       // a defect of PECS
  usage = 2,          // the command line is wrong
  not_found = 3,      // an input is missing or cannot be opened
  bad_input = 4,      // an input was read and is wrong
  bad_output = 5,     // an output cannot be written (no permission, disk full, exists)
  unsupported = 6,    // valid, but this build or version cannot do it
  no_memory = 7,      // not enough memory
  interrupted = 130,  // stopped by SIGINT; finished outputs are kept
  terminated = 143    // stopped by SIGTERM; as above
};

// what() is the line to print, without the prefix "pecs: ": one line of printable text, whatever the inputs contain.
class Error : public std::runtime_error {
 public:
  Error(ExitCode code, const std::string& line);
  ExitCode code() const noexcept { return code_; }

 private:
  ExitCode code_;
};

// "OPTION: got GOT, wanted WANTED"
Error bad_usage(const std::string& option, const std::string& got, const std::string& wanted);
// "FILE: PLACE: got GOT, wanted WANTED" (place may be empty).
Error bad_input(const std::string& file, const std::string& place, const std::string& got, const std::string& wanted);
// "FILE: cannot be opened: REASON"
Error not_found(const std::string& file, const std::string& reason);
// "FILE: cannot be written: REASON"
Error bad_output(const std::string& file, const std::string& reason);
// "WHAT: …": for what a build with PECS_CORE lacks.
Error not_in_core(const std::string& what);
// Converts an exception: file system errors are not_found, std::bad_alloc is no_memory, all others are internal.
Error as_error(const std::exception& e);

// Replaces control characters and bytes that are not UTF-8 by \xNN.
std::string printable(std::string_view text);
// At most `bytes` bytes, whole characters only, then "..." if the text is longer.
std::string shortened(std::string_view text, std::size_t bytes);

}  // namespace pecs
