#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

#include "../examples/common/count_allocations.hpp"

using namespace rbres;

namespace {

using Vector = Vec3<double>;
using Points = std::vector<Vector>;
using Hull = ConvexHull<double>;

Pose<double> pose(const Vector& at, const Quat<double>& q = {}) { return {at, rotation_matrix(q)}; }
Quat<double> random_turn(Random& r) {
  return normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
}
Vector random_direction(Random& r) { return rotate(random_turn(r), Vector{0, 0, 1}); }
Points box_corners(const Box<double>& box) {
  Points points;
  for (int i = 0; i < 8; ++i)
    points.push_back({i & 1 ? box.half.x : -box.half.x, i & 2 ? box.half.y : -box.half.y,
                      i & 4 ? box.half.z : -box.half.z});
  return points;
}
Hull hull_of(const Box<double>& box) { return Hull(box_corners(box)); }
Hull random_hull(Random& r, int points) {
  Points all;
  for (int i = 0; i < points; ++i) all.push_back(0.2 * Vector{r.normal(), r.normal(), r.normal()});
  return Hull(all);
}
Points world(const Hull& hull, const Pose<double>& at) {
  Points points;
  for (const Vector& v : hull.vertices()) points.push_back(at.position + at.axes * v);
  return points;
}

/// How far the origin is from the solid that points span, by trying all their subsets; inside, how deep.
/// Knows nothing of faces.
double signed_distance(const Points& points) {
  double nearest = 1e30, deepest = 1e30;
  const std::size_t n = points.size();
  const auto take = [&](const Vector& p) { nearest = std::min(nearest, norm(p)); };
  for (std::size_t i = 0; i < n; ++i) {
    take(points[i]);
    for (std::size_t j = i + 1; j < n; ++j) {
      const Vector d = points[j] - points[i];
      if (const double t = -dot(points[i], d) / squared_norm(d); t > 0 && t < 1) take(points[i] + t * d);
      for (std::size_t k = j + 1; k < n; ++k) {
        const Vector e = points[k] - points[i], normal = cross(d, e);
        const double area2 = squared_norm(normal);
        if (area2 < 1e-20) continue;
        const double above = dot(normal, points[i]) / area2;
        const Vector foot = above * normal, from = foot - points[i];
        const double s = dot(cross(from, e), normal) / area2, t = dot(cross(d, from), normal) / area2;
        if (s > 0 && t > 0 && s + t < 1) take(foot);
        // A plane with all points on one side bounds the solid.
        double low = 0, high = 0;
        for (const Vector& p : points) {
          const double out = dot(normal, p - points[i]);
          low = std::min(low, out);
          high = std::max(high, out);
          if (low < -1e-12 && high > 1e-12) break;
        }
        if (low < -1e-12 && high > 1e-12) continue;
        deepest = std::min(deepest, (high > 1e-12 ? -1 : 1) * above * std::sqrt(area2));
      }
    }
  }
  return deepest < 0 ? nearest : -deepest;
}
Points difference(const Points& a, const Points& b) {
  Points all;
  for (const Vector& p : a) {
    for (const Vector& q : b) all.push_back(q - p);
  }
  return all;
}

/// The manifold's points whose gap is at most `most`.
template <int P, bool C>
std::vector<std::pair<Vector, double>> points_of(const Manifold<double, P, C>& m, double most) {
  std::vector<std::pair<Vector, double>> points;
  for (std::size_t i = 0; i < P; ++i) {
    if (m.gap[i] <= most) points.emplace_back(m.point[i], m.gap[i]);
  }
  return points;
}
/// Each point of one stands beside one of the other.
template <class A, class B>
bool covers(const A& a, const B& b, double most) {
  const auto of_a = points_of(a, most), of_b = points_of(b, most + 1e-7);
  return std::all_of(of_a.begin(), of_a.end(), [&](const auto& p) {
    return std::any_of(of_b.begin(), of_b.end(), [&](const auto& q) {
      return norm(p.first - q.first) < 1e-7 && std::abs(p.second - q.second) < 1e-7;
    });
  });
}

/// Compares a contact of a box with that of the hull of its corners. `preferred`: axes whose gaps differ by
/// less may take each other's place (m).
template <class A, class B>
bool same_contact(const A& box, const B& hull, double preferred) {
  if (box.separation <= 0) {
    CHECK(std::abs(hull.separation - box.separation) < 1e-12);
  } else {  // boxes try axes that cannot separate hulls that touch
    CHECK(hull.separation > 0);
    CHECK(hull.separation <= box.separation + 1e-12);
  }
  if (box.separation > preferred) return true;
  if (norm(hull.normal - box.normal) > 1e-7) return false;
  return covers(box, hull, preferred) && covers(hull, box, preferred);
}

}  // namespace

