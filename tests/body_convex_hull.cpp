#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

#include "error_of.hpp"

using namespace rbres;

namespace {

using Vector = Vec3<double>;
using Points = std::vector<Vector>;
using Hull = ConvexHull<double>;

Quat<double> random_turn(Random& r) {
  return normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
}
Points corners(double hx, double hy, double hz) {
  Points points;
  for (int i = 0; i < 8; ++i) points.push_back({i & 1 ? hx : -hx, i & 2 ? hy : -hy, i & 4 ? hz : -hz});
  return points;
}
Points moved(const Points& points, const Quat<double>& turn, const Vector& shift) {
  Points all;
  for (const Vector& p : points) all.push_back(shift + rotate(turn, p));
  return all;
}
/// The unit inertia as a tensor along the points' axes.
Eigen::Matrix3d tensor(const Hull& hull) {
  const auto unit = hull.unit_inertia();
  const Eigen::Matrix3d axes = Eigen::Quaterniond(unit.axes).toRotationMatrix();
  return axes * Eigen::Vector3d(unit.moments).asDiagonal() * axes.transpose();
}
void check_near(const Vector& a, const Vector& b, double within) { CHECK(norm(a - b) <= within); }

/// What holds for every hull of these points.
void check_hull(const Hull& hull, const Points& points) {
  const auto faces = std::ssize(hull.faces()), vertices = std::ssize(hull.vertices()),
             edges = std::ssize(hull.edges());
  CHECK(vertices - edges + faces == 2);
  const double slack = 2e-6 * hull.bounding_radius();
  for (const auto& face : hull.faces()) {
    CHECK(norm(face.normal) == doctest::Approx(1).epsilon(1e-14));
    for (const Vector& p : points) CHECK(dot(face.normal, p - hull.centre_of_mass()) <= face.offset + slack);
    const auto loop = hull.corners(face);
    for (std::size_t k = 0; k < loop.size(); ++k) {  // in the plane, and counter-clockwise from outside
      const auto corner = [&](std::size_t i) {
        return hull.vertices()[static_cast<std::size_t>(loop[i % loop.size()])];
      };
      CHECK(std::abs(dot(face.normal, corner(k)) - face.offset) <= slack);
      CHECK(dot(cross(corner(k + 1) - corner(k), corner(k + 2) - corner(k + 1)), face.normal) > 0);
    }
  }
  for (const Vector& v : hull.vertices()) {  // each is one of the points
    const auto same = [&](const Vector& p) {
      return norm(p - hull.centre_of_mass() - v) < 1e-12 * hull.bounding_radius();
    };
    CHECK(std::any_of(points.begin(), points.end(), same));
  }
  for (const HullEdge& edge : hull.edges()) {
    CHECK(edge.left != edge.right);
    for (const int f : {edge.left, edge.right}) {
      const auto loop = hull.corners(hull.faces()[static_cast<std::size_t>(f)]);
      const auto tail = std::find(loop.begin(), loop.end(), edge.tail),
                 head = std::find(loop.begin(), loop.end(), edge.head);
      REQUIRE(tail != loop.end());
      REQUIRE(head != loop.end());
      const auto count = std::ssize(loop), step = (head - tail + count) % count;
      CHECK(step == (f == edge.left ? 1 : count - 1));
    }
  }
}

}  // namespace

TEST_CASE("the hull of a box's corners has its faces, its mass and its inertia") {
  Points points = corners(0.3, 0.2, 0.1);
  for (const Vector& inside :
       {Vector{}, Vector{0.3, 0, 0}, Vector{0.3, 0.2, 0.05}, Vector{0.3, 0.2, 0.1}, Vector{0.1, 0.1, 0.1}})
    points.push_back(inside);  // in the solid, on a face, on an edge, a corner again
  const Hull hull(points);
  const Box<double> box{0.3, 0.2, 0.1};
  CHECK(hull.vertices().size() == 8);
  CHECK(hull.faces().size() == 6);
  CHECK(hull.edges().size() == 12);
  check_hull(hull, points);
  CHECK(hull.volume() == doctest::Approx(box.volume()).epsilon(1e-14));
  check_near(hull.centre_of_mass(), {}, 1e-16);
  check_near(hull.unit_inertia().moments, box.unit_inertia(), 1e-16);
  CHECK(hull.unit_inertia().axes == Quat<double>{});
  CHECK(hull.bounding_radius() == doctest::Approx(box.bounding_radius()).epsilon(1e-15));
  CHECK(hull.inner_radius() == doctest::Approx(0.1).epsilon(1e-15));
  Random r(3);
  for (int i = 0; i < 20; ++i) {
    const Vector v{r.normal(), r.normal(), r.normal()};
    CHECK(hull.frontal(v, 0.7) == doctest::Approx(box.frontal(v, 0.7)).epsilon(1e-13));
  }
}

