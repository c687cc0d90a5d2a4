#pragma once

#include <rbres/learn/contact_flight.hpp>
#include <rbres/learn/scene_system.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>

#include <algorithm>
#include <span>
#include <vector>

namespace rbres::RBRES_ABI::detail {

/// What discrete contacts make of a frame of a scene's free flight, and the way back by forward duals. One
/// for each thread.
template <class Scene>
class AnalyticAnswer {
  using States = std::span<const RigidState<double>>;
  using D = Dual<13>;

 public:
  /// Takes `states` from where free flight from `start` has led them in h (s) to where contacts lead them.
  static void resolve(const Scene& scene, States start, double h, std::span<RigidState<double>> states) {
    const typename Scene::State before{{start.begin(), start.end()}};
    typename Scene::State after{{states.begin(), states.end()}};
    ContactTally<double> tally;
    DiscreteContact<Scene>(scene).resolve(before, after, h, SimulationOptions{}.rest_speed, tally);
    std::copy(after.body.begin(), after.body.end(), states.begin());
  }

  /// Adds to the derivatives by `flown` and `start`, given those by `answered`, which resolve() made of them.
  /// Where no force resists motion, what forces add to velocities in a frame is given, and the start follows
  /// from the end: the derivative by it is part of that by `flown`, for half the work.
  void add_gradient(const Scene& scene, States start, States flown, States answered, double h, bool resisted,
                    States by_answered, std::span<RigidState<double>> by_flown,
                    std::span<RigidState<double>> by_start) {
    left_.clear();
    for (std::size_t i = 0; i < flown.size(); ++i) {
      if (answered[i] == flown[i]) {
        by_flown[i].vector() += by_answered[i].vector();
      } else {
        left_.push_back(i);
      }
    }
    while (!left_.empty()) {
      take_group(scene, flown);
      back_through_group(scene, start, flown, h, resisted, by_answered, by_flown, by_start);
    }
  }

 private:
  /// Moves from left_ to group_ a body and all with which it may have met, directly or by way of others.
  void take_group(const Scene& scene, States flown) {
    group_.assign(1, left_.back());
    left_.pop_back();
    for (std::size_t k = 0; k < group_.size(); ++k) {
      const std::size_t i = group_[k];
      const auto close = [&](std::size_t j) {
        const double reach = radius(scene, i) + radius(scene, j);
        return squared_norm(flown[i].position - flown[j].position) < reach * reach;
      };
      const auto apart = std::partition(left_.begin(), left_.end(), [&](std::size_t j) { return !close(j); });
      group_.insert(group_.end(), apart, left_.end());
      left_.erase(apart, left_.end());
    }
    std::sort(group_.begin(), group_.end());
  }
  static double radius(const Scene& scene, std::size_t i) {
    return scene[static_cast<int>(i)].bounding_radius();
  }

  /// Once for each of its bodies, by whose 13 numbers all others are derived.
  void back_through_group(const Scene& scene, States start, States flown, double h, bool resisted,
                          States by_answered, std::span<RigidState<double>> by_flown,
                          std::span<RigidState<double>> by_start) {
    std::vector<Body<D>> bodies;
    for (const std::size_t i : group_) bodies.push_back(scene[static_cast<int>(i)].template cast<D>());
    std::vector<Plane<D>> planes;
    for (const Plane<double>& plane : scene.planes()) planes.push_back(plane.template cast<D>());
    const System<D, dynamic> dual(std::move(bodies), std::move(planes));
    DiscreteContact<System<D, dynamic>> discrete(dual);
    SystemState<D, dynamic> before, after;
    before.body.resize(group_.size());
    after.body.resize(group_.size());
    ContactTally<D> tally;
    const auto derive = [&](std::size_t by, bool by_the_start) {
      for (std::size_t k = 0; k < group_.size(); ++k) {
        const RigidState<double>&from = start[group_[k]], &to = flown[group_[k]];
        const bool own = group_[k] == by;
        after.body[k] = own && !by_the_start ? inputs(to) : constants(to);
        if (resisted) {
          before.body[k] = own && by_the_start ? inputs(from) : constants(from);
          continue;
        }
        // The flight began with what it ended with, but for what the forces did.
        const Vec3<double> gained = to.velocity - from.velocity;
        const Vec3<double> way = to.position - from.position - h * to.velocity;
        const RigidState<D>& y = after.body[k];
        before.body[k] = y;
        before.body[k].velocity = y.velocity - constant_vector<13>(gained);
        before.body[k].position = y.position - D(h) * y.velocity - constant_vector<13>(way);
      }
      discrete.resolve(before, after, D(h), D(SimulationOptions{}.rest_speed), tally);
      Eigen::Matrix<double, 13, 1> g = Eigen::Matrix<double, 13, 1>::Zero();
      for (std::size_t k = 0; k < group_.size(); ++k) {
        const RigidState<double>& w = by_answered[group_[k]];
        const RigidState<D>& y = after.body[k];
        g += pull_back<13>(w.position, y.position) + pull_back<13>(w.orientation, y.orientation) +
             pull_back<13>(w.velocity, y.velocity) + pull_back<13>(w.angular_velocity, y.angular_velocity);
      }
      (by_the_start ? by_start : by_flown)[by].vector() += g;
    };
    for (const std::size_t by : group_) {
      derive(by, false);
      if (resisted) derive(by, true);
    }
  }

  /// A state as the 13 inputs by which all is derived, or as given.
  /// @{
  static RigidState<D> inputs(const RigidState<double>& y) {
    return {dual_vector<13>(y.position, 0), dual_quaternion<13>(y.orientation, 3),
            dual_vector<13>(y.velocity, 7), dual_vector<13>(y.angular_velocity, 10)};
  }
  static RigidState<D> constants(const RigidState<double>& y) {
    const Quat<double>& q = y.orientation;
    return {constant_vector<13>(y.position),
            {D(q.x), D(q.y), D(q.z), D(q.w)},
            constant_vector<13>(y.velocity),
            constant_vector<13>(y.angular_velocity)};
  }
  /// @}

  std::vector<std::size_t> left_, group_;
};

}  // namespace rbres::RBRES_ABI::detail