TEST_CASE("the hull of a box's corners meets everything as the box does") {
  const Box<double> box{0.3, 0.2, 0.1}, other{0.1, 0.15, 0.25};
  const Hull hull = hull_of(box), other_hull = hull_of(other);
  const Sphere<double> ball{0.15};
  const Capsule<double> capsule{0.1, 0.2};
  const double preferred = 1e-4 * 0.1;
  int different = 0;
  for (int trial = 0; trial < 4000; ++trial) {
    CAPTURE(trial);
    Random r(1, std::uint64_t(trial));
    const auto pa = pose({0.1, -0.2, 0.3}, random_turn(r));
    const auto pb = pose(pa.position + r.uniform(0.2, 0.5) * random_direction(r), random_turn(r));
    different += !same_contact(detect(box, pa, other, pb), detect(hull, pa, other_hull, pb), preferred);
    different += !same_contact(detect(box, pa, other, pb), detect(hull, pa, other, pb), preferred);
    different += !same_contact(detect(box, pa, other, pb), detect(box, pa, other_hull, pb), preferred);
    const auto as_box = detect(ball, pa, box, pb), as_hull = detect(ball, pa, hull, pb);
    CHECK(std::abs(as_box.separation - as_hull.separation) < 1e-14);
    CHECK(norm(as_box.normal - as_hull.normal) < 1e-12);
    CHECK(norm(as_box.point[0] - as_hull.point[0]) < 1e-13);
    const auto bar_box = detect(box, pb, capsule, pa), bar_hull = detect(hull, pb, capsule, pa);
    if (bar_box.separation < -0.99 * capsule.radius) continue;  // deep inside they differ
    CHECK(std::abs(bar_box.separation - bar_hull.separation) < 1e-12);
    CHECK(norm(bar_box.normal - bar_hull.normal) < 1e-6);
    CHECK(std::abs(bar_box.gap[0] - bar_hull.gap[0]) < 1e-12);
    const Plane<double> plane{random_direction(r), r.uniform(-0.2, 0.2)};
    const auto on_box = detect(plane, box, pa);
    const auto on_hull = detect(plane, hull, pa);
    CHECK(std::abs(on_box.separation - on_hull.separation) < 1e-15);
    CHECK(covers(on_box, on_hull, 1));
    CHECK(covers(on_hull, on_box, 1));
  }
  CHECK(different < 12);  // of 12,000, where two axes are equally good
}

TEST_CASE("a hull's vertices meet a plane, each in its place") {
  const Hull cone = Hull::cone(0.2, 0.5, 7);
  const Plane<double> floor{};
  const auto m = detect(floor, cone, pose({1, 2, cone.centre_of_mass().z}));
  CHECK(std::abs(m.separation) < 1e-15);
  for (std::size_t i = 0; i < 32; ++i) {
    if (i < cone.vertices().size()) {
      CHECK(std::abs(m.gap[i] - cone.vertices()[i].z - cone.centre_of_mass().z) < 1e-15);
    } else {
      CHECK(m.gap[i] == m.none);
    }
  }
  CHECK(points_of(m, 1e-12).size() == 7);
}

