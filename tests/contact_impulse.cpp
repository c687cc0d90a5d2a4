#include <doctest/doctest.h>

#include <algorithm>
#include <rbres/rbres.hpp>

using namespace rbres;

namespace {

using Boxes = System<double, 2, Box<double>>;

/// Two boxes that touch somewhere, and approach.
struct Collision {
  Boxes system;
  SystemState<double, 2> y;
};
Collision random_impact(std::uint64_t stream, const Material<double>& material) {
  Random r(5, stream);
  const auto half = [&] { return r.uniform(0.1, 0.3); };
  Collision impact{{{Body{Box{half(), half(), half()}, r.uniform(0.5, 3), material},
                     Body{Box{half(), half(), half()}, r.uniform(0.5, 3), material}}},
                   {}};
  auto& y = impact.y;
  for (auto& body : y.body) {
    body.orientation = normalized(Quat<double>{r.normal(), r.normal(), r.normal(), r.normal()});
    body.velocity = {r.normal(), r.normal(), r.normal()};
    body.angular_velocity = {r.normal(), r.normal(), r.normal()};
  }
  y[1].position = {r.normal(), r.normal(), r.normal()};
  for (int i = 0; i < 100; ++i) {  // moves along the normal until they touch
    detail::with_manifold(impact.system, y, 0, 1,
                          [&](const auto& m, auto) { y[1].position -= m.separation * m.normal; });
  }
  return impact;
}

struct Sums {
  Vec3<double> linear, angular;
  double energy;
  Sums(const Collision& impact)
      : linear(linear_momentum(impact.system, impact.y)),
        angular(angular_momentum(impact.system, impact.y)),
        energy(kinetic_energy(impact.system, impact.y)) {}
};

/// Resolves the impact; returns the normal speeds before and after at the points that approached.
std::vector<std::pair<double, double>> resolve(Collision& impact) {
  std::vector<std::pair<double, double>> speeds;
  detail::with_manifold(impact.system, impact.y, 0, 1, [&](const auto& m, auto is_plane) {
    if constexpr (!decltype(is_plane)::value) {
      constexpr std::size_t points = std::decay_t<decltype(m)>::points;
      std::array<bool, points> touching;
      for (std::size_t i = 0; i < points; ++i) touching[i] = m.gap[i] < 1e-9;
      Motion<double> a = motion_of(impact.system[0], impact.y[0]),
                     b = motion_of(impact.system[1], impact.y[1]);
      const auto speed = [&](std::size_t i) {
        return dot(m.normal, b.velocity + cross(b.angular_velocity, m.point[i] - b.position) - a.velocity -
                                 cross(a.angular_velocity, m.point[i] - a.position));
      };
      std::array<double, points> before{};
      for (std::size_t i = 0; i < points; ++i) before[i] = speed(i);
      resolve_impact<false>(m, touching, detail::surface_of(impact.system, 0, 1), 0.0, 0.0, a, b);
      for (std::size_t i = 0; i < points; ++i) {
        if (touching[i] && before[i] < 0) speeds.push_back({before[i], speed(i)});
      }
      set_velocities(impact.y[0], a);
      set_velocities(impact.y[1], b);
    }
  });
  return speeds;
}

}  // namespace

TEST_CASE("an impact keeps momentum, never gains energy, and leaves with the restitution asked for") {
  int hits = 0;
  for (std::uint64_t i = 0; i < 500; ++i) {
    CAPTURE(i);
    Random r(6, i);
    const double e = r.uniform(), mu = r.uniform();
    Collision impact = random_impact(i, {e, mu});
    const Sums before(impact);
    const auto speeds = resolve(impact);
    const Sums after(impact);
    CHECK(norm(after.linear - before.linear) < 1e-13 * (1 + norm(before.linear)));
    CHECK(norm(after.angular - before.angular) < 1e-13 * (1 + norm(before.angular)));
    CHECK(after.energy <= before.energy * (1 + 1e-13));
    for (const auto& [came, left] : speeds) {
      ++hits;
      CHECK(left >= -e * came - 1e-12);
      if (speeds.size() == 1) CHECK(left == doctest::Approx(-e * came).epsilon(1e-9));
    }
  }
  CHECK(hits > 200);
}

