#include <doctest/doctest.h>

#include <numbers>
#include <rbres/rbres.hpp>
#include <unsupported/Eigen/AutoDiff>

using namespace rbres;

namespace {

Quat<double> about(const Vec3<double>& axis, double angle) {
  const Vec3<double> u = (1 / norm(axis)) * axis;
  return {std::sin(angle / 2) * u.x, std::sin(angle / 2) * u.y, std::sin(angle / 2) * u.z,
          std::cos(angle / 2)};
}
double distance(const Vec3<double>& a, const Vec3<double>& b) { return norm(a - b); }

}  // namespace

TEST_CASE("a quaternion turns vectors as Eigen's does: identity, nearly none, nearly half a turn") {
  const Vec3<double> axis{1, -2, 3}, v{0.3, 0.5, -0.7};
  for (const double angle : {0.0, 1e-12, 1e-6, 1.0, std::numbers::pi - 1e-9, std::numbers::pi}) {
    CAPTURE(angle);
    const Quat<double> q = about(axis, angle);
    const Eigen::Vector3d expected = Eigen::Quaterniond(q) * Eigen::Vector3d(v);
    CHECK(distance(rotate(q, v), expected) < 1e-15);
    CHECK(distance(rotation_matrix(q) * v, expected) < 1e-15);
    CHECK(distance(rotate_back(q, rotate(q, v)), v) < 1e-15);
    CHECK(distance(rotation_matrix(q).transposed_times(v), rotate(q.conjugate(), v)) < 1e-15);
    const Quat<double> half = about(axis, angle / 2);
    CHECK(squared_norm(half * half) == doctest::Approx(1).epsilon(1e-15));
    CHECK(distance(rotate(half * half, v), expected) < 2e-15);
  }
}

TEST_CASE("memory holds x, y, z, w, as Eigen's") {
  const Quat<double> q{1, 2, 3, 4};
  const Eigen::Quaterniond e = q;
  CHECK(e.w() == 4);
  CHECK(std::memcmp(&q, e.coeffs().data(), sizeof q) == 0);
}

TEST_CASE("q' = 1/2 q (x) [0, w], w in the body frame") {
  const Quat<double> q = about({1, 2, 3}, 0.7);
  const Vec3<double> w{0.3, -0.4, 1.2};
  const double h = 1e-6;
  const Quat<double> later = q * about(w, norm(w) * h), before = q * about(w, -norm(w) * h);
  const Quat<double> rate = quaternion_rate(q, w);
  CHECK(rate.x == doctest::Approx((later.x - before.x) / (2 * h)).epsilon(1e-9));
  CHECK(rate.y == doctest::Approx((later.y - before.y) / (2 * h)).epsilon(1e-9));
  CHECK(rate.z == doctest::Approx((later.z - before.z) / (2 * h)).epsilon(1e-9));
  CHECK(rate.w == doctest::Approx((later.w - before.w) / (2 * h)).epsilon(1e-9));
}

TEST_CASE("R diag(d) R^T") {
  const Mat3<double> r = rotation_matrix(about({3, 1, 2}, 1.1));
  const Vec3<double> d{1, 2, 5}, v{0.2, -0.4, 0.9};
  CHECK(distance(rotated_diagonal(r, d) * v, r * scale(d, r.transposed_times(v))) < 1e-15);
}

TEST_CASE_TEMPLATE("the length of nothing is 0, and has a derivative", S, float, double, Pack<float, 4>,
                   Pack<double, 2>, Eigen::AutoDiffScalar<Eigen::Vector3d>) {
  using Lanes = ScalarTraits<S>;
  Vec3<S> v;
  if constexpr (requires { v.x.derivatives(); })
    for (auto [number, i] : {std::pair{&v.x, 0}, {&v.y, 1}, {&v.z, 2}}) *number = S(0, 3, i);
  const S none = norm(v);
  CHECK(Lanes::lane(none, Lanes::lanes - 1) == 0);
  if constexpr (requires { none.derivatives(); }) CHECK(none.derivatives().allFinite());
  v.x = S(3), v.z = S(-4);
  const S five = norm(v);
  CHECK(Lanes::lane(five, 0) == 5);
  // In one lane alone, and as short as squares allow.
  if constexpr (Packed<S>) {
    S x = five;
    Lanes::set_lane(x, 1, 0);
    const S some = norm(Vec3<S>{x, S(0), S(0)});
    CHECK(Lanes::lane(some, 0) == 5);
    CHECK(Lanes::lane(some, 1) == 0);
  }
  v = {S(1e-15f), S(0), S(0)};
  const S tiny = norm(v);
  CHECK(Lanes::lane(tiny, 0) > 0);
}
