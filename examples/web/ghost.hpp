// The bodies of a World once more, moved by a learned contact law from the same start.
#pragma once

#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/scene_system.hpp>

#include "world.hpp"

namespace web {

class Ghost {
 public:
  /// Starts where the bodies of the world are. The law must outlive it, and so must the world.
  Ghost(const ContactLaw<>& law, World& world)
      : world_(&world),
        h_(law.scales.frame_time),
        system_(bodies(world), world.room().planes()),
        step_(law, system_, {.step = h_}) {
    restart();
  }
  Ghost(const Ghost&) = delete;
  Ghost& operator=(const Ghost&) = delete;

  /// Puts all bodies where those of the world are.
  void restart() {
    time_ = world_->time();
    after_.body.assign(&world_->state()[0], &world_->state()[0] + world_->bodies());
    before_ = shown_ = after_;
  }

  /// Follows to the world's time. A law moves bodies by whole frames; between two of them they are shown on
  /// the straight way from one to the next.
  void follow() {
    const double now = world_->time();
    for (; time_ < now - 1e-9; time_ += h_) {
      before_ = after_;
      step_.step(Forces{world_->gravity(), Pull{&world_->grip()}}, Rk4{}, after_, time_, h_, none_, tally_);
    }
    const double share = 1 - (time_ - now) / h_;
    for (int i = 0; i < system_.size(); ++i) {
      const RigidState<double>&a = before_[i], &b = after_[i];
      const double sign = a.orientation.x * b.orientation.x + a.orientation.y * b.orientation.y +
                                      a.orientation.z * b.orientation.z + a.orientation.w * b.orientation.w <
                                  0
                              ? -1
                              : 1;
      const auto mix = [&](double from, double to) { return (1 - share) * from + share * sign * to; };
      shown_[i].position = a.position + share * (b.position - a.position);
      shown_[i].orientation = normalized(
          Quat<double>{mix(a.orientation.x, b.orientation.x), mix(a.orientation.y, b.orientation.y),
                       mix(a.orientation.z, b.orientation.z), mix(a.orientation.w, b.orientation.w)});
    }
  }

  /// Where the bodies are at the world's time.
  const RigidState<double>* states() const { return shown_.body.data(); }
  /// Mean distance from the bodies of the world, m.
  double error() const {
    double sum = 0;
    for (int i = 0; i < system_.size(); ++i) sum += norm(shown_[i].position - world_->state()[i].position);
    return sum / system_.size();
  }

 private:
  struct None {};

  static std::vector<Body<double>> bodies(const World& world) {
    std::vector<Body<double>> all;
    for (int i = 0; i < world.bodies(); ++i) all.push_back(world.room()[i]);
    return all;
  }

  World* world_;
  double h_;  ///< s
  SceneSystem system_;
  ContactLaw<>::Step<SceneSystem> step_;
  double time_ = 0;  ///< of after_, s
  SceneState before_, after_, shown_;
  None none_;
  ContactTally<double> tally_;
};

}  // namespace web