TEST_CASE("without friction and with e = 1 the energy is kept") {
  for (std::uint64_t i = 0; i < 200; ++i) {
    CAPTURE(i);
    Collision impact = random_impact(i, {1, 0});
    const Sums before(impact);
    if (resolve(impact).size() > 1) continue;
    CHECK(Sums(impact).energy == doctest::Approx(before.energy).epsilon(1e-13));
  }
}

TEST_CASE("friction slides against the slip, and sticks within its cone") {
  // A box that lands flat on the floor while it slides.
  const double mu = 0.4, down = 1;
  for (const double along : {0.1, 3.0}) {
    const Material<double> material{0, mu};
    const System<double, 1, Box<double>> system{{Body{Box{0.3, 0.2, 0.001}, 2.0, material}},
                                                {floor_plane(material)}};
    SystemState<double, 1> y;
    y[0].position.z = 0.001;
    y[0].velocity = {along, 0, -down};
    detail::with_manifold(system, y, -1, 0, [&](const auto& m, auto is_plane) {
      if constexpr (decltype(is_plane)::value) {
        std::array<bool, 8> touching;
        for (std::size_t i = 0; i < 8; ++i) touching[i] = m.gap[i] < 1e-9;
        Motion<double> none{}, b = motion_of(system[0], y[0]);
        resolve_impact<true>(m, touching, detail::surface_of(system, -1, 0), 0.0, 0.0, none, b);
        CHECK(std::abs(b.velocity.x - std::max(along - mu * down, 0.0)) < 1e-12);
        CHECK(std::abs(b.velocity.y) < 1e-12);
        CHECK(std::abs(b.velocity.z) < 1e-12);
        CHECK(norm(b.angular_velocity) < 1e-9);
      }
    });
  }
}

TEST_CASE("the order of a face's points does not matter") {
  for (std::uint64_t i = 0; i < 200; ++i) {
    CAPTURE(i);
    Random r(7, i);
    const double thickness = r.uniform(0.05, 0.3);
    const Material<double> material{0, r.uniform()};
    const System<double, 1, Box<double>> system{{Body{Box{0.3, 0.2, thickness}, 2.0, material}},
                                                {floor_plane(material)}};
    SystemState<double, 1> y;
    y[0].position.z = thickness;
    y[0].velocity = {r.normal(), r.normal(), -2};
    y[0].angular_velocity = {0, 0, 3 * r.normal()};
    detail::with_manifold(system, y, -1, 0, [&](const auto& m, auto is_plane) {
      if constexpr (decltype(is_plane)::value) {
        auto reversed = m;
        std::reverse(reversed.point.begin(), reversed.point.end());
        std::reverse(reversed.gap.begin(), reversed.gap.end());
        const auto landed = [&](const auto& manifold) {
          std::array<bool, 8> touching;
          for (std::size_t k = 0; k < 8; ++k) touching[k] = manifold.gap[k] < 1e-9;
          Motion<double> none{}, b = motion_of(system[0], y[0]);
          resolve_impact<true>(manifold, touching, detail::surface_of(system, -1, 0), 0.0, 0.0, none, b);
          return b;
        };
        const Motion<double> a = landed(m), b = landed(reversed);
        CHECK(norm(a.velocity - b.velocity) < 1e-8);
        CHECK(norm(a.angular_velocity - b.angular_velocity) < 1e-8);
      }
    });
  }
}

