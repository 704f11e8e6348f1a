#include "stack/exr_block.h"

#include <Iex.h>
#include <ImfChannelList.h>
#include <ImfHeader.h>
#include <fmt/format.h>
#include <libdeflate.h>

#include <cstring>
#include <optional>

#include "stack/light_kernel.h"

namespace pecs::sensor {

struct ZipBlocks::Inflate {
  Inflate() : state(libdeflate_alloc_decompressor()) {
    if (!state) throw std::bad_alloc();
  }
  ~Inflate() { libdeflate_free_decompressor(state); }
  Inflate(const Inflate&) = delete;
  Inflate& operator=(const Inflate&) = delete;
  libdeflate_decompressor* state;
};

ZipBlocks::ZipBlocks(Imf::InputFile& file, int rows_per_block)
    : file_(file), rows_per_block_(rows_per_block), inflate_(std::make_unique<Inflate>()) {
  const Imath::Box2i box = file.header().dataWindow();
  min_y_ = box.min.y;
  height_ = box.max.y - box.min.y + 1;
  width_ = box.max.x - box.min.x + 1;
}
ZipBlocks::~ZipBlocks() = default;

std::unique_ptr<ZipBlocks> ZipBlocks::of(Imf::InputFile& file, std::span<const std::string> names) {
  const Imf::Header& header = file.header();
  const bool zips = header.compression() == Imf::ZIPS_COMPRESSION;
  if (header.hasTileDescription() || (!zips && header.compression() != Imf::ZIP_COMPRESSION)) return nullptr;
  std::unique_ptr<ZipBlocks> blocks(new ZipBlocks(file, zips ? 1 : 16));
  std::vector<std::optional<Channel>> wanted(names.size());
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    if (c.channel().xSampling != 1 || c.channel().ySampling != 1) return nullptr;
    const bool is_half = c.channel().type == Imf::HALF;
    for (std::size_t i = 0; i < names.size(); ++i)
      if (names[i] == c.name()) {
        if (c.channel().type == Imf::UINT) return nullptr;
        wanted[i] = Channel{blocks->row_bytes_, is_half};
      }
    blocks->row_bytes_ += static_cast<std::size_t>(blocks->width_) * (is_half ? 2 : 4);
  }
  for (const auto& channel : wanted) {
    if (!channel) return nullptr;
    blocks->channels_.push_back(*channel);
  }
  return blocks;
}

// Decodes the block that starts at this row into bytes_, in storage order: row by row, channel by channel.
void ZipBlocks::decode(int block) {
  const auto rows = static_cast<std::size_t>(std::min(rows_per_block_, height_ - block));
  const std::size_t size = rows * row_bytes_;
  const char* packed = nullptr;
  int packed_size = 0;
  file_.rawPixelData(min_y_ + block, packed, packed_size);
  bytes_.resize(size);
  decoded_ = -1;
  // A block that compression would not shrink is stored uncompressed.
  if (static_cast<std::size_t>(packed_size) == size) {
    std::memcpy(bytes_.data(), packed, size);
  } else {
    halves_.resize(size);
    std::size_t got = 0;
    const auto result = libdeflate_zlib_decompress(inflate_->state, packed, static_cast<std::size_t>(packed_size),
                                                   halves_.data(), size, &got);
    if (result != LIBDEFLATE_SUCCESS || got != size)
      throw Iex::InputExc(fmt::format("Damaged pixel data in the block of row {}.", block));
    undo_predictor(halves_);
    interleave_halves(halves_, bytes_);
  }
  decoded_ = block;
}

void ZipBlocks::read(int first, int rows, std::span<float> values) {
  const int block = first - first % rows_per_block_;
  if (decoded_ != block) decode(block);
  const auto width = static_cast<std::size_t>(width_);
  float* out = values.data();
  for (const Channel& channel : channels_)
    for (int row = first - block; row < first - block + rows; ++row, out += width) {
      const std::uint8_t* in = bytes_.data() + static_cast<std::size_t>(row) * row_bytes_ + channel.offset;
      if (channel.is_half)
        halves_to_floats(in, {out, width});
      else
        std::memcpy(out, in, width * sizeof(float));
    }
}

}  // namespace pecs::sensor