TEST_CASE("balls and capsules: the gap is the distance, or how far it is out") {
  for (int trial = 0; trial < 400; ++trial) {
    CAPTURE(trial);
    Random r(2, std::uint64_t(trial));
    const Hull hull = random_hull(r, 4 + int(r.below(9)));
    const auto ph = pose({0.3, 0.1, -0.2}, random_turn(r));
    const Sphere<double> ball{0.1};
    const Capsule<double> capsule{0.1, r.uniform(0, 0.3)};
    const auto pose_b = pose(ph.position + r.uniform(0, 0.8) * random_direction(r), random_turn(r));
    const Points solid = world(hull, ph);
    const auto check = [&](const auto& m, const auto& swapped, const Points& core, double radius) {
      CHECK(m.separation == doctest::Approx(signed_distance(difference(solid, core)) - radius).epsilon(1e-9));
      CHECK(std::abs(norm(m.normal) - 1) < 1e-12);
      CHECK(swapped.separation == m.separation);
      CHECK(norm(swapped.normal + m.normal) == 0);
      CHECK(m.gap[0] == doctest::Approx(m.separation).epsilon(1e-12));
      // The normal keeps them apart by that much.
      double first = -1e30, second = 1e30;
      for (const Vector& p : solid) first = std::max(first, dot(m.normal, p));
      for (const Vector& p : core) second = std::min(second, dot(m.normal, p) - radius);
      CHECK(second - first == doctest::Approx(m.separation).epsilon(1e-9));
      for (const double gap : m.gap) CHECK(gap >= m.separation - 1e-9);
    };
    check(detect(hull, ph, ball, pose_b), detect(ball, pose_b, hull, ph), {pose_b.position}, ball.radius);
    const Vector half = capsule.half_length * pose_b.axes.z;
    check(detect(hull, ph, capsule, pose_b), detect(capsule, pose_b, hull, ph),
          {pose_b.position - half, pose_b.position + half}, capsule.radius);
  }
}

TEST_CASE("hulls: the gap is the depth where they overlap, and apart at most the distance") {
  int overlaps = 0;
  for (int trial = 0; trial < 120; ++trial) {
    CAPTURE(trial);
    Random r(3, std::uint64_t(trial));
    const Hull a = random_hull(r, 4 + int(r.below(4))), b = random_hull(r, 4 + int(r.below(4)));
    const auto pa = pose({0.3, 0.1, -0.2}, random_turn(r));
    const auto pb = pose(pa.position + r.uniform(0.1, 0.6) * random_direction(r), random_turn(r));
    const auto m = detect(a, pa, b, pb), swapped = detect(b, pb, a, pa);
    const Points first = world(a, pa), second = world(b, pb);
    const double distance = signed_distance(difference(first, second));
    CHECK(std::abs(norm(m.normal) - 1) < 1e-12);
    CHECK(swapped.separation == doctest::Approx(m.separation).epsilon(1e-9));
    CHECK(norm(swapped.normal + m.normal) < 1e-9);
    double top = -1e30, bottom = 1e30;
    for (const Vector& p : first) top = std::max(top, dot(m.normal, p));
    for (const Vector& p : second) bottom = std::min(bottom, dot(m.normal, p));
    CHECK(bottom - top >= m.separation - 1e-4 * std::min(a.inner_radius(), b.inner_radius()));
    const auto nearest = *std::min_element(m.gap.begin(), m.gap.end());
    CHECK(nearest >= m.separation - 1e-12);
    if (distance > 0) {
      CHECK(m.separation > 0);
      CHECK(m.separation <= distance + 1e-12);
      continue;
    }
    ++overlaps;
    CHECK(m.separation == doctest::Approx(distance).epsilon(1e-9));
    CHECK(nearest <= m.separation + 1e-4 * std::min(a.inner_radius(), b.inner_radius()));
  }
  CHECK(overlaps > 40);
}

TEST_CASE("hulls lie on one another with points that span what the faces share") {
  const auto span = [](const auto& m) {
    double low = 1, high = -1;
    for (const auto& [point, gap] : points_of(m, 1e-9)) {
      CHECK(std::abs(gap) < 1e-14);
      CHECK(std::abs(point.z) < 1e-14);
      low = std::min(low, point.x);
      high = std::max(high, point.x);
    }
    return std::pair(low, high);
  };
  const Hull prism = Hull::cylinder(0.2, 0.1, 8);
  const auto m = detect(prism, pose({0, 0, -0.1}), prism, pose({0.1, 0, 0.1}));
  CHECK(m.normal.z == 1);
  CHECK(span(m).first == doctest::Approx(-0.1));
  CHECK(span(m).second == doctest::Approx(0.2));
  // Two faces of 31 corners cut to 62: as many as there is room for are kept, all around.
  const Hull cone = Hull::cone(0.2, 0.1, 31);
  const double lift = cone.centre_of_mass().z, angle = 0.05;
  const auto many = detect(cone, pose({0, 0, -lift}, {1, 0, 0, 0}), cone,
                           pose({0, 0, lift}, {0, 0, std::sin(angle), std::cos(angle)}));
  const auto points = points_of(many, 1e-9);
  CHECK(points.size() > 20);
  CHECK(points.size() <= 32);
  for (int k = 0; k < 12; ++k) {
    const Vector way{std::cos(k * std::numbers::pi / 6), std::sin(k * std::numbers::pi / 6), 0};
    double most = 0;
    for (const auto& point : points) most = std::max(most, dot(point.first, way));
    CHECK(most > 0.195);
  }
}

