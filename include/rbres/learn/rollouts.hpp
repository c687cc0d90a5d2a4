#pragma once

#include <rbres/learn/frame_gradient.hpp>
#include <rbres/learn/rollout_loss.hpp>
#include <rbres/learn/trajectory.hpp>
#include <rbres/nn/objective.hpp>

#include <cmath>
#include <concepts>
#include <cstdint>
#include <span>
#include <vector>

namespace rbres::RBRES_ABI {

/// Rollouts of a contact law beside trajectories, as an objective: an item is a window, some frames of one
/// scene; the law starts from its first frame and is judged by all others. Its value is the mean of
/// RolloutLoss over frames and bodies. Differentiates by hand through time and network.
template <class Law>
class Rollouts {
  using Net = typename Law::Network;
  static_assert(std::same_as<typename Net::Weight, typename Net::Scalar>,
                "Rollouts: a law of half-size weights is not trained; train a float one, then convert it");
  using States = std::vector<RigidState<double>>;

 public:
  /// Of one thread: every frame of the rollouts of a chunk.
  struct Scratch {
    /// The frames, one after the other.
    std::vector<detail::RolloutFrame<Law>> frames;
    /// Each body alone, of all rollouts.
    std::vector<const System<double, 1>*> bodies;
    /// What acts on them.
    std::vector<const SceneForces*> forces;
    /// The scene of each rollout.
    std::vector<const SceneSystem*> scenes;
    std::vector<double> shares;  ///< of a body's errors in the whole
    /// Of all bodies: where they are, and derivatives by them.
    /// @{
    States states, by_end, by_start, by_energy;
    /// @}
    /// The way back through one frame.
    detail::FrameGradient<Law> gradient;
  };

  /// Windows of `frames` + 1 frames, of which a scene's begin `stride` frames apart, of a set that must
  /// outlive the objective. The law gives scales and normalisation; `velocity` says what the velocities of
  /// the set are. Throws Error where the law's frame time is not the set's, or no scene is long enough, and
  /// for a cost of energy where wrenches add some.
  Rollouts(const Law& law, const TrajectorySet& set, int frames, int stride, const RolloutLoss& loss = {},
           SceneStep::Velocity velocity = SceneStep::Velocity::instant)
      : law_(law), set_(&set), frames_(frames), loss_(loss), velocity_(velocity) {
    if (frames < 1) detail::refuse("Rollouts: frames", "at least 1", frames);
    if (stride < 1) detail::refuse("Rollouts: stride", "at least 1", stride);
    if (std::abs(set.frame_time() - law.scales.frame_time) > 1e-9 * law.scales.frame_time)
      detail::refuse("Rollouts: frame time of the trajectories", detail::text(law.scales.frame_time, " s"),
                     set.frame_time());
    for (int s = 0; s < set.size(); ++s) {
      for (int t = 0; t + frames < set[s].frames(); t += stride) windows_.push_back({s, t});
      first_.push_back(alone_.size());
      for (int i = 0; i < set[s].bodies(); ++i) {
        alone_.push_back(System<double, 1>({set[s].body(i)}));
        forces_.push_back(detail::body_forces(set, set[s], i));
      }
      if (loss.physics.energy > 0 && !set[s].wrenches().empty())
        detail::refuse("Rollouts: cost of energy", "none in scenes with wrenches", loss.physics.energy);
      if constexpr (Law::corrects) scenes_.push_back(scene_system(set, set[s]));
    }
    if (windows_.empty())
      detail::refuse("Rollouts: scenes", detail::text("one of at least ", frames + 1, " frames"), "none");
  }

  /// What an Objective has.
  /// @{
  Scratch scratch() const { return {}; }
  std::ptrdiff_t count() const { return std::ssize(windows_); }
  /// @}
  /// Fewer long rollouts, of which a step takes few: so that several threads have some.
  std::ptrdiff_t chunk() const { return frames_ < 8 ? 16 : 4; }

  /// The sum over the rollouts.
  double value(const Net& network, Items items, Scratch& own) const {
    begin(items, own);
    double value = 0;
    for (int t = 0; t < frames_; ++t) {
      forward(network, items, own.frames[index(t)], own);
      own.by_end.assign(own.states.size(), zero);
      value += add_losses(items, t + 1, own.states, own.by_end);
      if (loss_.physics.any())
        value +=
            contact_costs(own.frames[index(t)], own.shares) +
            add_energy_gained(items, own.frames[index(t)].start, own.states, own, own.by_end, own.by_end);
    }
    return value;
  }

