#pragma once

#include <rbres/learn/contact_frame.hpp>
#include <rbres/learn/law_step.hpp>
#include <rbres/sim/contacts.hpp>

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace rbres::RBRES_ABI {

/// How bodies collide, learned from trajectories: it stands where Coulomb's and Newton's laws stand. At every
/// contact point of a frame a network gives an impulse in the contact's own frame, an angular impulse about
/// the normal, and the time at which they act, from gaps, velocities, masses and arms, and from messages over
/// the bodies that contacts share. Impulses are equal and opposite at one common point, so that linear and
/// angular momentum are kept whatever the network says; the world may be turned, mirrored or moved, and its
/// bodies numbered otherwise. One law serves any number of bodies of any shapes.
///
///     simulate(system, state, Gravity{}, Rk4{}, law, {.step = law.scales.frame_time, .duration = 2.0});
///
/// W = bfloat16 keeps the network's weights in half the memory. Such a law cannot be trained: convert one of
/// float, or load its file.
template <int Width = 48, int Rounds = 2, std::floating_point T = float, WeightOf<T> W = T>
struct ContactLaw {
  /// The network's numbers.
  using Scalar = T;
  /// What a law's network is.
  using Network =
      ContactNetwork<T, detail::Contact::features, detail::ContactImpulse::outputs, Width, Rounds, W>;
  /// The contacts of one frame.
  using Frame = detail::ContactFrame<T>;

  /// What is learned.
  Network network;
  /// Of the network's inputs.
  Normalizer<T, detail::Contact::features> input{};
  /// The units in which the network counts.
  ContactScales scales{};

  /// Room for `bodies` bodies among `planes` planes, with up to `points` contact points for each pair (1 for
  /// balls, 12 for boxes). A body is expected to have six pairs of its own and three planes at most; contacts
  /// beyond that are left out.
  class Workspace {
   public:
    /// Allocates all that a frame needs.
    Workspace(std::size_t bodies, std::size_t planes, std::size_t points = 12)
        : frame(bodies, most_contacts(bodies, planes, points)),
          network(static_cast<Eigen::Index>(most_contacts(bodies, planes, points)),
                  static_cast<Eigen::Index>(bodies)) {}

   private:
    friend ContactLaw;
    static std::size_t most_contacts(std::size_t bodies, std::size_t planes, std::size_t points) {
      const std::size_t pairs = std::min(bodies * (bodies - 1) / 2, 6 * bodies);
      return points * (pairs + std::min<std::size_t>(planes, 3) * bodies);
    }

    Frame frame;
    typename Network::Workspace network;
  };

  /// Turns `states`, where free flight has taken the bodies from `start` in a frame's time, into where they
  /// are with their contacts. Returns how many contact points took part. Allocates nothing.
  template <class Shape>
  long respond(std::span<const Body<double, Shape>> bodies, std::span<const Plane<double>> planes,
               std::span<const RigidState<double>> start, std::span<RigidState<double>> states,
               Workspace& own) const noexcept {
    Frame& frame = own.frame;
    const detail::SceneView<Shape> scene{bodies, planes};
    frame.clear();
    frame.add(scene, start, std::span<const RigidState<double>>(states), scales);
    long points = 0;
    for (int k = 1;; ++k) {
      answer(bodies, states, 1, own);
      points += std::ssize(frame.contacts);
      if (k == detail::most_impacts || !frame.goes_on(scales)) return points;
      frame.go_on(
          frame, [&](std::size_t i) -> const auto& { return bodies[i]; }, states, scales);
      frame.find(scene, 0, scales, k + 1 == detail::most_impacts);
    }
  }
  /// The same for `states` in which another law has answered the contacts of that free flight, from `start`
  /// to `flown`: the impulses, `share` times as strong, come on top.
  template <class Shape>
  long correct(std::span<const Body<double, Shape>> bodies, std::span<const Plane<double>> planes,
               std::span<const RigidState<double>> start, std::span<const RigidState<double>> flown,
               std::span<RigidState<double>> states, double share, Workspace& own) const noexcept {
    Frame& frame = own.frame;
    const detail::SceneView<Shape> scene{bodies, planes};
    frame.clear();
    frame.add(scene, start, flown, scales, true);
    for (std::size_t i = 0; i < states.size(); ++i) frame.flights[i].end = states[i].position;
    answer(bodies, states, share, own);
    return std::ssize(frame.contacts);
  }

  /// What simulate(), Stepper and simulate_batch() ask of contacts, see AnalyticContacts. The tally's
  /// `touching` counts contact points; nothing else is counted.
  static constexpr bool allows_overlap = true;
  static constexpr bool corrects = false;  ///< see HybridLaw
  /// How strong the impulses are, see HybridLaw.
  static constexpr double weight = 1;

  /// Throws Error where a step is not the law's frame time.
  void check(const StepPlan& plan) const {
    for (const long part : {0L, plan.parts() - 1})
      if (plan.parts() > 0) check_step(plan.part(part).step);
  }
  /// Throws Error where the step (s) is not the law's frame time.
  void check_step(double step) const {
    if (!(std::abs(step - scales.frame_time) <= 1e-6 * scales.frame_time))
      detail::refuse(
          "step of a learned contact law",
          detail::text("its frame time, ", scales.frame_time, " s (durations and samples are whole frames)"),
          step);
  }

  /// Takes one system's state over frames.
  template <class System>
  using Step = detail::LawStep<ContactLaw, System>;

 private:
  /// Adds what the network says of the workspace's contacts to `states`.
  template <class Shape>
  void answer(std::span<const Body<double, Shape>> bodies, std::span<RigidState<double>> states, double share,
              Workspace& own) const noexcept {
    Frame& frame = own.frame;
    frame.encode(input, scales);
    network.forward(frame.inputs, frame.presence, frame.ends, std::ssize(bodies), frame.outputs, own.network);
    frame.sum_impulses(scales);
    for (std::size_t i = 0; i < states.size(); ++i)
      states[i] = detail::pushed(bodies[i], states[i], frame.sums[i] * share);
  }
};

/// The same law with its network's weights kept as W, each rounded to the nearest.
template <class W, int Width, int Rounds, std::floating_point T, class Kept>
ContactLaw<Width, Rounds, T, W> with_weights(const ContactLaw<Width, Rounds, T, Kept>& law) {
  using Network = typename ContactLaw<Width, Rounds, T, W>::Network;
  return {Network(law.network), law.input, law.scales};
}

}  // namespace rbres::RBRES_ABI
