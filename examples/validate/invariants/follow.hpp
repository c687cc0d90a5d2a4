#pragma once

#include "watch.hpp"

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

/// Runs as many starts of a cell as S has lanes, and watches each.
template <class S, class Shape, class Starts>
auto follow(const World<Shape>& system, const Cell& cell, const Starts& starts, const Vector& gravity,
            double step, long steps) {
  using T = typename ScalarTraits<S>::Value;
  Runner<S, Shape> runner(system, gravity, step, cell.mode);
  constexpr std::size_t lanes = Runner<S, Shape>::lanes;
  std::vector<Watch<Shape>> watches;
  std::array<Balance, lanes> out;
  typename Watch<Shape>::Meet meet{};
  meet[std::size_t(cell.index)] = true;
  if (!cell.plane) meet[std::size_t(cell.partner())] = true;
  for (std::size_t l = 0; l < lanes; ++l) {
    runner.start(l, starts[l]);
    watches.emplace_back(
        runner.exact(), meet, gravity, [&](const States& y) { return runner.free_step(y); },
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