TEST_CASE("two surfaces share the larger restitution and the geometric mean of friction, in either order") {
  const Material<double> rubber{0.7, 0.9}, ice{0.2, 0.1};
  const auto ball = [](const Material<double>& m) { return Body{Sphere{0.1}, 1.0, m}; };
  const System<double, 2, Sphere<double>> system{{ball(rubber), ball(ice)}, {floor_plane(ice)}};
  for (const auto& [first, second] : {std::pair{0, 1}, std::pair{1, 0}, std::pair{-1, 0}}) {
    const Surface<double> surface = detail::surface_of(system, first, second);
    CHECK(surface.restitution == 0.7);
    CHECK(surface.friction == doctest::Approx(0.3).epsilon(1e-15));
  }
  CHECK(detail::surface_of(system, -1, 1).restitution == 0.2);
  CHECK(detail::surface_of(system, -1, 1).friction == doctest::Approx(0.1).epsilon(1e-15));
}

namespace {

/// A box in the corner of a floor and two walls, and one on top of it that also touches a wall: all points
/// that touch.
template <class S>
struct Corner {
  using Bodies = System<S, 2, Box<S>>;
  Bodies system;
  detail::MotionsOf<Bodies> motion;
  detail::ContactRows<Bodies> rows;

  explicit Corner(const System<double, 2, Box<double>>& plain)
      : system(plain.template cast<S>()), motion{}, rows(system) {}

  /// The impulses that stop these velocities (m/s, rad/s; of both bodies).
  void solve(const std::array<Vec3<S>, 4>& v) {
    typename Bodies::State y;
    y[0].position = {S(0.1), S(0.1), S(0.1)};
    y[1].position = {S(0.1), S(0.12), S(0.25)};
    for (int i = 0; i < 2; ++i) {
      y[i].velocity = v[std::size_t(2 * i)];
      y[i].angular_velocity = v[std::size_t(2 * i + 1)];
    }
    for (int i = 0; i < 2; ++i) motion[std::size_t(i)] = motion_of(system[i], y[i]);
    rows.clear();
    for (const Candidate& who :
         {Candidate{-1, 0}, Candidate{-2, 0}, Candidate{-3, 0}, Candidate{-2, 1}, Candidate{0, 1}}) {
      detail::ContactPair<Bodies> pair(system, who, S(1e-3));
      pair.find(system, y, pair.manifold);
      for (std::size_t i = 0; i < pair.points; ++i) {
        const MaskOf<S> touches = pair.manifold.gap[i] < S(1e-9);
        if (any(touches)) rows.add(pair, pair.manifold, i, touches, S(0), pair.surface.friction, motion);
      }
    }
    rows.solve(motion, MaskOf<S>(true));
  }
};

System<double, 2, Box<double>> corner_of(double friction) {
  const Material<double> m{0, friction};
  return {{Body{Box{0.1, 0.1, 0.1}, 1.0, m}, Body{Box{0.1, 0.08, 0.05}, 3.0, m}},
          {floor_plane(m), {{1, 0, 0}, 0, m}, {{0, 1, 0}, 0, m}}};
}

}  // namespace

TEST_CASE("points of several surfaces obey the contact laws together, and in lanes as alone") {
  Random random(1, 1);
  const auto draw = [&] {
    return Vec3<double>{random.uniform(-2, 1), random.uniform(-2, 1), random.uniform(-2, 1)};
  };
  for (const double friction : {0.0, 0.3, 1.0}) {
    CAPTURE(friction);
    const auto plain = corner_of(friction);
    Corner<double> alone(plain);
    using Lanes = Pack<double, 2>;
    Corner<Lanes> lanes(plain);
    for (int k = 0; k < 100; ++k) {
      CAPTURE(k);
      std::array<Vec3<double>, 4> v{draw(), draw(), draw(), draw()};
      std::array<Vec3<Lanes>, 4> both;
      for (std::size_t i = 0; i < 4; ++i) both[i] = {Lanes(v[i].x), Lanes(v[i].y), Lanes(v[i].z)};
      lanes.solve(both);
      alone.solve(v);
      int count = 0;
      alone.rows.each(alone.motion, [&](auto&, auto& point, auto& a, auto& b) {
        const auto& [p, pu, pv] = point.impulse();
        const double n = point.velocity(0, a, b), u = point.velocity(1, a, b), w = point.velocity(2, a, b);
        ++count;
        CHECK(p >= 0);
        CHECK(n > -1e-8);
        CHECK(p * n < 1e-8);
        const double along = std::hypot(pu, pv), slip = std::hypot(u, w);
        CHECK(along <= friction * p + 1e-12);
        // Where it slides, friction is all there is, against the slip.
        if (slip > 1e-6 && friction > 0) CHECK(pu * u + pv * w < -0.999 * friction * p * slip + 1e-12);
      });
      CHECK(count >= 16);
      for (std::size_t i = 0; i < 2; ++i) {
        const auto of_lane = [](const Lanes& x) { return x.v[1]; };
        CHECK(norm(detail::mapped(lanes.motion[i].velocity, of_lane) - alone.motion[i].velocity) < 1e-8);
      }
    }
  }
}

