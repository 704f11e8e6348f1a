#include "pecs/sensor/dropped_file.h"

#include <fmt/format.h>

#include <cstring>

#include "pecs/error.h"

namespace pecs::sensor {

NpyFile::NpyFile(const std::filesystem::path& path, std::string descr)
    : file_(path, AtomicFile::Order::goes_back), descr_(std::move(descr)) {
  write_header();
}

void NpyFile::write_header() {
  constexpr std::size_t kBytes = 192;  // a multiple of 64, as the format requires
  constexpr char kStart[] = {'\x93', 'N', 'U', 'M', 'P', 'Y', 1, 0, static_cast<char>(kBytes - 10), 0};
  const std::string text = fmt::format("{{'descr': {}, 'fortran_order': False, 'shape': ({},), }}", descr_, count_);
  file_.write(std::string_view(kStart, sizeof kStart));
  file_.write(fmt::format("{:<{}}\n", text, kBytes - sizeof kStart - 1));
}

void NpyFile::write(std::span<const std::byte> bytes, std::size_t records) {
  file_.write(bytes);
  count_ += records;
}

void NpyFile::commit() {
  file_.seek(0);
  write_header();
  file_.commit();
}

DroppedFile::DroppedFile(const std::filesystem::path& path, const StageOptions& stages)
    : file_(stages.any() ? path : throw Error(ExitCode::usage, fmt::format("{}: no stage drops events", path.string())),
            "[('t', '<i8'), ('x', '<u2'), ('y', '<u2'), ('p', '|u1'), ('stage', '|u1')]") {}

void DroppedFile::write(std::span<const DroppedEvent> dropped) {
  std::vector<std::byte> bytes;
  const auto add = [&](auto value) {
    const auto at = bytes.size();
    bytes.resize(at + sizeof value);
    std::memcpy(bytes.data() + at, &value, sizeof value);
  };
  std::size_t count = 0;
  for (const auto& [e, stage] : dropped)
    if (stage != Stage::roi) add(e.t_us), add(e.x), add(e.y), add(e.p), add(stage), ++count;
  file_.write(bytes, count);
}

}  // namespace pecs::sensor