TEST_CASE("a capsule lies on a hull with its ends, or with where it leaves the face") {
  const Quat<double> lying{0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  const Hull slab = hull_of(Box<double>{0.5, 0.5, 0.1});
  for (const double half : {0.3, 0.9}) {
    const auto m = detect(slab, pose({0, 0, -0.1}), Capsule<double>{0.1, half}, pose({0.1, 0, 0.1}, lying));
    CHECK(m.normal.z == doctest::Approx(1));
    const double left = std::max(0.1 - half, -0.5), right = std::min(0.1 + half, 0.5);
    for (std::size_t i = 0; i < 3; ++i) CHECK(std::abs(m.gap[i]) < 1e-14);
    CHECK(std::min(m.point[1].x, m.point[2].x) == doctest::Approx(left).epsilon(1e-6));
    CHECK(std::max(m.point[1].x, m.point[2].x) == doctest::Approx(right).epsilon(1e-6));
  }
}

TEST_CASE("no gap jumps, however hulls move through one another") {
  for (int trial = 0; trial < 30; ++trial) {
    CAPTURE(trial);
    Random r(4, std::uint64_t(trial));
    const Hull a = random_hull(r, 12), b = random_hull(r, 12);
    const Capsule<double> capsule{0.1, 0.2};
    const auto pa = pose({0, 0, 0}, random_turn(r));
    const Vector way = random_direction(r), axis = random_direction(r), aside = 0.1 * random_direction(r);
    const Quat<double> turn = random_turn(r);
    constexpr double step = 1e-3;  // m, and rad
    double last[2] = {};
    for (int k = 0; k <= 1200; ++k) {
      const double s = step * k - 0.6;
      const auto pb = pose(aside + s * way, quaternion_exp(s * axis) * turn);
      const double now[2] = {detect(a, pa, b, pb).separation, detect(a, pa, capsule, pb).separation};
      // Of the movement alone and of a turn about what lies up to this far away.
      const double most = step * (1 + 1.5 * std::max(b.bounding_radius(), 0.3) + a.bounding_radius());
      for (int i = 0; i < 2; ++i) {
        if (k > 0) CHECK(std::abs(now[i] - last[i]) < most);
        last[i] = now[i];
      }
    }
  }
}

TEST_CASE("shapes chosen at run time meet as those chosen when compiling") {
  const Hull hull = Hull::cylinder(0.2, 0.3, 6);
  const Box<double> box{0.2, 0.3, 0.1};
  const auto pa = pose({0, 0, 0}), pb = pose({0.3, 0.2, 0.1});
  using Any = AnyConvexShape<double>;
  CHECK(detect(Any(box), pa, Any(hull), pb).separation == detect(box, pa, hull, pb).separation);
  CHECK(detect(Any(hull), pa, Any(hull), pb).gap == detect(hull, pa, hull, pb).gap);
  static_assert(PairManifold<double, Any>::points == 32 && PlaneManifold<double, Any>::points == 32);
  static_assert(PairManifold<double, AnyShape<double>>::points == 12);
}

namespace {

Hull dodecahedron(double radius) {
  const double g = std::numbers::phi, s = radius / std::sqrt(3.0);
  Points points;
  for (int i = 0; i < 4; ++i) {
    const double a = (i & 1 ? s : -s), b = (i & 2 ? s : -s);
    for (const double c : {s, -s}) points.push_back({a, b, c});
    points.push_back({0, a / g, b * g});
    points.push_back({a / g, b * g, 0});
    points.push_back({b * g, 0, a / g});
  }
  return Hull(points);
}

/// What a run shows while it goes.
template <class System>
struct Watch {
  const System* system;
  double last = std::numeric_limits<double>::infinity(), rise = 0, deepest = 0;
  void operator()(double, const typename System::State& y) {
    const double now = energy(*system, y, Vector{0, 0, -9.81});
    rise = std::max(rise, now - last);
    last = now;
    for (const auto& contact : contacts(*system, y)) deepest = std::max(deepest, -contact.gap);
  }
};

}  // namespace

TEST_CASE("the hull of a box's corners lands as the box does") {
  const Box<double> box{0.1, 0.08, 0.05};
  using Any = AnyConvexShape<double>;
  for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
    const Material<double> material{.restitution = 0.3, .friction = 0.4};
    const auto body = [&](const Any& shape) { return Body<double, Any>(shape, 1.0, material); };
    SystemState<double, 2> start;
    start[0] = {{0, 0, 0.3}, normalized(Quat<double>{0.2, 0.1, 0, 1}), {0.3, 0, 0}, {1, 2, 0}};
    start[1] = {{0.03, 0.02, 0.6}, normalized(Quat<double>{0, 0.3, 0.1, 1}), {}, {}};
    const auto compare = [&](const auto& boxes, const auto& hulls, const auto& from, double duration,
                             double within) {
      auto as_box = from, as_hull = from;
      const SimulationOptions options{.step = 1e-3, .duration = duration, .contacts = mode};
      const auto report = simulate(boxes, as_box, Gravity{}, Rk4{}, options);
      CHECK(report.impacts >= 25);
      CHECK(simulate(hulls, as_hull, Gravity{}, Rk4{}, options).impacts == report.impacts);
      for (std::size_t i = 0; i < from.body.size(); ++i)
        CHECK(norm(as_box.body[i].position - as_hull.body[i].position) < within);
    };
    // Impacts of both bodies make a difference of rounding grow.
    compare(System<double, 2, Any>{{body(box), body(box)}, {floor_plane(material)}},
            System<double, 2, Any>{{body(hull_of(box)), body(hull_of(box))}, {floor_plane(material)}}, start,
            0.35, 1e-9);
    compare(System<double, 1, Any>{{body(box)}, {floor_plane(material)}},
            System<double, 1, Any>{{body(hull_of(box))}, {floor_plane(material)}},
            SystemState<double, 1>{{start[0]}}, 0.6, 1e-10);
  }
}

