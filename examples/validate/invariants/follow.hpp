#pragma once

#include "worlds.hpp"

namespace validate {

/// What goes wrong with the forces on one body, in one lane, from some time on.
struct Fault {
  enum Kind {
    none,
    force,        ///< this force downwards, N
    torque,       ///< this torque about every axis, N m
    late_torque,  ///< the same at the end of each step alone
    spring,       ///< a spring to the origin of this stiffness per mass, 1/s^2
    cubic,        ///< a force along v of this times |v|^2 v, N
    spin,         ///< a torque of this times I w, N m
  } kind = none;
  double size = 0;
  double time = 0;  ///< s
  int index = 0, lane = 0;
  double step = 1;  ///< of the run, s
};

/// What the bodies of a run feel: a uniform pull, and what is meant to go wrong. Counts how often it is
/// asked.
struct Loads {
  Vector gravity{0, 0, 0};
  long* asked = nullptr;
  Fault fault{};

  template <class S, class Shape>
  Wrench<S> operator()(const Body<S, Shape>& body, const RigidState<S>& y, int index, const S& time) const {
    if (asked != nullptr) ++*asked;
    const Vec3<S> g{as<S>(gravity.x), as<S>(gravity.y), as<S>(gravity.z)};
    Wrench<S> wrench{body.mass() * g, {}};
    const double now = static_cast<double>(ScalarTraits<S>::lane(time, fault.lane));
    if (fault.kind == Fault::none || index != fault.index || now < fault.time) return wrench;
    S size(0);
    ScalarTraits<S>::set_lane(size, fault.lane, static_cast<typename ScalarTraits<S>::Value>(fault.size));
    switch (fault.kind) {
      case Fault::force:
        wrench.force.z -= size;
        break;
      case Fault::late_torque:
        if (const double part = now / fault.step - std::floor(now / fault.step); part < 0.9 && part > 1e-6)
          break;
        [[fallthrough]];
      case Fault::torque:
        wrench.torque += Vec3<S>{size, size, size};
        break;
      case Fault::spring:
        wrench.force -= (size * body.mass()) * y.position;
        break;
      case Fault::cubic:
        wrench.force += (size * squared_norm(y.velocity)) * y.velocity;
        break;
      case Fault::spin:
        wrench.torque += size * scale(body.inertia(), y.angular_velocity);
        break;
      case Fault::none:
        break;
    }
    return wrench;
  }
};

/// What a run did to energy and momentum beyond what its integrator does to them where nothing is met, and
/// what else must stay small.
struct Balance {
  double impact_rise = 0;   ///< of the energy, the largest in one impact, over the scale of the run's energy
  double rise = 0;          ///< of the energy above the least so far, over the same
  double linear = 0;        ///< change of the momentum beyond rounding, over its scale
  double angular = 0;       ///< change of the angular momentum beyond rounding, over its scale
  double linear_along = 0;  ///< change of the momentum along the edge of the first two planes, over its scale
  double overlap = 0;       ///< the deepest at the end of a step, over the smaller body's bounding radius
  double work = 0;          ///< evaluations of the forces, over those of free motion
  long impacts = 0, impacts_in_step = 0;
};

/// Watches one run in double precision, whatever its scalar. `free` takes a state over a step in which
/// nothing is met, in the run's own scalar; `epsilon` is that scalar's.
///
/// Rounding is known, and no error of contacts. In free motion it is measured: what a step from the same
/// state does to the momentum. A step in which bodies touch writes their velocities at least twice, after its
/// forces and after the impulses at its end; each write is off by epsilon / 2 of the velocity at most. So it
/// may change the momentum by epsilon times the sum of the bodies' |m v|, the angular momentum by epsilon
/// times the sum of |x| |m v| + |R I w|. The errors of a resting contact do not change sign from step to
/// step: they add up as the number of steps, not as its root.
template <class Shape>
class Watch {
 public:
  using Free = std::function<States(const States&)>;

  Watch(const World<Shape>& system, const Vector& gravity, const Free& free, double epsilon,
        const States& start)
      : system_(system),
        gravity_(gravity),
        free_flight_(free),
        epsilon_(epsilon),
        start_(system, start, gravity) {
    for (int i = 0; i < bodies; ++i) {
      const auto& body = system[i];
      const double p = norm(linear_momentum(body, start[i])), r = body.bounding_radius();
      energy_scale_ += kinetic_energy(body, start[i]) + body.mass() * norm(gravity) * r;
      linear_scale_ += p + body.mass() * std::sqrt(norm(gravity) * r);
      angular_scale_ += p * (r + norm(start[i].position)) + norm(spin_angular_momentum(body, start[i]));
    }
    if (!system.planes().empty()) edge_ = cross(system.planes()[0].normal, system.planes()[1].normal);
    flown_ = free_flight_(start);
    free_ = free_change(start, flown_);
  }

