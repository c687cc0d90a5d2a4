#include <doctest/doctest.h>

#include <rbres/rbres.hpp>

using namespace rbres;

namespace {

constexpr double pi = std::numbers::pi;

/// Whether f refuses with a message that starts like this.
template <class F>
bool refuses(const F& f, std::string_view expected) {
  try {
    f();
  } catch (const Error& error) {
    INFO(error.what());
    CHECK(std::string_view(error.what()).starts_with(expected));
    return true;
  }
  return false;
}
#define CHECK_REFUSED(expression, expected) CHECK(refuses([&] { (void)(expression); }, expected))

}  // namespace

TEST_CASE("mass properties are those of the closed forms") {
  const auto sphere = Body<double, Sphere<double>>::of_density(Sphere{0.3}, 1000.0);
  CHECK(sphere.mass() == doctest::Approx(1000 * 4.0 / 3 * pi * 0.027).epsilon(1e-14));
  CHECK(sphere.inertia().x == doctest::Approx(0.4 * sphere.mass() * 0.09).epsilon(1e-14));

  const Body box{Box{0.1, 0.2, 0.3}, 12.0};
  CHECK(box.inertia().x == doctest::Approx(0.16 + 0.36).epsilon(1e-14));
  CHECK(box.inertia().y == doctest::Approx(0.04 + 0.36).epsilon(1e-14));
  CHECK(box.inertia().z == doctest::Approx(0.04 + 0.16).epsilon(1e-14));
  CHECK(box.shape().volume() == doctest::Approx(8 * 0.006).epsilon(1e-14));

  // A capsule against the sum of its slices.
  const Capsule capsule{0.2, 0.3};
  double volume = 0, along = 0, across = 0;
  const int slices = 200000;
  for (int i = 0; i < slices; ++i) {
    const double dz = 1.0 / slices, z = -0.5 + (i + 0.5) * dz, beyond = std::max(std::abs(z) - 0.3, 0.0);
    const double r2 = 0.04 - beyond * beyond, area = pi * r2;
    volume += area * dz;
    along += area * dz * r2 / 2;
    across += area * dz * (r2 / 4 + z * z);
  }
  CHECK(capsule.volume() == doctest::Approx(volume).epsilon(1e-9));
  CHECK(capsule.unit_inertia().z == doctest::Approx(along / volume).epsilon(1e-9));
  CHECK(capsule.unit_inertia().x == doctest::Approx(across / volume).epsilon(1e-9));
}

TEST_CASE("any inertia tensor is taken to its principal axes") {
  const Eigen::Vector3d moments(1, 2, 2.5);
  const Eigen::Quaterniond turn = Eigen::Quaterniond(0.9, 0.1, -0.3, 0.2).normalized();
  const Eigen::Matrix3d tensor = turn * moments.asDiagonal() * turn.conjugate();
  const auto principal = principal_inertia<double>(tensor);
  const Eigen::Matrix3d axes = Eigen::Quaterniond(principal.axes).toRotationMatrix();
  const Eigen::Matrix3d back = axes * Eigen::Vector3d(principal.moments).asDiagonal() * axes.transpose();
  CHECK((back - tensor).cwiseAbs().maxCoeff() < 1e-14);
  CHECK(axes.determinant() == doctest::Approx(1));

  // The body's frame is the principal one; its shape stands turned in it.
  const Body<double, Box<double>> body(Box<double>{0.1, 0.2, 0.3}, 4.0, tensor);
  RigidState<double> state;
  const Mat3<double> shape = shape_pose(body, state).axes;
  const Eigen::Vector3d x = Eigen::Vector3d(shape.x);
  CHECK((x - axes.transpose().col(0)).norm() < 1e-14);
}

