#pragma once

#include "free_motion.hpp"

namespace validate {

/// Watches impacts only.
template <class OnImpact>
struct ImpactWatch {
  OnImpact on_impact;
  template <class State>
  void impact(double time, const State& before, const State& after) {
    on_impact(time, before, after);
  }
};
template <class OnImpact>
ImpactWatch(OnImpact) -> ImpactWatch<OnImpact>;

inline System<double, 1, Sphere<double>> ball_over_floor(double restitution) {
  const Material<double> material{restitution, 0.0};
  return {{Body{Sphere{0.1}, 1.0, material}}, {floor_plane(material)}};
}

/// A sphere dropped from one metre bounces to e^2, e^4, ... of it.
inline void bounces(Rows& rows) {
  constexpr double g = 9.81, height = 1;
  for (const char* name : {"0", "0.25", "0.5", "0.75", "0.9", "1"}) {
    const double e = std::atof(name);
    const auto system = ball_over_floor(e);
    SystemState<double, 1> y;
    y[0].position.z = 0.1 + height;
    SystemState<double, 1> last = y;
    int apexes = 0;
    double expected = height;
    Worst worst;
    const double fall = std::sqrt(2 * height / g);
    simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-4, .duration = 6}, [&](double time, const auto& now) {
      const double up = last[0].velocity.z;
      if (e == 0) {
        if (time < fall + 1e-3) return true;
        worst(std::abs(now[0].position.z - 0.1) / height);  // stays on the floor
        ++apexes;
      } else if (up > 0 && now[0].velocity.z <= 0) {
        expected *= e * e;
        worst(relative(last[0].position.z - 0.1 + up * up / (2 * g), expected));
        ++apexes;
      }
      last = now;
      return apexes < 5;
    });
    if (apexes < 5) worst(NAN);
    rows.push_back({detail::text("bounce_e", name), worst.value(), 1e-9, "relative",
                    "apex heights e^(2n) h of five bounces, h = 1 m (Bullet loses half in one); chosen: "
                    "g = 9.81, step 0.2 ms, so that the last bounces of e = 0.25 take several steps"});
  }

  const auto system = ball_over_floor(1);
  SystemState<double, 1> y;
  y[0].position.z = 0.1 + height;
  const Vec3<double> gravity{0, 0, -g};
  const double start = energy(system, y, gravity);
  int bounces = 0;
  double error = 0;
  const auto until = [&](double, const auto& now) {
    error = relative(energy(system, now, gravity), start);
    return bounces < 1000;
  };
  struct Observer {
    const decltype(until)& look;
    int& bounces;
    bool operator()(double time, const SystemState<double, 1>& now) { return look(time, now); }
    void impact(double, const SystemState<double, 1>&, const SystemState<double, 1>&) { ++bounces; }
  };
  simulate(system, y, Gravity{}, Rk4{}, {.step = 2e-3, .duration = 1000}, Observer{until, bounces});
  rows.push_back({"bounce_e1_energy", bounces < 1000 ? NAN : error, 1e-9, "relative",
                  "kept over 1,000 bounces; chosen: 1 m high, g = 9.81, step 2 ms"});
}

