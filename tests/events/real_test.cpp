// A recording and a simulation by ESIM. The sums were computed with independent readers: h5py with the vendor's ECF
// plugin, and expelliarmus; tests/python/events/test_formats.py compares every event.
#include <array>

#include "shared.h"
#include "streams.h"

using namespace pecs;
using namespace pecs::events;
using namespace pecs::tests;

namespace {

// Sum over i of i * value, i from 1, of t, x, y and p, modulo 2^64: changes with every swap or change of an event.
std::array<std::uint64_t, 4> sums(const std::vector<Event>& events) {
  std::array<std::uint64_t, 4> out{};
  for (std::uint64_t i = 0; i < events.size(); ++i) {
    const Event& e = events[i];
    const std::array<std::uint64_t, 4> values = {static_cast<std::uint64_t>(e.t_us), e.x, e.y, e.p};
    for (std::size_t k = 0; k < 4; ++k) out[k] += (i + 1) * values[k];
  }
  return out;
}

using Sums = std::array<std::uint64_t, 4>;

}  // namespace

TEST(RealFiles, MetavisionHdf5IsEventExact) {
  PECS_NEEDS_SHARED("data/real/R_360_L.hdf5");
  const Stream s = read_all(shared_dir() / "data/real/R_360_L.hdf5");
  ASSERT_EQ(s.events.size(), 350'632u);
  EXPECT_EQ(s.info.width, 1280);
  EXPECT_EQ(s.info.height, 720);
  EXPECT_EQ(s.info.camera, "IMX636");
  EXPECT_EQ(s.events.front().t_us, 4944);
  EXPECT_EQ(s.events.back().t_us, 59206);
  EXPECT_EQ(sums(s.events), (Sums{2524420263278715, 56319108811321, 24577297172146, 35550124306}));
}

TEST(RealFiles, DatIsEventExact) {
  PECS_NEEDS_SHARED("data/peer/R_360_L_ESIM.dat");
  const Stream s = read_all(shared_dir() / "data/peer/R_360_L_ESIM.dat");
  ASSERT_EQ(s.events.size(), 523'331u);
  EXPECT_EQ(s.info.width, 1215);
  EXPECT_EQ(s.info.height, 684);
  EXPECT_EQ(sums(s.events), (Sums{5203723077589333, 129414848374992, 57337924283237, 68310969369}));
}

TEST(RealFiles, ATruncatedRecordingIsRefused) {
  PECS_NEEDS_SHARED("data/real/R_360_L.hdf5");
  const TempFolder folder;
  auto bytes = bytes_of(shared_dir() / "data/real/R_360_L.hdf5");
  bytes.resize(bytes.size() / 2);
  write_bytes(folder / "half.hdf5", bytes);
  ExitCode code{};
  const std::string line = error_of([&] { read_all(folder / "half.hdf5"); }, &code);
  EXPECT_EQ(code, ExitCode::bad_input) << line;
}

TEST(RealFiles, DamageInAChunkIsPlaced) {
  PECS_NEEDS_SHARED("data/real/R_360_L.hdf5");
  const TempFolder folder;
  auto bytes = bytes_of(shared_dir() / "data/real/R_360_L.hdf5");
  bytes[63510] = bytes[63511] = '\x7f';  // the second chunk's number of events
  write_bytes(folder / "bad.hdf5", bytes);
  const auto reader = open_reader(folder / "bad.hdf5");
  std::vector<Event> first(16384);
  EXPECT_EQ(reader->read(first), first.size()) << "the chunk before it is good";
  EXPECT_NE(error_of([&] { reader->read(first); }).find("byte 63510: got a block of "), std::string::npos);
}
