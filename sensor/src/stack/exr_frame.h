#pragma once
// Frame files of a stack: names, and checks of their OpenEXR headers.
#include <Iex.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pecs/error.h"
#include "pecs/sensor/source.h"

namespace pecs::sensor {

inline constexpr const char* kTimeAttribute = "pecsTimeNs";
inline constexpr double kSameLambda_nm = 0.005;  // channel names carry three decimals

std::string frame_name(const Layer& layer, std::int64_t index);
std::string between_name(std::int64_t interval, std::int64_t number);
// "S0.486,25nm": decimal comma, no trailing zeros.
std::string channel_name(double lambda_nm);
// The wavelength in a channel name: S0.550nm, emissive in the OpenEXR layout for spectral images; or S0_550nm,
// band_550nm of Mitsuba, whose names have no point. Nothing for other channels.
std::optional<double> channel_lambda_nm(std::string name);

// Sets OpenEXR's global limits, once.
void limit_exr();
std::string one_line(std::string text);

// Throws bad_input if the header declares more pixels than a file of this size can hold with the best compression,
// before memory is allocated for them.
void check_declared_size(const Imf::Header& header, const std::filesystem::path& path);

// Throws bad_input for an attribute of the header that is longer than the file (OpenEXR would allocate its length), or
// whose length is not that of its type (OpenEXR would read the rest as further attributes).
void check_attributes(const std::filesystem::path& path);

// Runs f and translates exceptions of OpenEXR to pecs::Error with the file's name.
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

// The window of a file that is the frame: the display window, black outside the data window; in stacks of PECS, and of
// pbrt, which renders a crop that way, the data window.
const Imath::Box2i& frame_window(const Imf::Header& header, bool is_foreign);
int width_of(const Imath::Box2i& window);
int height_of(const Imath::Box2i& window);
// The file's names of the layer's channels. Throws bad_input for another size, pixels that are not square, or a channel
// that is missing or subsampled.
std::vector<std::string> check_header(const Imf::Header& header, const std::filesystem::path& path,
                                      const StackInfo& info, const Layer& layer, bool is_foreign = false);
// The time in the header; throws bad_input if there is none.
std::int64_t time_of(const Imf::Header& header, const std::filesystem::path& path);
// Throws bad_input for a time in the header that differs by more than `tolerance_ns`.
void check_time(const Imf::Header& header, const std::filesystem::path& path, std::int64_t time_ns, bool required,
                std::int64_t tolerance_ns = 0);

// values: [channel][row][x], of the rows from first_row on.
Imf::FrameBuffer frame_buffer(std::span<const std::string> channels, float* values, int width, int rows, int min_x,
                              int first_row);

}  // namespace pecs::sensor
