// AEDAT4 (iniVation DV): "#!AER-DAT4.0\r\n"; an IOHeader, after its length in 4 bytes; packets of {i32 stream, i32
// bytes} and that many bytes, compressed; at the header's data_table_position the FileDataTable, compressed.
// Compression is by LZ4 or Zstandard frames. Unpacked, a packet of an event stream is an EventPacket after its length
// in 4 bytes (aedat4.fbs). The header's XML names the streams: typeIdentifier "EVTS", and sizeX, sizeY and source under
// "info". A truncated recording has position -1 and no table. Reads the first event stream; counts frames ("FRME"), and
// skips IMU and triggers. Frames are written as stream 1, with the upper 8 bits of their values.
#include <fmt/format.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <deque>
#include <pugixml.hpp>
#include <sstream>

#include "aedat4_generated.h"
#include "buffer_size.h"
#include "checked_writer.h"
#include "codec.h"
#include "input_file.h"
#include "output_file.h"

namespace pecs::events {
namespace {

constexpr std::string_view kMagic = "#!AER-DAT4.0\r\n";
constexpr std::uint64_t kMaxHeaderBytes = 1 << 24, kMaxPacketBytes = 1 << 28;
constexpr int kAedat4MaxSize = 32768;  // x and y are signed 16-bit
enum Compression { kNone, kLz4, kLz4High, kZstd, kZstdHigh };
constexpr const char *kHeaderId = "IOHE", *kEventsId = "EVTS", *kFrameId = "FRME", *kTableId = "FTAB";

// The unpacked bytes; empty if `packed` is not a complete frame, or unpacks to more than kMaxPacketBytes.
std::vector<std::uint8_t> unpack(const std::vector<std::byte>& packed, int compression) {
  std::vector<std::uint8_t> out;
  const auto step = [&] { out.resize(std::max(buffer_size(1 << 16, 256), out.size() * 2)); };
  std::size_t in_at = 0, out_at = 0;
  if (compression == kLz4 || compression == kLz4High) {
    LZ4F_dctx* raw = nullptr;
    LZ4F_createDecompressionContext(&raw, LZ4F_VERSION);
    const std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> context(raw,
                                                                                       &LZ4F_freeDecompressionContext);
    for (;;) {
      if (out_at == out.size()) step();
      std::size_t in_bytes = packed.size() - in_at, out_bytes = out.size() - out_at;
      const std::size_t left =
          LZ4F_decompress(context.get(), out.data() + out_at, &out_bytes, packed.data() + in_at, &in_bytes, nullptr);
      in_at += in_bytes;
      out_at += out_bytes;
      if (left == 0) break;
      if (LZ4F_isError(left) || (in_bytes == 0 && out_bytes == 0) || out_at > kMaxPacketBytes) return {};
    }
  } else if (compression == kZstd || compression == kZstdHigh) {
    const std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> context(ZSTD_createDCtx(), &ZSTD_freeDCtx);
    ZSTD_inBuffer in{packed.data(), packed.size(), 0};
    for (;;) {
      if (out_at == out.size()) step();
      ZSTD_outBuffer to{out.data(), out.size(), out_at};
      const std::size_t in_before = in.pos;
      const std::size_t left = ZSTD_decompressStream(context.get(), &to, &in);
      const bool stuck = in.pos == in_before && to.pos == out_at;
      out_at = to.pos;
      if (left == 0) break;
      if (ZSTD_isError(left) || stuck || out_at > kMaxPacketBytes) return {};
    }
  } else {
    out.assign(reinterpret_cast<const std::uint8_t*>(packed.data()),
               reinterpret_cast<const std::uint8_t*>(packed.data()) + packed.size());
    return out;
  }
  out.resize(out_at);
  return out;
}

// A FlatBuffer behind its length in 4 bytes. It is aligned to the length; DV 1.x aligned it to its own first byte: then
// it is moved there.
class Prefixed {
 public:
  Prefixed() = default;
  Prefixed(std::vector<std::uint8_t> bytes) : bytes_(std::move(bytes)) {}  // NOLINT(google-explicit-constructor)

  // Null if the bytes are damaged.
  template <class Table>
  const Table* root(const char* id) {
    constexpr std::size_t kLength = sizeof(flatbuffers::uoffset_t), kLeast = 12;
    if (bytes_.size() < kLength + kLeast) return nullptr;
    flatbuffers::Verifier prefixed(bytes_.data(), bytes_.size());
    if (prefixed.VerifySizePrefixedBuffer<Table>(id)) return flatbuffers::GetSizePrefixedRoot<Table>(bytes_.data());
    std::uint32_t length = 0;
    std::memcpy(&length, bytes_.data(), sizeof length);
    if (length != bytes_.size() - kLength) return nullptr;
    bytes_.erase(bytes_.begin(), bytes_.begin() + kLength);
    flatbuffers::Verifier plain(bytes_.data(), bytes_.size());
    return plain.VerifyBuffer<Table>(id) ? flatbuffers::GetRoot<Table>(bytes_.data()) : nullptr;
  }

