#pragma once

#include <limits>
#include <rbres/contact/broad_phase.hpp>
#include <rbres/contact/contact_memory.hpp>
#include <rbres/contact/impact_search.hpp>
#include <rbres/contact/impacts.hpp>
#include <rbres/core/reserved.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>
#include <rbres/sim/resting_work.hpp>
#include <span>
#include <utility>

namespace rbres {

/// Motion over one step with every impact at its own time. The step is cut at each time of impact; contacts
/// that rest, slide or roll get constant forces over each part, found such that none approaches at its end:
/// exact where the forces are constant, of second order otherwise, so that nothing drifts and a slide stops
/// where it should. A resting contact costs no events.
///
/// What is guaranteed: no impact deeper than about 5e-5 of the smaller body's radius is missed, unless the
/// step meets its event cap; then its rest is done with discrete contacts and counted as an overrun.
template <class System>
class ContinuousContact {
  using S = typename System::Scalar;
  using State = typename System::State;
  static constexpr int N = System::bodies;
  using Pair = detail::ContactPair<System>;
  using Motions = typename Pair::Motions;
  static constexpr std::size_t P = Pair::points;

 public:
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(&system),
        options_(options),
        broad_(system.planes().size()),
        impacts_(system, most_pairs(system)),
        islands_(most_pairs(system)),
        rows_(system),
        memory_(rows_.capacity()),
        discrete_(system) {
    pairs_.reserve(most_pairs(system));
  }

  /// Takes y from t to t + h. `observer` may have impact(time, before, after), called with the states around
  /// each group of simultaneous impacts (plain scalars only). Where a number is no longer finite, neither is
  /// the state that is left.
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
            Observer& observer, ContactTally<S>& tally) {
    continue_from(y);
    impacts_.start_step();
    pushed_.fill(S(0));
    S left = h, now = t;
    MaskOf<S> lost(false);          // goes too far for one step
    bool answered = false;          // the impacts of this instant
    const S pull = as<S>(0.1) / h;  // resting contacts close a tenth of their gap in a step
    for (int event = 0; event < options_.max_events; ++event) {
      MaskOf<S> running = (left > S(0)) & !lost;
      if (!any(running)) break;
      State free = fly(*system_, forces, integrator, y, now, left);
      const MaskOf<S> faulty = find_pairs(y, free, left, running);
      left = select(faulty, S(0), left);
      running = running & !faulty;
      if (pairs_.empty()) {
        y = chosen(running, free, y);
        left = select(running, S(0), left);
        continue;
      }
      Motions motion = motions(y);
      measure(y, motion, running);
      if (!answered) {
        const MaskOf<S> hit = impacts_.resolve(pairs_, motion, tally.impacts);
        if (any(hit)) {
          const State before = y;
          for (int i = 0; i < N; ++i)
            detail::set_velocities_where(impacts_.changed(i), y[i], motion[index(i)]);
          if constexpr (requires { observer.impact(now, before, y); })
            observer.impact(now, before, std::as_const(y));
          answered = true;
          continue;
        }
      }
      answered = false;

      const bool resting = find_resting(running);
      if (resting && any(stop_approaches(y, motion, pull)))
        free = fly(*system_, forces, integrator, y, now, left);
      std::array<RestingForce, N> contact;
      if (resting) contact = resting_forces(y, motion, free, left, pull);
      const auto flown = [&](const S& time) {
        const auto push = [&](const RigidState<S>& state, int i, const S& at, const Wrench<S>& wrench) {
          const RestingForce& c = contact[index(i)];
          const Vec3<S> torque = c.torque_at(S(at - now), state.position - y[i].position);
          return wrench + Wrench<S>{c.force, rotate_back(state.orientation, torque)};
        };
        return resting ? fly(*system_, forces, integrator, y, now, time, push)
                       : fly(*system_, forces, integrator, y, now, time);
      };
      State end = resting ? flown(left) : free;
      // Contact forces may carry a body farther than its free flight: then others may be in its way.
      if (resting && widen_reach(y, end, left, running)) {
        answered = true;
        continue;
      }
      S part = left;
      // However dense the impacts, time goes on.
      const S impact = maximum(earliest_impact(y, end, part, lost), minimum(part, S(as<S>(1e-9) * h)));
      const MaskOf<S> cut = running & (impact < part);
      if (any(cut)) {
        part = impact;
        end = flown(part);
      }
      if (resting) {
        const State flown_to = end;
        settle(end, pull);
        bound_energy(y, flown_to, contact, part, end);
      }
      y = chosen(running, end, y);
      left = select(running, S(left - part), left);
      now = now + part;
      pushed_.fill(S(0));
    }
    const MaskOf<S> over = left > S(0), unresolved = impacts_.unresolved();
    tally.overruns += over | unresolved;
    if (any(over)) {
      State end = fly(*system_, forces, integrator, y, now, left);
      discrete_.resolve(y, end, left, as<S>(options_.rest_speed), tally);
      y = chosen(over, end, y);
    }
    last_ = y;
  }