TEST_CASE("hulls that are dropped come to rest on the floor, and on one another") {
  using Any = AnyConvexShape<double>;
  const Material<double> material{.restitution = 0.2, .friction = 0.6};
  for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
    for (const Hull& hull : {dodecahedron(0.1), Hull::cylinder(0.1, 0.05, 12), Hull::cone(0.1, 0.15, 9)}) {
      CAPTURE(hull.describe());
      const System<double, 1, Hull> system{{Body<double, Hull>(hull, 1.0, material)},
                                           {floor_plane(material)}};
      SystemState<double, 1> y;
      y[0] = {{0, 0, 0.4}, normalized(Quat<double>{0.1, 0.2, 0, 1}), {0.1, 0, 0}, {1, 0.5, 0}};
      Watch<System<double, 1, Hull>> watch{&system};
      const auto report =
          simulate(system, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 6, .contacts = mode}, watch);
      const bool continuous = mode == ContactMode::continuous;
      CHECK(report.status == SimulationStatus::finished);
      CHECK(report.overruns == 0);
      CHECK(watch.rise < 1e-10 * 4);
      CHECK(watch.deepest < (continuous ? 1e-3 * hull.bounding_radius() : 0.01));
      CHECK(norm(y[0].velocity) < (continuous ? 1e-9 : 1e-6));
      CHECK(norm(y[0].angular_velocity) < (continuous ? 1e-8 : 1e-5));
      int touching = 0;  // it lies on a face
      for (const auto& contact : contacts(system, y, 1e-5))
        touching = static_cast<int>(contact.points().size());
      if (continuous) CHECK(touching >= 3);
    }
  }
  // A tower of a cylinder, a hull that was a box, and a cone on its base.
  const Hull slab = hull_of(Box<double>{0.1, 0.1, 0.05}), drum = Hull::cylinder(0.1, 0.1, 16),
             cone = Hull::cone(0.1, 0.2, 16);
  const auto body = [&](const Hull& hull) { return Body<double, Any>(hull, 1.0, material); };
  const System<double, 4, Any> tower{
      {body(drum), body(slab), body(cone), Body<double, Any>(Capsule<double>{0.05, 0.1}, 1.0, material)},
      {floor_plane(material)}};
  SystemState<double, 4> y;
  y[0].position = {0, 0, 0.1};
  y[1].position = {0.01, 0, 0.25};
  y[2].position = {0, 0.01, 0.3 + cone.centre_of_mass().z};
  y[3].position = {0.5, 0, 0.05};
  y[3].orientation = {0, std::sqrt(0.5), 0, std::sqrt(0.5)};
  const auto start = y;
  Watch<System<double, 4, Any>> watch{&tower};
  const auto report = simulate(tower, y, Gravity{}, Rk4{}, {.step = 1e-3, .duration = 2}, watch);
  CHECK(report.impacts == 0);
  CHECK(report.overruns == 0);
  CHECK(watch.deepest < 1e-9);
  for (int i = 0; i < 4; ++i) CHECK(norm(y[i].position - start[i].position) < 1e-9);
}