 private:
  std::vector<std::uint8_t> bytes_;
};

class Aedat4Reader final : public EventReader<Aedat4Reader> {
 public:
  explicit Aedat4Reader(const std::filesystem::path& path) : file_(path) {
    read_header();
    extent_.emplace(info_, kAedat4MaxSize);
  }

  std::string place() const override { return fmt::format("packet at byte {}", packet_at_); }

  bool next(Event& event) {
    while (used_ == packet_size())
      if (!next_packet()) return false;
    const aedat4::Event& e = *elements_->Get(static_cast<flatbuffers::uoffset_t>(used_++));
    event = {e.timestamp(), static_cast<std::uint16_t>(e.x()), static_cast<std::uint16_t>(e.y()),
             static_cast<std::uint8_t>(e.on())};
    if (e.x() < 0 || e.y() < 0 || !extent_->add(event))
      throw bad_input(file_.path().string(), fmt::format("byte {}", packet_at_),
                      fmt::format("an event at pixel ({}, {})", e.x(), e.y()), extent_->wanted());
    return true;
  }

 private:
  std::size_t packet_size() const { return elements_ ? elements_->size() : 0; }

  void read_header() {
    std::string magic(kMagic.size(), '\0');
    file_.read_exactly(std::as_writable_bytes(std::span(magic)), "signature");
    if (magic != kMagic) throw file_.damage("no signature", "#!AER-DAT4.0", kMagic.size());
    std::uint32_t bytes = 0;
    file_.read_exactly(std::as_writable_bytes(std::span(&bytes, 1)), "header length");
    if (bytes > std::min(file_.size() - file_.offset(), kMaxHeaderBytes))
      throw file_.damage(fmt::format("a header of {} bytes", bytes), "at most what the file has", 4);
    std::vector<std::uint8_t> header(sizeof bytes + bytes);
    std::memcpy(header.data(), &bytes, sizeof bytes);
    file_.read_exactly(std::as_writable_bytes(std::span(header).subspan(sizeof bytes)), "header");
    Prefixed buffer(std::move(header));
    const auto* io_header = buffer.root<aedat4::IOHeader>(kHeaderId);
    if (!io_header) throw file_.damage("a damaged header", "an IOHeader", bytes);
    compression_ = io_header->compression();
    end_ = io_header->data_table_position() < 0 ? file_.size()
                                                : static_cast<std::uint64_t>(io_header->data_table_position());
    if (compression_ < kNone || compression_ > kZstdHigh)
      throw file_.damage(fmt::format("compression {}", compression_), "0 to 4", bytes);
    if (end_ > file_.size() || end_ < file_.offset())
      throw file_.damage(fmt::format("the packets' end at byte {}", end_), "inside the file", bytes);
    find_stream(io_header->info_node() ? io_header->info_node()->string_view() : std::string_view());
  }

  void find_stream(std::string_view xml) {
    pugi::xml_document document;
    if (!document.load_buffer(xml.data(), xml.size()))
      throw file_.damage("a header without XML", "the list of streams");
    const auto attribute = [](const pugi::xml_node& node, const char* key) {
      return std::string(node.find_child_by_attribute("attr", "key", key).text().as_string());
    };
    for (const pugi::xpath_node& found : document.select_nodes("//node[@name='outInfo']/node")) {
      const pugi::xml_node stream = found.node();
      const std::string type = attribute(stream, "typeIdentifier");
      if (type == kFrameId && frame_stream_ < 0) frame_stream_ = stream.attribute("name").as_int(-1);
      if (type != kEventsId || stream_ >= 0) continue;
      const pugi::xml_node info = stream.find_child_by_attribute("node", "name", "info");
      stream_ = stream.attribute("name").as_int(-1);
      info_.width = std::atoi(attribute(info, "sizeX").c_str());
      info_.height = std::atoi(attribute(info, "sizeY").c_str());
      info_.camera = attribute(info, "source");
      if (info_.width < 1 || info_.height < 1 || info_.width > kAedat4MaxSize || info_.height > kAedat4MaxSize)
        info_.width = info_.height = 0;
    }
    if (stream_ < 0) throw file_.damage("no stream of events", "one in the header's list");
  }

