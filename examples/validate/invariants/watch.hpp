#pragma once

#include "worlds.hpp"

namespace validate {

/// What a run did to energy and momentum beyond what its integrator does to them where nothing is met, and
/// what else must stay small.
struct Balance {
  /// Of the energy above the least so far, over the scale of the run's; or how far the velocity of a body
  /// that meets nothing is from that of its free flight, over its speed.
  double rise = 0;
  double impact_rise = 0;   ///< of the energy, the largest in one impact, over the same scale
  double linear = 0;        ///< change of the momentum beyond rounding, over its scale
  double angular = 0;       ///< change of the angular momentum beyond rounding, over its scale
  double linear_along = 0;  ///< change of the momentum along the edge of the first two planes, over its scale
  double overlap = 0;       ///< the deepest at the end of a step, over the smaller body's bounding radius
  double work = 0;          ///< evaluations of the forces, over those of free motion
  long impacts = 0, impacts_in_step = 0;
};

/// Watches one run in double precision, whatever its scalar. `meet` says which bodies may meet something: the
/// energy is theirs, for the potential energy of far bodies rounds to more than theirs. `free` takes a state
/// over a step in which nothing is met, in the run's own scalar; `epsilon` is that scalar's.
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
  using Meet = std::array<bool, bodies>;

  Watch(const World<Shape>& system, const Meet& meet, const Vector& gravity, const Free& free, double epsilon,
        const States& start)
      : system_(system),
        meet_(meet),
        gravity_(gravity),
        free_flight_(free),
        epsilon_(epsilon),
        start_(sums(start)) {
    for (int i = 0; i < bodies; ++i) {
      const auto& body = system[i];
      const double p = norm(linear_momentum(body, start[i])), r = body.bounding_radius();
      if (meet_[std::size_t(i)])
        energy_scale_ += kinetic_energy(body, start[i]) + body.mass() * norm(gravity) * r;
      linear_scale_ += p + body.mass() * std::sqrt(norm(gravity) * r);
      angular_scale_ += p * (r + norm(start[i].position)) + norm(spin_angular_momentum(body, start[i]));
    }
    if (!system.planes().empty()) edge_ = cross(system.planes()[0].normal, system.planes()[1].normal);
    flown_ = free_flight_(start);
    free_ = free_change(start, flown_);
  }

  void impact(const States& before, const States& after) {
    const double rise = energy_of(after) - energy_of(before);
    balance.impact_rise = std::max(balance.impact_rise, rise / energy_scale_);
  }
  /// The state at the end of a step.
  void step(const States& y) {
    const Sums now = sums(y);
    if (y != flown_) allow_rounding(y);
    const auto worst = [](double& value, double next) { value = next <= value ? value : next; };
    for (int i = 0; i < bodies; ++i) {
      if (meet_[std::size_t(i)]) continue;
      const double astray = norm(y[i].velocity - flown_[i].velocity), speed = norm(flown_[i].velocity);
      worst(balance.rise, astray == 0 ? 0 : astray / speed);
    }
    flown_ = free_flight_(y);
    const Change free = free_change(y, flown_);
    // From either end of the step: an impact in it may have changed how fast a body turns.
    spent_.energy += std::max(free_.energy, free.energy);
    spent_.along += std::max(free_.along, free.along);
    spent_.angular += std::max(free_.angular, free.angular);
    free_ = free;
    const double gained = now.energy - start_.energy - spent_.energy;
    least_ = std::min(least_, gained + sunk(y));
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
  };
  Sums sums(const States& y) const {
    return {energy_of(y), linear_momentum(system_, y), angular_momentum(system_, y)};
  }
  double energy_of(const States& y) const {
    double sum = 0;
    for (int i = 0; i < bodies; ++i) {
      const auto& body = system_[i];
      if (meet_[std::size_t(i)])
        sum += kinetic_energy(body, y[i]) - body.mass() * dot(gravity_, y[i].position);
    }
    return sum;
  }
  struct Change {
    double energy = 0, along = 0, linear = 0, angular = 0;  ///< along: the edge of the first two planes
  };
  /// What a step from y to `flown` changes in free motion: the integrator's own error, rounding included.
  Change free_change(const States& y, const States& flown) const {
    const Sums a = sums(y), b = sums(flown);
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
  Meet meet_;
  Vector gravity_, edge_;
  Free free_flight_;
  double epsilon_, least_ = 0, energy_scale_ = 0, linear_scale_ = 0, angular_scale_ = 0;
  Sums start_;
  Change free_, spent_, rounded_;
  States flown_;
};

}  // namespace validate
