// Contacts of a state, as any program may ask for them: every pair of shapes, and every shape and a plane.
#include <doctest/doctest.h>

#include <rbres/contact/contact_query.hpp>
#include <rbres/core/pack.hpp>
#include <rbres/core/philox.hpp>

#include "../examples/common/count_allocations.hpp"

using namespace rbres;

namespace {

using Shape = AnyShape<double>;
using Pair = System<double, 2, Shape>;
using State = Pair::State;
using Vector = Vec3<double>;
using Turn = Quat<double>;

const std::array<Shape, 3> shapes{Sphere<double>{0.3}, Box<double>{0.2, 0.3, 0.15},
                                  Capsule<double>{0.1, 0.15}};
constexpr std::array names{"sphere", "box", "capsule"};

Body<double, Shape> body(const Shape& shape) { return {shape, 1.0}; }
Turn random_turn(Random& r) { return normalized(Turn{r.normal(), r.normal(), r.normal(), r.normal()}); }
Vector random_vector(Random& r) { return {r.normal(), r.normal(), r.normal()}; }

/// A contact that outlives the loop.
struct Found {
  int first, second;
  Vector normal;
  double gap;
  std::vector<std::pair<Vector, double>> points;
};
template <class System>
std::vector<Found> find(const System& system, const typename System::State& y, double margin = 0) {
  std::vector<Found> all;
  for (const auto& contact : contacts(system, y, margin)) {
    all.push_back({contact.first, contact.second, contact.normal, contact.gap, {}});
    for (const auto& point : contact.points()) all.back().points.push_back({point.position, point.gap});
  }
  return all;
}

/// How far two lists of points are apart, in whatever order; infinite where one has more.
double apart(const Found& a, const Found& b) {
  if (a.points.size() != b.points.size()) return INFINITY;
  double worst = 0;
  for (const auto& [x, gap] : a.points) {
    double least = INFINITY;
    for (const auto& [y, other] : b.points) least = std::min(least, norm(x - y) + std::abs(gap - other));
    worst = std::max(worst, least);
  }
  return worst;
}

/// How far a body reaches up and down from its centre where it stands straight (capsules: lies along x).
double height(const Shape& shape) {
  if (const auto* box = std::get_if<Box<double>>(&shape)) return box->half.z;
  if (const auto* capsule = std::get_if<Capsule<double>>(&shape)) return capsule->radius;
  return std::get<Sphere<double>>(shape).radius;
}
Turn lying(const Shape& shape) {
  if (!std::holds_alternative<Capsule<double>>(shape)) return {};
  return {0, std::sqrt(0.5), 0, std::sqrt(0.5)};
}

/// Bodies that stand on a floor and on one another with the given gaps, in a world that is then turned and
/// moved: the way up is `up`, the floor at `ground`.
struct Tower {
  Pair system;
  State y;
  Vector up, ground;
};
Tower tower(int lower, int upper, double floor_gap, double gap, Random& r) {
  const auto &a = shapes[std::size_t(lower)], &b = shapes[std::size_t(upper)];
  const Turn turn = random_turn(r);
  const Vector up = rotate(turn, Vector{0, 0, 1}), ground = random_vector(r);
  const double middle = floor_gap + height(a), top = middle + height(a) + gap + height(b);
  State y;
  y[0] = {ground + middle * up, turn * lying(a), {}, {}};
  y[1] = {ground + top * up, turn * lying(b), {}, {}};
  return {{{body(a), body(b)}, {{up, dot(up, ground)}}}, y, up, ground};
}

}  // namespace

TEST_CASE("gaps, normals and points are those of the closed form, turned and moved anywhere") {
  // How many points hold up a shape on its side, on a plane and on a box.
  constexpr std::array feet{1, 4, 2};
  Random r(1);
  for (int lower = 0; lower < 3; ++lower) {
    for (int upper = 0; upper < 3; ++upper) {
      for (const double gap : {-0.02, -1e-9, 1e-9, 0.02}) {
        CAPTURE(names[std::size_t(lower)]);
        CAPTURE(names[std::size_t(upper)]);
        CAPTURE(gap);
        const Tower t = tower(lower, upper, -gap, gap, r);
        const auto found = find(t.system, t.y, 0.03);
        REQUIRE(found.size() == 2);
        const Found &floor = found[0], &pair = found[1];
        CHECK(floor.first == -1);
        CHECK(floor.second == 0);
        CHECK(pair.first == 0);
        CHECK(pair.second == 1);
        CHECK(std::ssize(floor.points) == feet[std::size_t(lower)]);
        if (lower == 1) CHECK(std::ssize(pair.points) >= feet[std::size_t(upper)]);
        for (const auto& [contact, expected] : {std::pair{&floor, -gap}, {&pair, gap}}) {
          CHECK(norm(contact->normal - t.up) < 1e-12);
          CHECK(contact->gap == doctest::Approx(expected).epsilon(1e-12));
          for (const auto& [position, distance] : contact->points)
            CHECK(distance == doctest::Approx(expected).epsilon(1e-12));
        }
        // Over a plane a point is the body's, else halfway between the surfaces.
        const double top = -gap + 2 * height(shapes[std::size_t(lower)]);
        for (const auto& point : floor.points)
          CHECK(std::abs(dot(t.up, point.first - t.ground) + gap) < 1e-12);
        for (const auto& point : pair.points)
          CHECK(std::abs(dot(t.up, point.first - t.ground) - top - gap / 2) < 1e-12);
        // The margin decides.
        CHECK(find(t.system, t.y, -0.03).empty());
        CHECK(find(t.system, t.y).size() == 1);  // either the floor or the pair overlaps
        CHECK(find(t.system, t.y)[0].gap < 0);
      }
    }
  }
}

