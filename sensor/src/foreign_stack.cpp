#include "foreign_stack.h"

#include <ImfChannelList.h>
#include <ImfInputFile.h>
#include <ImfStringAttribute.h>
#include <fmt/format.h>

#include <algorithm>

#include "exr_frame.h"
#include "exr_size.h"
#include "pecs/sensor/stack.h"

namespace pecs::sensor {
namespace {

// Weights of bands that came without: a band reaches halfway to its neighbours, an outer one as far to either side, as
// in the layout of Fichet et al. (pbrt's values are means over such buckets).
void bucket_weights(std::vector<Band>& bands) {
  const std::size_t n = bands.size();
  if (n < 2) return;
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t left = i ? i - 1 : 0, right = std::min(i + 1, n - 1);
    bands[i].weight_nm = (bands[right].lambda_nm - bands[left].lambda_nm) / static_cast<double>(right - left);
  }
}

}  // namespace

ForeignStack foreign_stack(const std::filesystem::path& path) {
  return reading(path, [&] {
    const Imf::InputFile file(path.c_str(), 0);
    check_declared_size(file.header(), path);
    const Imf::Header& header = file.header();
    ForeignStack f;
    StackInfo& info = f.info;
    info.width = width_of(header);
    info.height = height_of(header);
    const auto* units = header.findTypedAttribute<Imf::StringAttribute>("emissiveUnits");
    info.quantity =
        units && units->value() == unit_of(Quantity::irradiance) ? Quantity::irradiance : Quantity::radiance;
    std::vector<std::pair<double, std::string>> found;
    std::vector<std::string> numbered;
    for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
      const std::string name = c.name();
      if (const auto lambda = channel_lambda_nm(name)) found.emplace_back(*lambda, name);
      if (name.starts_with("Radiance.C")) numbered.push_back(name);  // sorted: C01, C02, …
    }
    f.layout = "spectral EXR";
    if (found.empty() && numbered.size() > 1) {
      f.layout = "pbrt Radiance.C01…";
      for (std::size_t i = 0; i < numbered.size(); ++i)
        found.emplace_back(400 + 300.0 * static_cast<double>(i) / static_cast<double>(numbered.size() - 1),
                           numbered[i]);
    }
    const auto has = [&](const char* name) { return header.channels().findChannel(name) != nullptr; };
    if (found.empty() && has("R") && has("G") && has("B")) {
      f.layout = "RGB EXR";
      info.quantity = Quantity::relative;
      found = {{465, "B"}, {550, "G"}, {610, "R"}};
    }
    if (found.empty() || found.size() > kMaxBands)
      throw bad_input(path.string(), "channels", fmt::format("{} named S0.<wavelength>nm", found.size()),
                      fmt::format("1 to {}, or Radiance.C01…, or R, G, B", kMaxBands));
    std::ranges::sort(found);
    Layer light{kLight, "", {}, unit_of(info.quantity)};
    for (const auto& [lambda_nm, name] : found) {
      info.bands.push_back({lambda_nm, 1});
      light.channels.push_back(name);
    }
    if (f.layout != "RGB EXR") bucket_weights(info.bands);
    info.layers = {std::move(light)};
    return f;
  });
}

}  // namespace pecs::sensor
