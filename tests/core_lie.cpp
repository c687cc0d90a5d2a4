#include <doctest/doctest.h>

#include <numbers>
#include <rbres/core/lie.hpp>
#include <rbres/core/pack.hpp>
#include <unsupported/Eigen/AutoDiff>
#include <vector>

using namespace rbres;

namespace {

constexpr double pi = std::numbers::pi;

template <class S>
double distance(const Vec3<S>& a, const Vec3<S>& b) {
  return std::sqrt(static_cast<double>(squared_norm(a - b)));
}
template <class S>
double distance(const Mat3<S>& a, const Mat3<S>& b) {
  return distance(a.x, b.x) + distance(a.y, b.y) + distance(a.z, b.z);
}
template <class S>
double distance(const Quat<S>& a, const Quat<S>& b) {
  return std::sqrt(static_cast<double>(squared_norm(Quat<S>{a.x - b.x, a.y - b.y, a.z - b.z, a.w - b.w})));
}
template <class S>
Mat3<S> product(const Mat3<S>& a, const Mat3<S>& b) {
  return {a * b.x, a * b.y, a * b.z};
}
template <class S>
const Mat3<S> identity{{S(1), S(0), S(0)}, {S(0), S(1), S(0)}, {S(0), S(0), S(1)}};

/// Rotation vectors of all lengths around some axes: zero, near zero, near pi, near a full turn.
template <class S>
std::vector<Vec3<S>> tangents(double longest) {
  std::vector<Vec3<S>> all{{}};
  for (const Eigen::Vector3d& axis :
       {Eigen::Vector3d{1, 0, 0}, {0, -1, 0}, {0, 0, 1}, {1, -2, 3}, {-0.3, 0.1, 0.02}})
    for (const double angle : {1e-30, 1e-12, 1e-8, 1e-4, 1e-2, 0.2, 0.3, 0.99, 1.01, 1.9, 2.1, 3.0, pi - 1e-4,
                               pi - 1e-7, pi, pi + 1e-4, 4.0, 6.0, 2 * pi - 1e-2})
      if (angle <= longest) all.emplace_back((axis.normalized() * angle).template cast<S>());
  return all;
}

/// phi with derivatives by its three numbers.
using Dual = Eigen::AutoDiffScalar<Eigen::Vector3d>;
Vec3<Dual> with_derivatives(const Vec3<double>& phi) {
  return {Dual(phi.x, 3, 0), Dual(phi.y, 3, 1), Dual(phi.z, 3, 2)};
}
Mat3<double> jacobian(const Vec3<Dual>& v) {
  const auto column = [&](int i) {
    return Vec3<double>{v.x.derivatives()[i], v.y.derivatives()[i], v.z.derivatives()[i]};
  };
  return {column(0), column(1), column(2)};
}

}  // namespace

TEST_CASE_TEMPLATE("exp and log are each other's inverse, on quaternions and on matrices", S, float, double) {
  const double tolerance = 16 * static_cast<double>(std::numeric_limits<S>::epsilon());
  for (const Vec3<S>& phi : tangents<S>(7)) {
    CAPTURE(phi.x);
    CAPTURE(phi.y);
    CAPTURE(phi.z);
    const double angle = Eigen::Matrix<S, 3, 1>(phi).template cast<double>().norm();
    const Quat<S> q = quaternion_exp(phi);
    const Mat3<S> r = rotation_exp(phi);
    CHECK(static_cast<double>(squared_norm(q)) == doctest::Approx(1).epsilon(tolerance));
    CHECK(distance(rotation_matrix(q), r) < tolerance);
    CHECK(distance(product(r, rotation_exp(-phi)), identity<S>) < tolerance);
    CHECK(distance(rotation_exp(quaternion_log(q)), r) < tolerance);
    CHECK(distance(rotation_exp(rotation_log(r)), r) < tolerance);
    const Quat<S> other = quaternion_exp(quaternion_log(q));
    CHECK(std::min(distance(other, q), distance(other, Quat<S>{-q.x, -q.y, -q.z, -q.w})) < tolerance);
    if (angle > pi - 1e-6) continue;
    // Relative, however small: a matrix keeps only what its ones leave.
    CHECK(distance(quaternion_log(q), phi) <= tolerance * angle);
    CHECK(distance(quaternion_log(Quat<S>{-3 * q.x, -3 * q.y, -3 * q.z, -3 * q.w}), phi) <=
          tolerance * angle);
    CHECK(distance(rotation_log(r), phi) < 2 * tolerance);
  }
}

