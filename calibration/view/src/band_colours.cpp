#include "pecs/view/band_colours.h"

#include <Eigen/Dense>
#include <algorithm>

#include "pecs/data_dir.h"
#include "pecs/sensor/named_spectrum.h"

namespace pecs::view {
namespace {

// Three functions of wavelength, linearly interpolated.
class Table {
 public:
  explicit Table(const char* basis)
      : rows_(sensor::read_table(data_dir("lens_data/spectra") / "basis" / (std::string(basis) + ".csv"), 4)) {}
  double min_nm() const { return rows_.front()[0]; }
  double max_nm() const { return rows_.back()[0]; }
  Eigen::Vector3d at(double nm) const {  // clamped to the ends of the table
    nm = std::clamp(nm, min_nm(), max_nm());
    const auto above = std::lower_bound(rows_.begin() + 1, rows_.end() - 1, nm,
                                        [](const std::vector<double>& row, double x) { return row[0] < x; });
    const auto &a = *(above - 1), &b = *above;
    const double f = (nm - a[0]) / (b[0] - a[0]);
    return {a[1] + f * (b[1] - a[1]), a[2] + f * (b[2] - a[2]), a[3] + f * (b[3] - a[3])};
  }

 private:
  std::vector<std::vector<double>> rows_;
};

}  // namespace

std::vector<std::array<double, 3>> rgb_of_bands(const std::vector<sensor::Band>& bands,
                                                const sensor::Spectrum& illuminant) {
  // IEC 61966-2-1
  Eigen::Matrix3d rgb_from_xyz;
  rgb_from_xyz << 3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570;
  const Table observer("cie1931"), primaries("srgb");
  const auto seen = [&](double nm) -> Eigen::Vector3d {
    return nm < observer.min_nm() || nm > observer.max_nm() ? Eigen::Vector3d::Zero() : observer.at(nm);
  };

  // Per band: light of the three primaries, CIE sum as linear sRGB, and luminous weight.
  const auto n = static_cast<Eigen::Index>(bands.size());
  Eigen::MatrixXd light(n, 3), sum(3, n);
  Eigen::VectorXd weight(n);
  for (Eigen::Index k = 0; k < n; ++k) {
    const sensor::Band& band = bands[static_cast<std::size_t>(k)];
    light.row(k) = illuminant.at(band.lambda_nm) * primaries.at(band.lambda_nm).transpose();
    sum.col(k) = band.weight_nm * rgb_from_xyz * seen(band.lambda_nm);
    weight[k] = seen(band.lambda_nm).sum() * band.weight_nm;
  }
  weight.array() += std::max(1e-3 * weight.maxCoeff(), 1e-12);
  Eigen::Vector3d white = Eigen::Vector3d::Zero();
  for (double nm = observer.min_nm(); nm <= observer.max_nm(); nm += 1)
    white += illuminant.at(nm) * (rgb_from_xyz * observer.at(nm));

  // The mixture; components that the bands do not determine are grey.
  const Eigen::MatrixXd weighted = weight.asDiagonal() * light;
  Eigen::Matrix3d normal = light.transpose() * weighted;
  const double scale = std::max(normal.trace(), 1e-300);
  normal += 1e-5 * scale * (Eigen::Matrix3d::Identity() - Eigen::Matrix3d::Constant(1.0 / 3));
  const Eigen::MatrixXd mixture = normal.ldlt().solve(weighted.transpose());
  const Eigen::MatrixXd missed = Eigen::MatrixXd::Identity(n, n) - light * mixture;
  const Eigen::MatrixXd rgb = mixture + white.cwiseInverse().asDiagonal() * sum * missed;

  std::vector<std::array<double, 3>> out;
  for (Eigen::Index k = 0; k < n; ++k) out.push_back({rgb(0, k), rgb(1, k), rgb(2, k)});
  return out;
}

}  // namespace pecs::view
