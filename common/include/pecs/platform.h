#pragma once
// All that is the operating system's and not standard C++: files and their locks, processes, signals, memory,
// libraries. No other file includes its headers (tests/python/docs/test_structure.py).
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace pecs::platform {

// Files.
class Descriptor {
 public:
  Descriptor() = default;
  explicit Descriptor(int number) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }
  ~Descriptor();
  int number() const { return number_; }

 private:
  int number_ = -1;
};
// Opens, locks and empties a file for the output `path`, in this order: a file that another process writes stays
// intact. Throws bad_output for a link, for what is no regular file, and where another process has the lock.
Descriptor claim(const std::filesystem::path& file, const std::filesystem::path& path);
std::FILE* open_to_read(const std::filesystem::path& path);              // null: errno
std::FILE* open_stream(const std::filesystem::path& path);               // to write; null: errno
std::FILE* open_again(const Descriptor& file, const char* mode = "wb");  // the same file; null: errno
std::FILE* open_unnamed(const std::filesystem::path& beside);            // to write and read; null: errno
// Flushes it to the disk, then renames it; the reason where that fails, else empty.
std::string rename_complete(const Descriptor& file, const std::filesystem::path& from, const std::filesystem::path& to);
std::string rename_complete(const std::filesystem::path& from, const std::filesystem::path& to);
// For libraries that open files by char. Throws unsupported for a name that the system's code page lacks.
std::string name_for_libraries(const std::filesystem::path& path);
void will_read(const std::filesystem::path& path);  // asks for the file's content ahead of its use

// Processes.
std::vector<std::string> arguments(int argc, char** argv);  // of main, without the program; UTF-8
std::optional<std::string> environment(const char* name);
void set_environment(const char* name, const std::string& value);
std::vector<std::string> python_places();  // of a Python, in the folders of a checkout or an environment
bool stderr_is_terminal();
std::filesystem::path own_binary();   // the program or shared library that this code was linked into
std::filesystem::path own_program();  // the program; empty where the system does not tell
// Replaces this process; returns the reason where it cannot.
std::string become(const std::string& program, std::vector<std::string> words);
// Another program, which reads and writes one stream of bytes as its standard input; its standard output is stderr. It
// ends when the stream does.
class Child {
 public:
  Child(const std::string& program, std::vector<std::string> words);  // throws internal
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;
  ~Child();  // waits for its end
  // False: the program has ended.
  bool write(const void* bytes, std::size_t count);
  bool read(void* bytes, std::size_t count);

 private:
  Descriptor stream_;
  std::intptr_t process_ = -1;
};
// Whether work() returns in a child process within a time, without a word on stderr.
bool succeeds_in_child(const std::function<void()>& work, unsigned limit_s);
void open_standard_descriptors();  // closed ones among 0 to 2 become /dev/null
// SIGINT and SIGTERM print a line and end the process with their exit code, unless they are ignored; a write beyond a
// limit of file size is an error and no signal.
void take_signals();

// A symbol of a shared library. Throws internal.
const void* symbol_of(const char* library, const char* symbol);

inline constexpr std::size_t kHugePage = std::size_t{2} << 20;
// Requests huge pages where some fit: fewer page faults and TLB misses. Most Linux systems use them only on request.
// Does not touch `memory`.
void ask_for_huge_pages(void* memory, std::size_t bytes);

}  // namespace pecs::platform
