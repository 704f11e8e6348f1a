// pecs lens: properties, ray tracing, conversion and drawings of lens prescriptions.
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <iostream>
#include <memory>

#include "commands.h"
#include "console.h"
#include "help.h"
#include "pecs/error.h"
#include "pecs/files.h"
#include "pecs/lens/draw.h"
#include "pecs/lens/exchange.h"
#include "pecs/lens/report.h"
#include "pecs/lens/trace_csv.h"
#include "picture_file.h"
#include "units.h"

namespace pecs::app {
namespace {

// Options of all lens commands.
struct LensArguments {
  std::string lens;
  std::optional<double> focus_m;
  lens::StopChoice stop;
  bool json = false;
  int width_px = 1920;

  void add_width_to(CLI::App& command) {
    add_quantity(command, "--width", width_px, "px", "width of a .png")
        ->capture_default_str()
        ->check(CLI::Range(16, 16384));
  }
  void add_to(CLI::App& command) {
    command.add_option("LENS", lens, "prescription (lens_data/SCHEMA.md), or a name from lens_data/lenses")->required();
  }
  void add_state_to(CLI::App& command) {
    add_quantity(command, "--focus", focus_m, "m", "object distance from the entrance pupil (default: infinity)");
    add_stop_to(command);
  }
  void add_stop_to(CLI::App& command) {
    auto* diameter =
        add_quantity(command, "--stop-diameter", stop.diameter_mm, "mm", "diameter of the stop (default: wide open)");
    command.add_option("--fnumber", stop.fnumber, "f-number instead of a diameter")->excludes(diameter);
  }
};

void add_film(CLI::App& command, lens::InfoOptions& info) {
  add_quantity(command, "--film-width", info.film_width_mm, "mm", "film width")
      ->check(CLI::Range(1e-3, 1e3))
      ->capture_default_str();
  add_quantity(command, "--film-height", info.film_height_mm, "mm", "film height")
      ->check(CLI::Range(1e-3, 1e3))
      ->capture_default_str();
}

void print_text(const Json& report, const lens::InfoOptions& film) {
  const auto row = [&](const char* name, const char* key, const char* unit) {
    const Json& value = report[key];
    fmt::print("  {:<24}{}\n", name, value.is_null() ? "-" : fmt::format("{:.6g} {}", value.get<double>(), unit));
  };
  fmt::print("{}\n", report["name"].get<std::string>());
  for (const Json& note : report["notes"]) fmt::print("  note: {}\n", note.get<std::string>());
  row("wavelength", "lambda_nm", "nm");
  row("EFL", "efl_mm", "mm");
  row("BFL", "bfl_mm", "mm");
  row("f-number", "fnumber", "");
  row("working f-number", "working_fnumber", "");
  row("stop diameter", "stop_diameter_mm", "mm");
  row("entrance pupil z", "entrance_pupil_z_mm", "mm");
  row("entrance pupil diameter", "entrance_pupil_diameter_mm", "mm");
  row("exit pupil z", "exit_pupil_z_mm", "mm");
  row("exit pupil diameter", "exit_pupil_diameter_mm", "mm");
  row("film z", "film_z_mm", "mm");
  row("RMS spot on the axis", "rms_spot_um", "um");
  row("E0 per radiance", "e0_sr", "sr");
  fmt::print("  {:<24}{:g} x {:g} mm\n", "film", film.film_width_mm, film.film_height_mm);
  row("field of view, across", "hfov_deg", "deg");
  row("field of view, up", "vfov_deg", "deg");
  row("field of view, diagonal", "dfov_deg", "deg");
  fmt::print("  {:>8} {:>9} {:>12} {:>12} {:>20} {:>20}\n", "film mm", "angle deg", "illumination", "distortion %",
             "lateral colour um", "RMS spot um");
  for (const Json& r : report["field"]) {
    const auto list = [](const Json& values) {
      std::string out;
      for (const Json& v : values)
        out += (out.empty() ? "" : " ") + (v.is_null() ? std::string("-") : fmt::format("{:.2f}", v.get<double>()));
      return out;
    };
    const auto cell = [&](const char* key, int digits) {
      return r[key].is_null() ? std::string("-") : fmt::format("{:.{}f}", r[key].get<double>(), digits);
    };
    fmt::print("  {:>8} {:>9} {:>12} {:>12} {:>20} {:>20}\n", cell("r_mm", 3), cell("angle_deg", 3),
               cell("relative_illumination", 4), cell("distortion_percent", 4), list(r["lateral_colour_um"]),
               list(r["rms_spot_um"]));
  }
}

void add_lens_info(CLI::App& parent) {
  struct Options : LensArguments {
    lens::InfoOptions info;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* command = parent.add_subcommand("info", "print focal lengths, f-number, pupils, field of view");
  o->add_to(*command);
  o->add_state_to(*command);
  add_quantity(*command, "--wavelength", o->info.lambda_nm, "nm", "wavelength")->capture_default_str();
  add_film(*command, o->info);
  add_quantity(*command, "--bands", o->info.bands_nm, "nm",
               "wavelengths of the colours along the field, separated by commas (default: --wavelength)")
      ->delimiter(',');
  command->add_option("--field-rows", o->info.field_rows, "film radii, axis to corner")
      ->capture_default_str()
      ->check(CLI::Range(2, 1000));
  command->add_flag("--json", o->json, "machine-readable output");
  add_examples(*command,
               {"pecs lens info pecs_lab_15mm --focus 0.5m", "pecs lens info pecs_lab_15mm --fnumber 8 --json"});
  command->callback([o] {
    o->info.focus_m = o->focus_m;
    o->info.stop = o->stop;
    const Json report = lens::info(lens::load_prescription(o->lens), o->info);
    if (o->json) return print_json(report, 2);
    print_text(report, o->info);
  });
}

void add_lens_pupil(CLI::App& parent, Console& console) {
  struct Options : LensArguments {
    lens::InfoOptions info;
    std::string output;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* command =
      parent.add_subcommand("pupil", "print the pupil over the film radius: covering ellipse, exact area, irradiance");
  o->add_to(*command);
  o->add_state_to(*command);
  add_quantity(*command, "--wavelength", o->info.lambda_nm, "nm", "wavelength")->capture_default_str();
  add_film(*command, o->info);
  add_output(*command, "-o,--output", o->output,
             "picture (.svg or .png) of exact pupils and ellipses at five film radii");
  o->add_width_to(*command);
  command->add_flag("--json", o->json, "machine-readable output");
  add_examples(*command, {"pecs lens pupil pecs_lab_15mm --fnumber 4 -o pupils.svg"});
  command->callback([o, &console] {
    o->info.focus_m = o->focus_m;
    o->info.stop = o->stop;
    const lens::Prescription prescription = lens::load_prescription(o->lens);
    const Json report = lens::pupil_report(prescription, o->info);
    if (!o->output.empty()) {
      write_picture(o->output,
                    lens::draw_pupils_svg(prescription, o->info.lambda_nm, report["stop_diameter_mm"],
                                          report["film_z_mm"], report["pupil"].back()["r_mm"]),
                    o->width_px);
      Json results = report;
      results.erase("pupil");
      console.record(o->output, {.command = "lens pupil", .config = results, .inputs = {prescription.file}});
    }
    if (o->json) return print_json(report, 2);
    fmt::print("{}: {} nm, film z {:.6g} mm, direction plane z {:.6g} mm, missed {:.2g}\n", prescription.name,
               o->info.lambda_nm, report["film_z_mm"].get<double>(), report["plane_z_mm"].get<double>(),
               report["missed_fraction"].get<double>());
    fmt::print("{:>8} {:>9} {:>9} {:>9} {:>10} {:>10} {:>12}\n", "r_mm", "p_mm", "a_mm", "b_mm", "area_mm2",
               "acceptance", "illumination");
    for (const Json& row : report["pupil"])
      fmt::print("{:8.4f} {:9.5f} {:9.5f} {:9.5f} {:10.5f} {:10.4f} {:12.5f}\n", row["r_mm"].get<double>(),
                 row["p_mm"].get<double>(), row["a_mm"].get<double>(), row["b_mm"].get<double>(),
                 row["area_mm2"].get<double>(), row["acceptance"].get<double>(),
                 row["relative_illumination"].get<double>());
  });
}

void add_lens_convert(CLI::App& parent, Console& console) {
  struct Options : LensArguments {
    std::string output;
    double lambda_nm = lens::kLambdaD;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* command =
      parent.add_subcommand("convert", "convert Zemax .zmx or pbrt .dat to JSON, or any lens to pbrt's .dat");
  o->add_to(*command);
  add_output(*command, "-o,--output", o->output, "file to write: .json, or .dat for pbrt")->required();
  add_quantity(*command, "--wavelength", o->lambda_nm, "nm", "wavelength of pbrt's single index")
      ->capture_default_str();
  add_quantity(*command, "--focus", o->focus_m, "m", "focus of pbrt's film distance (default: infinity)");
  add_examples(*command, {"pecs lens convert lens.zmx -o lens.json",
                          "pecs lens convert pecs_lab_15mm -o lens.dat --wavelength 550nm"});
  command->callback([o, &console] {
    const lens::Prescription prescription = lens::load_prescription(o->lens);  // validates the lens
    std::string text;
    if (o->output.ends_with(".json")) {
      text = text_of(lens::load_lens_json(o->lens), 1) + "\n";
    } else if (o->output.ends_with(".dat")) {
      const double bands[] = {o->lambda_nm};
      text = lens::export_pbrt(prescription, o->lambda_nm, lens::best_focus(prescription, bands, o->focus_m).film_z_mm);
    } else {
      throw Error(ExitCode::usage, o->output + ": unknown extension; use .json or .dat");
    }
    write_file(o->output, text);
    console.record(o->output,
                   {.command = "lens convert", .config = {{"lambda_nm", o->lambda_nm}}, .inputs = {prescription.file}});
  });
}

void add_lens_trace(CLI::App& parent) {
  struct Options : LensArguments {
    double lambda_nm = lens::kLambdaD;
    double to_z_mm = 0;
    bool no_clip = false;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* command = parent.add_subcommand(
      "trace", "trace rays from stdin: x,y,z,dx,dy,dz in mm, first vertex z = 0, +z from object to film");
  o->add_to(*command);
  o->add_stop_to(*command);
  add_quantity(*command, "--wavelength", o->lambda_nm, "nm", "wavelength")->capture_default_str();
  add_quantity(*command, "--to-z", o->to_z_mm, "mm", "plane in which the traced rays are printed")->required();
  command->add_flag("--no-clip", o->no_clip, "ignore stop and housing");
  add_examples(*command, {"echo 0,0,-100,0,0,1 | pecs lens trace pecs_lab_15mm --to-z 40mm --wavelength 550nm"});
  command->callback([o] {
    const lens::Prescription prescription = lens::load_prescription(o->lens);
    const lens::Tracer tracer(prescription, o->lambda_nm, lens::resolve_stop(prescription, o->stop));
    const auto clip = o->no_clip ? lens::Tracer::Clip::none : lens::Tracer::Clip::housing;
    std::ios::sync_with_stdio(false);
    lens::trace_csv(std::cin, "stdin", stdout, tracer, clip, o->to_z_mm);
    if (std::fflush(stdout) != 0) throw bad_output("stdout", "not all rays were written");
  });
}

// draw: a section of the lens; chart: a sheet with all curves.
void add_lens_picture(CLI::App& parent, Console& console, const std::string& name, const std::string& help,
                      std::string (*picture)(const lens::Prescription&, const lens::DrawOptions&)) {
  struct Options : LensArguments {
    lens::DrawOptions draw;
    lens::InfoOptions film;
    std::string output;
  };
  const auto o = std::make_shared<Options>();
  CLI::App* command = parent.add_subcommand(name, help);
  o->add_to(*command);
  o->add_state_to(*command);
  add_output(*command, "-o,--output", o->output, "picture: .svg or .png")->required();
  o->add_width_to(*command);
  add_quantity(*command, "--wavelength", o->draw.bands_nm, "nm", "wavelengths, separated by commas")
      ->delimiter(',')
      ->capture_default_str();
  add_film(*command, o->film);
  command->add_option("--fields", o->draw.fields, "film points, as fractions of the film's half diagonal")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--rays", o->draw.rays_per_fan, "rays per field and wavelength")
      ->capture_default_str()
      ->check(CLI::Range(1, 200));
  const std::string example = fmt::format("pecs lens {0} pecs_lab_15mm -o {0}.svg", name);
  const std::string other =
      fmt::format("pecs lens {0} pecs_lab_15mm -o {0}.png --width 1200px --fnumber 5.6 --wavelength 450nm,550nm", name);
  add_examples(*command, {example.c_str(), other.c_str()});
  command->callback([o, &console, name, picture] {
    const lens::Prescription prescription = lens::load_prescription(o->lens);
    o->draw.focus_m = o->focus_m;
    o->draw.stop_diameter_mm = lens::resolve_stop(prescription, o->stop);
    o->draw.film_half_diagonal_mm = 0.5 * std::hypot(o->film.film_width_mm, o->film.film_height_mm);
    write_picture(o->output, picture(prescription, o->draw), o->width_px);
    console.record(o->output, {.command = "lens " + name,
                               .config = {{"lambda_nm", o->draw.bands_nm},
                                          {"focus_m", or_null(o->draw.focus_m)},
                                          {"stop_diameter_mm", o->draw.stop_diameter_mm},
                                          {"fields", o->draw.fields},
                                          {"film_width_mm", o->film.film_width_mm},
                                          {"film_height_mm", o->film.film_height_mm},
                                          {"rays", o->draw.rays_per_fan}},
                               .inputs = {prescription.file}});
  });
}

}  // namespace

void add_lens(CLI::App& app, Console& console) {
  CLI::App* command = app.add_subcommand("lens", "lens prescriptions: first-order data, ray tracing, drawings");
  command->require_subcommand(1);
  add_examples(*command, {"pecs lens info pecs_lab_15mm", "pecs lens draw pecs_lab_15mm -o lens.svg"});
  add_lens_info(*command);
  add_lens_trace(*command);
  add_lens_pupil(*command, console);
  add_lens_convert(*command, console);
  add_lens_picture(*command, console, "draw", "draw a section of the lens with rays, as SVG or PNG", lens::draw_svg);
  add_lens_picture(*command, console, "chart",
                   "draw section, spots, illumination, distortion, lateral colour and MTF on one sheet, SVG or PNG",
                   lens::chart_svg);
}

}  // namespace pecs::app
