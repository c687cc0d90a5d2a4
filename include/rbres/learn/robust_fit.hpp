#pragma once

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <rbres/core/error.hpp>
#include <vector>

namespace rbres::RBRES_ABI {

/// A number to fit: where the search starts, how far it looks at first, and its bounds.
struct FitNumber {
  /// In the number's own unit.
  /// @{
  double start = 0, width = 1, least = 0, most = 1;
  /// @}
};

/// How a fit goes.
struct FitOptions {
  double tolerance = 2e-2;  ///< the search ends with steps of this share of the first widths
  /// Steps before the search ends anyway.
  int max_iterations = 60;

  /// Throws Error naming the first option that makes no sense.
  void check() const {
    if (!(tolerance > 0 && tolerance < 1)) detail::refuse("fit tolerance", "a number in (0, 1)", tolerance);
    if (max_iterations < 1) detail::refuse("iterations of a fit", "1 or more", max_iterations);
  }
};

/// What a fit found.
struct FitResult {
  /// The numbers, in the order in which they were given.
  Eigen::VectorXd value;
  Eigen::MatrixXd covariance;  ///< of the values; infinite on the diagonal where the data do not say
  double loss = 0;             ///< see RobustFit
  long evaluations = 0;        ///< of all errors
};

/// Least squares that a few gross errors do not rule, for models with kinks and jumps, as contacts make them.
/// The loss is the mean over samples of sqrt(|e|^2 + c^2) - c, with c the median of |e|: squares of small
/// errors, and large ones by their size (pseudo-Huber loss; Charbonnier and others 1994). Derivatives at a
/// point would follow every kink, so slopes are taken over the width of the trust region (as in DFO-GN,
/// Cartis and Roberts 2019), by central differences; the best of the points that they need is a step of a
/// compass search and stands in where the Gauss-Newton step is worse. The covariance is Huber's (1967), with
/// one term for each cluster of samples, because errors along a trajectory are not independent.
///
/// `errors(x, E)` fills E (components x samples) for the values x; E may have the samples of the first
/// clusters alone. `clusters` has the first sample of each cluster and, last, the number of samples.
template <class Errors>
class RobustFit {
  using Vector = Eigen::VectorXd;
  using Matrix = Eigen::MatrixXd;

 public:
  /// `errors` must outlive it. Throws Error where there are no more clusters than numbers, or an option makes
  /// no sense.
  RobustFit(const std::vector<FitNumber>& numbers, Eigen::Index components,
            std::vector<Eigen::Index> clusters, const Errors& errors, const FitOptions& options = {})
      : numbers_(numbers),
        components_(components),
        clusters_(std::move(clusters)),
        errors_(errors),
        options_(options) {
    options.check();
    if (numbers.empty()) detail::refuse("numbers to fit", "at least one", "none");
    const auto wanted = static_cast<std::ptrdiff_t>(numbers.size()) + 1;
    if (std::ssize(clusters_) - 1 < wanted) {
      detail::refuse("windows to fit to", detail::text("at least ", wanted, ", one more than numbers"),
                     std::max<std::ptrdiff_t>(std::ssize(clusters_) - 1, 0));
    }
  }

  /// Fits the numbers.
  FitResult run() {
    Vector x(count());
    for (Eigen::Index i = 0; i < count(); ++i) x(i) = std::clamp(at(i).start, at(i).least, at(i).most);
    // The way is found on a part of the samples. The typical error of the start may be far from that of the
    // result, so its median is taken anew.
    const auto groups = std::ssize(clusters_) - 1;
    for (const auto& [part, radius] :
         {std::pair{std::min<std::ptrdiff_t>(groups, 12 * count()), 1.0}, {groups, 0.25}}) {
      samples_ = clusters_[static_cast<std::size_t>(part)];
      Matrix e = evaluate(x);
      scale_ = std::max(median_length(e), 1e-12);
      search(x, std::move(e), radius);
    }
    // Slopes over a small region would see every kink as information.
    const Slopes slopes = slopes_at(x, evaluate(x), 0.5);
    return {x, covariance(slopes), slopes.loss, evaluations_};
  }

 private:
  /// The errors' derivatives by the numbers, each in units of its width, and the points that gave them.
  struct Slopes {
    Matrix errors;
    std::vector<Matrix> by;  ///< components x samples, for each number
    Vector weight;           ///< of each sample
    double loss = 0, best_loss = 0;
    Vector best;  ///< the best of the points
  };

  Eigen::Index count() const { return static_cast<Eigen::Index>(numbers_.size()); }
  const FitNumber& at(Eigen::Index i) const { return numbers_[static_cast<std::size_t>(i)]; }

  Matrix evaluate(const Vector& x) {
    Matrix e(components_, samples_);
    errors_(x, e);
    ++evaluations_;
    return e;
  }
  static double median_length(const Matrix& e) {
    Vector lengths = e.colwise().norm();
    const auto middle = lengths.begin() + lengths.size() / 2;
    std::nth_element(lengths.begin(), middle, lengths.end());
    return *middle;
  }
  double loss(const Matrix& e) const {
    return ((e.colwise().squaredNorm().array() + scale_ * scale_).sqrt() - scale_).mean();
  }
  /// x moved by `step`, in units of the widths, within the bounds.
  Vector moved(Vector x, const Vector& step) const {
    for (Eigen::Index i = 0; i < count(); ++i)
      x(i) = std::clamp(x(i) + step(i) * at(i).width, at(i).least, at(i).most);
    return x;
  }