TEST_CASE("Newton's method solves chains of balls by itself, for the velocities of their few points") {
  constexpr int most = 8;
  using Bodies = System<double, most, AnyShape<double>>;
  Random random(1, 2);
  for (const double friction : {0.0, 0.3, 1.0}) {
    for (int count = 2; count <= most; ++count) {
      CAPTURE(friction);
      CAPTURE(count);
      const Material<double> m{0, friction};
      std::array<double, most> radii;
      SystemState<double, most> y;
      for (int i = 0; i < most; ++i) {  // each leans on the one below
        const double radius = radii[std::size_t(i)] = random.uniform(0.05, 0.2);
        const auto draw = [&] { return random.uniform(-1, 1); };
        y[i].position.z = radius;
        if (i > 0) {
          const double apart = radius + radii[std::size_t(i - 1)];
          y[i].position = y[i - 1].position + apart * Vec3<double>{0.6, 0, 0.8};
        }
        y[i].velocity = {draw(), draw(), -1.0 * i + draw()};
        y[i].angular_velocity = {draw(), draw(), draw()};
      }
      const auto ball = [&](std::size_t i) {
        return Body<double>(Sphere{radii[i]}, random.uniform(0.1, 10), m);
      };
      const Bodies system{{ball(0), ball(1), ball(2), ball(3), ball(4), ball(5), ball(6), ball(7)},
                          {floor_plane(m)}};
      detail::MotionsOf<Bodies> motion;
      for (int i = 0; i < most; ++i) motion[std::size_t(i)] = motion_of(system[i], y[i]);
      detail::ContactRows<Bodies> rows(system);
      for (int i = 0; i < count; ++i) {
        detail::ContactPair<Bodies> pair(system, {i - 1, i}, 1e-3);
        pair.find(system, y, pair.manifold);
        CHECK(std::abs(pair.manifold.gap[0]) < 1e-12);
        rows.add(pair, pair.manifold, 0, true, 0.0, friction, motion);
      }
      detail::PointEquations<Bodies, double> equations(system);
      CHECK(equations.take_up(rows, motion));
      detail::CoupledNewton<Bodies, double> newton(system, most);
      CHECK(newton.solve(rows, motion, true, 1e-12, 1e-12, 1e-12));
      rows.each(motion, [&](auto&, auto& point, auto& a, auto& b) {
        const auto& [p, pu, pv] = point.impulse();
        const double n = point.velocity(0, a, b), u = point.velocity(1, a, b), w = point.velocity(2, a, b);
        CHECK(p >= 0);
        CHECK(n > -1e-11);
        CHECK(p * n < 1e-10);
        CHECK(std::hypot(pu, pv) <= friction * p + 1e-12);
        if (std::hypot(u, w) > 1e-6)
          CHECK(pu * u + pv * w <= -0.999 * friction * p * std::hypot(u, w) + 1e-12);
      });
    }
  }
}