/// Two spheres of unequal mass and size meet obliquely, with friction: once they stick, once they slide.
inline void oblique_impact(Rows& rows) {
  Worst worst;
  for (const double mu : {0.05, 0.8}) {
    const double e = 0.7, m1 = 1.5, m2 = 0.4, r1 = 0.3, r2 = 0.2;
    const Material<double> material{e, mu};
    const System<double, 2, Sphere<double>> system{
        {Body{Sphere{r1}, m1, material}, Body{Sphere{r2}, m2, material}}};
    SystemState<double, 2> y;
    y[0].velocity = {1, 0.2, -0.1};
    y[0].angular_velocity = {3, -2, 5};
    y[1].position = {1.1, 0.35, 0.2};
    y[1].velocity = {-2, -0.4, 0.3};
    y[1].angular_velocity = {-4, 1, 2};

    // Straight flight until the distance is r1 + r2.
    const Vec3<double> d = y[1].position - y[0].position, v = y[1].velocity - y[0].velocity;
    const double a = squared_norm(v), b = dot(d, v), c = squared_norm(d) - (r1 + r2) * (r1 + r2);
    const double time = c / (-b + std::sqrt(b * b - a * c));
    const Vec3<double> n = (1 / (r1 + r2)) * (d + time * v);
    // Newton's restitution along n, Coulomb's friction along the slip; a uniform ball's surface answers a
    // tangential impulse 7/2 times as much as its centre. Nothing turns a ball in flight, so its spin is
    // compared in the body frame as it was at the start (orientation identity) and turned by the flight.
    const Quat<double> q1 = fly(system, no_force, DormandPrince54{1e-15, 1e-16}, y, 0.0, time)[0].orientation;
    const Quat<double> q2 = fly(system, no_force, DormandPrince54{1e-15, 1e-16}, y, 0.0, time)[1].orientation;
    const Vec3<double> w1 = rotate(q1, y[0].angular_velocity), w2 = rotate(q2, y[1].angular_velocity);
    const Vec3<double> slip_all = v - cross(r2 * w2 + r1 * w1, n);
    const double approach = dot(slip_all, n);
    const Vec3<double> slip = slip_all - approach * n;
    const double along_n = -(1 + e) * approach / (1 / m1 + 1 / m2);
    const double sticking = norm(slip) / (3.5 * (1 / m1 + 1 / m2));
    const double along_t = std::min(sticking, mu * along_n);
    const Vec3<double> p = along_n * n - (along_t / norm(slip)) * slip;
    const Vec3<double> turn = cross(n, p);
    const Vec3<double> v1 = y[0].velocity - (1 / m1) * p, v2 = y[1].velocity + (1 / m2) * p;
    const Vec3<double> s1 = w1 - (r1 / (0.4 * m1 * r1 * r1)) * turn,
                       s2 = w2 - (r2 / (0.4 * m2 * r2 * r2)) * turn;

    simulate(system, y, no_force, Rk4{}, {.step = 1e-3, .duration = 0.4},
             ImpactWatch{[&](double, const auto&, const auto& after) {
               worst(difference(after[0].velocity, v1) / norm(v1));
               worst(difference(after[1].velocity, v2) / norm(v2));
               worst(difference(after[0].angular_velocity_world(), s1) / norm(s1));
               worst(difference(after[1].angular_velocity_world(), s2) / norm(s2));
             }});
    worst(difference(y[1].velocity, v2) / norm(v2));
  }
  rows.push_back(
      {"oblique_impact", worst.value(), 1e-12, "relative",
       "closed form: velocities and spins after; friction 0.05 (slides) and 0.8 (sticks), e = 0.7"});
}

/// What is kept in an impact: sums over all bodies.
struct Balance {
  Vec3<double> linear, angular;
  double energy, linear_scale = 0, angular_scale = 0;

  template <class System>
  Balance(const System& system, const typename System::State& y)
      : linear(linear_momentum(system, y)),
        angular(angular_momentum(system, y)),
        energy(kinetic_energy(system, y)) {
    for (int i = 0; i < System::bodies; ++i) {
      const Vec3<double> p = linear_momentum(system[i], y[i]);
      linear_scale += norm(p);
      angular_scale += norm(cross(y[i].position, p)) + norm(spin_angular_momentum(system[i], y[i]));
    }
  }
};

