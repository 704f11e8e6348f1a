#pragma once
// Parts that benches share.
#include <algorithm>
#include <ctime>
#include <string>
#include <vector>

namespace pecs::bench {

// Time of this process, all threads.
inline double cpu_s() {
  timespec t{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}

inline double seconds(auto&& work) {
  const double start = cpu_s();
  work();
  return cpu_s() - start;
}

inline double median(std::vector<double> v) {
  std::ranges::sort(v);
  return v[v.size() / 2];
}

// The word behind a key of the command line.
inline std::string option(const std::vector<std::string>& args, const std::string& key, const std::string& value) {
  const auto at = std::ranges::find(args, key);
  return at != args.end() && at + 1 != args.end() ? *(at + 1) : value;
}
inline int option(const std::vector<std::string>& args, const std::string& key, int value) {
  return std::stoi(option(args, key, std::to_string(value)));
}

}  // namespace pecs::bench
