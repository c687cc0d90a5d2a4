// A law of contacts that is none of the library's, and stands where they stand.
#pragma once

#include <algorithm>
#include <cmath>
#include <rbres/contact/contact_query.hpp>
#include <rbres/contact/impulse.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/contacts.hpp>
#include <vector>

namespace rbres::contacts_program {

/// Restitution and friction that fall with speed, as those of many materials do: no single number of either
/// fits slow and fast contacts. See AnalyticContacts for what simulate() and Stepper ask of it.
struct FadingContacts {
  double restitution = 0.9;  ///< of slow impacts
  double friction = 0.6;     ///< of slow slip
  double speed = 1;          ///< at which both are halved, m/s
  static constexpr bool allows_overlap = true;

  template <class System>
  class Step {
    using State = typename System::State;

   public:
    Step(const FadingContacts& law, const System& system, const SimulationOptions& options)
        : law_(&law), system_(&system), rest_speed_(options.rest_speed) {
      motion_.reserve(static_cast<std::size_t>(system.size()) + 1);
      points_.reserve(12 * most_pairs(system.size(), static_cast<int>(system.planes().size())));
    }

    template <class Model, class Integrator, class Observer>
    void step(const Model& forces, const Integrator& integrator, State& y, double t, double h, Observer&,
              ContactTally<double>& tally) {
      fly_on(*system_, forces, integrator, y, t, h);
      find_points(y, h);
      if (points_.empty()) return;
      tally.touching += std::ssize(points_);
      constexpr int sweeps = 20;
      for (int k = 0; k < sweeps; ++k)
        for (Point& p : points_)
          p.contact.relax(p.target, p.friction, true, motion_[p.first], motion_[p.second]);
      for (int i = 0; i < system_->size(); ++i) set_velocities(y[i], motion_[static_cast<std::size_t>(i)]);
    }

   private:
    struct Point {
      ContactPoint<double, false> contact;
      double target, friction;    ///< speed along the normal after the step, m/s; coefficient
      std::size_t first, second;  ///< of motion_
    };
    static std::size_t most_pairs(int bodies, int planes) {
      return static_cast<std::size_t>(std::min(bodies * (bodies - 1) / 2, 12 * bodies) + planes * bodies);
    }

    void find_points(const State& y, double h) {
      motion_.clear();
      points_.clear();
      for (int i = 0; i < system_->size(); ++i) motion_.push_back(motion_of((*system_)[i], y[i]));
      const std::size_t fixed = motion_.size();
      motion_.push_back({});  // of planes: nothing moves it
      for (const auto& pair : rbres::contacts(*system_, y)) {
        const std::size_t first = pair.first < 0 ? fixed : static_cast<std::size_t>(pair.first),
                          second = static_cast<std::size_t>(pair.second);
        for (const auto& point : pair.points()) {
          const Motion<double>&a = motion_[first], &b = motion_[second];
          Point p{{pair.normal, point.position, a, b}, 0, 0, first, second};
          const double approach = std::max(0.0, -p.contact.velocity(0, a, b));
          const double slip = std::hypot(p.contact.velocity(1, a, b), p.contact.velocity(2, a, b));
          // A tenth of an overlap goes in a step, but never fast.
          p.target = std::min(0.2, -0.1 * point.gap / h);
          if (approach > rest_speed_)
            p.target = std::max(p.target, faded(law_->restitution, approach) * approach);
          p.friction = faded(law_->friction, slip);
          points_.push_back(p);
        }
      }
    }
    double faded(double number, double speed) const { return number / (1 + speed / law_->speed); }

    const FadingContacts* law_;
    const System* system_;
    double rest_speed_;
    std::vector<Motion<double>> motion_;
    std::vector<Point> points_;
  };
};

}  // namespace rbres::contacts_program
