#pragma once

#include <limits>
#include <rbres/contact/held_contacts.hpp>
#include <rbres/contact/impact_search.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>
#include <utility>

namespace rbres {

/// Motion over one step with every impact at its own time. The step is cut at each time of impact; contacts
/// that rest, slide or roll are held by constant forces over each part, found such that none approaches at
/// its end: exact where the forces are constant, of second order otherwise, so that nothing drifts and a
/// slide stops where it should. A resting contact costs no events.
template <class System>
class ContinuousContact {
  using S = typename System::Scalar;
  using State = typename System::State;
  static constexpr int N = System::bodies;
  using Pair = detail::ContactPair<System>;
  static constexpr std::size_t P = Pair::points;

 public:
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(system), options_(options), broad_(system.planes().size()), held_(system) {
    pairs_.reserve(N * (N - 1) / 2 + N * system.planes().size());
  }

  /// Takes y from t to t + h. `observer` may have impact(time, before, after), called with the states around
  /// each group of simultaneous impacts (plain scalars only).
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
            Observer& observer, ContactTally<S>& tally) {
    continue_from(y);
    S left = h, now = t;
    const S pull = as<S>(0.1) / h;  // held contacts close a tenth of their gap in a step
    const auto push = [&](const RigidState<S>& state, int i, const Wrench<S>& wrench) {
      const Wrench<S>& contact = contact_[index(i)];
      return wrench + Wrench<S>{contact.force, rotate_back(state.orientation, contact.torque)};
    };
    for (int event = 0; event < options_.max_events; ++event) {
      const MaskOf<S> running = left > S(0);
      if (!any(running)) break;
      State free = fly(system_, forces, integrator, y, now, left);
      find_pairs(y, free, left);
      if (pairs_.empty()) {
        y = chosen(running, free, y);
        left = S(0);
        break;
      }
      measure(y, running);
      if (any(impacts(y, now, observer, tally))) continue;  // velocities changed: look again from here

      const MaskOf<S> held = find_held(running);
      const auto flown = [&](const S& time) {
        return any(held) ? fly(system_, forces, integrator, y, now, time, push)
                         : fly(system_, forces, integrator, y, now, time);
      };
      S part = left;
      State end = free;
      if (any(held)) {
        if (any(soften(y, pull))) free = fly(system_, forces, integrator, y, now, left);
        hold(y, free, left, pull);
        end = flown(left);
      }
      // However dense the impacts, time goes on.
      const S impact = maximum(earliest_impact(y, end, part), minimum(part, S(as<S>(1e-9) * h)));
      const MaskOf<S> cut = running & (impact < part);
      if (any(cut)) {
        part = impact;
        end = flown(part);
      }
      if (any(held)) settle(end, pull);
      y = chosen(running, end, y);
      left = select(running, S(left - part), S(0));
      now = now + part;
    }
    const MaskOf<S> over = left > S(0);
    if (any(over)) {
      tally.overruns += select(over, S(1), S(0));
      State end = fly(system_, forces, integrator, y, now, left);
      detail::meet_all(system_, y, end, as<S>(options_.rest_speed), tally);
      y = chosen(over, end, y);
    }
    last_ = y;
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static State chosen(const MaskOf<S>& m, const State& a, const State& b) {
    State out;
    for (int i = 0; i < N; ++i) out[i] = select(m, a[i], b[i]);
    return out;
  }

  /// A state that did not come out of the last step owes nothing to it.
  void continue_from(const State& y) {
    MaskOf<S> same(true);
    for (int i = 0; i < N; ++i) {
      const MaskOf<S> x = y[i].position.x == last_[i].position.x, z = y[i].position.z == last_[i].position.z,
                      v = y[i].velocity.x == last_[i].velocity.x;
      same = same & x & z & v;
    }
    if (!all(same)) held_.forget_unless(same);
  }

  /// The pairs that may touch between y and `free`, and what is fixed about them.
  void find_pairs(const State& y, const State& free, const S& left) {
    std::array<S, N> reach;
    for (int i = 0; i < N; ++i) {
      // The path stays near its chord: a constant acceleration leaves it by an eighth of its velocity change.
      const S way =
          norm(free[i].position - y[i].position) + as<S>(0.5) * left * norm(free[i].velocity - y[i].velocity);
      // Nothing meets a body whose reach is NaN: lanes that are done need no pairs.
      reach[index(i)] = select(left > S(0), S(system_[i].bounding_radius() * as<S>(1.001) + way),
                               S(std::numeric_limits<typename Constants<S>::Real>::quiet_NaN()));
    }
    pairs_.clear();
    for (const Candidate& who : broad_.find(system_, y, reach)) {
      Pair& pair = pairs_.emplace_back();
      pair.who = who;
      pair.surface = detail::surface_of(system_, who.first, who.second);
      pair.size = system_[who.second].bounding_radius();
      if (who.first >= 0) pair.size = minimum(pair.size, system_[who.first].bounding_radius());
      pair.touch = as<S>(Constants<S>::touch) * pair.size;
      pair.near = as<S>(100.0) * pair.touch;
      // A perfectly elastic contact never comes to rest by bouncing.
      pair.rest_speed = select(pair.surface.restitution < S(1), as<S>(options_.rest_speed), as<S>(1e-7));
      pair.still = minimum(pair.rest_speed, as<S>(100 * Constants<S>::touch));
    }
  }

  void measure(const State& y, const MaskOf<S>& running) {
    for (int i = 0; i < N; ++i) motion_[index(i)] = motion_of(system_[i], y[i]);
    for (Pair& pair : pairs_) {
      pair.find(system_, y, pair.manifold);
      for (std::size_t i = 0; i < P; ++i) {
        pair.touching[i] = running & (pair.manifold.gap[i] <= pair.touch);
        pair.speed[i] = pair.opening(pair.manifold, i, motion_);
      }
    }
  }

  /// Impacts at this instant, pair by pair until no touching pair approaches. Returns where there was one.
  template <class Observer>
  MaskOf<S> impacts(State& y, const S& now, Observer& observer, ContactTally<S>& tally) {
    constexpr int sweeps = 200;
    MaskOf<S> changed(false);
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      MaskOf<S> again(false);
      for (Pair& pair : pairs_) {
        MaskOf<S> near(false);
        for (const auto& touching : pair.touching) near = near | touching;
        if (!any(near)) continue;
        // Chains that would bounce for ever at one instant are ended without bounce.
        Surface<S> surface = pair.surface;
        if (sweep > sweeps / 2) surface.restitution = S(0);
        const auto resolve = [&](auto fixed) {
          return resolve_impact<decltype(fixed)::value>(pair.manifold, pair.touching, surface,
                                                        pair.rest_speed, pair.rest_speed, pair.first(motion_),
                                                        pair.second(motion_));
        };
        const MaskOf<S> hit = pair.plane() ? resolve(std::true_type{}) : resolve(std::false_type{});
        tally.impacts += select(hit, S(1), S(0));
        again = again | hit;
      }
      changed = changed | again;
      if (!any(again)) break;
    }
    if (any(changed)) {
      const State before = y;
      for (int i = 0; i < N; ++i) detail::set_velocities_where(changed, y[i], motion_[index(i)]);
      if constexpr (requires { observer.impact(now, before, y); })
        observer.impact(now, before, std::as_const(y));
    }
    return changed;
  }

