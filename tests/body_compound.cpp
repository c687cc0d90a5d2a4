#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

#include "error_of.hpp"

using namespace rbres;

namespace {

using Vector = Vec3<double>;
using Pair = Compound<double, 2>;
using Any = Compound<double, 4, AnyConvexShape<double>>;
using Bodies = Body<double, Pair>;

Quat<double> random_turn(Random& r) {
  return normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
}
Vector random_place(Random& r, double size) {
  return {size * r.normal(), size * r.normal(), size * r.normal()};
}
/// A body's inertia about its centre of mass, along the axes of the frame of its parts.
template <class B>
Eigen::Matrix3d tensor(const B& body) {
  const Eigen::Matrix3d axes = Eigen::Quaterniond(body.shape_rotation().conjugate()).toRotationMatrix();
  return axes * Eigen::Vector3d(body.inertia()).asDiagonal() * axes.transpose();
}
/// A random part of random shape.
template <class C>
typename C::Part random_part(Random& r) {
  const auto shape = [&]() -> AnyConvexShape<double> {
    switch (r.below(4)) {
      case 0:
        return Sphere<double>{r.uniform(0.1, 0.3)};
      case 1:
        return Box<double>{r.uniform(0.1, 0.3), r.uniform(0.1, 0.3), r.uniform(0.1, 0.3)};
      case 2:
        return Capsule<double>{r.uniform(0.1, 0.2), r.uniform(0.1, 0.3)};
      default:
        return ConvexHull<double>::cone(r.uniform(0.1, 0.3), r.uniform(0.1, 0.3), 5);
    }
  };
  return {shape(), random_place(r, 0.3), random_turn(r), r.uniform(0.5, 2)};
}

}  // namespace

TEST_CASE("two halves have the mass and inertia of the whole box") {
  const Box<double> whole{0.3, 0.2, 0.1};
  const Pair halves{{Box{0.15, 0.2, 0.1}, {-0.15, 0, 0}}, {Box{0.15, 0.2, 0.1}, {0.15, 0, 0}}};
  CHECK(halves.size() == 2);
  CHECK(halves.volume() == doctest::Approx(whole.volume()).epsilon(1e-15));
  CHECK(halves.mass() == halves.volume());
  CHECK(halves.bounding_radius() == whole.bounding_radius());
  const auto a = Bodies::of_density(halves, 500), b = Bodies(halves, 2.0);
  const Body<double, Box<double>> box(whole, 2.0);
  CHECK(a.mass() == doctest::Approx(24).epsilon(1e-15));
  CHECK(norm(b.inertia() - box.inertia()) <= 1e-15 * norm(box.inertia()));
  CHECK(b.shape_rotation() == Quat<double>{});
  CHECK(b.shape_origin() == Vector{});
}

TEST_CASE("one part has exactly the numbers of its shape, wherever it stands") {
  const Box<double> box{0.3, 0.2, 0.1};
  for (const Vector& at : {Vector{}, Vector{1, -2, 0.3}}) {
    const Pair one{{box, at}};
    const Body<double, Pair> body(one, 3.0);
    const Body<double, Box<double>> plain(box, 3.0);
    CHECK(body.inertia() == plain.inertia());
    CHECK(one.bounding_radius() == box.bounding_radius());
    CHECK(one.centre_of_mass() == at);
    CHECK(body.shape_origin() == -at);
  }
}

TEST_CASE("a dumbbell's numbers are those of its balls") {
  // Of 1 and 3 kg, 0.4 m apart: the centre of mass is 0.3 m from the light one.
  const double r = 0.1, volume = 4.0 / 3 * std::numbers::pi * r * r * r;
  const Pair dumbbell{{Sphere{r}, {0, 0, 1}, {}, 1 / volume}, {Sphere{r}, {0.4, 0, 1}, {}, 3 / volume}};
  CHECK(dumbbell.mass() == doctest::Approx(4).epsilon(1e-14));
  CHECK(norm(dumbbell.centre_of_mass() - Vector{0.3, 0, 1}) < 1e-15);
  CHECK(dumbbell.bounding_radius() == doctest::Approx(0.4).epsilon(1e-15));
  const Body body(dumbbell, dumbbell.mass());
  const double own = 0.4 * 4 * r * r, across = own + 1 * 0.09 + 3 * 0.01;
  CHECK(body.inertia().x == doctest::Approx(own).epsilon(1e-14));
  CHECK(body.inertia().y == doctest::Approx(across).epsilon(1e-14));
  CHECK(body.inertia().z == doctest::Approx(across).epsilon(1e-14));
  CHECK(norm(body.shape_origin() + Vector{0.3, 0, 1}) < 1e-15);
}

TEST_CASE("a part's orientation turns its inertia and its surface") {
  const double quarter = std::sqrt(0.5);
  const Compound<double, 1> turned{{Box{0.3, 0.2, 0.1}, {}, {0, 0, quarter, quarter}}};
  const Body body(turned, 1.0);
  CHECK(norm(body.inertia() - Body(Box{0.2, 0.3, 0.1}, 1.0).inertia()) < 1e-15);
  CHECK(turned.frontal({1, 0, 0}, 1.0) == doctest::Approx(4 * 0.3 * 0.1));
}

TEST_CASE("where parts overlap, each counts in full") {
  const Pair twice{{Box{0.1, 0.1, 0.1}, {}}, {Box{0.1, 0.1, 0.1}, {}}};
  CHECK(twice.volume() == doctest::Approx(0.016));
  CHECK(Bodies(twice, 1.0).inertia().x == doctest::Approx(Body(Box{0.1, 0.1, 0.1}, 1.0).inertia().x));
}