  // The next packet of the stream.
  bool next_packet() {
    elements_ = nullptr;
    used_ = 0;
    while (file_.offset() < end_) {
      packet_at_ = file_.offset();
      struct {
        std::int32_t stream, bytes;
      } head{};
      file_.read_exactly(std::as_writable_bytes(std::span(&head, 1)), "packet header");
      if (head.bytes < 0 || static_cast<std::uint64_t>(head.bytes) > end_ - std::min(end_, file_.offset()) ||
          static_cast<std::uint64_t>(head.bytes) > kMaxPacketBytes)
        throw file_.damage(fmt::format("a packet of {} bytes", head.bytes),
                           fmt::format("at most {}", end_ - std::min(end_, file_.offset())), 4);
      if (head.stream != stream_) {
        info_.frames += head.stream == frame_stream_;
        file_.seek(file_.offset() + static_cast<std::uint64_t>(head.bytes));
        continue;
      }
      packed_.resize(static_cast<std::size_t>(head.bytes));
      file_.read_exactly(packed_, "packet");
      packet_ = unpack(packed_, compression_);
      const auto* packet = packet_.root<aedat4::EventPacket>(kEventsId);
      if (!packet)
        throw bad_input(file_.path().string(), fmt::format("byte {}", packet_at_), "a damaged packet", "packed events");
      elements_ = packet->elements();
      return true;
    }
    return false;
  }

  InputFile file_;
  int compression_ = kNone, stream_ = -1, frame_stream_ = -1;
  std::uint64_t end_ = 0, packet_at_ = 0;
  std::vector<std::byte> packed_;
  Prefixed packet_;
  const flatbuffers::Vector<const aedat4::Event*>* elements_ = nullptr;  // into packet_
  std::size_t used_ = 0;
};

constexpr Limits kAedat4Limits = {.max_size = kAedat4MaxSize};
constexpr std::size_t kPacketEvents = 8192;

class Aedat4Writer final : public CheckedWriter {
 public:
  Aedat4Writer(const std::filesystem::path& path, const StreamInfo& size)
      : CheckedWriter(path, size, kAedat4Limits), file_(path, AtomicFile::Order::goes_back) {
    file_.put_text(kMagic);
    put_header(0);
  }

  using CheckedWriter::write;
  void write(Frame frame) override { frames_.push_back(std::move(frame)); }

 private:
  void put(std::span<const Event> events) override {
    for (const Event& e : events) {
      while (!frames_.empty() && frames_.front().end_us <= e.t_us) put_frame();
      packet_.emplace_back(e.t_us, static_cast<std::int16_t>(e.x), static_cast<std::int16_t>(e.y), e.p != 0);
      if (packet_.size() == kPacketEvents) put_packet();
    }
  }

  void finish() override {
    while (!frames_.empty()) put_frame();
    if (!packet_.empty()) put_packet();
    const std::uint64_t table_at = file_.offset();
    flatbuffers::FlatBufferBuilder builder;
    std::vector<flatbuffers::Offset<aedat4::FileDataDefinition>> entries;
    for (const Entry& e : entries_) {
      const aedat4::PacketHeader head(e.stream, e.bytes);
      entries.push_back(aedat4::CreateFileDataDefinition(builder, e.at, &head, e.count, e.t_first_us, e.t_last_us));
    }
    builder.FinishSizePrefixed(aedat4::CreateFileDataTableDirect(builder, &entries), kTableId);
    file_.put_bytes(packed(builder));
    file_.rewrite_from(kMagic.size());  // the header, with the table's position
    put_header(static_cast<std::int64_t>(table_at));
    file_.commit();
  }