  /// Takes up the points that touch, or nearly so, and move slowly.
  MaskOf<S> find_held(const MaskOf<S>& running) {
    held_.clear();
    MaskOf<S> held(false);
    for (Pair& pair : pairs_) {
      const MaskOf<S> room(!held_.full());  // pairs that find none bounce instead
      pair.any_held = MaskOf<S>(false);
      for (std::size_t i = 0; i < P; ++i) {
        const MaskOf<S> close = pair.manifold.gap[i] <= pair.near;
        const MaskOf<S> slow = square(pair.speed[i]) <= square(pair.rest_speed);
        pair.held[i] = running & close & slow & room;
        pair.any_held = pair.any_held | pair.held[i];
      }
      held = held | pair.any_held;
      if (any(pair.any_held)) held_.add(pair, motion_);
    }
    return held;
  }

  /// Slow approaches of held points end at once, without bounce. Returns where there were any.
  MaskOf<S> soften(State& y, const S& pull) {
    MaskOf<S> slow(false);
    for (const Pair& pair : pairs_) {
      for (std::size_t i = 0; i < P; ++i) {
        const S allowed = pair.still + pull * maximum(pair.manifold.gap[i], S(0));
        const MaskOf<S> approaches = pair.speed[i] < -allowed;
        slow = slow | (pair.held[i] & approaches);
      }
    }
    if (!any(slow)) return slow;
    held_.relax(motion_, pull, slow, false);
    for (int i = 0; i < N; ++i) detail::set_velocities_where(slow, y[i], motion_[index(i)]);
    held_.clear();
    for (Pair& pair : pairs_) {
      if (!any(pair.any_held)) continue;
      for (std::size_t i = 0; i < P; ++i) pair.speed[i] = pair.opening(pair.manifold, i, motion_);
      held_.add(pair, motion_);
    }
    return slow;
  }

