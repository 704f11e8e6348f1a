#pragma once
// The way into every program and out of it.
#include <functional>

namespace pecs {

// Runs body() and returns the exit code: its own, or the one of what it throws, which is said in one line on stderr as
// "NAME: …". Before: closed descriptors 0 to 2 become /dev/null, so that no file takes their place; SIGINT and SIGTERM
// end the program at once with 130 and 143, outputs staying .partial; a file size limit is an error of writing. After:
// a standard output that could not be written (disk full) is bad_output.
int run_program(const char* name, const std::function<int()>& body) noexcept;

}  // namespace pecs