TEST_CASE("contacts do not depend on the numbering of bodies, nor on where the world stands") {
  Random r(2);
  std::ptrdiff_t met = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    CAPTURE(trial);
    const auto &a = shapes[r.below(3)], &b = shapes[r.below(3)];
    const Vector normal = (1 / std::sqrt(3.0)) * Vector{1, -1, 1};
    const Pair system({body(a), body(b)}, {{normal, -0.3}, floor_plane<double>()});
    State y;
    for (int i = 0; i < 2; ++i) y[i] = {0.2 * random_vector(r), random_turn(r), {}, {}};
    const auto expected = find(system, y, 0.01);
    // Where a capsule's axis or a ball's centre is inside a box, the way out is a choice.
    if (std::any_of(expected.begin(), expected.end(),
                    [](const Found& c) { return c.first == 0 && c.gap < -0.09; }))
      continue;
    met += std::ssize(expected);

    const auto compare = [&](const std::vector<Found>& found, const auto& point_there,
                             const auto& vector_there) {
      REQUIRE(found.size() == expected.size());
      for (std::size_t k = 0; k < found.size(); ++k) {
        Found there = expected[k];
        for (auto& point : there.points) point.first = point_there(point.first);
        CHECK(found[k].first == there.first);
        CHECK(found[k].second == there.second);
        CHECK(found[k].gap == doctest::Approx(there.gap).epsilon(1e-9));
        CHECK(norm(found[k].normal - vector_there(there.normal)) < 1e-9);
        CHECK(apart(found[k], there) < 1e-9);
      }
    };

    // Turned and moved.
    const Turn turn = random_turn(r);
    const Vector way = random_vector(r);
    const auto turned = [&](const Vector& v) { return rotate(turn, v); };
    const auto moved = [&](const Vector& p) { return turned(p) + way; };
    const auto planes_there = [&](const auto& vector_there, const Vector& shift) {
      auto planes = system.planes();
      for (auto& plane : planes) {
        plane.normal = vector_there(plane.normal);
        plane.offset += dot(plane.normal, shift);
      }
      return planes;
    };
    State other;
    for (int i = 0; i < 2; ++i) other[i] = {moved(y[i].position), turn * y[i].orientation, {}, {}};
    compare(find(Pair({body(a), body(b)}, planes_there(turned, way)), other, 0.01), moved, turned);

    // In the mirror of y: the shapes are their own mirror images.
    const auto mirrored = [](const Vector& v) { return Vector{v.x, -v.y, v.z}; };
    for (int i = 0; i < 2; ++i) {
      const Turn& q = y[i].orientation;
      other[i] = {mirrored(y[i].position), {-q.x, q.y, -q.z, q.w}, {}, {}};
    }
    compare(find(Pair({body(a), body(b)}, planes_there(mirrored, {})), other, 0.01), mirrored, mirrored);

    // With the bodies in the other order: a pair's normal turns round.
    const auto swapped = find(Pair({body(b), body(a)}, system.planes()), {y[1], y[0]}, 0.01);
    REQUIRE(swapped.size() == expected.size());
    for (const Found& contact : expected) {
      const bool plane = contact.first < 0;
      const auto same = std::find_if(swapped.begin(), swapped.end(), [&](const Found& s) {
        return plane ? s.first == contact.first && s.second == 1 - contact.second : s.first == 0;
      });
      REQUIRE(same != swapped.end());
      CHECK(norm(same->normal - (plane ? 1.0 : -1.0) * contact.normal) < 1e-9);
      CHECK(same->gap == doctest::Approx(contact.gap).epsilon(1e-9));
      CHECK(apart(*same, contact) < 1e-9);
    }
  }
  CHECK(met > 3000);
}

