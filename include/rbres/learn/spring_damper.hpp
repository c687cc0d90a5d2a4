#pragma once

#include <algorithm>
#include <rbres/contact/contact_query.hpp>
#include <rbres/contact/impulse.hpp>
#include <rbres/learn/scene_simulator.hpp>
#include <rbres/learn/windows.hpp>

namespace rbres::RBRES_ABI {

/// Contacts as springs and dampers along the normal, with Coulomb friction: the form of law of engines with
/// soft contacts. Both are given for a unit of the contact's effective mass, so that they mean the same for
/// light and heavy bodies: a point that overlaps by d and opens at speed v is pushed apart with an
/// acceleration of stiffness * d - damping * v, never pulled.
struct SpringDamper {
  double stiffness = 1e4;  ///< 1/s^2
  double damping = 30;     ///< 1/s
  double friction = 0.3;   ///< Coulomb coefficient
};

/// Takes the bodies of one scene from frame to frame with springs and dampers, in steps of a millisecond or
/// less. Not copied: it points into the set.
class SpringDamperSimulator {
 public:
  static constexpr double longest_step = 1e-3;  ///< s

  /// Both must outlive it.
  SpringDamperSimulator(const TrajectorySet& set, const Trajectory& scene, const SpringDamper& law)
      : system_(WorldNumbers{}.system(set, scene)),
        forces_(scene_forces(set, scene)),
        law_(law),
        steps_(std::max(1, static_cast<int>(std::ceil(set.frame_time() / longest_step - 1e-9)))),
        h_(set.frame_time() / steps_),
        motion_(static_cast<std::size_t>(scene.bodies())),
        change_(motion_.size()) {}

  /// One frame on. Allocates nothing.
  void operator()(SceneState& state) {
    for (int k = 0; k < steps_; ++k) {
      push(state);
      fly_on(system_, forces_, Rk4{}, state, 0.0, h_);
    }
  }

 private:
  struct Change {
    Vec3<double> velocity, angular_velocity;
  };

  /// Changes the velocities by what the contacts of this moment do in a step.
  void push(SceneState& state) {
    const int n = system_.size();
    for (int i = 0; i < n; ++i) motion_[at(i)] = motion_of(system_[i], state[i]);
    std::fill(change_.begin(), change_.end(), Change{});
    bool any = false;
    for (const auto& contact : contacts(system_, state)) {
      any = true;
      const double share = 1.0 / static_cast<double>(contact.points().size());
      for (const auto& point : contact.points())
        push_point(contact.first, contact.second, contact.normal, point.position, point.gap, share);
    }
    if (!any) return;
    for (int i = 0; i < n; ++i) {
      motion_[at(i)].velocity += change_[at(i)].velocity;
      motion_[at(i)].angular_velocity += change_[at(i)].angular_velocity;
      set_velocities(state[i], motion_[at(i)]);
    }
  }

  /// One of the points that share a pair's contact.
  void push_point(int first, int second, const Vec3<double>& normal, const Vec3<double>& point, double gap,
                  double share) {
    const Motion<double> fixed{};
    const Motion<double>&b = motion_[at(second)], &a = first < 0 ? fixed : motion_[at(first)];
    const Vec3<double> rb = point - b.position, ra = first < 0 ? Vec3<double>{} : point - a.position;
    const Vec3<double> v =
        b.velocity + cross(b.angular_velocity, rb) - a.velocity - cross(a.angular_velocity, ra);
    const auto mass_along = [&](const Vec3<double>& d) {
      const Vec3<double> tb = cross(rb, d), ta = cross(ra, d);
      return 1 / (b.inverse_mass + dot(tb, b.inverse_inertia * tb) + a.inverse_mass +
                  dot(ta, a.inverse_inertia * ta));
    };
    const double opening = dot(normal, v);
    const double push = std::max(0.0, -law_.stiffness * gap - law_.damping * opening);
    const double normal_impulse = share * mass_along(normal) * push * h_;
    Vec3<double> impulse = normal_impulse * normal;
    const Vec3<double> slip = v - opening * normal;
    if (const double speed = norm(slip); speed > 1e-9) {
      const Vec3<double> direction = (1 / speed) * slip;
      // No more than what stops the point within the step.
      impulse -= std::min(law_.friction * normal_impulse, share * mass_along(direction) * speed) * direction;
    }
    add(b, rb, impulse, change_[at(second)]);
    if (first >= 0) add(a, ra, -impulse, change_[at(first)]);
  }
  static void add(const Motion<double>& m, const Vec3<double>& arm, const Vec3<double>& impulse,
                  Change& change) {
    change.velocity += m.inverse_mass * impulse;
    change.angular_velocity += m.inverse_inertia * cross(arm, impulse);
  }
  static std::size_t at(int i) { return static_cast<std::size_t>(i); }

  SceneSystem system_;
  SceneForces forces_;
  SpringDamper law_;
  int steps_;
  double h_;  ///< s
  std::vector<Motion<double>> motion_;
  std::vector<Change> change_;
};

/// Fits stiffness, damping and friction to a set, over windows of so many frames, as identify fits its
/// numbers. The stiffest spring is one that the steps still follow. A template, so that only programs that
/// call it compile its linear algebra.
template <class = void>
SpringDamper fit_spring_damper(const TrajectorySet& set, int window, long most_states,
                               const FitOptions& options = {}) {
  const auto law = [](const Eigen::VectorXd& x) {
    return SpringDamper{std::exp(x(0)), std::exp(x(1)), x(2)};
  };
  const auto simulator = [&](const Trajectory& scene, const Eigen::VectorXd& x) {
    return SpringDamperSimulator(set, scene, law(x));
  };
  const std::vector<FitNumber> numbers{{std::log(1e4), 1, std::log(100.0), std::log(2.5e5)},
                                       {std::log(30.0), 1, std::log(0.1), std::log(500.0)},
                                       {0.3, 0.15, 0, 2}};
  return law(fit_windows(set, windows_of(set, window, most_states), numbers, simulator, options).value);
}

}  // namespace rbres::RBRES_ABI
