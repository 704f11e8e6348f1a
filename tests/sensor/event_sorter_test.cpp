#include "pecs/sensor/event_sorter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

namespace pecs::sensor {
namespace {

constexpr int kWidth = 640;
constexpr std::uint32_t kPixels = 640 * 480;

events::Event event_of(EventKey key) {
  const std::uint32_t pixel = key_pixel(key);
  return {key_time_us(key), static_cast<std::uint16_t>(pixel % kWidth), static_cast<std::uint16_t>(pixel / kWidth),
          static_cast<std::uint8_t>(key_on(key))};
}

std::vector<EventKey> random_keys(std::mt19937& random, std::size_t count, std::int64_t begin_us, std::int64_t end_us) {
  std::vector<EventKey> keys(count);
  for (EventKey& key : keys)
    key = event_key(std::uniform_int_distribution(begin_us, end_us)(random),
                    static_cast<std::uint32_t>(random() % kPixels), random() % 2);
  return keys;
}

// Keys in any order, of several parts, batch by batch: what is final leaves in order, what is not comes with the next.
TEST(EventSorter, AnyOrderLeavesSorted) {
  std::mt19937 random(1);
  EventSorter sorter(kWidth);
  LabelledEvents found;
  std::vector<EventKey> all;
  for (std::int64_t begin_us = 0; begin_us < 40000; begin_us += 10000) {
    std::vector<double> t_us;
    for (int i = 0; i < 10; ++i) t_us.push_back(static_cast<double>(begin_us) + 1000.0 * i);
    sorter.begin(t_us);
    sorter.part(2);
    for (std::size_t part = 0; part < 3; ++part) {
      const std::vector<EventKey> keys = random_keys(random, 7000, begin_us, begin_us + 12000);
      for (const EventKey key : keys) sorter.part(part).add(key);
      all.insert(all.end(), keys.begin(), keys.end());
    }
    sorter.take(begin_us + 9500, found);
  }
  sorter.begin({});
  sorter.take(1 << 20, found);
  std::ranges::sort(all);
  ASSERT_EQ(found.events.size(), all.size());
  for (std::size_t i = 0; i < all.size(); ++i) EXPECT_EQ(found.events[i], event_of(all[i])) << i;
}

TEST(EventSorter, PixelsOfEveryWidth) {
  std::mt19937 random(3);
  for (const std::uint32_t width : {1u, 2u, 3u, 346u, 1280u, 8191u, 8192u}) {
    EventSorter sorter(static_cast<int>(width));
    sorter.begin(std::vector{0.0});
    std::vector<EventKey> keys{0, event_key(1, width * 8192 - 1, true), event_key(1, width * 8191, false)};
    for (int i = 0; i < 1000; ++i)
      keys.push_back(event_key(random() % 900, static_cast<std::uint32_t>(random()) % (width * 8192), random() % 2));
    for (const EventKey key : keys) sorter.part(0).add(key);
    LabelledEvents found;
    sorter.take(1 << 20, found);
    std::ranges::sort(keys);
    for (std::size_t i = 0; i < keys.size(); ++i) {
      const std::uint32_t pixel = key_pixel(keys[i]);
      const events::Event wanted{key_time_us(keys[i]), static_cast<std::uint16_t>(pixel % width),
                                 static_cast<std::uint16_t>(pixel / width), static_cast<std::uint8_t>(key_on(keys[i]))};
      ASSERT_EQ(found.events[i], wanted) << width;
    }
  }
}

}  // namespace
}  // namespace pecs::sensor