TEST_CASE("a shape known when compiling, one chosen at run time and lanes have the same contacts") {
  using Lanes = Pack<double, 4>;
  using Boxes = System<double, 3, Box<double>>;
  const Box<double> box{0.2, 0.3, 0.15};
  const auto boxes = Boxes::of(Body{box, 1.0}, {floor_plane<double>()});
  const auto any = System<double, 3>::of(Body<double>{Body{box, 1.0}}, {floor_plane<double>()});
  const auto packed = boxes.cast<Lanes>();
  constexpr double margin = 0.02;
  Random r(3);
  for (int trial = 0; trial < 100; ++trial) {
    CAPTURE(trial);
    std::array<Boxes::State, 4> alone;
    decltype(packed)::State y;
    for (int lane = 0; lane < 4; ++lane) {
      auto& at = alone[std::size_t(lane)];
      for (int i = 0; i < 3; ++i) at[i] = {0.3 * random_vector(r), random_turn(r), {}, {}};
      set_lane(y, lane, at);
    }
    std::array<std::vector<Found>, 4> in_lane;
    for (const auto& contact : contacts(packed, y, Lanes(margin))) {
      for (int lane = 0; lane < 4; ++lane) {
        Found found{contact.first,
                    contact.second,
                    Vector{contact.normal.x[lane], contact.normal.y[lane], contact.normal.z[lane]},
                    contact.gap[lane],
                    {}};
        for (const auto& [p, gap] : contact.points()) {
          if (gap[lane] <= margin) found.points.push_back({{p.x[lane], p.y[lane], p.z[lane]}, gap[lane]});
        }
        if (!found.points.empty()) in_lane[std::size_t(lane)].push_back(found);
      }
    }
    for (std::size_t lane = 0; lane < 4; ++lane) {
      const auto expected = find(boxes, alone[lane], margin), as_any = find(any, alone[lane], margin);
      REQUIRE(in_lane[lane].size() == expected.size());
      REQUIRE(as_any.size() == expected.size());
      for (std::size_t k = 0; k < expected.size(); ++k) {
        for (const auto& found : {in_lane[lane][k], as_any[k]}) {
          CHECK(found.first == expected[k].first);
          CHECK(found.second == expected[k].second);
          CHECK(norm(found.normal - expected[k].normal) < 1e-12);
          CHECK(found.gap == doctest::Approx(expected[k].gap).epsilon(1e-12));
          CHECK(apart(found, expected[k]) < 1e-12);
        }
      }
    }
  }
}

TEST_CASE("every pair is found once, planes first, in order") {
  constexpr int N = 5;
  const auto system = System<double, N, Sphere<double>>::of(
      Body{Sphere{1.0}, 1.0}, {floor_plane<double>(), {{1, 0, 0}, 0, {}}, {{0, 1, 0}, -10, {}}});
  SystemState<double, N> y;
  for (int i = 0; i < N; ++i) y[i].position = {0.1 * i, 0, 0.5};
  std::vector<std::pair<int, int>> expected, found;
  for (const int plane : {-1, -2})
    for (int i = 0; i < N; ++i) expected.push_back({plane, i});
  for (int i = 0; i < N; ++i)
    for (int j = i + 1; j < N; ++j) expected.push_back({i, j});
  for (const auto& contact : contacts(system, y)) {
    found.push_back({contact.first, contact.second});
    CHECK(contact.with_plane() == (contact.first < 0));
    if (contact.with_plane()) CHECK(system.planes()[std::size_t(contact.plane())].normal == contact.normal);
  }
  CHECK(found == expected);
  // Balls that just touch do.
  y[0].position = {0, 0, 1};
  y[1].position = {0, 2, 1};
  for (int i = 2; i < N; ++i) y[i].position = {50.0 * i, 0, 50};
  CHECK(find(system, y).size() == 5);  // both on the floor and at x = 0, and the pair
  // What is nowhere touches nothing.
  for (int i = 0; i < N; ++i) y[i].position.z = NAN;
  CHECK(find(system, y).empty());
}

TEST_CASE("a body whose position is not finite touches nothing") {
  constexpr double inf = std::numeric_limits<double>::infinity(),
                   nan = std::numeric_limits<double>::quiet_NaN();
  for (const Shape& shape : shapes) {
    for (const double sign : {1.0, -1.0}) {
      const Pair pair({body(shape), body(shape)},
                      {{{0, 0, sign}, 0.0}, {{sign, 0, 0}, 0.0}, {{0, sign, 0}, 0.0}});
      for (const double far : {inf, -inf, nan}) {
        for (double Vector::*axis : {&Vector::x, &Vector::y, &Vector::z}) {
          State y;
          y[1].position = {0.01, 0.02, 0.03};
          y[0].position.*axis = far;
          for (const auto& contact : contacts(pair, y)) {
            CHECK(contact.first < 0);
            CHECK(contact.second == 1);
          }
        }
      }
    }
  }
}

TEST_CASE("asking allocates nothing, throws nothing, and is a range like any other") {
  const Pair system({body(shapes[0]), body(shapes[1])}, {floor_plane<double>()});
  const State y{};
  static_assert(noexcept(contacts(system, y))&& noexcept(contacts(system, y).begin())&& noexcept(
      ++contacts(system, y).begin())&& noexcept((*contacts(system, y).begin()).points()));
  static_assert(std::ranges::input_range<Contacts<Pair>>);
  const long before = allocations;
  std::ptrdiff_t points = 0;
  for (const auto& contact : contacts(system, y)) points += std::ssize(contact.points());
  CHECK(allocations == before);
  CHECK(points > 2);
  CHECK(std::ranges::count_if(contacts(system, y), [](const auto& c) { return c.with_plane(); }) == 2);
}