  Slopes slopes_at(const Vector& x, Matrix e, double radius) {
    Slopes s;
    s.loss = s.best_loss = loss(e);
    s.best = x;
    const auto consider = [&](const Vector& point, const Matrix& errors) {
      if (const double l = loss(errors); l < s.best_loss) {
        s.best_loss = l;
        s.best = point;
      }
    };
    Eigen::ArrayXd spread = e.colwise().squaredNorm().array();
    for (Eigen::Index i = 0; i < count(); ++i) {
      const Vector step = radius * Vector::Unit(count(), i);
      const Vector above = moved(x, step), below = moved(x, -step);
      Matrix up = evaluate(above);
      const Matrix down = evaluate(below);
      consider(above, up);
      consider(below, down);
      spread += 0.5 * (up.colwise().squaredNorm() + down.colwise().squaredNorm()).array().transpose();
      up = (up - down) * (at(i).width / (above(i) - below(i)));
      s.by.push_back(std::move(up));
    }
    // A trajectory that turns over somewhere within the region has no slope there: it weighs little.
    s.weight = (spread / static_cast<double>(count() + 1) + scale_ * scale_).rsqrt();
    s.errors = std::move(e);
    return s;
  }

  /// The weighted sums J^T e and J^T J over samples first, ..., last - 1.
  Vector gradient(const Slopes& s, Eigen::Index first, Eigen::Index last) const {
    Vector g(count());
    const auto part = Eigen::seq(first, last - 1);
    for (Eigen::Index i = 0; i < count(); ++i) {
      const Matrix& by = s.by[static_cast<std::size_t>(i)];
      g(i) = by(Eigen::all, part).cwiseProduct(s.errors(Eigen::all, part)).colwise().sum() * s.weight(part);
    }
    return g;
  }
  Matrix normal_matrix(const Slopes& s) const {
    Matrix a(count(), count());
    for (Eigen::Index i = 0; i < count(); ++i) {
      for (Eigen::Index j = 0; j <= i; ++j) {
        const Matrix &p = s.by[static_cast<std::size_t>(i)], &q = s.by[static_cast<std::size_t>(j)];
        a(i, j) = a(j, i) = p.cwiseProduct(q).colwise().sum() * s.weight;
      }
    }
    return a;
  }

  void search(Vector& x, Matrix e, double radius) {
    for (int k = 0; k < options_.max_iterations && radius > options_.tolerance; ++k) {
      const Slopes slopes = slopes_at(x, std::move(e), radius);
      const Vector g = gradient(slopes, 0, samples_);
      const Matrix a = normal_matrix(slopes);
      // Levenberg and Marquardt: damped until the step stays where the slopes were taken.
      Vector step;
      const double trace = a.trace() / static_cast<double>(count());
      for (double damping = 1e-9; damping < 1e9; damping *= 4) {
        const Matrix damped =
            a + Vector(damping * (a.diagonal().array() + 1e-6 * trace)).asDiagonal().toDenseMatrix();
        step = -damped.ldlt().solve(g);
        if (step.allFinite() && step.cwiseAbs().maxCoeff() <= 1.5 * radius) break;
      }
      double least = slopes.best_loss;
      Vector next = slopes.best;
      e.resize(0, 0);
      if (step.allFinite()) {
        const Vector trial = moved(x, step);
        Matrix errors = evaluate(trial);
        if (const double l = loss(errors); l < least) {
          least = l;
          next = trial;
          e = std::move(errors);
        }
      }
      x = next;
      if (e.size() == 0) e = evaluate(x);
      const double promised = -(g.dot(step) + 0.5 * step.dot(a * step)) / static_cast<double>(samples_);
      const double length = step.cwiseAbs().maxCoeff();
      if (!(slopes.loss - least > 0.1 * promised) || length < 0.5 * radius) {
        radius *= 0.5;
      } else if (length > radius) {
        radius = std::min(2 * radius, 1.0);
      }
    }
  }

  Matrix covariance(const Slopes& s) const {
    const Eigen::Index n = count(), groups = std::ssize(clusters_) - 1;
    Matrix terms(n, groups);
    for (Eigen::Index c = 0; c < groups; ++c)
      terms.col(c) =
          gradient(s, clusters_[static_cast<std::size_t>(c)], clusters_[static_cast<std::size_t>(c) + 1]);
    terms.colwise() -= Vector(terms.rowwise().mean());
    const Eigen::SelfAdjointEigenSolver<Matrix> solver(normal_matrix(s));
    const Vector& values = solver.eigenvalues();
    Vector inverse = Vector::Zero(n);
    for (Eigen::Index k = 0; k < n; ++k)
      if (values(k) > 1e-9 * values(n - 1)) inverse(k) = 1 / values(k);
    const Matrix& v = solver.eigenvectors();
    const Matrix influence = v * inverse.asDiagonal() * v.transpose() * terms;
    Matrix covariance =
        influence * influence.transpose() * (static_cast<double>(groups) / static_cast<double>(groups - n));
    for (Eigen::Index i = 0; i < n; ++i) {
      covariance.row(i) *= at(i).width;
      covariance.col(i) *= at(i).width;
    }
    for (Eigen::Index i = 0; i < n; ++i)
      for (Eigen::Index k = 0; k < n; ++k)
        if (inverse(k) == 0 && std::abs(v(i, k)) > 1e-3)
          covariance(i, i) = std::numeric_limits<double>::infinity();
    return covariance;
  }

  std::vector<FitNumber> numbers_;
  Eigen::Index components_;
  std::vector<Eigen::Index> clusters_;
  const Errors& errors_;
  FitOptions options_;
  double scale_ = 1;          ///< c in the loss
  Eigen::Index samples_ = 0;  ///< how many are looked at now
  long evaluations_ = 0;
};

}  // namespace rbres::RBRES_ABI