TEST_CASE("a body in another scalar is the same body, however its shape stands in it") {
  Eigen::Matrix3d tensor;
  tensor << 0.010, 0.002, -0.001, 0.002, 0.012, 0.003, -0.001, 0.003, 0.015;
  const auto check = [&](const auto& shape) {
    using Shape = std::decay_t<decltype(shape)>;
    const Material<double> material{0.25, 0.5};
    for (const bool turned : {false, true}) {
      const Body<double, Shape> body = turned ? Body<double, Shape>(shape, 2.0, tensor, material)
                                              : Body<double, Shape>(shape, 2.0, material);
      CHECK((norm(Vec3<double>{body.shape_rotation().x, body.shape_rotation().y, body.shape_rotation().z}) >
             0.1) == turned);
      const auto same = [&](const auto& other) {
        const auto at = [](const auto& x) { return ScalarTraits<std::decay_t<decltype(x)>>::lane(x, 0); };
        const Quat<double>& p = body.shape_rotation();
        const auto& q = other.shape_rotation();
        CHECK(std::array{double(at(q.x)), double(at(q.y)), double(at(q.z)), double(at(q.w))} ==
              std::array{p.x, p.y, p.z, p.w});
        CHECK(std::array{double(at(other.inertia().x)), double(at(other.inertia().y)),
                         double(at(other.inertia().z)), double(at(other.mass())),
                         double(at(other.material().friction)), double(at(other.bounding_radius()))} ==
              std::array{body.inertia().x, body.inertia().y, body.inertia().z, body.mass(),
                         body.material().friction, body.bounding_radius()});
      };
      same(body.template cast<double>());
      same(body.template cast<Pack<double, 4>>());
      same(body.scaled(1, 1, 1, material));
      same(Body<double>(body));
      same(Body<double>(body).template cast<double>());
    }
  };
  check(Sphere{0.1});
  check(Box{0.1, 0.2, 0.3});
  check(Capsule{0.1, 0.2});
}

TEST_CASE("impossible bodies are refused, and the message says which and why") {
  const auto ball = [](const char* mass) {
    return detail::text("body (sphere of radius 0.1 m, ", mass, " kg), ");
  };
  CHECK_REFUSED((Body{Sphere{0.1}, 0.0}), ball("0") + "mass: expected a positive number of kg, found 0");
  CHECK_REFUSED((Body{Sphere{0.1}, double(NAN)}),
                ball("nan") + "mass: expected a positive number of kg, found nan");
  CHECK_REFUSED((Body{Sphere{-0.1}, 1.0}),
                "body (sphere of radius -0.1 m, 1 kg), sphere radius: expected a "
                "positive length, found -0.1");
  CHECK_REFUSED((Body{Box{0.1, 0.0, 0.1}, 1.0}),
                "body (box of half extents (0.1, 0, 0.1) m, 1 kg), box half "
                "extent: expected a positive length, found 0");
  CHECK_REFUSED((Body{Capsule{0.1, -1.0}, 1.0}),
                "body (capsule of radius 0.1 m and half length -1 m, 1 kg), "
                "capsule half length: expected a length of 0 or more, found -1");
  CHECK_REFUSED(
      (Body{Sphere{0.1}, 1.0, Vec3<double>{1, 1, 3}}),
      ball("1") + "inertia: expected no moment larger than the sum of the other two, found (1, 1, 3)");
  CHECK_REFUSED((Body{Sphere{0.1}, 1.0, Vec3<double>{1, -1, 1}}),
                ball("1") + "inertia: expected three positive moments (kg m^2), found (1, -1, 1)");
  CHECK_REFUSED((Body{Sphere{0.1}, 1.0, Material<double>{1.5, 0.3}}),
                ball("1") + "restitution: expected a number in [0, 1], found 1.5");
  CHECK_REFUSED((Body{Sphere{0.1}, 1.0, Material<double>{0.5, -0.3}}),
                ball("1") + "friction: expected a number of 0 or more, found -0.3");
  Eigen::Matrix3d tensor = Eigen::Matrix3d::Identity();
  tensor(0, 1) = 0.5;
  using Ball = Body<double, Sphere<double>>;
  CHECK_REFUSED((Ball{Sphere{0.1}, 1.0, tensor}), ball("1") + "inertia tensor: expected a symmetric matrix");
  tensor(0, 0) = INFINITY;
  CHECK_REFUSED((Ball{Sphere{0.1}, 1.0, tensor}), ball("1") + "inertia tensor: expected finite numbers");
  const Body good{Sphere{0.1}, 1.0};
  CHECK_REFUSED((System<double, 1, Sphere<double>>{{good}, {Plane<double>{{0, 0, 2}, 0, {}}}}),
                "plane 0, normal: expected a unit vector, found one of length 2");
  CHECK_REFUSED((System<double, 1, Sphere<double>>{{good}, {{}, {{0, 0, 1}, 0, {0.5, NAN}}}}),
                "plane 1, friction: expected a number of 0 or more, found nan");
}