 private:
  using RestingForce = detail::RestingForce<S>;

  static std::size_t most_pairs(const System& system) { return N * (N - 1) / 2 + N * system.planes().size(); }
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static State chosen(const MaskOf<S>& m, const State& a, const State& b) {
    State out;
    for (int i = 0; i < N; ++i) out[i] = select(m, a[i], b[i]);
    return out;
  }
  Motions motions(const State& y) const {
    Motions m;
    for (int i = 0; i < N; ++i) m[index(i)] = motion_of((*system_)[i], y[i]);
    return m;
  }
  /// A state that did not come out of the last step owes nothing to it.
  void continue_from(const State& y) {
    MaskOf<S> same(true);
    const S *now = &y[0].position.x, *then = &last_[0].position.x;
    for (int k = 0; k < State::size; ++k) {
      const MaskOf<S> equal = now[k] == then[k];
      same = same & equal;
    }
    if (!all(same)) memory_.forget_unless(same);
  }

  /// The pairs that may touch between y and `free`, and what is fixed about them. Returns the running lanes
  /// in which a number, or its square, is not finite; there the body's position says so, too.
  MaskOf<S> find_pairs(State& y, const State& free, const S& left, const MaskOf<S>& running) {
    constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
    std::array<S, N> reach;
    MaskOf<S> faulty(false);
    for (int i = 0; i < N; ++i) {
      const S way = maximum(way_of(y[i], free[i], left), pushed_[index(i)]);
      way_[index(i)] = way;
      const Quat<S>& q = free[i].orientation;
      const S all_of_it = way + norm(free[i].velocity) + norm(free[i].angular_velocity) + q.x + q.w;
      const MaskOf<S> unfit = running & !is_finite(all_of_it);
      faulty = faulty | unfit;
      y[i].position.x = select(unfit, S(nan), y[i].position.x);
      // Nothing meets a body whose reach is NaN: lanes that are done need no pairs.
      reach[index(i)] = select(running, S((*system_)[i].bounding_radius() * as<S>(1.001) + way), S(nan));
    }
    pairs_.clear();
    for (const Candidate& who : broad_.find(*system_, y, reach))
      pairs_.emplace_back(*system_, who, as<S>(options_.rest_speed));
    return faulty;
  }

  /// How far a body may get from where it starts. The path stays near its chord: a constant acceleration
  /// leaves it by an eighth of its velocity change.
  static S way_of(const RigidState<S>& from, const RigidState<S>& to, const S& time) {
    return norm(to.position - from.position) + as<S>(0.5) * time * norm(to.velocity - from.velocity);
  }
  /// Notes the bodies that go farther than the pairs were sought for. Returns whether there are any.
  bool widen_reach(const State& y, const State& end, const S& left, const MaskOf<S>& running) {
    bool wider = false;
    for (int i = 0; i < N; ++i) {
      const S way = way_of(y[i], end[i], left);
      const MaskOf<S> beyond =
          running & (way > way_[index(i)] + as<S>(5e-4) * (*system_)[i].bounding_radius());
      if (!any(beyond)) continue;
      wider = true;
      pushed_[index(i)] = select(beyond, S(as<S>(1.5) * way), pushed_[index(i)]);
    }
    return wider;
  }

  void measure(const State& y, const Motions& motion, const MaskOf<S>& running) {
    for (Pair& pair : pairs_) {
      pair.find(*system_, y, pair.manifold);
      for (std::size_t i = 0; i < P; ++i) {
        pair.touching[i] = running & (pair.manifold.gap[i] <= pair.touch);
        pair.speed[i] = pair.opening(pair.manifold, i, motion);
      }
    }
  }

  /// Marks the points that touch, or nearly so, and move slowly; groups their pairs into islands. False where
  /// there are none.
  bool find_resting(const MaskOf<S>& running) {
    islands_.clear();
    rests_.fill(MaskOf<S>(false));
    bool found = false;
    for (std::size_t k = 0; k < pairs_.size(); ++k) {
      Pair& pair = pairs_[k];
      pair.any_resting = MaskOf<S>(false);
      for (std::size_t i = 0; i < P; ++i) {
        const MaskOf<S> close = pair.manifold.gap[i] <= pair.near;
        const MaskOf<S> slow = square(pair.speed[i]) <= square(pair.rest_speed);
        const MaskOf<S> comes = pair.speed[i] <= S(0);  // impacts are answered: what is left is rounding
        pair.resting[i] = running & ((close & slow) | (pair.touching[i] & comes));
        pair.any_resting = pair.any_resting | pair.resting[i];
      }
      if (!any(pair.any_resting)) continue;
      found = true;
      for (const int body : {pair.who.first, pair.who.second}) {
        if (body >= 0) rests_[index(body)] = rests_[index(body)] | pair.any_resting;
      }
      islands_.add(k, pair.who.first, pair.who.second);
    }
    if (found) islands_.group(Packed<S>);
    return found;
  }

