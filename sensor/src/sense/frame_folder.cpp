#include "sense/frame_folder.h"

#include <fmt/format.h>
#include <libdeflate.h>

#include <memory>
#include <vector>

#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/platform.h"

namespace pecs::sensor {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMark = ".pecs_partial";  // of a folder that PECS may delete (docs/reference/exit_codes.md)

using Bytes = std::vector<std::uint8_t>;

void put_32(Bytes& out, std::uint32_t value) {
  for (const int shift : {24, 16, 8, 0}) out.push_back(static_cast<std::uint8_t>(value >> shift));
}

void put_chunk(Bytes& out, std::string_view type, const Bytes& data) {
  put_32(out, static_cast<std::uint32_t>(data.size()));
  const std::size_t begin = out.size();
  out.insert(out.end(), type.begin(), type.end());
  out.insert(out.end(), data.begin(), data.end());
  put_32(out, libdeflate_crc32(0, out.data() + begin, out.size() - begin));
}

// PNG (ISO/IEC 15948), grey, without filters.
Bytes png(const events::Frame& frame, std::uint32_t width, std::uint32_t height) {
  const int depth = frame.bits <= 8 ? 8 : 16;
  Bytes rows, head, packed, out = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  for (std::size_t p = 0; p < frame.values.size(); ++p) {
    if (p % width == 0) rows.push_back(0);
    const int value = frame.values[p] << (depth - frame.bits);
    if (depth == 16) rows.push_back(static_cast<std::uint8_t>(value >> 8));
    rows.push_back(static_cast<std::uint8_t>(value));
  }
  const std::unique_ptr<libdeflate_compressor, decltype(&libdeflate_free_compressor)> compressor(
      libdeflate_alloc_compressor(6), &libdeflate_free_compressor);
  packed.resize(libdeflate_zlib_compress_bound(compressor.get(), rows.size()));
  packed.resize(libdeflate_zlib_compress(compressor.get(), rows.data(), rows.size(), packed.data(), packed.size()));
  put_32(head, width), put_32(head, height);
  head.insert(head.end(), {static_cast<std::uint8_t>(depth), 0, 0, 0, 0});
  put_chunk(out, "IHDR", head);
  put_chunk(out, "IDAT", packed);
  put_chunk(out, "IEND", {});
  return out;
}

}  // namespace

FrameFolder::FrameFolder(fs::path folder, int width, int height)
    : folder_(folder.has_filename() ? std::move(folder) : folder.parent_path()),
      partial_(partial_path(folder_)),
      width_(static_cast<std::uint32_t>(width)),
      height_(static_cast<std::uint32_t>(height)) {
  if (fs::exists(fs::symlink_status(folder_))) throw bad_output(folder_.string(), "it exists, wanted a new folder");
  std::error_code ec;
  if (fs::exists(fs::symlink_status(partial_))) {
    if (!fs::exists(partial_ / kMark)) throw bad_output(partial_.string(), "it exists and is not of PECS");
    fs::remove_all(partial_, ec);
  }
  fs::create_directories(partial_ / "images", ec);
  if (ec) throw bad_output(partial_.string(), ec.message());
  write_file(partial_ / kMark, "");
}

void FrameFolder::write(const events::Frame& frame) {
  exposures_ += fmt::format("{},{},{}\n", frames_, frame.begin_us, frame.end_us);
  const std::string name = fmt::format("images/frame_{:08}.png", frames_++);
  const Bytes picture = png(frame, width_, height_);
  write_file(partial_ / name, std::as_bytes(std::span(picture)));
  const std::int64_t twice_us = frame.begin_us + frame.end_us;
  times_ += fmt::format("{}.{:06} {}\n", twice_us / 2'000'000, twice_us / 2 % 1'000'000, name);
}

void FrameFolder::close() {
  write_file(partial_ / "images.txt", times_);
  write_file(partial_ / "exposures.csv", exposures_);
  std::error_code ec;
  fs::remove(partial_ / kMark, ec);
  if (const std::string reason = platform::rename_complete(partial_, folder_); !reason.empty())
    throw bad_output(folder_.string(), reason);
}

}  // namespace pecs::sensor
