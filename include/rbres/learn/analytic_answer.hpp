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

  /// Adds to the derivatives by `flown`, given those by `answered`, which resolve() made of it. The forces
  /// must not depend on the states: what they add to velocities in a frame counts as given.
  void add_gradient(const Scene& scene, States start, States flown, States answered, double h,
                    States by_answered, std::span<RigidState<double>> by_flown) {
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
      back_through_group(scene, start, flown, h, by_answered, by_flown);
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
  void back_through_group(const Scene& scene, States start, States flown, double h, States by_answered,
                          std::span<RigidState<double>> by_flown) {
    std::vector<Body<D>> bodies;
    for (const std::size_t i : group_) bodies.push_back(scene[static_cast<int>(i)].template cast<D>());
    std::vector<Plane<D>> planes;
    for (const Plane<double>& plane : scene.planes()) planes.push_back(plane.template cast<D>());
    const BasicSceneSystem<D> dual(std::move(bodies), std::move(planes));
    DiscreteContact<BasicSceneSystem<D>> discrete(dual);
    BasicSceneState<D> before, after;
    before.body.resize(group_.size());
    after.body.resize(group_.size());
    ContactTally<D> tally;
    for (const std::size_t by : group_) {
      for (std::size_t k = 0; k < group_.size(); ++k) {
        const RigidState<double>&from = start[group_[k]], &to = flown[group_[k]];
        RigidState<D>& y = after.body[k];
        if (group_[k] == by) {
          y = {dual_vector<13>(to.position, 0), dual_quaternion<13>(to.orientation, 3),
               dual_vector<13>(to.velocity, 7), dual_vector<13>(to.angular_velocity, 10)};
        } else {
          const Quat<double>& q = to.orientation;
          y = {constant_vector<13>(to.position),
               {D(q.x), D(q.y), D(q.z), D(q.w)},
               constant_vector<13>(to.velocity),
               constant_vector<13>(to.angular_velocity)};
        }
        // The flight began with what it ended with, but for what the forces did.
        const Vec3<double> gained = to.velocity - from.velocity;
        const Vec3<double> way = to.position - from.position - h * to.velocity;
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
      by_flown[by].vector() += g;
    }
  }

  std::vector<std::size_t> left_, group_;
};

}  // namespace rbres::RBRES_ABI::detail