TEST_CASE("exp is the rotation about the axis by the angle") {
  for (const Vec3<double>& phi : tangents<double>(7)) {
    const Eigen::Vector3d v(phi);
    const Eigen::AngleAxisd turn(v.norm(), v.stableNormalized());
    CHECK((Eigen::Quaterniond(quaternion_exp(phi)).coeffs() - Eigen::Quaterniond(turn).coeffs()).norm() <
          1e-15);
    const Vec3<double> x{0.3, -0.7, 1.1};
    CHECK(distance(rotation_exp(phi) * x, Vec3<double>(Eigen::Vector3d(turn * Eigen::Vector3d(x)))) < 2e-15);
  }
}

TEST_CASE("a rotation of pi has its axis, whose sign is free") {
  for (const Vec3<double>& axis :
       {Vec3<double>{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.6, 0, 0.8}, {0, 0.8, -0.6}}) {
    const Vec3<double> log = quaternion_log(Quat<double>{axis.x, axis.y, axis.z, 0});
    CHECK(std::min(distance(log, pi * axis), distance(log, -pi * axis)) < 1e-15);
    const Vec3<double> of_matrix = rotation_log(rotation_exp(pi * axis));
    CHECK(std::min(distance(of_matrix, pi * axis), distance(of_matrix, -pi * axis)) < 1e-15);
  }
}

TEST_CASE_TEMPLATE("the right Jacobian's inverse is its inverse", S, float, double) {
  for (const Vec3<S>& phi : tangents<S>(6.1)) {
    CAPTURE(squared_norm(phi));
    const double tolerance = 64 * static_cast<double>(std::numeric_limits<S>::epsilon());
    CHECK(distance(product(right_jacobian(phi), right_jacobian_inverse(phi)), identity<S>) < tolerance);
  }
}

TEST_CASE("the Jacobians are the maps' derivatives, which dual numbers give at zero and at pi, too") {
  for (const Vec3<double>& phi : tangents<double>(7)) {
    CAPTURE(phi.x);
    CAPTURE(phi.y);
    CAPTURE(phi.z);
    const Quat<Dual> q = quaternion_exp(with_derivatives(phi));
    // exp(phi)^-1 exp(phi + d), whose rotation vector is J_r d.
    const auto back = quaternion_exp(phi).conjugate();
    const Quat<Dual> local{Dual(back.x), Dual(back.y), Dual(back.z), Dual(back.w)};
    const Mat3<double> found = jacobian(quaternion_log(local * q));
    CHECK(distance(found, right_jacobian(phi)) < 2e-15);
    const double angle = Eigen::Vector3d(phi).norm();
    if (angle > pi - 1e-7) continue;
    // log(exp(phi) exp(d)) = phi + J_r^-1 d
    const Quat<double> start = quaternion_exp(phi);
    const Quat<Dual> from{Dual(start.x), Dual(start.y), Dual(start.z), Dual(start.w)};
    const Vec3<Dual> moved = quaternion_log(from * quaternion_exp(with_derivatives({})));
    CHECK(distance(jacobian(moved), right_jacobian_inverse(phi)) < 4e-15);
    CHECK(distance(jacobian(rotation_log(rotation_exp(with_derivatives(phi)))), identity<double>) < 4e-15);
  }
}

TEST_CASE_TEMPLATE("lanes are what single numbers are", S, float, double) {
  using P = Pack<S, 4>;
  const auto all = tangents<S>(6.1);
  const double tolerance = 16 * static_cast<double>(std::numeric_limits<S>::epsilon());
  for (std::size_t first = 0; first + 4 <= all.size(); ++first) {
    Vec3<P> phi;
    for (int i = 0; i < 4; ++i) {
      const Vec3<S>& one = all[first + static_cast<std::size_t>(i)];
      phi.x.v[i] = one.x, phi.y.v[i] = one.y, phi.z.v[i] = one.z;
    }
    const auto lane = [](const Vec3<P>& v, int i) { return Vec3<S>{v.x[i], v.y[i], v.z[i]}; };
    const Quat<P> q = quaternion_exp(phi);
    const Vec3<P> log = quaternion_log(q), of_matrix = rotation_log(rotation_exp(phi));
    const Mat3<P> jacobian = right_jacobian(phi), inverse = right_jacobian_inverse(phi);
    for (int i = 0; i < 4; ++i) {
      const Vec3<S>& one = all[first + static_cast<std::size_t>(i)];
      if (std::abs(std::sqrt(static_cast<double>(squared_norm(one))) - pi) < 1e-6) continue;  // sign is free
      CHECK(distance(Quat<S>{q.x[i], q.y[i], q.z[i], q.w[i]}, quaternion_exp(one)) < tolerance);
      CHECK(distance(lane(log, i), quaternion_log(quaternion_exp(one))) < tolerance);
      CHECK(distance(lane(of_matrix, i), rotation_log(rotation_exp(one))) < tolerance);
      CHECK(distance(lane(jacobian.y, i), right_jacobian(one).y) < tolerance);
      CHECK(distance(lane(inverse.z, i), right_jacobian_inverse(one).z) < 4 * tolerance);
    }
  }
}