TEST_CASE("neither the order of the parts nor the user's frame matters") {
  for (int trial = 0; trial < 200; ++trial) {
    Random r(3, std::uint64_t(trial));
    std::vector<Any::Part> parts;
    for (int k = 0; k < 4; ++k) parts.push_back(random_part<Any>(r));
    const Any compound(parts);
    const Body body(compound, 2.0);
    const Eigen::Matrix3d inertia = tensor(body);
    const double size = inertia.trace();

    auto reversed = parts;
    std::reverse(reversed.begin(), reversed.end());
    const Body other(Any(reversed), 2.0);
    CHECK((tensor(other) - inertia).norm() < 1e-14 * size);
    CHECK(norm(other.shape().centre_of_mass() - compound.centre_of_mass()) < 1e-15);

    const Quat<double> turn = random_turn(r);
    const Vector shift = random_place(r, 1);
    auto moved = parts;
    for (auto& part : moved) {
      part.position = shift + rotate(turn, part.position);
      part.orientation = turn * part.orientation;
    }
    const Body there(Any(moved), 2.0);
    CHECK(norm(there.inertia() - body.inertia()) < 1e-13 * size);
    CHECK(there.bounding_radius() == doctest::Approx(body.bounding_radius()).epsilon(1e-13));
    CHECK(norm(there.shape().centre_of_mass() - shift - rotate(turn, compound.centre_of_mass())) < 1e-14);
    const Eigen::Matrix3d q = Eigen::Quaterniond(turn).toRotationMatrix();
    CHECK((tensor(there) - q * inertia * q.transpose()).norm() < 1e-13 * size);
    // The same place of the user's frame in the world puts the parts at the same places.
    RigidState<double> y;
    y.orientation = random_turn(r);
    const Vector corner = parts[2].position;
    const auto world = [&](const auto& b, const Vector& p) {
      return rotate(b.shape_rotation(), p) + b.shape_origin();
    };
    CHECK(norm(world(body, corner)) ==
          doctest::Approx(norm(world(there, shift + rotate(turn, corner)))).epsilon(1e-12));
  }
}

TEST_CASE("compounds are scaled and cast") {
  Random r(4, 0);
  const Any compound{random_part<Any>(r), random_part<Any>(r)};
  const Body<double, Any> body(compound, 2.0, {0.2, 0.7});
  const auto large = body.scaled(3, 2, 18, {0.1, 0.4});
  CHECK(large.mass() == doctest::Approx(4));
  CHECK(large.bounding_radius() == doctest::Approx(3 * body.bounding_radius()).epsilon(1e-14));
  CHECK(large.shape().volume() == doctest::Approx(27 * compound.volume()).epsilon(1e-14));
  CHECK(norm(large.inertia() - 18.0 * body.inertia()) < 1e-14);
  CHECK(norm(large.shape_origin() - 3.0 * body.shape_origin()) < 1e-15);
  CHECK(large.material().friction == 0.4);
  const auto single = body.cast<float>();
  static_assert(std::is_same_v<decltype(single)::Shape, Compound<float, 4, AnyConvexShape<float>>>);
  CHECK(single.bounding_radius() == doctest::Approx(body.bounding_radius()).epsilon(1e-6));
  CHECK(norm(single.cast<double>().inertia() - body.inertia()) < 1e-6);
  // The area turned towards a flow is at most that of all parts.
  const Pair halves{{Box{0.15, 0.2, 0.1}, {-0.15, 0, 0}}, {Box{0.15, 0.2, 0.1}, {0.15, 0, 0}}};
  CHECK(halves.frontal({0, 0, 2}, 1.0) == doctest::Approx(Box{0.3, 0.2, 0.1}.frontal({0, 0, 2}, 1.0)));
}

TEST_CASE("plain shapes and smaller compounds stand where larger compounds do") {
  const Body<double, Sphere<double>> ball(Sphere<double>{0.1}, 1.0, {0.3, 0.4});
  const Bodies from_ball(ball);
  CHECK(from_ball.mass() == 1);
  CHECK(from_ball.inertia() == ball.inertia());
  const Pair pair{{Sphere{0.1}}, {Box{0.1, 0.1, 0.1}, {0.2, 0, 0}}};
  const Compound<double, 5> more = pair;
  CHECK(more.size() == 2);
  CHECK(more.volume() == pair.volume());
  const System<double, 2, Compound<double, 5>> mixed{
      {Body<double, Compound<double, 5>>(Body(pair, 1.0)), ball}};
  CHECK(mixed[1].shape().describe() == "compound of 1 part and bounding radius 0.1 m");
}

TEST_CASE("what is no compound is refused") {
  using Parts = std::vector<Pair::Part>;
  const auto error = [](const Parts& parts) { return error_of([&] { Pair compound(parts); }); };
  CHECK(error({}) == "compound: expected a part or more, found none");
  const Pair::Part ball{Sphere{0.1}};
  CHECK(error({ball, ball, ball}) == "compound: expected at most 2 parts, found 3");
  CHECK(error({ball, {Sphere{-0.1}}}).find("part 1, sphere radius: expected a positive length") == 0);
  CHECK(error({{Sphere{0.1}, {0, NAN, 0}}}).find("part 0, position y: expected a finite number") == 0);
  CHECK(error({{Sphere{0.1}, {0, 1e20, 0}}}).find("part 0, position: expected from -1e+15 to 1e+15 m") == 0);
  CHECK(error({{Sphere{0.1}, {}, {0, 0, 0, 1.1}}}).find("part 0, orientation: expected a unit quaternion") ==
        0);
  CHECK(error({{Sphere{0.1}, {}, {}, 0.0}}).find("part 0, density: expected a positive number") == 0);
  CHECK(error_of([&] {
          Bodies(Pair{ball}, -1.0);
        }).find("body (compound of 1 part and bounding radius 0.1 m, -1 kg)") == 0);
}