TEST_CASE("a tetrahedron has the moments of the closed form") {
  // Off the origin, with its right angle at (1, 2, 3) and legs a, b, c: M = abc / 6, centre at a quarter of
  // each leg; about that I_xx = M (b^2 + c^2) 3 / 80 and I_xy = M a b / 80.
  const double a = 0.5, b = 0.3, c = 0.8;
  const Hull hull({{1, 2, 3}, {1 + a, 2, 3}, {1, 2 + b, 3}, {1, 2, 3 + c}});
  CHECK(hull.faces().size() == 4);
  CHECK(hull.volume() == doctest::Approx(a * b * c / 6).epsilon(1e-13));
  check_near(hull.centre_of_mass(), {1 + a / 4, 2 + b / 4, 3 + c / 4}, 1e-15);
  Eigen::Matrix3d expected;
  expected << 3 * (b * b + c * c), a * b, a * c, a * b, 3 * (a * a + c * c), b * c, a * c, b * c,
      3 * (a * a + b * b);
  CHECK((tensor(hull) - expected / 80).norm() < 1e-15);
}

TEST_CASE("cylinders and cones of many sides come near the round ones") {
  const double r = 0.2, h = 0.15;
  double last = std::numeric_limits<double>::infinity();
  for (const int sides : {4, 8, 16}) {
    CAPTURE(sides);
    const Hull prism = Hull::cylinder(r, h, sides);
    const double polygon = 0.5 * sides * std::sin(2 * std::numbers::pi / sides) * r * r;
    CHECK(prism.volume() == doctest::Approx(polygon * 2 * h).epsilon(1e-13));
    CHECK(std::ssize(prism.vertices()) == 2 * sides);
    CHECK(std::ssize(prism.faces()) == sides + 2);
    CHECK(prism.unit_inertia().axes == Quat<double>{});
    const double off = 1 - prism.unit_inertia().moments.z / (0.5 * r * r);
    CHECK(off < 0.3 * last);  // of second order
    CHECK(off > 0);
    last = off;
    const Hull cone = Hull::cone(r, 2 * h, sides);
    CHECK(cone.volume() == doctest::Approx(polygon * 2 * h / 3).epsilon(1e-13));
    check_near(cone.centre_of_mass(), {0, 0, h / 2}, 1e-15);
    CHECK(std::ssize(cone.faces()) == sides + 1);
  }
  const Hull cone = Hull::cone(r, 2 * h, 31);
  CHECK(cone.unit_inertia().moments.z == doctest::Approx(0.3 * r * r).epsilon(0.015));
  CHECK(cone.unit_inertia().moments.x == doctest::Approx(0.15 * r * r + 0.0375 * 4 * h * h).epsilon(0.015));
}

TEST_CASE("hulls of random points: every point inside, and mass that random points inside confirm") {
  for (int trial = 0; trial < 200; ++trial) {
    CAPTURE(trial);
    Random r(8, std::uint64_t(trial));
    Points points;
    const bool lattice = trial % 2;  // with many points in a plane and on a line
    for (int i = 0; i < (lattice ? 60 : 12); ++i) {
      points.push_back(lattice ? Vector{double(r.below(3)), double(r.below(3)), double(r.below(3))}
                               : Vector{r.normal(), r.normal(), r.normal()});
    }
    points = moved(points, random_turn(r), {10 * r.normal(), 0, 0});
    const Hull hull(points);
    check_hull(hull, points);
    if (trial >= 10) continue;
    // A box around it, filled with points.
    const double side = hull.bounding_radius();
    constexpr int tries = 200000;
    long inside = 0;
    Vector sum;
    Eigen::Matrix3d second = Eigen::Matrix3d::Zero();
    for (int i = 0; i < tries; ++i) {
      const Vector p{r.uniform(-side, side), r.uniform(-side, side), r.uniform(-side, side)};
      const auto in = [&](const auto& face) { return dot(face.normal, p) <= face.offset; };
      if (!std::all_of(hull.faces().begin(), hull.faces().end(), in)) continue;
      ++inside;
      sum += p;
      second += Eigen::Vector3d(p) * Eigen::Vector3d(p).transpose();
    }
    const double share = double(inside) / tries;
    CHECK(8 * side * side * side * share == doctest::Approx(hull.volume()).epsilon(0.05));
    check_near((1.0 / double(inside)) * sum, {}, 0.02 * side);
    second /= double(inside);
    const Eigen::Matrix3d expected = second.trace() * Eigen::Matrix3d::Identity() - second;
    CHECK((tensor(hull) - expected).norm() < 0.05 * expected.norm());
  }
}