TEST_CASE("numbers whose squares or inverses overflow are refused") {
  const auto refused = [](const auto& body) {
    try {
      body();
    } catch (const Error& error) {
      INFO(error.what());
      CHECK(std::string(error.what()).find(": expected from ") != std::string::npos);
      return true;
    }
    return false;
  };
  const auto sphere = [&](double radius, double mass) {
    return refused([&] { (void)Body{Sphere{radius}, mass}; });
  };
  for (const double large : {1e41, 1e200, 1e-41, 1e-200}) CHECK(sphere(0.1, large));
  for (const double large : {1e16, 1e200, 1e-16, 1e-200}) CHECK(sphere(large, 1));
  for (const double kept : {1e10, 1e-10}) CHECK(!sphere(kept, 1 / kept));
  CHECK(refused([] { (void)Body{Box{1.0, 1e200, 1.0}, 1.0}; }));
  CHECK(refused([] { (void)Body{Capsule{1e-200, 1.0}, 1.0}; }));
  CHECK(refused([] { (void)Body{Capsule{1.0, 1e200}, 1.0}; }));
  CHECK(!refused([] { (void)Body{Capsule{1.0, 0.0}, 1.0}; }));
  for (const double moment : {1e200, 1e-200})
    CHECK(refused([&] { (void)Body{Sphere{0.1}, 1.0, Vec3<double>{moment, moment, moment}}; }));
  CHECK(refused([] { (void)Body{Sphere{0.1}, 1.0, Material<double>{0.5, 1e200}}; }));
  CHECK(refused([] { (void)Body{Sphere{0.1f}, 1e20f}; }));
  CHECK(refused([] { (void)Body{Sphere{1e-10f}, 1.0f}; }));
  CHECK(refused([] { (void)Body{Sphere{0.1}, 1e30}.cast<float>(); }));
}

TEST_CASE_TEMPLATE("bodies at the limits move and collide with finite numbers", S, float, double) {
  using Limits = BodyLimits<S>;
  const auto length = static_cast<S>(Limits::length), mass = static_cast<S>(Limits::mass),
             moment = static_cast<S>(Limits::moment);
  const Material<S> rough{S(0.5), S(1)};
  using Box1 = Body<S, Box<S>>;
  // What turns most and least easily, on the largest and the smallest levers.
  for (const S& radius : {length, S(1 / length)})
    for (const S& m : {mass, S(1 / mass)})
      for (const S& i : {moment, S(1 / moment)}) {
        CAPTURE(radius);
        CAPTURE(m);
        CAPTURE(i);
        const Box<S> box(radius, radius, radius);
        const System<S, 2, Box<S>> system{{Box1(box, m, Vec3<S>{i, i, i}, rough), Box1(box, S(1), rough)},
                                          {floor_plane(rough)}};
        for (const auto mode : {ContactMode::continuous, ContactMode::discrete}) {
          SystemState<S, 2> y;
          y[0].position = {S(0), S(0), S(radius * S(1.001))};
          y[1].position = {S(radius * S(0.1)), S(0), S(radius * S(3.002))};
          y[0].velocity.z = -radius, y[1].velocity.x = radius;
          const auto nothing = [](const auto&, const auto&) { return Wrench<S>{}; };
          const auto report =
              simulate(system, y, nothing, Rk4{}, {.step = 0.01, .duration = 0.1, .contacts = mode});
          CHECK(report.status == SimulationStatus::finished);
        }
      }
}

TEST_CASE("states can be copied as bytes") {
  static_assert(std::is_trivially_copyable_v<Vec3<double>> && std::is_trivially_copyable_v<Quat<float>>);
  static_assert(std::is_trivially_copyable_v<SystemState<float, 3>> &&
                std::is_standard_layout_v<SystemState<float, 3>>);
  static_assert(sizeof(SystemState<double, 5>) == 520 && sizeof(Wrench<double>) == 48);
  SystemState<double, 2> y;
  for (int i = 0; i < 26; ++i) y.vector()(i) = i;
  CHECK(y[1].position.x == 13);
  CHECK(y[1].orientation.w == 19);
  CHECK(y[1].velocity.x == 20);
  CHECK(y[1].angular_velocity.z == 25);
}