  /// The same; adds the sum's derivative to `gradient`.
  double differentiate(const Net& network, Items items, const DropoutMask&, Scratch& own,
                       ParameterGradient<Net>& gradient) const {
    begin(items, own);
    for (int t = 0; t < frames_; ++t) forward(network, items, own.frames[index(t)], own);
    double value = 0;
    own.by_end.assign(own.states.size(), zero);
    for (int t = frames_; t-- > 0;) {
      const auto& frame = own.frames[index(t)];
      const States& end = t + 1 < frames_ ? own.frames[index(t + 1)].start : own.states;
      value += add_losses(items, t + 1, end, own.by_end);
      own.by_energy.assign(end.size(), zero);
      if (loss_.physics.any())
        value += contact_costs(frame, own.shares) +
                 add_energy_gained(items, frame.start, end, own, own.by_energy, own.by_end);
      own.gradient(law_, network, own.bodies, own.forces, own.scenes, *set_, velocity_, own.frames[index(t)],
                   loss_.physics, own.shares, own.by_end, own.by_start, gradient);
      for (std::size_t i = 0; i < end.size(); ++i) own.by_start[i].vector() += own.by_energy[i].vector();
      limit_growth(items, own.by_start);
      own.by_end.swap(own.by_start);
    }
    return value;
  }

  /// Of the windows, their numbers, and how they are judged.
  std::uint64_t digest() const {
    detail::Digest digest;
    digest.add(static_cast<std::uint64_t>(frames_));
    digest.add(static_cast<std::uint64_t>(velocity_));
    for (const double x : {law_.scales.frame_time, law_.scales.speed, law_.scales.margin}) digest.add(&x, 1);
    digest.add(&loss_.largest_growth, 1);
    for (const double x : {loss_.physics.energy, loss_.physics.penetration, loss_.physics.complementarity})
      digest.add(&x, 1);
    digest.add(static_cast<std::uint64_t>(law_.scales.moment));
    for (const auto& term : {loss_.position, loss_.rotation, loss_.velocity, loss_.spin})
      for (const double x : {term.weight, term.cap}) digest.add(&x, 1);
    digest.add(law_.input.mean.data(), static_cast<std::size_t>(law_.input.mean.size()));
    digest.add(law_.input.deviation.data(), static_cast<std::size_t>(law_.input.deviation.size()));
    for (const Window& w : windows_) digest.add(static_cast<std::uint64_t>(w.scene) << 32 | index(w.start));
    for (const Trajectory& scene : *set_)
      for (int t = 0; t < scene.frames(); ++t) digest.add(scene.frame(t).data(), scene.frame(t).size());
    digest.add(&set_->gravity(), 1);
    const Resistance& resistance = set_->resistance();
    for (const double x :
         {resistance.friction.density, resistance.friction.drag, resistance.friction.rotational_drag,
          resistance.damping.linear, resistance.damping.angular})
      digest.add(&x, 1);
    for (const Trajectory& scene : *set_) digest.add(scene.wrenches().data(), scene.wrenches().size());
    digest.add(set_->planes().data(), set_->planes().size());
    for (const System<double, 1>& alone : alone_) {
      const Body<double>& body = alone[0];
      // Shapes with these moments and this radius are alike.
      digest.add(&body.inertia(), 1);
      digest.add(&body.material(), 1);
      for (const double x : {body.mass(), body.bounding_radius()}) digest.add(&x, 1);
    }
    return digest.value();
  }

 private:
  struct Window {
    int scene, start;
  };
  static constexpr RigidState<double> zero = detail::FrameGradient<Law>::zero;
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  /// Puts the first frames of all items into own.states, one behind the other.
  void begin(Items items, Scratch& own) const {
    own.frames.resize(index(frames_));
    own.states.clear();
    own.bodies.clear();
    own.forces.clear();
    own.scenes.clear();
    own.shares.clear();
    for (const std::uint32_t item : items) {
      const Window& window = windows_[item];
      const auto start = (*set_)[window.scene].frame(window.start);
      own.states.insert(own.states.end(), start.begin(), start.end());
      own.shares.insert(own.shares.end(), start.size(),
                        1 / static_cast<double>(index(frames_) * start.size()));
      for (std::size_t i = 0; i < start.size(); ++i) {
        own.bodies.push_back(&alone_[first_[index(window.scene)] + i]);
        own.forces.push_back(&forces_[first_[index(window.scene)] + i]);
      }
      if constexpr (Law::corrects) own.scenes.push_back(&scenes_[index(window.scene)]);
    }
  }

