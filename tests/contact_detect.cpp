#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

using namespace rbres;

namespace {

Pose<double> pose(const Vec3<double>& at, const Quat<double>& q = {}) { return {at, rotation_matrix(q)}; }
Quat<double> random_turn(Random& r) {
  return normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
}

/// A shape is a core (a sphere's centre, a capsule's axis, a box's solid) with a radius around it. The core's
/// point nearest to `x`, and its extreme points.
Vec3<double> nearest(const Sphere<double>&, const Pose<double>& p, const Vec3<double>&) { return p.position; }
Vec3<double> nearest(const Capsule<double>& c, const Pose<double>& p, const Vec3<double>& x) {
  return p.position + clamp(dot(p.axes.z, x - p.position), -c.half_length, c.half_length) * p.axes.z;
}
Vec3<double> nearest(const Box<double>& b, const Pose<double>& p, const Vec3<double>& x) {
  const Vec3<double> local = p.axes.transposed_times(x - p.position);
  return p.position + p.axes * Vec3<double>{clamp(local.x, -b.half.x, b.half.x),
                                            clamp(local.y, -b.half.y, b.half.y),
                                            clamp(local.z, -b.half.z, b.half.z)};
}
std::vector<Vec3<double>> corners(const Sphere<double>&, const Pose<double>& p) { return {p.position}; }
std::vector<Vec3<double>> corners(const Capsule<double>& c, const Pose<double>& p) {
  return {p.position - c.half_length * p.axes.z, p.position + c.half_length * p.axes.z};
}
std::vector<Vec3<double>> corners(const Box<double>& b, const Pose<double>& p) {
  std::vector<Vec3<double>> points;
  for (const int i : {-1, 1}) {
    for (const int j : {-1, 1}) {
      for (const int k : {-1, 1})
        points.push_back(p.position + p.axes * Vec3<double>{i * b.half.x, j * b.half.y, k * b.half.z});
    }
  }
  return points;
}
double radius(const Sphere<double>& s) { return s.radius; }
double radius(const Capsule<double>& c) { return c.radius; }
double radius(const Box<double>&) { return 0; }

template <int P, bool C>
double smallest(const Manifold<double, P, C>& m) {
  return *std::min_element(m.gap.begin(), m.gap.end());
}

/// What holds for any two shapes apart: the same answer in either order, a unit normal from the first to the
/// second, the gap between the true distance and what a separating direction proves. Of the cores' distance
/// the separation is at least the share `proven`: 1 where normals are free, less where they are those of
/// faces and of pairs of edges.
template <class A, class B>
void check_pair(const A& a, const B& b, double proven) {
  const double round = radius(a) + radius(b);
  // Two boxes' faces are preferred to their edges by 1e-4 of the smallest half extent, here 0.1 m.
  const double preferred = std::is_same_v<A, Box<double>> && std::is_same_v<B, A> ? 1e-5 : 1e-9;
  Random r(11);
  for (int trial = 0; trial < 1000; ++trial) {
    CAPTURE(trial);
    const Vec3<double> away{r.normal(), r.normal(), r.normal()};
    const double apart = (a.bounding_radius() + b.bounding_radius()) * r.uniform(0.9, 1.4);
    const auto pa = pose({0.1, -0.2, 0.3}, random_turn(r));
    const auto pb = pose(pa.position + (apart / norm(away)) * away, random_turn(r));
    // To and fro between the cores, each time to the nearest point: to the distance, from above.
    Vec3<double> x = pa.position, y = pb.position;
    for (int k = 0; k < 300; ++k) {
      y = nearest(b, pb, x);
      x = nearest(a, pa, y);
    }
    const double distance = norm(x - y) - round;
    if (distance <= 0.02) continue;
    const auto ab = detect(a, pa, b, pb), ba = detect(b, pb, a, pa);
    CHECK(squared_norm(ab.normal) == doctest::Approx(1).epsilon(1e-12));
    CHECK(dot(ab.normal, pb.position - pa.position) > 0);
    CHECK(ab.separation == doctest::Approx(ba.separation).epsilon(1e-9));
    CHECK(squared_norm(ab.normal + ba.normal) < 1e-12);
    CHECK(ab.separation > 0);
    CHECK(ab.separation <= distance + 1e-12);
    CHECK(ab.separation >= proven * (distance + round) - round - 1e-9);
    // The normal really keeps the two apart by that much.
    double first = -1e30, second = 1e30;
    for (const auto& corner : corners(a, pa)) first = std::max(first, dot(ab.normal, corner) + radius(a));
    for (const auto& corner : corners(b, pb)) second = std::min(second, dot(ab.normal, corner) - radius(b));
    CHECK(second - first >= ab.separation - preferred);
    CHECK(smallest(ab) >= ab.separation - 1e-9);
  }
}

}  // namespace

