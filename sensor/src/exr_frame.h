#pragma once
// One frame file of a stack, as OpenEXR sees it.
#include <Iex.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "exr_size.h"
#include "pecs/error.h"
#include "pecs/sensor/source.h"

namespace pecs::sensor {

inline constexpr const char* kTimeAttribute = "pecsTimeNs";
inline constexpr double kSameLambda_nm = 0.005;  // channel names carry three decimals

std::string frame_name(const Layer& layer, std::int64_t index);
std::string between_name(std::int64_t interval, std::int64_t number);
// "S0.486,25nm": decimal comma, no trailing zeros.
std::string channel_name(double lambda_nm);
// The wavelength in a channel name of the layout's emissive kind, S0.550nm, or of Mitsuba, whose names hold no point:
// S0_550nm, band_550nm. Nothing for other channels.
std::optional<double> channel_lambda_nm(std::string name);

// OpenEXR's global limits, set once before anything is read or written.
void limit_exr();
std::string one_line(std::string text);

// Runs f; what OpenEXR throws becomes our error with the file's name.
template <class F>
auto reading(const std::filesystem::path& path, F&& f) {
  limit_exr();
  check_attributes(path);
  try {
    return f();
  } catch (const Error&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Iex::ErrnoExc& e) {
    throw not_found(path.string(), one_line(e.what()));
  } catch (const std::exception& e) {
    throw bad_input(path.string(), "OpenEXR", one_line(e.what()), "a whole OpenEXR file");
  }
}

int width_of(const Imf::Header& header);
int height_of(const Imf::Header& header);
// The file's names of the layer's channels. Throws bad_input for another size, or a channel that is missing or
// subsampled.
std::vector<std::string> check_header(const Imf::Header& header, const std::filesystem::path& path,
                                      const StackInfo& info, const Layer& layer);
// Of its own; throws bad_input where it has none.
std::int64_t time_of(const Imf::Header& header, const std::filesystem::path& path);
void check_time(const Imf::Header& header, const std::filesystem::path& path, std::int64_t time_ns, bool required);

// values: [channel][row][x], of the rows from first_row on.
Imf::FrameBuffer frame_buffer(std::span<const std::string> channels, float* values, int width, int rows, int min_x,
                              int first_row);

}  // namespace pecs::sensor
