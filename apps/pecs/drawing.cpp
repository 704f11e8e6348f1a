#include "drawing.h"

#include <cairo-pdf.h>
#include <fmt/format.h>
#include <librsvg/rsvg.h>

#include <cmath>
#include <memory>

#include "pecs/error.h"

namespace pecs::app {
namespace {

struct Unref {
  void operator()(RsvgHandle* handle) const { g_object_unref(handle); }
};

struct Drawing {
  std::unique_ptr<RsvgHandle, Unref> handle;
  RsvgRectangle box{};  // the viewBox

  explicit Drawing(const std::string& svg) {
    GError* error = nullptr;
    handle.reset(rsvg_handle_new_from_data(reinterpret_cast<const guint8*>(svg.data()), svg.size(), &error));
    gboolean has_box = FALSE;
    if (handle) rsvg_handle_get_intrinsic_dimensions(handle.get(), nullptr, nullptr, nullptr, nullptr, &has_box, &box);
    g_clear_error(&error);
    if (!handle || !has_box) throw Error(ExitCode::internal, "librsvg cannot read the drawing");
  }
};

cairo_status_t append(void* to, const unsigned char* data, unsigned size) {
  static_cast<std::string*>(to)->append(reinterpret_cast<const char*>(data), size);
  return CAIRO_STATUS_SUCCESS;
}

using Surface = std::unique_ptr<cairo_surface_t, decltype(&cairo_surface_destroy)>;
using Cairo = std::unique_ptr<cairo_t, decltype(&cairo_destroy)>;

}  // namespace

std::string drawn_as_pdf(const std::string& svg) {
  const Drawing drawing(svg);
  constexpr double kPointsPerMm = 72 / 25.4;
  const RsvgRectangle page{0, 0, drawing.box.width * kPointsPerMm, drawing.box.height * kPointsPerMm};
  std::string pdf;
  {
    const Surface surface(cairo_pdf_surface_create_for_stream(append, &pdf, page.width, page.height),
                          &cairo_surface_destroy);
    const Cairo cairo(cairo_create(surface.get()), &cairo_destroy);
    if (!rsvg_handle_render_document(drawing.handle.get(), cairo.get(), &page, nullptr))
      throw Error(ExitCode::internal, "librsvg cannot draw the page");
    cairo_show_page(cairo.get());
    cairo_surface_finish(surface.get());
  }
  return pdf;
}

std::string drawn_as_png(const std::string& svg, int width_px) {
  const Drawing drawing(svg);
  const RsvgRectangle& box = drawing.box;
  const int height_px = static_cast<int>(std::lround(width_px * box.height / box.width));
  const Surface surface(cairo_image_surface_create(CAIRO_FORMAT_RGB24, width_px, height_px), &cairo_surface_destroy);
  const Cairo cairo(cairo_create(surface.get()), &cairo_destroy);
  const RsvgRectangle viewport{0, 0, static_cast<double>(width_px), static_cast<double>(height_px)};
  std::string png;
  if (!rsvg_handle_render_document(drawing.handle.get(), cairo.get(), &viewport, nullptr) ||
      cairo_surface_write_to_png_stream(surface.get(), append, &png) != CAIRO_STATUS_SUCCESS)
    throw Error(ExitCode::internal, fmt::format("librsvg cannot draw {} x {} pixels", width_px, height_px));
  return png;
}

}  // namespace pecs::app
