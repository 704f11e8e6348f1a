// One suite over every format that both reads and writes.
#include <algorithm>

#include "pecs/files.h"
#include "streams.h"

using namespace pecs;
using namespace pecs::events;
using namespace pecs::tests;
namespace fs = std::filesystem;

namespace {

void write(const Codec& codec, const fs::path& path, const Stream& stream, std::size_t chunk = SIZE_MAX) {
  const auto writer = codec.open_writer(path, stream.info);
  for (std::size_t i = 0; i < stream.events.size(); i += std::min(chunk, stream.events.size() - i))
    writer->write(std::span(stream.events).subspan(i, std::min(chunk, stream.events.size() - i)));
  writer->close();
}

Stream read(const Codec& codec, const fs::path& path, std::size_t chunk) {
  const auto reader = open_reader(codec, path);
  Stream out;
  std::vector<Event> buffer(chunk);
  while (const std::size_t n = reader->read(buffer))
    out.events.insert(out.events.end(), buffer.begin(), buffer.begin() + n);
  EXPECT_EQ(reader->read(buffer), 0u) << "after the end";
  out.info = reader->info();
  return out;
}

}  // namespace

class EachFormat : public testing::TestWithParam<const Codec*> {
 protected:
  const Codec& codec() const { return *GetParam(); }
  fs::path file() const { return folder_ / ("events" + codec().extensions.front()); }
  TempFolder folder_;
};

TEST_P(EachFormat, GivesBackWhatWasWritten) {
  for (const auto& [name, stream] : streams_for(codec().limits)) {
    SCOPED_TRACE(name);
    write(codec(), file(), stream);
    EXPECT_EQ(codec_of_file(file()).name, codec().name) << "by its content";
    const Stream back = read(codec(), file(), 1 << 16);
    EXPECT_EQ(back.events.size(), stream.events.size());
    EXPECT_TRUE(back.events == stream.events);
    if (codec().limits.keeps_size) {
      EXPECT_EQ(back.info.width, stream.info.width);
      EXPECT_EQ(back.info.height, stream.info.height);
    }
  }
}

TEST_P(EachFormat, DoesNotDependOnTheChunks) {
  const Stream stream{{1280, 720, ""}, row_bursts(1280, 720, 5)};
  write(codec(), file(), stream);
  ASSERT_TRUE(read(codec(), file(), 1).events == stream.events);
  ASSERT_TRUE(read(codec(), file(), 13).events == stream.events);
  const std::string whole = sha256_of_file(file());
  for (const std::size_t chunk : {1, 17, 4096}) {
    write(codec(), file(), stream, chunk);
    EXPECT_EQ(sha256_of_file(file()), whole) << chunk;
  }
}

TEST_P(EachFormat, ATruncatedFileGivesAnErrorOrAPrefix) {
  const Stream stream{{1280, 720, ""}, random_events(150, 1280, 720, 0, 300, 6)};
  write(codec(), file(), stream);
  ASSERT_TRUE(read(codec(), file(), 64).events == stream.events);
  const auto whole = bytes_of(file());
  const std::size_t step = std::max<std::size_t>(1, whole.size() / 200);
  for (std::size_t size = 0; size < whole.size(); size += size < 200 || size + 100 > whole.size() ? 1 : step) {
    write_bytes(file(), {whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size)});
    std::vector<Event> got;
    const std::string line = error_of([&] {
      const auto reader = open_reader(codec(), file());
      std::vector<Event> buffer(64);
      while (const std::size_t n = reader->read(buffer)) got.insert(got.end(), buffer.begin(), buffer.begin() + n);
    });
    ASSERT_LE(got.size(), stream.events.size()) << size;
    const bool text = std::ranges::all_of(whole, [](char c) { return c == '\n' || (c >= ' ' && c <= '~'); });
    // A truncated text line may end in a shorter number, so the last event may differ.
    const std::size_t sure = text && !got.empty() ? got.size() - 1 : got.size();
    ASSERT_TRUE(std::equal(got.begin(), got.begin() + static_cast<std::ptrdiff_t>(sure), stream.events.begin()))
        << size;
    ASSERT_TRUE(line.empty() || line.starts_with(file().string() + ": ")) << line;
  }
}

TEST_P(EachFormat, AppearsAtCloseOnly) {
  const Stream stream{{640, 480, ""}, random_events(100, 640, 480, 0, 3, 7)};
  {
    const auto writer = codec().open_writer(file(), stream.info);
    writer->write(stream.events);
  }
  EXPECT_FALSE(fs::exists(file()));
  write(codec(), file(), stream);
  EXPECT_TRUE(fs::exists(file()));
  EXPECT_FALSE(fs::exists(partial_path(file())));
}

TEST_P(EachFormat, RefusesWhatIsNotAStream) {
  const StreamInfo size{640, 480, ""};
  const auto refused = [&](std::vector<Event> events) {
    ExitCode code{};
    const std::string line = error_of(
        [&] {
          const auto writer = codec().open_writer(file(), size);
          writer->write(events);
          writer->close();
        },
        &code);
    EXPECT_EQ(code, ExitCode::bad_input);
    return line;
  };
  EXPECT_NE(refused({{10, 1, 1, 1}, {9, 1, 1, 1}}).find("event 1: got t = 9 us, wanted at least 10 us"),
            std::string::npos);
  EXPECT_NE(refused({{10, 640, 1, 1}}).find("event 0: got pixel (640, 1), wanted inside 640x480"), std::string::npos);
  EXPECT_NE(refused({{10, 1, 480, 1}}).find("got pixel (1, 480)"), std::string::npos);
  EXPECT_NE(refused({{10, 1, 1, 2}}).find("got p = 2"), std::string::npos);
  EXPECT_FALSE(fs::exists(file()));
}

TEST_P(EachFormat, SaysThatAFolderIsMissing) {
  ExitCode code{};
  const std::string line =
      error_of([&] { codec().open_writer(folder_ / "none" / "x", StreamInfo{640, 480, ""}); }, &code);
  EXPECT_EQ(code, ExitCode::bad_output) << line;
}

INSTANTIATE_TEST_SUITE_P(Formats, EachFormat, testing::ValuesIn(two_way()), format_name);