TEST_CASE("points that are off a plane by a rounding error or a digit make one face") {
  for (int trial = 0; trial < 400; ++trial) {
    CAPTURE(trial);
    Random r(9, std::uint64_t(trial));
    Points points = trial % 2 ? corners(1, 1, 1) : Points{};
    for (int i = 0; i < 200; ++i) {  // on faces, and a third of them on edges
      Vector p{r.below(2) ? 1.0 : -1.0, r.uniform(-1, 1), r.uniform(-1, 1)};
      if (r.below(2)) p = {p.y, p.x, p.z};
      if (r.below(3) == 0) p.z = r.below(2) ? 1 : -1;
      points.push_back(p);
    }
    const double noise = std::pow(10.0, trial % 4 < 2 ? r.uniform(-17, -7) : r.uniform(-9.5, -8.5));
    for (Vector& p : points) p += noise * Vector{r.normal(), r.normal(), r.normal()};
    points = moved(points, random_turn(r), {5, 5, 5});
    if (trial % 2) {
      const Hull hull(points);
      CHECK(hull.faces().size() == 6);
      CHECK(hull.vertices().size() == 8);
    } else {  // no corners: more vertices, maybe too many, but always a closed surface
      const auto refusal = error_of([&] { check_hull(Hull(points), points); });
      CHECK((refusal.empty() || refusal.starts_with("vertices of a convex hull")));
    }
  }
}

TEST_CASE("a body says where the frame of the points stands in its own") {
  Random r(4);
  const Vector shift{0.4, -1, 2};
  const Quat<double> turn = random_turn(r);
  const Points points = moved(corners(0.3, 0.2, 0.1), turn, shift);
  const Body<double, Hull> body(Hull(points), 2.0);
  // In the body frame the vertices are symmetric: each coordinate is plus or minus a half extent.
  for (const Vector& p : points) {
    Vector at = absolute(body.shape_origin() + rotate(body.shape_rotation(), p));
    double sorted[3] = {at.x, at.y, at.z};
    std::sort(sorted, sorted + 3);
    CHECK(sorted[0] == doctest::Approx(0.1).epsilon(1e-13));
    CHECK(sorted[1] == doctest::Approx(0.2).epsilon(1e-13));
    CHECK(sorted[2] == doctest::Approx(0.3).epsilon(1e-13));
  }
  check_near(body.shape_origin() + rotate(body.shape_rotation(), body.shape().centre_of_mass()), {}, 1e-15);
  const auto dense = Body<double, Hull>::of_density(Hull(points), 100.0);
  CHECK(dense.mass() == doctest::Approx(100 * 0.048).epsilon(1e-13));
  CHECK(Body<double>(Box{0.3, 0.2, 0.1}, 1.0).shape_origin() == Vector{});
  // A kinematic body's axes are the points' own.
  const auto table = Body<double, Hull>::kinematic(Hull(points));
  CHECK(table.shape_rotation() == Quat<double>{});
  check_near(table.shape_origin(), -shift, 1e-15);
  // An inertia of one's own is about the centre of mass, along the points' axes.
  const Eigen::Matrix3d own = Eigen::Vector3d(0.3, 0.2, 0.25).asDiagonal();
  CHECK(Body<double, Hull>(Hull(points), 2.0, own).inertia().x == doctest::Approx(0.2));
}

