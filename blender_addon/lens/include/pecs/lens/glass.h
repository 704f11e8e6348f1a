#pragma once
// Refractive index over wavelength, relative to air.
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace pecs::lens {

inline constexpr double kLambdaD = 587.5618, kLambdaF = 486.1327, kLambdaC = 656.2725, kLambdaG = 435.8343;  // nm

class Glass {
 public:
  static Glass air() { return constant(1.0, "air"); }
  static Glass constant(double n, std::string name);
  // n = n0 + c / (lambda - lambda0)^1.2 (Hartmann), through nd, Vd and the normal line P_gF = 0.6438 - 0.001682 Vd.
  static Glass from_nd_vd(double nd, double vd, std::string name);
  // A file of lens_data/glasses (lens_data/SCHEMA.md); throws bad_input.
  static Glass from_file(const std::filesystem::path& path);

  Glass with_nd(double nd) const;  // the same dispersion, shifted so that the index at the d line is nd
  // lambda in [min_nm(), max_nm()]; outside this range, the value is invalid.
  double n(double lambda_nm) const;
  double nd() const { return n(kLambdaD); }
  double vd() const { return (n(kLambdaD) - 1.0) / (n(kLambdaF) - n(kLambdaC)); }
  double min_nm() const { return min_nm_; }
  double max_nm() const { return max_nm_; }
  bool is_air() const { return form_ == Form::constant && c_.front() == 1.0; }
  const std::string& name() const { return name_; }      // "N-BK7", "air"; empty when unnamed
  const std::string& source() const { return source_; }  // "Schott", "nd, vd", "constant"

 private:
  // refractiveindex.info's formulas 1-3 (lambda in um).
  enum class Form { constant, hartmann, sellmeier1 = 11, sellmeier2 = 12, polynomial3 = 13 };
  double unshifted(double lambda_nm) const;
  Form form_ = Form::constant;
  double shift_ = 0;  // added to the index of the formula
  std::vector<double> c_{1.0};
  double min_nm_ = 200, max_nm_ = 3000;
  std::string name_, source_;
};

// The catalogue glasses of lens_data/glasses, or nothing when `catalog` has no glass of that name. A remark in
// parentheses after the name ("L-TIM28 (mold)") is ignored.
std::optional<Glass> catalog_glass(const std::string& catalog, const std::string& name);
// A glass as files of other programs name it: in one of these catalogues, else in any; if there is none, without an
// appended "_MOLD", or with Schott's "N-" (BK7, whose melt with lead and arsenic is no longer made).
struct NamedGlass {
  std::string name, catalog;
  bool is_of_another_catalog = false;  // than those given
};
std::optional<NamedGlass> glass_of_name(const std::string& name, const std::vector<std::string>& catalogs);
// The glass of that name in any catalogue whose nd and Vd agree with those given (5e-4, 0.3), with the nd given.
std::optional<Glass> matching_glass(const std::string& name, double nd, double vd);

// The glass of that name in the first catalogue that has one ("N-BK7"), or in a certain one ("schott/N-BK7"). Throws
// not_found.
Glass named_glass(const std::string& name);

}  // namespace pecs::lens