TEST_CASE("every pair: symmetry, a unit normal, a gap that the normal proves") {
  const Sphere<double> sphere{0.3};
  const Box<double> box{0.2, 0.3, 0.1};
  const Capsule<double> capsule{0.1, 0.4};
  check_pair(sphere, Sphere<double>{0.1}, 1);
  check_pair(sphere, box, 1);
  check_pair(sphere, capsule, 1);
  check_pair(box, Box<double>{0.1, 0.1, 0.4}, 0.6);
  check_pair(box, capsule, 0.6);
  check_pair(capsule, Capsule<double>{0.2, 0.1}, 1);
}

TEST_CASE("balls and capsules: the gap is the distance") {
  const auto m = detect(Sphere<double>{0.3}, pose({0, 0, 0}), Sphere<double>{0.2}, pose({0.6, 0.8, 0}));
  CHECK(m.separation == doctest::Approx(0.5).epsilon(1e-15));
  CHECK(m.normal.x == doctest::Approx(0.6).epsilon(1e-15));
  CHECK(m.point[0].y == doctest::Approx(0.8 * 0.55).epsilon(1e-15));
  // Crossed capsules: axes along z and x, 0.5 apart.
  const Quat<double> turned{0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  const auto c = detect(Capsule<double>{0.1, 1.0}, pose({0, 0, 0}), Capsule<double>{0.2, 1.0},
                        pose({0, 0.5, 0.3}, turned));
  CHECK(c.separation == doctest::Approx(0.2).epsilon(1e-12));
  CHECK(c.point[0].z == doctest::Approx(0.3).epsilon(1e-12));
  CHECK(c.gap[1] > 1);
  // Overlapping balls.
  CHECK(detect(Sphere<double>{1.0}, pose({0, 0, 0}), Sphere<double>{1.0}, pose({1, 0, 0})).separation == -1);
}

TEST_CASE("a box lies flat on a plane with four points") {
  const Plane<double> floor{};
  const auto m = detect(floor, Box<double>{0.2, 0.3, 0.1}, pose({1, 2, 0.1}));
  CHECK(std::count_if(m.gap.begin(), m.gap.end(), [](double g) { return std::abs(g) < 1e-15; }) == 4);
  CHECK(std::count_if(m.gap.begin(), m.gap.end(), [](double g) { return std::abs(g - 0.2) < 1e-15; }) == 4);
  CHECK(std::abs(m.separation) < 1e-15);
}

TEST_CASE("a box lies flat on a box, turned or not") {
  for (const double angle : {0.0, 0.3, std::numbers::pi / 4}) {
    CAPTURE(angle);
    const Quat<double> q{0, 0, std::sin(angle / 2), std::cos(angle / 2)};
    const Box<double> box{0.1, 0.1, 0.1};
    const auto m = detect(box, pose({0, 0, 0.1}), box, pose({0.02, 0, 0.3}, q));
    CHECK(std::abs(m.separation) < 1e-15);
    CHECK(m.normal.z == doctest::Approx(1).epsilon(1e-15));
    double low_x = 1, high_x = -1, low_y = 1, high_y = -1;
    int points = 0;
    for (std::size_t i = 0; i < 12; ++i) {
      if (m.gap[i] > 1) continue;
      ++points;
      CHECK(std::abs(m.gap[i]) < 1e-15);
      CHECK(m.point[i].z == doctest::Approx(0.2).epsilon(1e-14));
      low_x = std::min(low_x, m.point[i].x), high_x = std::max(high_x, m.point[i].x);
      low_y = std::min(low_y, m.point[i].y), high_y = std::max(high_y, m.point[i].y);
    }
    CHECK(points >= 4);
    // The points span the overlap of the two faces.
    if (angle == 0) {
      CHECK(low_x == doctest::Approx(-0.08));
      CHECK(high_x == doctest::Approx(0.1));
    }
    CHECK(high_y - low_y == doctest::Approx(0.2).epsilon(0.01));
  }
}

TEST_CASE("points that are not there stand near the boxes: far away they would spoil other lanes' points") {
  const Box<double> box{0.1, 0.08, 0.05};
  Random r(12);
  for (int trial = 0; trial < 2000; ++trial) {  // both on one table, turned about its normal
    const auto standing = [&](double x) {
      const double angle = r.uniform(-0.3, 0.3), tilt = trial % 2 ? 1e-17 * r.normal() : 0;
      return pose({x, r.uniform(-0.05, 0.05), 0.05}, {tilt, -tilt, std::sin(angle / 2), std::cos(angle / 2)});
    };
    const auto a = standing(0), b = standing(r.uniform(0.2, 0.4));
    for (const Vec3<double>& point : detect(box, a, box, b).point) CHECK(norm(point - a.position) < 2);
  }
}

TEST_CASE("a capsule lies on a plane and on a box with both ends") {
  const Quat<double> lying{0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  const Capsule<double> capsule{0.1, 0.3};
  const auto on_plane = detect(Plane<double>{}, capsule, pose({0, 0, 0.1}, lying));
  CHECK(std::abs(on_plane.gap[0]) < 1e-15);
  CHECK(std::abs(on_plane.gap[1]) < 1e-15);
  const auto on_box = detect(Box<double>{0.5, 0.5, 0.1}, pose({0, 0, 0}), capsule, pose({0, 0, 0.2}, lying));
  CHECK(on_box.normal.z == doctest::Approx(1));
  for (std::size_t i = 0; i < 3; ++i) CHECK(std::abs(on_box.gap[i]) < 1e-15);
}

TEST_CASE("a capsule that lies across a face or an edge touches where it leaves them, however it is turned") {
  const Capsule<double> capsule{0.1, 0.5};
  const Box<double> box{0.2, 0.3, 0.15};
  const Quat<double> along_x{0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  const auto touches = [&](const Vec3<double>& above, double first, double last) {
    for (const double yaw : {0.0, 0.3, -2.0}) {
      CAPTURE(yaw);
      const Quat<double> turn = quaternion_exp(Vec3<double>{0.1, yaw, 0.2});
      const auto pb = pose({0.3, -0.2, 0.1}, turn);
      const auto m = detect(capsule, pose(pb.position + pb.axes * above, turn * along_x), box, pb);
      std::array<double, 3> at{};
      for (std::size_t i = 0; i < 3; ++i) {
        CHECK(std::abs(m.gap[i]) < 1e-12);
        at[i] = dot(pb.axes.x, m.point[i] - pb.position);
      }
      std::sort(at.begin(), at.end());
      CHECK(at[0] == doctest::Approx(first));
      CHECK(at[2] == doctest::Approx(last));
    }
  };
  touches({0, 0, 0.25}, -0.2, 0.2);                  // a face, both ends beyond it
  touches({0.4, 0.1, 0.25}, -0.1, 0.2);              // one end
  touches({0, 0.3 + 0.06, 0.15 + 0.08}, -0.2, 0.2);  // an edge
  touches({-0.45, -0.3 - 0.08, -0.15 - 0.06}, -0.2, 0.05);
  // On the border of a face, whatever rounding makes of it.
  for (const double beyond : {0.0, 1e-16, -1e-12, 1e-12, -1e-9, 1e-9, 1e-7, 5e-7}) {
    for (const double yaw : {0.0, 1e-12, -1e-9, 1e-9}) {
      CAPTURE(beyond);
      CAPTURE(yaw);
      const auto m = detect(
          capsule, pose({0, 0.3 * (1 + beyond), 0.25}, quaternion_exp(Vec3<double>{0, 0, yaw}) * along_x),
          box, pose({0, 0, 0}));
      double low = 0, high = 0;
      for (std::size_t i = 0; i < 3; ++i) {
        CHECK(std::abs(m.gap[i]) < 1e-11);
        low = std::min(low, m.point[i].x);
        high = std::max(high, m.point[i].x);
      }
      CHECK(low == doctest::Approx(-0.2));
      CHECK(high == doctest::Approx(0.2));
    }
  }
}

TEST_CASE("a ball inside a box is pushed out of the nearest face") {
  const auto m =
      detect(Box<double>{0.5, 0.5, 0.5}, pose({0, 0, 0}), Sphere<double>{0.1}, pose({0.4, 0.1, 0}));
  CHECK(m.normal.x == 1);
  CHECK(m.separation == doctest::Approx(-0.2).epsilon(1e-15));
}

TEST_CASE("shapes chosen at run time meet as those chosen when compiling") {
  const Box<double> box{0.2, 0.3, 0.1};
  const Sphere<double> sphere{0.3};
  const auto pa = pose({0, 0, 0}), pb = pose({0.5, 0.2, 0.1});
  CHECK(detect(AnyShape<double>(box), pa, AnyShape<double>(sphere), pb).separation ==
        detect(box, pa, sphere, pb).separation);
}

TEST_CASE("nearly parallel capsules meet alike in either order") {
  Random r(31, 0);
  const Capsule<double> a{0.1, 0.5}, b{0.15, 0.4};
  for (int i = 0; i < 100; ++i) {
    const double tilt = 5e-3 * r.normal();  // of capsules that count as parallel, up to 1e-2
    const auto pa = pose({0, 0, 0}), pb = pose({0.25, 0.1 * r.normal(), 0.1 * r.normal()},
                                               quaternion_exp(Vec3<double>{tilt, 5e-3 * r.normal(), 0}));
    const auto m = detect(a, pa, b, pb), swapped = detect(b, pb, a, pa);
    CHECK(norm(m.normal + swapped.normal) < 1e-14);
    CHECK(std::abs(m.separation - swapped.separation) < 1e-14);
  }
}

TEST_CASE("nothing jumps where capsules begin to lie on one another with two points") {
  const Capsule<double> a{0.1, 0.5}, b{0.15, 0.4};
  const auto meet = [&](double tilt, double along) {
    return detect(a, pose({0, 0, 0}), b, pose({0.25, 0, along}, quaternion_exp(Vec3<double>{tilt, 0, 0})));
  };
  const auto check_no_jump = [](const auto& at, double two, double one) {
    while (std::abs(two - one) > 1e-12) {
      const double middle = 0.5 * (two + one);
      (at(middle).gap[1] < 1 ? two : one) = middle;
    }
    CHECK(at(two).gap[1] < 1);
    CHECK(at(one).gap[1] > 1);
    CHECK(std::abs(at(two).separation - at(one).separation) < 1e-11);
    CHECK(norm(at(two).normal - at(one).normal) < 1e-8);
  };
  check_no_jump([&](double tilt) { return meet(tilt, 0.3); }, 0, 0.2);
  check_no_jump([&](double along) { return meet(5e-3, along); }, 0.3, 1);
}