  // Has a fixed length for every position but -1, the default, which FlatBuffers omits.
  void put_header(std::int64_t data_table_position) {
    pugi::xml_document document;
    const auto node = [](pugi::xml_node parent, const char* name, const char* path) {
      pugi::xml_node child = parent.append_child("node");
      child.append_attribute("name") = name;
      child.append_attribute("path") = path;
      return child;
    };
    const auto attribute = [](pugi::xml_node parent, const char* key, const char* type, const std::string& value) {
      pugi::xml_node child = parent.append_child("attr");
      child.append_attribute("key") = key;
      child.append_attribute("type") = type;
      child.text() = value.c_str();
    };
    pugi::xml_node dv = document.append_child("dv");
    dv.append_attribute("version") = "2.0";
    const pugi::xml_node streams = node(dv, "outInfo", "/outInfo/");
    const auto add_stream = [&](const char* name, const char* output, const char* type, const char* description) {
      const std::string path = fmt::format("/outInfo/{}/", name);
      const pugi::xml_node stream = node(streams, name, path.c_str());
      attribute(stream, "compression", "string", "LZ4");
      attribute(stream, "originalModuleName", "string", "pecs");
      attribute(stream, "originalOutputName", "string", output);
      attribute(stream, "typeDescription", "string", description);
      attribute(stream, "typeIdentifier", "string", type);
      const pugi::xml_node camera = node(stream, "info", (path + "info/").c_str());
      attribute(camera, "sizeX", "int", std::to_string(info().width));
      attribute(camera, "sizeY", "int", std::to_string(info().height));
      attribute(camera, "source", "string", info().camera.empty() ? "pecs" : info().camera);
    };
    add_stream("0", "events", kEventsId, "Array of events (polarity ON/OFF).");
    if (info().frames) add_stream("1", "frames", kFrameId, "Standard frame (8-bit image).");
    std::ostringstream xml;
    document.save(xml, "    ", pugi::format_default | pugi::format_no_declaration);

    flatbuffers::FlatBufferBuilder builder;
    builder.FinishSizePrefixed(aedat4::CreateIOHeaderDirect(builder, kLz4, data_table_position, xml.str().c_str()),
                               kHeaderId);
    file_.put_bytes(std::as_bytes(std::span(builder.GetBufferPointer(), builder.GetSize())));
  }

  void put_packet() {
    flatbuffers::FlatBufferBuilder builder(packet_.size() * sizeof(aedat4::Event) + 64);
    builder.FinishSizePrefixed(
        aedat4::CreateEventPacket(builder, builder.CreateVectorOfStructs(packet_.data(), packet_.size())), kEventsId);
    put_data(0, builder, packet_.size(), packet_.front().timestamp(), packet_.back().timestamp());
    packet_.clear();
  }

  void put_frame() {
    if (!packet_.empty()) put_packet();
    const Frame& frame = frames_.front();
    std::vector<std::uint8_t> pixels(frame.values.size());
    std::ranges::transform(frame.values, pixels.begin(),
                           [&](std::uint16_t value) { return static_cast<std::uint8_t>(value << 8 >> frame.bits); });
    flatbuffers::FlatBufferBuilder builder(pixels.size() + 128);
    const auto width = static_cast<std::int16_t>(info().width), height = static_cast<std::int16_t>(info().height);
    builder.FinishSizePrefixed(aedat4::CreateFrameDirect(builder, frame.begin_us, frame.begin_us, frame.end_us,
                                                         frame.begin_us, frame.end_us, 0, width, height, 0, 0, &pixels),
                               kFrameId);
    put_data(1, builder, 1, frame.begin_us, frame.begin_us);
    frames_.pop_front();
  }

  void put_data(std::int32_t stream, const flatbuffers::FlatBufferBuilder& builder, std::size_t count,
                std::int64_t t_first_us, std::int64_t t_last_us) {
    const std::span<const std::byte> bytes = packed(builder);
    const auto size = static_cast<std::int32_t>(bytes.size());
    file_.put(stream);
    file_.put(size);
    entries_.push_back({stream, static_cast<std::int64_t>(file_.offset()), size, static_cast<std::int64_t>(count),
                        t_first_us, t_last_us});
    file_.put_bytes(bytes);
  }

  std::span<const std::byte> packed(const flatbuffers::FlatBufferBuilder& builder) {
    packed_.resize(LZ4F_compressFrameBound(builder.GetSize(), nullptr));
    const std::size_t size =
        LZ4F_compressFrame(packed_.data(), packed_.size(), builder.GetBufferPointer(), builder.GetSize(), nullptr);
    if (LZ4F_isError(size)) throw Error(ExitCode::internal, std::string("LZ4: ") + LZ4F_getErrorName(size));
    return std::span(packed_).first(size);
  }

  struct Entry {
    std::int32_t stream;
    std::int64_t at;
    std::int32_t bytes;
    std::int64_t count, t_first_us, t_last_us;
  };
  OutputFile file_;
  std::vector<aedat4::Event> packet_;
  std::deque<Frame> frames_;  // not written yet
  std::vector<Entry> entries_;
  std::vector<std::byte> packed_;
};

}  // namespace

Codec make_aedat4() {
  Codec codec =
      make_codec<Aedat4Reader, Aedat4Writer>("aedat4", "iniVation AEDAT4", ".aedat4", kAedat4Limits,
                                             [](const auto&, auto head) { return begins_with(head, kMagic); });
  codec.holds_frames = true;
  return codec;
}

}  // namespace pecs::events