TEST_CASE_TEMPLATE("Newton's method solves impacts of bodies of any size by itself", S, double, float) {
  for (const double half : {0.01, 0.1, 20.0}) {
    for (const double friction : {0.0, 0.3, 1.0}) {
      CAPTURE(half);
      CAPTURE(friction);
      const Box<S> box{S(half), S(half), S(0.5 * half)};
      const Body<S, Box<S>> body(box, S(4000 * half * half * half), Material<S>{});
      // From one corner to all four of a face; speeds as of a fall as deep as the body is large.
      for (std::size_t points = 1; points <= 4; ++points) {
        CAPTURE(points);
        const S speed = S(std::sqrt(10 * half));
        RigidState<S> state;
        state.velocity = speed * Vec3<S>{S(0.4), S(-0.2), S(-1)};
        state.angular_velocity = (speed / S(half)) * Vec3<S>{S(0.1), S(0.2), S(-0.3)};
        Motion<S> motion = motion_of(body, state);
        std::vector<ContactPoint<S, true>> contacts;
        for (std::size_t i = 0; i < points; ++i) {
          const Vec3<S> corner{i & 1 ? box.half.x : -box.half.x, i & 2 ? box.half.y : -box.half.y,
                               -box.half.z};
          contacts.emplace_back(Vec3<S>{S(0), S(0), S(1)}, corner, motion, motion);
        }
        const S tolerance = S(std::is_same_v<S, float> ? 1e-5 : 1e-12) * speed;
        if (points == 1) {
          detail::PointNewton<S> newton(contacts[0], S(0), true, motion, motion);
          CHECK_FALSE(newton.solve(S(friction), tolerance));
          newton.apply(S(friction), contacts[0], motion, motion);
        } else {
          detail::PairNewton<S, true, 4> newton(contacts[0].frame(), motion, motion);
          for (const auto& contact : contacts) newton.add(contact, S(0), true);
          CHECK_FALSE(newton.solve(S(friction), tolerance));
          for (std::size_t i = 0; i < points; ++i) newton.apply(i, S(friction), contacts[i], motion, motion);
        }
        for (const auto& contact : contacts) CHECK(contact.velocity(0, motion, motion) > S(-4) * tolerance);
      }
    }
  }
}

TEST_CASE("friction is solved where Newton's method fails and sweeps solve the normals") {
  Random random(1, 1);
  const auto draw = [&] {
    return Vec3<double>{random.uniform(-2, 1), random.uniform(-2, 1), random.uniform(-2, 1)};
  };
  Corner<double> corner(corner_of(1.0));
  for (int k = 0; k < 2010; ++k) {
    const std::array<Vec3<double>, 4> v{draw(), draw(), draw(), draw()};
    if (k != 1735 && k != 1893 && k != 2009) continue;
    CAPTURE(k);
    corner.solve(v);
    corner.rows.each(corner.motion, [&](auto&, auto& point, auto& a, auto& b) {
      const auto& [p, pu, pv] = point.impulse();
      const double u = point.velocity(1, a, b), w = point.velocity(2, a, b);
      const double slip = std::hypot(u, w), along = std::hypot(pu, pv);
      if (along < p - 1e-6) CHECK(slip < 1e-6);
      CHECK(pu * u + pv * w <= -(1 - 1e-6) * p * slip + 1e-6);
    });
  }
}

TEST_CASE_TEMPLATE("impulses are within their cones where no method solves the laws, too", S, double, float) {
  Random random(1, 1);
  const auto draw = [&] {
    return Vec3<S>{S(random.uniform(-2, 1)), S(random.uniform(-2, 1)), S(random.uniform(-2, 1))};
  };
  const S rounding = std::is_same_v<S, float> ? S(1e-5) : S(1e-12);
  for (const double friction : {1.0, 5.0, 20.0}) {
    CAPTURE(friction);
    Corner<S> corner(corner_of(friction));
    for (int k = 0; k < 400; ++k) {
      CAPTURE(k);
      const std::array<Vec3<S>, 4> v{draw(), draw(), draw(), draw()};
      corner.solve(v);
      corner.rows.each(corner.motion, [&](auto& row, auto& point, auto&, auto&) {
        const auto& [p, pu, pv] = point.impulse();
        CHECK(p >= -rounding);
        CHECK(std::hypot(pu, pv) <= row.friction * std::max(p, S(0)) + rounding);
      });
    }
  }
}