  void impact(const States& before, const States& after) {
    const double rise = energy(system_, after, gravity_) - energy(system_, before, gravity_);
    balance.impact_rise = std::max(balance.impact_rise, rise / energy_scale_);
  }
  /// The state at the end of a step.
  void step(const States& y) {
    const Sums now(system_, y, gravity_);
    if (y != flown_) allow_rounding(y);
    flown_ = free_flight_(y);
    const Change free = free_change(y, flown_);
    // From either end of the step: an impact in it may have changed how fast a body turns.
    spent_.energy += std::max(free_.energy, free.energy);
    spent_.along += std::max(free_.along, free.along);
    spent_.angular += std::max(free_.angular, free.angular);
    free_ = free;
    const double gained = now.energy - start_.energy - spent_.energy;
    least_ = std::min(least_, gained + sunk(y));
    const auto worst = [](double& value, double next) { value = next <= value ? value : next; };
    worst(balance.rise, (gained - least_) / energy_scale_);
    worst(balance.linear, (norm(now.linear - start_.linear) - rounded_.linear) / linear_scale_);
    const double along = std::abs(dot(now.linear - start_.linear, edge_));
    worst(balance.linear_along, (along - spent_.along - rounded_.linear) / linear_scale_);
    const double angular = norm(now.angular - start_.angular);
    worst(balance.angular, (angular - spent_.angular - rounded_.angular) / angular_scale_);
    worst(balance.overlap, overlap(system_, y));
  }

  Balance balance;

 private:
  struct Sums {
    double energy;
    Vector linear, angular;
    Sums(const World<Shape>& system, const States& y, const Vector& gravity)
        : energy(rbres::energy(system, y, gravity)),
          linear(linear_momentum(system, y)),
          angular(angular_momentum(system, y)) {}
  };
  struct Change {
    double energy = 0, along = 0, linear = 0, angular = 0;  ///< along: the edge of the first two planes
  };
  /// What a step from y to `flown` changes in free motion: the integrator's own error, rounding included.
  Change free_change(const States& y, const States& flown) const {
    const Sums a(system_, y, gravity_), b(system_, flown, gravity_);
    return {.energy = std::abs(b.energy - a.energy),
            .along = std::abs(dot(b.linear - a.linear, edge_)),
            .angular = norm(b.angular - a.angular)};
  }
  /// What a step in which bodies touch may lose to rounding.
  void allow_rounding(const States& y) {
    for (int i = 0; i < bodies; ++i) {
      const double p = norm(linear_momentum(system_[i], y[i]));
      rounded_.linear += epsilon_ * p;
      rounded_.angular +=
          epsilon_ * (p * norm(y[i].position) + norm(spin_angular_momentum(system_[i], y[i])));
    }
  }

  /// What gravity gave to bodies that overlap planes, and takes back when they are pushed out.
  double sunk(const States& y) const {
    double sum = 0;
    for (std::size_t p = 0; p < system_.planes().size(); ++p) {
      const double pull = -dot(gravity_, system_.planes()[p].normal);
      for (int i = 0; i < bodies; ++i)
        sum += std::max(0.0, -pull * system_[i].mass() * separation(system_, y, -1 - static_cast<int>(p), i));
    }
    return sum;
  }

  const World<Shape>& system_;
  Vector gravity_, edge_;
  Free free_flight_;
  double epsilon_, least_ = 0, energy_scale_ = 0, linear_scale_ = 0, angular_scale_ = 0;
  Sums start_;
  Change free_, spent_, rounded_;
  States flown_;
};

template <class T>
States in_double(const SystemState<T, bodies>& y) {
  States out;
  for (int k = 0; k < y.size; ++k) (&out[0].position.x)[k] = static_cast<double>((&y[0].position.x)[k]);
  return out;
}
template <class T>
SystemState<T, bodies> from_double(const States& y) {
  SystemState<T, bodies> out;
  for (int k = 0; k < y.size; ++k) (&out[0].position.x)[k] = static_cast<T>((&y[0].position.x)[k]);
  return out;
}

/// Hears of impacts for a Watch, or for nobody.
template <class T, class Shape>
struct Ear {
  Watch<Shape>* watch = nullptr;
  std::function<void(double, const SystemState<T, bodies>&)> look{};
  std::function<void(double)> hit{};