  /// Finds the constant forces with which no held point approaches when `left` is over.
  void hold(const State& y, const State& free, const S& left, const S& pull) {
    for (int i = 0; i < N; ++i) {
      motion_[index(i)].velocity = free[i].velocity;
      motion_[index(i)].angular_velocity = free[i].angular_velocity_world();
    }
    const auto before = motion_;
    const MaskOf<S> open = left > S(0);
    held_.warm_start(motion_, left);
    held_.relax(motion_, pull, open, true);
    held_.remember(left, as<S>(1e-4) / pull);
    const S rate = S(1) / select(open, left, S(1));
    for (int i = 0; i < N; ++i) {
      const Motion<S>&m = motion_[index(i)], &b = before[index(i)];
      const Mat3<S> axes = rotation_matrix(y[i].orientation);
      const Vec3<S> spin = axes.transposed_times(m.angular_velocity - b.angular_velocity);
      contact_[index(i)] = {(rate * system_[i].mass()) * (m.velocity - b.velocity),
                            rate * (axes * scale(system_[i].inertia(), spin))};
    }
  }

  /// The held contacts at the end of a part: impulses that leave none approaching.
  void settle(State& end, const S& pull) {
    held_.clear();
    for (int i = 0; i < N; ++i) motion_[index(i)] = motion_of(system_[i], end[i]);
    for (Pair& pair : pairs_) {
      if (!any(pair.any_held)) continue;
      pair.find(system_, end, pair.manifold);
      if (!pair.fixed_points()) {  // they may have changed places
        for (std::size_t i = 0; i < P; ++i) {
          const MaskOf<S> near = pair.manifold.gap[i] <= pair.near;
          pair.held[i] = pair.any_held & near;
        }
      }
      held_.add(pair, motion_);
    }
    held_.relax(motion_, pull, MaskOf<S>(true), false);
    for (int i = 0; i < N; ++i) set_velocities(end[i], motion_[index(i)]);
  }

  /// When the first pair meets that is not held.
  S earliest_impact(const State& start, const State& end, const S& part) {
    for (int i = 0; i < N; ++i) {
      end_motion_[index(i)].position = end[i].position;
      end_motion_[index(i)].velocity = end[i].velocity;
      end_motion_[index(i)].angular_velocity = end[i].angular_velocity_world();
    }
    S earliest = part;
    for (const Pair& pair : pairs_) {
      earliest = minimum(earliest, detail::impact_time(system_, pair, start, end, end_motion_, part));
    }
    return earliest;
  }

  const System& system_;
  SimulationOptions options_;
  BroadPhase<S, N> broad_;
  detail::HeldContacts<System> held_;
  std::vector<Pair> pairs_;
  typename Pair::Motions motion_, end_motion_;
  std::array<Wrench<S>, N> contact_;  ///< of the held contacts; world frame, torque too
  State last_{};
};

}  // namespace rbres
