#include <fmt/format.h>

#include <algorithm>
#include <random>

#include "pack.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/page/page.h"
#include "pecs/strict_json.h"
#include "pecs/text.h"
#include "pecs/view/event_pictures.h"

namespace pecs::view {

using namespace page;

extern const std::string_view kEvents3d;  // web/

std::vector<std::uint8_t> packed_events(const events::Recording& recording, std::size_t limit) {
  if (recording.span_us > UINT32_MAX)
    throw Error(ExitCode::unsupported,
                fmt::format("{}: a page shows at most 71 minutes; select a part with --from and --to", recording.name));

  // A random subset in order (Knuth's selection sampling), which adds no periodic pattern.
  const std::size_t total = recording.events.size();
  std::size_t left = std::min(total, limit);
  std::mt19937_64 random(1);
  std::vector<std::uint8_t> packed;
  packed.reserve(left * 8);
  for (std::size_t i = 0; i < total; ++i) {
    const events::Event& e = recording.events[i];
    if (left < total - i && random() % (total - i) >= left) continue;
    --left;
    const std::uint32_t x = e.x | e.p << 15;
    for (const auto& [word, bytes] :
         {std::pair{static_cast<std::uint32_t>(e.t_us), 4}, {x, 2}, {std::uint32_t{e.y}, 2}})
      for (int k = 0; k < bytes; ++k) packed.push_back(static_cast<std::uint8_t>(word >> 8 * k));
  }
  return packed;
}

std::size_t write_page(const events::Recording& recording, const std::filesystem::path& path, std::size_t limit) {
  const std::vector<std::uint8_t> packed = packed_events(recording, limit);
  const auto on =
      std::count_if(recording.events.begin(), recording.events.end(), [](const auto& e) { return e.p == 1; });
  const Json meta = {{"width", recording.width},
                     {"height", recording.height},
                     {"span_us", recording.span_us},
                     {"first_us", recording.first_us},
                     {"total", recording.events.size()},
                     {"on_fraction", static_cast<double>(on) / static_cast<double>(recording.events.size())}};
  write_file(path,
             framed("Events: " + recording.name, fill_template(kEvents3d, {{"title", html_escaped(recording.name)},
                                                                           {"meta", text_of(meta)},
                                                                           {"events", base64(packed)}})));
  return packed.size() / 8;
}

}  // namespace pecs::view