/// Random boxes and spheres thrown at one another, N at a time.
template <int N>
void cluster(std::uint64_t stream, bool elastic, Worst& linear, Worst& angular, Worst& energy,
             long& impacts) {
  Random random(2026, stream);
  const auto in = [&](double size) {
    return Vec3<double>{random.uniform(-size, size), random.uniform(-size, size),
                        random.uniform(-size, size)};
  };
  const auto body = [&](int) -> Body<double> {
    const Material<double> material{elastic ? 1.0 : random.uniform(), elastic ? 0.0 : random.uniform()};
    const double mass = random.uniform(0.2, 5);
    if (random.below(2) == 0) return Body{Sphere{random.uniform(0.05, 0.2)}, mass, material};
    return Body{Box{random.uniform(0.05, 0.2), random.uniform(0.05, 0.2), random.uniform(0.05, 0.2)}, mass,
                material};
  };
  const auto bodies = [&]<std::size_t... I>(std::index_sequence<I...>) {
    return std::array<Body<double>, N>{body(static_cast<int>(I))...};
  };
  const System<double, N> system{bodies(std::make_index_sequence<N>{})};
  SystemState<double, N> y;
  for (int i = 0; i < N; ++i) {
    // On a ring, so that none touches another at the start, and towards its middle.
    const double angle = 2 * std::numbers::pi * i / N;
    y[i].position = Vec3<double>{0.65 * std::cos(angle), 0.65 * std::sin(angle), 0} + in(0.02);
    y[i].orientation =
        normalized(Quat<double>{random.normal(), random.normal(), random.normal(), random.normal()});
    y[i].velocity = (-random.uniform(2, 5)) * y[i].position + in(0.3);
    y[i].angular_velocity = in(5);
  }
  simulate(system, y, no_force, Rk4{}, {.step = 5e-3, .duration = 0.6},
           ImpactWatch{[&](double, const auto& before, const auto& after) {
             const Balance a(system, before), b(system, after);
             linear(norm(b.linear - a.linear) / a.linear_scale);
             angular(norm(b.angular - a.angular) / a.angular_scale);
             energy(elastic ? std::abs(b.energy - a.energy) / a.energy : (b.energy - a.energy) / a.energy);
             ++impacts;
           }});
}

inline void momentum(Rows& rows) {
  const int clusters = 1000;
  Worst linear, angular, rise, change;
  long impacts = 0, elastic_impacts = 0;
  for (std::uint64_t i = 0; i < clusters; ++i) {
    const auto run = [&]<int N>(std::integral_constant<int, N>) {
      cluster<N>(i, false, linear, angular, rise, impacts);
      cluster<N>(clusters + i, true, linear, angular, change, elastic_impacts);
    };
    if (i % 3 == 0) run(std::integral_constant<int, 3>{});
    if (i % 3 == 1) run(std::integral_constant<int, 4>{});
    if (i % 3 == 2) run(std::integral_constant<int, 5>{});
  }
  if (impacts < clusters || elastic_impacts < clusters) linear(NAN);
  const auto scene = detail::text(
      "per impact; 1,000 clusters of 3-5 boxes and spheres, chosen: no floor, step 5 ms, "
      "thrown at 1.3 to 3.3 m/s from a ring of 0.65 m; ",
      impacts, " impacts");
  const auto elastic = detail::text("1,000 clusters with e = 1, no friction, ", elastic_impacts, " impacts");
  rows.push_back({"momentum_linear", linear.value(), 1e-11, "relative", scene + ", and " + elastic});
  rows.push_back({"momentum_angular", angular.value(), 1e-11, "relative", "the same"});
  rows.push_back({"momentum_energy_rise", rise.value(), 1e-11, "relative", scene});
  rows.push_back({"momentum_energy_elastic", change.value(), 1e-11, "relative", elastic});
}

/// Newton's cradle.
inline void cradle(Rows& rows) {
  const double r = 0.1, speed = 2;
  const auto system = System<double, 5, Sphere<double>>::of(Body{Sphere{r}, 1.0, Material<double>{1, 0}});
  SystemState<double, 5> y;
  for (int i = 0; i < 5; ++i) y[i].position.x = i * (2 * r + 1e-3 * r);
  y[0].position.x -= 0.1;
  y[0].velocity.x = speed;
  simulate(system, y, no_force, Rk4{}, {.step = 1e-3, .duration = 0.5});
  Worst worst;
  for (int i = 0; i < 4; ++i) worst(norm(y[i].velocity) / speed);
  worst(difference(y[4].velocity, {speed, 0, 0}) / speed);
  rows.push_back({"cradle", worst.value(), 1e-6, "relative",
                  "five spheres, gaps 1e-3 radii, e = 1: the last takes it all"});
}

inline void impacts(Rows& rows) {
  bounces(rows);
  oblique_impact(rows);
  momentum(rows);
  cradle(rows);
}

}  // namespace validate
