#include "pecs/sensor/bands.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "pecs/error.h"

namespace pecs::sensor {
namespace {

void check_range(int n, double min_nm, double max_nm) {
  if (!(min_nm < max_nm))
    throw bad_input("bands", "range", fmt::format("{} to {} nm", min_nm, max_nm),
                    "an increasing range within the QE's");
  // The recurrence stays orthogonal only if the 1 nm grid has far more points than the rule.
  const int most = std::min(64, static_cast<int>((max_nm - min_nm) / 4));
  if (n < 1 || n > most) throw bad_input("bands", "n", std::to_string(n), fmt::format("1 to {}", most));
}

// lambda QE(lambda) E(lambda) as a discrete measure: trapezoid rule, steps of about 1 nm.
struct Measure {
  const Spectrum& qe;
  const Spectrum* illuminant;
  Eigen::ArrayXd x, lambda_nm, w;  // x in [-1, 1]
  double mass = 0;

  Measure(const Spectrum& curve, const Spectrum* lamp, int n, double min_nm, double max_nm)
      : qe(curve), illuminant(lamp) {
    check_range(n, min_nm, max_nm);
    const Eigen::Index points = static_cast<Eigen::Index>(std::lround(max_nm - min_nm)) + 1;
    x = Eigen::ArrayXd::LinSpaced(points, -1, 1);
    lambda_nm = min_nm + (max_nm - min_nm) * (x + 1) / 2;
    w = lambda_nm.unaryExpr([&](double l) { return density(l); }) * (max_nm - min_nm) / static_cast<double>(points - 1);
    w(0) /= 2;
    w(points - 1) /= 2;
    mass = w.sum();
    if (!(mass > 0) || (w > 0).count() < Eigen::Index{4} * n)
      throw bad_input("bands", "illuminant", "hardly any light where the chip sees",
                      "a spectrum inside the QE's range");
  }
  double density(double l) const { return l * qe.at(l) * (illuminant ? illuminant->at(l) : 1.0); }

  // share: the node's part of the mass.
  Band band(double l, double share) const {
    const double here = density(l);
    if (!(here > 0))
      throw bad_input("bands", "illuminant", fmt::format("zero at {:.2f} nm", l),
                      "light at every node (change n or range)");
    return {l, mass * share / here};
  }
};

}  // namespace

std::vector<Band> gauss_bands(const Spectrum& qe, const Spectrum* illuminant, int n, double min_nm, double max_nm) {
  const Measure measure(qe, illuminant, n, min_nm, max_nm);
  const Eigen::ArrayXd &x = measure.x, &w = measure.w;

  // Three-term recurrence p_{k+1} = (x - a_k) p_k - b_k p_{k-1}; with normalised polynomials.
  Eigen::VectorXd a(n), root_b(n > 1 ? n - 1 : 0);
  Eigen::ArrayXd before = Eigen::ArrayXd::Zero(x.size());
  Eigen::ArrayXd now = Eigen::ArrayXd::Constant(x.size(), 1 / std::sqrt(measure.mass));
  for (int k = 0; k < n; ++k) {
    a(k) = (w * x * now * now).sum();
    if (k + 1 == n) break;
    Eigen::ArrayXd next = (x - a(k)) * now - (k ? root_b(k - 1) : 0.0) * before;
    root_b(k) = std::sqrt((w * next * next).sum());
    before = now;
    now = next / root_b(k);
  }

  // Golub-Welsch: nodes are eigenvalues, weights the squared first components.
  Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen;
  eigen.computeFromTridiagonal(a, root_b);
  std::vector<Band> bands;
  for (int k = 0; k < n; ++k) {
    const double l = min_nm + (max_nm - min_nm) * (eigen.eigenvalues()(k) + 1) / 2;
    const double first = eigen.eigenvectors()(0, k);
    bands.push_back(measure.band(l, first * first));
  }
  return bands;
}

std::vector<Band> uniform_bands(int n, double min_nm, double max_nm) {
  check_range(n, min_nm, max_nm);
  std::vector<Band> bands;
  const double width_nm = (max_nm - min_nm) / n;
  for (int k = 0; k < n; ++k) bands.push_back({min_nm + (k + 0.5) * width_nm, width_nm});
  return bands;
}

}  // namespace pecs::sensor
