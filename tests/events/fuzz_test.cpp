// Damaged copies of valid files, from fixed seeds: a reader returns events or throws one pecs::Error, and terminates.
// PECS_FUZZ_ROUNDS sets the number of copies. HDF5 files are only cut short: damage to
// the container meets the HDF5 library (1.10.8 of Debian 12 reads out of bounds in H5HG_read), so ECF is tried alone.
#include <cstdlib>

#include "ecf.h"
#include "streams.h"

using namespace pecs;
using namespace pecs::events;
using namespace pecs::tests;

namespace {

constexpr std::uint64_t kKinds = 5, kCut = 4;

int rounds(int usual) {
  const char* asked = std::getenv("PECS_FUZZ_ROUNDS");
  return asked ? std::atoi(asked) : usual;
}

void damage(std::vector<char>& bytes, std::mt19937_64& random, std::uint64_t kind) {
  const auto somewhere = [&] { return static_cast<std::size_t>(random() % bytes.size()); };
  switch (kind) {
    case 0:  // flip a few bits
      for (std::uint64_t n = 1 + random() % 8; n > 0; --n) bytes[somewhere()] ^= static_cast<char>(1u << random() % 8);
      break;
    case 1:  // overwrite a piece with one value
      for (std::size_t i = somewhere(), n = random() % 16; n > 0 && i < bytes.size(); ++i, --n)
        bytes[i] = static_cast<char>(random() % 2 ? 0xff : random() % 256);
      break;
    case 2:  // remove a piece
      bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(somewhere()));
      break;
    case 3:  // repeat a piece
    {
      const std::size_t from = somewhere(), n = std::min<std::size_t>(bytes.size() - from, random() % 64);
      const std::vector<char> piece(bytes.begin() + static_cast<std::ptrdiff_t>(from),
                                    bytes.begin() + static_cast<std::ptrdiff_t>(from + n));
      bytes.insert(bytes.begin() + static_cast<std::ptrdiff_t>(somewhere()), piece.begin(), piece.end());
      break;
    }
    default:
      bytes.resize(1 + somewhere());
  }
}

}  // namespace

class FuzzEach : public testing::TestWithParam<const Codec*> {};

TEST_P(FuzzEach, DamageIsAnErrorOrEvents) {
  const Codec& codec = *GetParam();
  const TempFolder folder;
  const auto path = folder / ("e" + codec.extensions.front());
  {
    const auto writer = codec.open_writer(path, {1280, 720, "IMX636"});
    auto events = random_events(300, 1280, 720, 0, 300, 8);
    const auto burst = row_bursts(64, 720, 9);
    for (Event e : std::span(burst).first(300)) {
      e.t_us += events.front().t_us + 1'000'000;
      events.push_back(e);
    }
    writer->write(events);
    writer->close();
  }
  const std::vector<char> good = bytes_of(path);
  const bool hdf5 = codec.name == "dsec" || codec.name == "metavision-hdf5";
  int errors = 0;
  for (int round = 0; round < rounds(150); ++round) {
    std::mt19937_64 random(static_cast<std::uint64_t>(round));
    const std::uint64_t kind = hdf5 ? kCut : random() % kKinds;
    // Half of the damage is in the first quarter, which contains the header.
    const auto quarter = good.begin() + static_cast<std::ptrdiff_t>(round % 2 && !hdf5 ? good.size() / 4 : good.size());
    std::vector<char> bytes(good.begin(), quarter);
    damage(bytes, random, kind);
    bytes.insert(bytes.end(), quarter, good.end());
    write_bytes(path, bytes);
    SCOPED_TRACE(round);
    std::size_t count = 0;
    try {
      codec.sniff(path, std::as_bytes(std::span(bytes).first(std::min<std::size_t>(bytes.size(), 1 << 16))));
      const auto reader = open_reader(codec, path);
      std::vector<Event> block(1000);
      while (const std::size_t n = reader->read(block)) ASSERT_LT(count += n, 10'000'000u);
    } catch (const Error& e) {
      EXPECT_EQ(e.code(), ExitCode::bad_input) << e.what();
      EXPECT_EQ(std::string(e.what()).find('\n'), std::string::npos);
      ++errors;
    }
  }
  EXPECT_GT(errors, 0) << "the damage was never seen";
}

INSTANTIATE_TEST_SUITE_P(Formats, FuzzEach, testing::ValuesIn(two_way()), format_name);

TEST(Fuzz, EcfBlocks) {
  int refused = 0;
  for (int round = 0; round < rounds(3000); ++round) {
    std::mt19937_64 random(static_cast<std::uint64_t>(round));
    // Sparse, dense and row-wise streams use the three block styles.
    const std::vector<Event> events = round % 3 == 0   ? random_events(200, 1280, 720, 5, 300, 8)
                                      : round % 3 == 1 ? random_events(200, 1280, 3, 5, 1, 9)
                                                       : row_bursts(64, 720, 9);
    std::vector<std::byte> block;
    ecf::encode(std::span(events).first(200), block);
    std::vector<char> bytes(reinterpret_cast<const char*>(block.data()),
                            reinterpret_cast<const char*>(block.data()) + block.size());
    damage(bytes, random, random() % kKinds);
    std::vector<Event> out;
    try {
      ecf::decode(std::as_bytes(std::span(bytes)), 300, out);
      ASSERT_LE(out.size(), 300u);
    } catch (const ecf::Damage& d) {
      ASSERT_LE(d.offset, bytes.size());
      ++refused;
    }
  }
  EXPECT_GT(refused, 0);
}