  /// Takes up the resting points of an island, each to leave at target(pair, point) (m/s) at least.
  template <class Target>
  void take_up(std::size_t island, Motions& motion, const Target& target) {
    rows_.clear();
    for (const std::size_t k : islands_[island]) {
      const Pair& pair = pairs_[k];
      if (rows_.full()) return;  // points that find no room bounce when they have sunk in
      for (std::size_t i = 0; i < P; ++i) {
        if (any(pair.resting[i]))
          rows_.add(pair, i, pair.resting[i], target(pair, i), pair.surface.friction, motion);
      }
    }
  }

  /// The least speed (m/s) at which a resting point is to leave: gaps close slowly, overlaps open slowly.
  static S closing(const Pair& pair, std::size_t i, const S& pull) { return -pull * pair.manifold.gap[i]; }

  /// Slow approaches of resting points end at once, without bounce. Returns where there were any.
  MaskOf<S> stop_approaches(State& y, Motions& motion, const S& pull) {
    MaskOf<S> stopped(false);
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      MaskOf<S> slow(false);
      for (const std::size_t k : islands_[island]) {
        const Pair& pair = pairs_[k];
        for (std::size_t i = 0; i < P; ++i) {
          const S allowed = pair.still + pull * maximum(pair.manifold.gap[i], S(0));
          const MaskOf<S> approaches = pair.speed[i] < -allowed;
          slow = slow | (pair.resting[i] & approaches);
        }
      }
      if (!any(slow)) continue;
      stopped = stopped | slow;
      take_up(island, motion,
              [&](const Pair& pair, std::size_t i) { return minimum(closing(pair, i, pull), S(0)); });
      rows_.solve(motion, slow);
    }
    if (!any(stopped)) return stopped;
    for (int i = 0; i < N; ++i)
      detail::set_velocities_where(stopped & rests_[index(i)], y[i], motion[index(i)]);
    for (Pair& pair : pairs_) {
      for (std::size_t i = 0; i < P; ++i) pair.speed[i] = pair.opening(pair.manifold, i, motion);
    }
    return stopped;
  }

  /// The constant forces with which no resting point approaches when `left` is over. A point may come back as
  /// fast as it left: its gap over the time between is then none.
  std::array<RestingForce, N> resting_forces(const State& y, Motions motion, const State& free, const S& left,
                                             const S& pull) {
    for (int i = 0; i < N; ++i) {
      motion[index(i)].velocity = free[i].velocity;
      motion[index(i)].angular_velocity = free[i].angular_velocity_world();
    }
    const Motions before = motion;
    const MaskOf<S> open = left > S(0);
    const S rate = S(1) / select(open, left, S(1));
    // Forces over the shortest parts are rounding, and not worth keeping.
    const S kept_rate = select(left * pull > as<S>(1e-4), rate, S(0));
    std::array<RestingForce, N> contact{};
    memory_.start();
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      take_up(island, motion,
              [&](const Pair& pair, std::size_t i) { return S(closing(pair, i, pull) - pair.speed[i]); });
      rows_.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
        std::array<S, 3> impulse = memory_.force(row);
        for (S& p : impulse) p = select(row.active, S(left * p), S(0));
        point.add(impulse, first, second);
      });
      rows_.solve(motion, open);
      rows_.each(motion, [&](auto& row, auto& point, auto&, auto&) {
        memory_.keep(row, kept_rate, open);
        Vec3<S> force;
        for (std::size_t d = 0; d < 3; ++d) force += (rate * row.impulse()[d]) * point.direction(d);
        if (row.plane()) return;
        const auto first = index(row.who.first), second = index(row.who.second);
        const S &a = motion[first].inverse_mass, &b = motion[second].inverse_mass;
        const auto along = [&](const Vec3<S>& v, const Vec3<S>& w) {
          return (S(1) / (a + b)) * (a * v + b * w);
        };
        const Vec3<S> from = along(y[row.who.first].velocity, y[row.who.second].velocity);
        const Vec3<S> to = along(motion[first].velocity, motion[second].velocity);
        const Vec3<S> drift = cross(from, force), bend = as<S>(0.5) * rate * cross(to - from, force);
        contact[second].paired += force;
        contact[second].drift += drift;
        contact[second].bend += bend;
        contact[first].paired -= force;
        contact[first].drift -= drift;
        contact[first].bend -= bend;
      });
    }
    memory_.finish(open);
    for (int i = 0; i < N; ++i) {
      if (!any(rests_[index(i)])) continue;
      const Motion<S>&m = motion[index(i)], &b = before[index(i)];
      const Mat3<S> axes = rotation_matrix(y[i].orientation);
      const Vec3<S> spin = axes.transposed_times(m.angular_velocity - b.angular_velocity);
      contact[index(i)].force = (rate * (*system_)[i].mass()) * (m.velocity - b.velocity);
      contact[index(i)].torque = rate * (axes * scale((*system_)[i].inertia(), spin));
    }
    return contact;
  }

  /// The resting contacts at the end of a part: impulses that leave none approaching.
  void settle(State& end, const S& pull) {
    Motions motion = motions(end);
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      for (const std::size_t k : islands_[island]) {
        Pair& pair = pairs_[k];
        pair.find(*system_, end, pair.manifold);
        if (pair.fixed_points()) continue;
        for (std::size_t i = 0; i < P; ++i) {  // they may have changed places
          const MaskOf<S> near = pair.manifold.gap[i] <= pair.near;
          pair.resting[i] = pair.any_resting & near;
        }
      }
      take_up(island, motion, [&](const Pair& pair, std::size_t i) { return closing(pair, i, pull); });
      rows_.solve(motion, MaskOf<S>(true));
    }
    for (int i = 0; i < N; ++i) detail::set_velocities_where(rests_[index(i)], end[i], motion[index(i)]);
  }

  /// Resting contacts do no work but that of friction, which is never positive: what their forces did too
  /// much from y to `flown`, and the impulses from there to `end`, is taken out of the islands' motion again.
  void bound_energy(const State& y, const State& flown, const std::array<RestingForce, N>& contact,
                    const S& part, State& end) {
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      if constexpr (!Packed<S>) {
        bound_energy(islands_[island], rests_, y, flown, contact, part, end);
      } else {  // one group of pairs, in which each lane has islands of its own: the smallest body names them
        std::array<S, N> name;
        for (int i = 0; i < N; ++i) name[index(i)] = as<S>(double(i));
        for (int round = 1; round < N; ++round) {
          for (const std::size_t k : islands_[island]) {
            const Pair& pair = pairs_[k];
            if (pair.plane()) continue;
            S &a = name[index(pair.who.first)], &b = name[index(pair.who.second)];
            const S least = minimum(a, b);
            a = select(pair.any_resting, least, a);
            b = select(pair.any_resting, least, b);
          }
        }
        for (int i = 0; i < N; ++i) {
          std::array<MaskOf<S>, N> members;
          for (int j = 0; j < N; ++j)
            members[index(j)] = rests_[index(j)] & (name[index(j)] == as<S>(double(i)));
          bound_energy(islands_[island], members, y, flown, contact, part, end);
        }
      }
    }
  }
  void bound_energy(std::span<const std::size_t> island, const std::array<MaskOf<S>, N>& members,
                    const State& y, const State& flown, const std::array<RestingForce, N>& contact,
                    const S& part, State& end) {
    energy_.start();
    for (const std::size_t k : island) {
      const Pair& pair = pairs_[k];
      energy_.add(pair.who, pair.manifold.normal, pair.surface.friction,
                  pair.any_resting & members[index(pair.who.second)]);
    }
    S excess(0);
    for (const int i : energy_.bodies()) {
      const auto& body = (*system_)[i];
      const S gained = contact[index(i)].work(y[i], flown[i], part) + kinetic_energy(body, end[i]) -
                       kinetic_energy(body, flown[i]);
      excess += select(members[index(i)], gained, S(0));
    }
    energy_.remove(*system_, end, excess, members);
  }

  /// When the first pair touches that does not rest.
  S earliest_impact(const State& start, const State& end, const S& part, MaskOf<S>& lost) {
    Motions motion;
    for (int i = 0; i < N; ++i) {
      motion[index(i)].position = end[i].position;
      motion[index(i)].velocity = end[i].velocity;
      motion[index(i)].angular_velocity = end[i].angular_velocity_world();
    }
    S earliest = part;
    for (const Pair& pair : pairs_)
      earliest = minimum(earliest, detail::impact_time(*system_, pair, start, end, motion, part, lost));
    return earliest;
  }

  const System* system_;
  SimulationOptions options_;
  BroadPhase<S, N> broad_;
  detail::Impacts<System> impacts_;
  detail::Islands<N> islands_;
  detail::ContactRows<System> rows_;
  detail::ContactMemory<System> memory_;
  detail::IslandEnergy<System> energy_;
  detail::DiscreteContact<System> discrete_;  ///< for steps past their event cap
  detail::Reserved<Pair> pairs_;
  std::array<S, N> way_, pushed_;   ///< m, for which pairs were sought; that contact forces ask for
  std::array<MaskOf<S>, N> rests_;  ///< which bodies have a resting contact
  State last_{};
};

}  // namespace rbres