  void operator()(double time, const SystemState<T, bodies>& y) {
    if (look) look(time, y);
  }
  void impact(double time, const SystemState<T, bodies>& before, const SystemState<T, bodies>& after) {
    if (hit) hit(time);
    if (watch != nullptr) watch->impact(in_double(before), in_double(after));
  }
};

/// A stepper of a world in scalar S that draws the starts of its lanes from doubles.
template <class S, class Shape>
class Runner {
  using T = typename ScalarTraits<S>::Value;
  using Plain = decltype(std::declval<World<Shape>>().template cast<T>());
  using Wide = decltype(std::declval<World<Shape>>().template cast<S>());

 public:
  static constexpr std::size_t lanes = ScalarTraits<S>::lanes;

  Runner(const World<Shape>& system, const Vector& gravity, double step, ContactMode mode,
         const Fault& fault = {})
      : plain_(system.template cast<T>()),
        exact_(plain_.template cast<double>()),
        wide_(plain_.template cast<S>()),
        gravity_(gravity),
        step_(step),
        stepper_(wide_, Loads{gravity, &asked_, fault}, Rk4{},
                 SimulationOptions{.step = step, .contacts = mode}) {}
  Runner(const Runner&) = delete;
  Runner& operator=(const Runner&) = delete;

  /// The system with its numbers as S holds them.
  const World<Shape>& exact() const { return exact_; }
  void start(std::size_t lane, const States& y) { set_lane(y_, static_cast<int>(lane), from_double<T>(y)); }
  States state(std::size_t lane) const { return in_double(rbres::lane(y_, static_cast<int>(lane))); }
  void advance(Ear<T, Shape>& ear) {
    stepper_.step(y_, as<S>(static_cast<double>(done_) * step_), as<S>(step_), ear);
    ++done_;
  }
  void advance(long steps) {
    Ear<T, Shape> nobody;
    for (long k = 0; k < steps; ++k) advance(nobody);
  }
  long impacts(std::size_t lane) const { return static_cast<long>(in_lane(stepper_.tally().impacts, lane)); }
  long overruns(std::size_t lane) const {
    return static_cast<long>(in_lane(stepper_.tally().overruns, lane));
  }
  bool finite(std::size_t lane) const { return in_lane(stepper_.finite(), lane); }
  /// A state after a step in which nothing is met.
  States free_step(const States& y) const {
    return in_double(fly(plain_, Loads{gravity_}, Rk4{}, from_double<T>(y), T(0), static_cast<T>(step_)));
  }
  /// Evaluations of the forces so far, over those of free motion.
  double work() const { return static_cast<double>(asked_) / static_cast<double>(4 * bodies * done_); }

 private:
  template <class Each>
  static auto in_lane(const Each& each, [[maybe_unused]] std::size_t lane) {
    if constexpr (lanes == 1) {
      return each;
    } else {
      return each[static_cast<int>(lane)];
    }
  }

  Plain plain_;
  World<Shape> exact_;
  Wide wide_;
  Vector gravity_;
  double step_;
  long asked_ = 0, done_ = 0;
  Stepper<Wide, Loads, Rk4> stepper_;
  typename Wide::State y_;
};

/// Runs as many starts as S has lanes, and watches each.
template <class S, class Shape, class Starts>
auto follow(const World<Shape>& system, const Starts& starts, const Vector& gravity, double step, long steps,
            ContactMode mode) {
  using T = typename ScalarTraits<S>::Value;
  Runner<S, Shape> runner(system, gravity, step, mode);
  constexpr std::size_t lanes = Runner<S, Shape>::lanes;
  std::vector<Watch<Shape>> watches;
  std::array<Balance, lanes> out;
  for (std::size_t l = 0; l < lanes; ++l) {
    runner.start(l, starts[l]);
    watches.emplace_back(
        runner.exact(), gravity, [&](const States& y) { return runner.free_step(y); },
        std::numeric_limits<T>::epsilon(), runner.state(l));
  }
  std::array<long, lanes> impacts{};
  Ear<T, Shape> ear{&watches[0]};
  for (long k = 0; k < steps; ++k) {
    runner.advance(ear);
    for (std::size_t l = 0; l < lanes; ++l) {
      watches[l].step(runner.state(l));
      const long so_far = runner.impacts(l);
      watches[l].balance.impacts_in_step = std::max(watches[l].balance.impacts_in_step, so_far - impacts[l]);
      impacts[l] = so_far;
    }
  }
  for (std::size_t l = 0; l < lanes; ++l) {
    out[l] = watches[l].balance;
    out[l].work = runner.work();
    out[l].impacts = impacts[l];
  }
  return out;
}

}  // namespace validate