TEST_CASE("a hull that flies fast meets a thin plate") {
  using Any = AnyConvexShape<double>;
  const Material<double> material{.restitution = 1, .friction = 0};
  int through = 0;
  for (int trial = 0; trial < 60; ++trial) {
    Random r(6, std::uint64_t(trial));
    const System<double, 2, Any> system{
        {Body<double, Any>(random_hull(r, 10), 1.0, material),
         Body<double, Any>::kinematic(hull_of(Box<double>{5, 5, 0.001}), material)}};
    SystemState<double, 2> y;
    y[0] = {{0, 0, 2 + 1e-4 * trial},
            random_turn(r),
            {r.normal(), r.normal(), -100},
            {r.normal(), r.normal(), r.normal()}};
    simulate(system, y, Forces{}, Rk4{}, {.step = 1e-3, .duration = 0.04});
    through += y[0].position.z < 0;
  }
  CHECK(through == 0);
}

TEST_CASE("hulls in float fall as in double, and a step allocates nothing") {
  using Any = AnyConvexShape<double>;
  const Material<double> material{.restitution = 0.5, .friction = 0.3};
  const auto body = [&](const Any& shape) { return Body<double, Any>(shape, 1.0, material); };
  const System<double, 3, Any> system{
      {body(dodecahedron(0.1)), body(Box<double>{0.1, 0.1, 0.1}), body(Capsule<double>{0.05, 0.1})},
      {floor_plane(material)}};
  SystemState<double, 3> start;
  start[0] = {{0, 0, 0.3}, normalized(Quat<double>{0.1, 0.2, 0.3, 1}), {}, {}};
  start[1] = {{0.05, 0.02, 0.6}, normalized(Quat<double>{0.3, 0.2, 0.1, 1}), {}, {}};
  start[2] = {{0.02, 0.05, 0.9}, normalized(Quat<double>{0.1, 0.3, 0.1, 1}), {}, {}};
  for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
    auto y = start;
    Stepper stepper(system, Gravity{}, Rk4{}, SimulationOptions{.contacts = mode});
    const long before = allocations;
    for (int i = 0; i < 1500; ++i) stepper.step(y, 1e-3 * i, 1e-3);
    CHECK(allocations == before);
    CHECK(stepper.tally().impacts > 10);

    const auto single = system.cast<float>();
    SystemState<float, 3> z;
    for (int i = 0; i < 39; ++i) z.vector()(i) = static_cast<float>(start.vector()(i));
    auto w = start;
    const SimulationOptions options{.duration = 0.27, .contacts = mode};
    CHECK(simulate(single, z, Gravity<float>{}, Rk4{}, options).impacts ==
          simulate(system, w, Gravity{}, Rk4{}, options).impacts);
    for (int i = 0; i < 3; ++i)
      CHECK(norm(w[i].position - Vector{z[i].position.x, z[i].position.y, z[i].position.z}) < 1e-4);
    CHECK(simulate(single, z, Gravity<float>{}, Rk4{}, {.duration = 3, .contacts = mode}).status ==
          SimulationStatus::finished);
    for (int i = 0; i < 3; ++i) CHECK(z[i].position.z > 0.04);
  }
}