  /// Takes own.states on by a frame.
  void forward(const Net& network, Items items, detail::RolloutFrame<Law>& frame, Scratch& own) const {
    frame.start = own.states;
    frame.flown.resize(own.states.size());
    for (std::size_t i = 0; i < own.states.size(); ++i) {
      SystemState<double, 1> alone{{frame.start[i]}};
      detail::fly_on(velocity_, *own.bodies[i], *own.forces[i], alone, law_.scales.frame_time);
      frame.flown[i] = alone[0];
    }
    own.states = frame.flown;
    frame.answers = 0;
    auto* answer = &frame.next();
    answer->contacts.clear();
    each_scene(items, [&](const auto& scene, std::size_t base, [[maybe_unused]] std::size_t number) {
      const std::size_t n = scene.bodies.size();
      answer->contacts.add(scene, std::span<const RigidState<double>>(frame.start).subspan(base, n),
                           std::span<const RigidState<double>>(frame.flown).subspan(base, n), law_.scales,
                           Law::corrects);
      if constexpr (Law::corrects)
        detail::AnalyticAnswer<SceneSystem>::resolve(
            *own.scenes[number], std::span<const RigidState<double>>(frame.start).subspan(base, n),
            law_.scales.frame_time, std::span(own.states).subspan(base, n));
    });
    if constexpr (Law::corrects)
      for (std::size_t i = 0; i < own.states.size(); ++i)
        answer->contacts.flights[i].end = own.states[i].position;
    for (;;) {
      auto& contacts = answer->contacts;
      answer->before = own.states;
      contacts.encode(law_.input, law_.scales);
      answer->record.forward(network, contacts.inputs, contacts.presence, contacts.ends,
                             std::ssize(own.states), contacts.outputs);
      contacts.sum_impulses(law_.scales);
      for (std::size_t i = 0; i < own.states.size(); ++i)
        own.states[i] = detail::pushed((*own.bodies[i])[0], own.states[i], contacts.sums[i] * law_.weight);
      if (Law::corrects || frame.answers == detail::most_impacts || !contacts.goes_on(law_.scales)) return;
      answer = &frame.next();
      answer->contacts.go_on(
          frame.all[frame.answers - 2].contacts,
          [&](std::size_t i) -> const auto& { return (*own.bodies[i])[0]; }, own.states, law_.scales);
      each_scene(items, [&](const auto& scene, std::size_t base, std::size_t) {
        answer->contacts.find(scene, base, law_.scales, frame.answers == detail::most_impacts);
      });
    }
  }

  /// Calls f(scene, number of its first body, number of the item) for the scenes of all items.
  template <class F>
  void each_scene(Items items, const F& f) const {
    std::size_t base = 0, number = 0;
    for (const std::uint32_t item : items) {
      const Trajectory& scene = (*set_)[windows_[item].scene];
      const auto n = index(scene.bodies());
      f(detail::SceneView<AnyShape<double>>{{&scene.body(0), n}, set_->planes()}, base, number++);
      base += n;
    }
  }

  /// What states cost that are t frames after the start.
  double add_losses(Items items, int t, const States& states, States& by_states) const {
    double value = 0;
    std::size_t base = 0;
    for (const std::uint32_t item : items) {
      const Window& window = windows_[item];
      const auto truth = (*set_)[window.scene].frame(window.start + t);
      const double share = 1 / static_cast<double>(index(frames_) * truth.size());
      for (std::size_t i = 0; i < truth.size(); ++i)
        value += detail::add_loss(loss_, states[base + i], truth[i], share, by_states[base + i]);
      base += truth.size();
    }
    return value;
  }

  /// What the physics terms of a frame's contacts cost.
  double contact_costs(const detail::RolloutFrame<Law>& frame, const std::vector<double>& shares) const {
    double value = 0;
    for (const auto& answer : frame.answered()) {
      const auto& contacts = answer.contacts;
      for (std::size_t k = 0; k < contacts.contacts.size(); ++k) {
        const detail::Contact& c = contacts.contacts[k];
        value += shares[index(c.second)] *
                 detail::contact_cost(loss_.physics, c, contacts.output(k)[0], law_.scales).value;
      }
    }
    return value;
  }

  /// What the energy costs that scenes gain from `from` to `to`; adds the derivatives by both.
  double add_energy_gained(Items items, const States& from, const States& to, const Scratch& own,
                           States& by_from, States& by_to) const {
    const double weight = loss_.physics.energy / frames_;
    double value = 0;
    std::size_t base = 0;
    for (const std::uint32_t item : items) {
      const auto n = index((*set_)[windows_[item].scene].bodies());
      const auto part = [&](auto& all) { return std::span(all).subspan(base, n); };
      const auto bodies = part(own.bodies);
      const Vec3<double>& g = set_->gravity();
      const double gained =
          detail::specific_energy(bodies, part(to), g) - detail::specific_energy(bodies, part(from), g);
      if (gained > 0) {
        value += weight * gained;
        detail::add_specific_energy_gradient(bodies, part(to), g, weight, part(by_to));
        detail::add_specific_energy_gradient(bodies, part(from), g, -weight, part(by_from));
      }
      base += n;
    }
    return value;
  }

  void limit_growth(Items items, States& by_states) const {
    if (std::isinf(loss_.largest_growth)) return;
    std::size_t i = 0;
    for (const std::uint32_t item : items) {
      const int bodies = (*set_)[windows_[item].scene].bodies();
      for (int k = 0; k < bodies; ++k)
        detail::limit_growth(loss_, frames_ * law_.scales.frame_time, 1.0 / bodies, by_states[i++]);
    }
  }

  Law law_;
  const TrajectorySet* set_;
  int frames_;
  RolloutLoss loss_;
  SceneStep::Velocity velocity_;
  std::vector<Window> windows_;
  std::vector<System<double, 1>> alone_;  ///< every body of every scene
  std::vector<SceneForces> forces_;       ///< on each
  std::vector<std::size_t> first_;        ///< a scene's first body among them
  std::vector<SceneSystem> scenes_;       ///< of a law that corrects the analytic one
};

}  // namespace rbres::RBRES_ABI
