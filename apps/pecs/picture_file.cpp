#include "picture_file.h"

#include <fmt/format.h>
#include <librsvg/rsvg.h>

#include <cmath>
#include <memory>

#include "pecs/error.h"
#include "pecs/files.h"

namespace pecs::app {
namespace {

std::string drawn_as_png(const std::string& svg, int width_px) {
  const auto unref = [](auto* object) { g_object_unref(object); };
  GError* error = nullptr;
  const std::unique_ptr<RsvgHandle, decltype(unref)> handle(
      rsvg_handle_new_from_data(reinterpret_cast<const guint8*>(svg.data()), svg.size(), &error));
  gboolean has_box = FALSE;
  RsvgRectangle box{};
  if (handle) rsvg_handle_get_intrinsic_dimensions(handle.get(), nullptr, nullptr, nullptr, nullptr, &has_box, &box);
  if (!handle || !has_box) {
    g_clear_error(&error);
    throw Error(ExitCode::internal, "a drawing that librsvg cannot read");
  }
  const int height_px = static_cast<int>(std::lround(width_px * box.height / box.width));
  const std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)> surface(
      cairo_image_surface_create(CAIRO_FORMAT_RGB24, width_px, height_px), &cairo_surface_destroy);
  const std::unique_ptr<cairo_t, decltype(&cairo_destroy)> cairo(cairo_create(surface.get()), &cairo_destroy);
  const RsvgRectangle viewport{0, 0, static_cast<double>(width_px), static_cast<double>(height_px)};
  std::string png;
  const auto append = [](void* to, const unsigned char* data, unsigned size) {
    static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(data), size);
    return CAIRO_STATUS_SUCCESS;
  };
  if (!rsvg_handle_render_document(handle.get(), cairo.get(), &viewport, nullptr) ||
      cairo_surface_write_to_png_stream(surface.get(), append, &png) != CAIRO_STATUS_SUCCESS)
    throw Error(ExitCode::internal, fmt::format("no drawing of {} x {} pixels", width_px, height_px));
  return png;
}

}  // namespace

void write_picture(const std::string& path, const std::string& svg, int width_px) {
  const bool png = path.ends_with(".png");
  if (!png && !path.ends_with(".svg"))
    throw Error(ExitCode::usage, fmt::format("-o: got '{}', wanted a name that ends in .svg or .png", path));
  AtomicFile file(path);
  file.write(png ? drawn_as_png(svg, width_px) : svg);
  file.commit();
}

}  // namespace pecs::app