TEST_CASE("hulls, scaled and in other scalars") {
  const Hull hull({{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}, {1, 2, 3}});
  const Hull large = hull.scaled(2.0);
  CHECK(large.volume() == doctest::Approx(8 * hull.volume()).epsilon(1e-15));
  CHECK(large.frontal({1, 2, 3}, 1.0) == doctest::Approx(4 * hull.frontal({1, 2, 3}, 1.0)).epsilon(1e-15));
  check_near(large.vertices()[3], 2.0 * hull.vertices()[3], 1e-15);
  check_near(large.centre_of_mass(), 2.0 * hull.centre_of_mass(), 1e-15);
  CHECK(large.faces()[1].offset == doctest::Approx(2 * hull.faces()[1].offset));
  check_near(large.unit_inertia().moments, 4.0 * hull.unit_inertia().moments, 1e-14);

  const Body<double, AnyConvexShape<double>> body(hull, 2.0);
  const auto single = body.cast<float>();
  static_assert(std::is_same_v<std::decay_t<decltype(single)>, Body<float, AnyConvexShape<float>>>);
  CHECK(single.inertia().x == doctest::Approx(body.inertia().x).epsilon(1e-6));
  CHECK(std::get<ConvexHull<float>>(single.shape()).vertices().size() == hull.vertices().size());
  CHECK(body.scaled(2.0, 3.0, 12.0, {}).bounding_radius() == doctest::Approx(2 * hull.bounding_radius()));
  const ConvexHull<float> box(
      {{-1, -1, -1}, {1, -1, -1}, {-1, 1, -1}, {1, 1, -1}, {-1, -1, 1}, {1, -1, 1}, {-1, 1, 1}, {1, 1, 1}});
  CHECK(box.faces().size() == 6);
}

TEST_CASE("points that span no solid are refused") {
  const auto refusal = [](const Points& points) { return error_of([&] { Hull hull(points); }); };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  CHECK(refusal({}) == "points of a convex hull: expected 4 or more, found 0");
  CHECK(refusal({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}) == "points of a convex hull: expected 4 or more, found 3");
  CHECK(refusal({{1, 1, 1}, {1, 1, 1}, {1, 1, 1}, {1, 1, 1}}) ==
        "points of a convex hull: expected points that span a volume, found one point");
  CHECK(refusal({{0, 0, 0}, {1, 1, 1}, {2, 2, 2}, {5, 5, 5}}) ==
        "points of a convex hull: expected points that span a volume, found ones on a line");
  CHECK(refusal({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 1e-8}}) ==
        "points of a convex hull: expected points that span a volume, found ones in a plane");
  CHECK(refusal({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 1e-4}}) == "");
  CHECK(refusal({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {nan, 1, 1}})
            .starts_with("points of a convex hull: expected finite numbers"));
  CHECK(refusal({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1e16}})
            .starts_with("points of a convex hull: expected from -1e+15 to 1e+15 m"));
  CHECK(refusal({{0, 0, 0}, {1e-16, 0, 0}, {0, 1e-16, 0}, {0, 0, 1e-16}})
            .starts_with("convex hull bounding radius"));
  Random r(5);
  Points ball;
  for (int i = 0; i < 1000; ++i) {
    const Vector p{r.normal(), r.normal(), r.normal()};
    ball.push_back((1 / norm(p)) * p);
    if (i == 32) CHECK(refusal(ball) == "vertices of a convex hull: expected at most 32, found 33");
  }
  CHECK(refusal(ball) == "vertices of a convex hull: expected at most 32, found more than 256");

  CHECK(error_of([] { Hull::cylinder(0.1, 0.1, 2); }) == "cylinder sides: expected from 3 to 16, found 2");
  CHECK(error_of([] { Hull::cylinder(0.1, 0.1, 17); }) == "cylinder sides: expected from 3 to 16, found 17");
  CHECK(error_of([] { Hull::cone(0.1, 0.1, 32); }) == "cone sides: expected from 3 to 31, found 32");
  CHECK(error_of([] { Hull::cone(0.1, -0.1, 5); }) == "cone height: expected a positive length, found -0.1");
  CHECK(error_of([] {
          Hull::cylinder(0.1, 1e6, 5);
        }).starts_with("points of a convex hull: expected points that span"));
}
