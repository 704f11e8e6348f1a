#pragma once
// Start and end of every program.
#include <functional>

namespace pecs {

// Runs body() and returns its exit code, or that of the exception it throws, which is printed in one line on stderr as
// "NAME: …". Before: closed descriptors 0 to 2 become /dev/null, so that no file takes their number; SIGINT and SIGTERM
// end the program with 130 and 143, with outputs left as .partial; exceeding a file size limit is a write error. After:
// a standard output that could not be written (disk full) is bad_output.
int run_program(const char* name, const std::function<int()>& body) noexcept;

}  // namespace pecs
