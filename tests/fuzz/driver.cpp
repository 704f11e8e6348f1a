// The main of a fuzzer where the compiler brings none (GCC): fuzz_TARGET RUNS DICTIONARY FOLDER... tries every file of
// the folders and then RUNS mutants of them, which are the same ones every time. Nothing guides it to new code, as
// libFuzzer is guided (scripts/fuzz.sh): it holds what was found. An input that fails is left as fuzz_TARGET.input.
#include <sys/mman.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <filesystem>
#include <fstream>
#include <memory>
#include <random>
#include <span>
#include <vector>

#include "fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

using namespace pecs;
namespace fs = std::filesystem;

constexpr itimerval kLongestRun{.it_interval = {}, .it_value = {.tv_sec = 20, .tv_usec = 0}};  // of CPU time
constexpr std::size_t kLargestInput = 20'000;

std::string bytes_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> inputs_of(std::span<char*> folders) {
  std::vector<fs::path> paths;
  for (const char* folder : folders)
    if (fs::is_directory(folder))
      for (const auto& entry : fs::directory_iterator(folder)) paths.push_back(entry.path());
  std::ranges::sort(paths);
  std::vector<std::string> out;
  for (const fs::path& path : paths) out.push_back(bytes_of(path));
  return out;
}

// The words of a libFuzzer dictionary: a line each, in quotes, with \xNN, \\ and \" escape what is not plain text.
std::vector<std::string> words_of(const fs::path& dictionary) {
  std::vector<std::string> out;
  std::ifstream in(dictionary);
  for (std::string line; std::getline(in, line);) {
    std::string word;
    for (std::size_t i = line.find('"') + 1; i > 0 && i + 1 < line.size(); ++i) {
      unsigned byte = static_cast<unsigned char>(line[i]);
      if (line[i] == '\\' && line[++i] == 'x') {
        std::from_chars(&line[i + 1], &line[i + 3], byte, 16);
        i += 2;
      } else {
        byte = static_cast<unsigned char>(line[i]);
      }
      word += static_cast<char>(byte);
    }
    if (!word.empty()) out.push_back(word);
  }
  return out;
}

struct Material {
  std::vector<std::string> inputs, words;
};

// One to six changes of one input; `run` says which.
std::string mutant(const Material& from, std::uint64_t run) {
  std::mt19937_64 random(run);
  const auto below = [&](std::size_t n) { return static_cast<std::size_t>(random() % std::max<std::size_t>(n, 1)); };
  const auto any_of = [&](const std::vector<std::string>& all) { return all.empty() ? "" : all[below(all.size())]; };
  constexpr std::uint64_t kEdges[] = {0, 1, 0x7f, 0x80, 0xff, 0x7fff, 0x8000, 0xffff, INT32_MAX, UINT32_MAX, INT64_MAX};
  std::string bytes = any_of(from.inputs);
  for (std::size_t changes = 1 + below(6); changes > 0; --changes) {
    // Half of the changes in the first quarter, where headers are.
    const std::size_t at = below(below(2) ? bytes.size() / 4 : bytes.size() + 1), left = bytes.size() - at;
    switch (below(9)) {
      case 0:
        if (left > 0) bytes[at] ^= static_cast<char>(1 << below(8));
        break;
      case 1:
        if (left > 0) bytes[at] = static_cast<char>(below(256));
        break;
      case 2: {  // an integer at the edge of its type
        const std::uint64_t value = kEdges[below(std::size(kEdges))] + below(2);
        const std::size_t n = std::min<std::size_t>(left, std::size_t{1} << below(4));
        bytes.replace(at, n, reinterpret_cast<const char*>(&value), n);
        break;
      }
      case 3:
        bytes.erase(at, below(std::min<std::size_t>(left, 64) + 1));
        break;
      case 4:  // a piece comes again elsewhere
        bytes.insert(below(bytes.size() + 1), std::string(bytes, at, below(64)));
        break;
      case 5:  // a piece of another file
      {
        const std::string other = any_of(from.inputs);
        bytes.insert(at, other, below(other.size() + 1), below(256));
        break;
      }
      case 6:
        bytes.insert(at, any_of(from.words));
        break;
      case 7: {
        const std::string word = any_of(from.words);
        bytes.replace(at, std::min(left, word.size()), word);
        break;
      }
      default:
        if (below(4) == 0) bytes.resize(at);
    }
    bytes.resize(std::min(bytes.size(), kLargestInput));
  }
  return bytes;
}

// A copy of its own, so that a byte beyond its end is seen.
void try_input(const std::string& bytes) {
  const auto data = std::make_unique<std::uint8_t[]>(bytes.size());
  std::ranges::copy(bytes, data.get());
  ::setitimer(ITIMER_PROF, &kLongestRun, nullptr);
  LLVMFuzzerTestOneInput(data.get(), bytes.size());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) fuzz::defect("wanted RUNS DICTIONARY FOLDER...");
  const std::uint64_t mutants = std::strtoull(argv[1], nullptr, 10);
  const Material from{inputs_of({argv + 3, argv + argc}), words_of(argv[2])};
  if (from.inputs.empty()) fuzz::defect("no inputs in the folders");
  const std::uint64_t runs = from.inputs.size() + mutants;
  const auto input = [&](std::uint64_t i) {
    return i < from.inputs.size() ? from.inputs[i] : mutant(from, i - from.inputs.size());
  };

  // A child runs, so that whatever ends it, the input is known.
  void* shared = ::mmap(nullptr, sizeof(std::uint64_t), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  auto& run = *new (shared) std::atomic<std::uint64_t>(0);
  const pid_t child = ::fork();
  if (child == 0) {
    for (; run < runs; ++run) try_input(input(run));
    return 0;
  }
  int status = 0;
  if (child < 0 || ::waitpid(child, &status, 0) != child) fuzz::defect("no child");
  if (status == 0) {
    std::printf("%s: %zu inputs, %llu mutants\n", argv[0], from.inputs.size(),
                static_cast<unsigned long long>(mutants));
    return 0;
  }
  const std::string left = fs::path(argv[0]).filename().string() + ".input";
  std::ofstream(left, std::ios::binary) << input(run);
  std::fprintf(stderr, "fuzz: run %llu %s: its input is in %s\n", static_cast<unsigned long long>(run.load()),
               WIFSIGNALED(status) && WTERMSIG(status) == SIGPROF ? "never ends" : "failed", left.c_str());
  return 1;
}
