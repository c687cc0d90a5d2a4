#pragma once

#include <rbres/contact/broad_phase.hpp>
#include <rbres/contact/time_of_impact.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/sim/discrete_contact.hpp>
#include <rbres/sim/options.hpp>
#include <utility>

namespace rbres {

/// Motion over one step with every impact at its own time. The step is cut at each time of impact; contacts
/// that rest, slide or roll are held by constant forces over each part: half of their impulse at its start,
/// the other half, solved anew, at its end (kick, drift, kick), which is of second order and exact where the
/// forces are constant, so that nothing drifts and a slide stops where it should. A resting contact costs no
/// events.
template <class System>
class ContinuousContact {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Shape = typename System::Shape;
  static constexpr int N = System::bodies;
  using BodyPair = PairManifold<S, Shape>;
  using PlanePair = PlaneManifold<S, Shape>;
  static constexpr std::size_t P =
      BodyPair::points > PlanePair::points ? BodyPair::points : PlanePair::points;
  /// Where the points of two bodies stand moves with their manifold; those of a plane are corners, always the
  /// same.
  static constexpr bool single = P == 1;

  struct Pair {
    Candidate who;
    Vec3<S> normal;
    std::array<Vec3<S>, P> point;
    std::array<S, P> gap, speed;
    std::array<MaskOf<S>, P> touching, held;
    MaskOf<S> any_held;
    Surface<S> surface;
    S separation, touch, rest_speed, still;
    std::size_t rows;  ///< where its held points start in rows_
    int points;
  };

 public:
  ContinuousContact(const System& system, const SimulationOptions& options)
      : system_(system), options_(options), broad_(system.planes().size()) {
    const std::size_t pairs = N * (N - 1) / 2 + N * system.planes().size();
    pairs_.reserve(pairs);
    // More than 6 N pairs of bodies cannot touch at once unless they overlap; those that do come first.
    rows_.reserve(P * std::min<std::size_t>(pairs, 6 * N + N * system.planes().size()));
  }

  /// Takes y from t to t + h. `observer` may have impact(time, before, after), called with the states around
  /// each group of simultaneous impacts (plain scalars only).
  template <class Model, class Integrator, class Observer>
  void step(const Model& forces, const Integrator& integrator, State& y, const S& t, const S& h,
            Observer& observer, ContactTally<S>& tally) {
    S left = h, now = t;
    const S pull = as<S>(0.1) / h;  // held contacts close a tenth of their gap in a step
    for (int event = 0; event < options_.max_events; ++event) {
      const MaskOf<S> running = left > S(0);
      if (!any(running)) return;
      const State free = fly(system_, forces, integrator, y, now, left);
      find_pairs(y, free, left);
      if (pairs_.empty()) {
        y = chosen(running, free, y);
        return;
      }
      for (int i = 0; i < N; ++i) motion_[index(i)] = motion_of(system_[i], y[i]);
      for (Pair& pair : pairs_) measure(pair, y, running);
      if (any(impacts(y, now, observer, tally))) continue;  // velocities changed: look again from here

      const MaskOf<S> held = hold(y, free, left, pull);
      const auto push = [&](const RigidState<S>& state, int i, const Wrench<S>& wrench) {
        const Wrench<S>& contact = contact_[index(i)];
        return wrench + Wrench<S>{contact.force, rotate_back(state.orientation, contact.torque)};
      };
      const auto flown = [&](const S& time) {
        return any(held) ? fly(system_, forces, integrator, y, now, time, push)
                         : fly(system_, forces, integrator, y, now, time);
      };
      S part = left;
      State end = any(held) ? flown(left) : free;
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
    if (!any(over)) return;
    tally.overruns += select(over, S(1), S(0));
    State end = fly(system_, forces, integrator, y, now, left);
    detail::meet_all(system_, y, end, as<S>(options_.rest_speed), tally);
    y = chosen(over, end, y);
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  static State chosen(const MaskOf<S>& m, const State& a, const State& b) {
    State out;
    for (int i = 0; i < N; ++i) out[i] = select(m, a[i], b[i]);
    return out;
  }

  /// The pairs that may touch between y and `free`, and what is fixed about them.
  void find_pairs(const State& y, const State& free, const S& left) {
    std::array<S, N> reach;
    for (int i = 0; i < N; ++i) {
      // The path stays near its chord: a constant acceleration leaves it by an eighth of its velocity change.
      reach[index(i)] = system_[i].bounding_radius() * as<S>(1.001) + norm(free[i].position - y[i].position) +
                        as<S>(0.5) * left * norm(free[i].velocity - y[i].velocity);
    }
    pairs_.clear();
    for (const Candidate& who : broad_.find(system_, y, reach)) {
      Pair pair{};
      pair.who = who;
      pair.surface = detail::surface_of(system_, who.first, who.second);
      S size = system_[who.second].bounding_radius();
      if (who.first >= 0) size = minimum(size, system_[who.first].bounding_radius());
      pair.touch = as<S>(Constants<S>::touch) * size;
      // A perfectly elastic contact never comes to rest by bouncing.
      pair.rest_speed = select(pair.surface.restitution < S(1), as<S>(options_.rest_speed), as<S>(1e-7));
      pair.still = minimum(pair.rest_speed, as<S>(100 * Constants<S>::touch));
      pairs_.push_back(pair);
    }
  }

  void set_geometry(Pair& pair, const State& y) const {
    detail::with_manifold(system_, y, pair.who.first, pair.who.second, [&](const auto& m, auto) {
      pair.normal = m.normal;
      pair.separation = m.separation;
      pair.points = m.points;
      for (std::size_t i = 0; i < P; ++i) {
        pair.gap[i] = i < m.points ? m.gap[i] : S(m.none);
        if (i < m.points) pair.point[i] = m.point[i];
      }
    });
  }
  Motion<S>& first(const Pair& pair) { return motion_[index(pair.who.first < 0 ? 0 : pair.who.first)]; }
  Motion<S>& second(const Pair& pair) { return motion_[index(pair.who.second)]; }

  /// Speed at which the gap at one point opens, m/s.
  static S opening(const Pair& pair, std::size_t i, const std::array<Motion<S>, N>& motion) {
    const auto at = [&](int body) {
      const Motion<S>& m = motion[index(body)];
      return m.velocity + cross(m.angular_velocity, pair.point[i] - m.position);
    };
    Vec3<S> v = at(pair.who.second);
    if (pair.who.first >= 0) v -= at(pair.who.first);
    return dot(pair.normal, v);
  }

  void measure(Pair& pair, const State& y, const MaskOf<S>& running) {
    set_geometry(pair, y);
    for (std::size_t i = 0; i < P; ++i) {
      pair.touching[i] = running & (pair.gap[i] <= pair.touch);
      pair.speed[i] = opening(pair, i, motion_);
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
          if constexpr (single && BodyPair::central && PlanePair::central) {
            const Manifold<S, 1, true> m{pair.normal, pair.separation, pair.point, pair.gap};
            return resolve_impact<decltype(fixed)::value>(m, pair.touching, surface, pair.rest_speed,
                                                          pair.still, first(pair), second(pair));
          } else {
            const Manifold<S, int(P)> m{pair.normal, pair.separation, pair.point, pair.gap};
            return resolve_impact<decltype(fixed)::value>(m, pair.touching, surface, pair.rest_speed,
                                                          pair.still, first(pair), second(pair));
          }
        };
        const MaskOf<S> hit = pair.who.first < 0 ? resolve(std::true_type{}) : resolve(std::false_type{});
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

  /// Finds the contacts that rest at y and the impulses that hold them until the end of the step.
  MaskOf<S> hold(const State& y, const State& free, const S& left, const S& pull) {
    rows_.clear();
    MaskOf<S> held(false);
    for (Pair& pair : pairs_) {
      pair.any_held = MaskOf<S>(false);
      for (std::size_t i = 0; i < P; ++i) {
        const MaskOf<S> slow = pair.speed[i] <= pair.still - pull * minimum(pair.gap[i], S(0));
        pair.held[i] = pair.touching[i] & slow;
        pair.any_held = pair.any_held | pair.held[i];
      }
      held = held | pair.any_held;
      add_rows(pair);
    }
    if (!any(held)) return held;
    for (int i = 0; i < N; ++i) {
      Motion<S>& m = motion_[index(i)];
      m.velocity = free[i].velocity;
      m.angular_velocity = free[i].angular_velocity_world();
    }
    std::array<Motion<S>, N> before = motion_;
    relax(S(0));
    const S rate = S(1) / select(left > S(0), left, S(1));
    for (int i = 0; i < N; ++i) {
      Motion<S>&m = motion_[index(i)], &b = before[index(i)];
      const Mat3<S> axes = rotation_matrix(y[i].orientation);
      const Vec3<S> spin = axes.transposed_times(m.angular_velocity - b.angular_velocity);
      contact_[index(i)] = {(rate * system_[i].mass()) * (m.velocity - b.velocity),
                            rate * (axes * scale(system_[i].inertia(), spin))};
      m.velocity = y[i].velocity;
      m.angular_velocity = y[i].angular_velocity_world();
    }
    return held;
  }

  struct Row {
    ContactPoint<S, false> free;
    ContactPoint<S, true> fixed;
  };

  /// Rows for the held points of a pair at its present geometry.
  void add_rows(Pair& pair) {
    pair.rows = rows_.size();
    if (!any(pair.any_held)) return;
    if (rows_.size() + index(pair.points) > rows_.capacity()) {  // see the constructor
      pair.any_held = MaskOf<S>(false);
      return;
    }
    for (int i = 0; i < pair.points; ++i) {
      Row row;
      if (any(pair.held[index(i)])) {
        if (pair.who.first < 0) {
          row.fixed = ContactPoint<S, true>(pair.normal, pair.point[index(i)], first(pair), second(pair));
        } else {
          row.free = ContactPoint<S, false>(pair.normal, pair.point[index(i)], first(pair), second(pair));
        }
      }
      rows_.push_back(row);
    }
  }

  /// Calls f(pair, point index, row) for every held point.
  template <class F>
  void each_held(const F& f) {
    for (Pair& pair : pairs_) {
      if (!any(pair.any_held)) continue;
      for (int i = 0; i < pair.points; ++i) {
        if (!any(pair.held[index(i)])) continue;
        Row& row = rows_[pair.rows + index(i)];
        pair.who.first < 0 ? f(pair, index(i), row.fixed) : f(pair, index(i), row.free);
      }
    }
  }

  /// Projected Gauss-Seidel over all held points: no approach, less a tenth of the gap per `pull` of a
  /// second.
  void relax(const S& pull) {
    constexpr int sweeps = 300;
    const S enough = as<S>(1e-3 * Constants<S>::touch);  // m/s
    MaskOf<S> working(true);
    for (int sweep = 0; sweep < sweeps; ++sweep) {
      S worst(0);
      each_held([&](Pair& pair, std::size_t i, auto& row) {
        worst = maximum(worst, row.relax(S(-pull * pair.gap[i]), pair.surface.friction,
                                         pair.held[i] & working, first(pair), second(pair)));
      });
      working = working & (worst > enough);
      if (!any(working)) return;
    }
  }

  /// The held contacts at the end of a part: impulses that leave none approaching.
  void settle(State& end, const S& pull) {
    rows_.clear();
    for (int i = 0; i < N; ++i) motion_[index(i)] = motion_of(system_[i], end[i]);
    for (Pair& pair : pairs_) {
      if (!any(pair.any_held)) continue;
      set_geometry(pair, end);
      const MaskOf<S> was = pair.any_held;
      pair.any_held = MaskOf<S>(false);
      for (std::size_t i = 0; i < P; ++i) {
        // A plane's points keep their numbers; two bodies' points may have changed places.
        const MaskOf<S> touches = was & (pair.gap[i] <= S(4) * pair.touch);
        pair.held[i] = pair.who.first < 0 || single ? pair.held[i] : touches;
        pair.any_held = pair.any_held | pair.held[i];
      }
      add_rows(pair);
    }
    relax(pull);
    for (int i = 0; i < N; ++i) set_velocities(end[i], motion_[index(i)]);
  }

  /// When the first pair that is not held meets between start and end; `part` where none does.
  S earliest_impact(const State& start, const State& end, const S& part) {
    S earliest = part;
    for (int i = 0; i < N; ++i) {
      end_motion_[index(i)].position = end[i].position;
      end_motion_[index(i)].velocity = end[i].velocity;
      end_motion_[index(i)].angular_velocity = end[i].angular_velocity_world();
    }
    for (Pair& pair : pairs_) {
      const MaskOf<S> open = part > S(0);
      const bool plane = pair.who.first < 0;
      std::array<MaskOf<S>, P> counts;  // points that may start a contact
      for (std::size_t i = 0; i < P; ++i) counts[i] = open & !(plane ? pair.held[i] : pair.any_held);
      // A point that overlaps and leaves comes back when it is as deep again.
      const auto lowest = [&](const Pair& p) {
        if (!plane) return S(p.separation - minimum(pair.separation, S(0)));
        S least(PlanePair::none);
        for (std::size_t i = 0; i < P; ++i) {
          const S gap = p.gap[i] - minimum(pair.gap[i], S(0));
          least = minimum(least, select(counts[i], gap, S(PlanePair::none)));
        }
        return least;
      };
      MaskOf<S> counted(false);
      for (const auto& c : counts) counted = counted | c;
      if (!any(counted)) continue;

      Pair after = pair;
      set_geometry(after, end);
      Approach<S> approach{part, lowest(pair), lowest(after), S(0), part, pair.touch, S(0)};
      approach.size = system_[pair.who.second].bounding_radius();
      approach.speed_bound = speed_bound(pair, start, end) + as<S>(1e-6);
      if (!plane) approach.size = minimum(approach.size, system_[pair.who.first].bounding_radius());

      MaskOf<S> dips(!plane && !single);
      for (std::size_t i = 0; i < P; ++i) {
        if (!any(counts[i])) continue;
        const S later = opening(after, i, end_motion_);
        const MaskOf<S> came = pair.speed[i]<S(0), leaves = later> S(0);
        dips = dips | (counts[i] & came & leaves);
        // A point that has just left is apart when gravity has turned it round, if that comes soon.
        const MaskOf<S> touched = pair.touching[i], leaving = counts[i] & touched;
        const S lost = maximum(S(pair.speed[i] - later), S(Constants<S>::tiny));
        approach.first_look =
            select(leaving,
                   minimum(approach.first_look, S(part * clamp(S(pair.speed[i] / lost), as<S>(1e-3), S(1)))),
                   approach.first_look);
      }
      const MaskOf<S> search =
          counted & ((approach.gap_end < S(0)) |
                     (dips & (approach.gap_start + approach.gap_end < approach.speed_bound * part)));
      if (!any(search)) continue;
      Pair probe = pair;
      State at = start;
      MaskOf<S> found(false);
      const S time = time_of_impact(
          approach, search,
          [&](const S& when) {
            if (!plane)
              at[pair.who.first] = interpolate(start[pair.who.first], end[pair.who.first], part, when);
            at[pair.who.second] = interpolate(start[pair.who.second], end[pair.who.second], part, when);
            set_geometry(probe, at);
            return lowest(probe);
          },
          found);
      earliest = select(found, minimum(earliest, time), earliest);
    }
    return earliest;
  }

  /// No point of the pair's surfaces approaches faster than this, m/s.
  S speed_bound(const Pair& pair, const State& start, const State& end) const {
    const auto lever = [&](int i) {
      return detail::with_shape(system_[i].shape(), [](const auto& s) { return s.lever(); });
    };
    const auto bound = [&](const State& y) {
      const int j = pair.who.second;
      Vec3<S> v = y[j].velocity;
      S spin = lever(j) * norm(y[j].angular_velocity);
      if (pair.who.first >= 0) {
        v -= y[pair.who.first].velocity;
        spin += lever(pair.who.first) * norm(y[pair.who.first].angular_velocity);
      }
      return S(norm(v) + spin);
    };
    return maximum(bound(start), bound(end));
  }

  const System& system_;
  SimulationOptions options_;
  BroadPhase<S, N> broad_;
  std::vector<Pair> pairs_;
  std::vector<Row> rows_;
  std::array<Motion<S>, N> motion_, end_motion_;
  std::array<Wrench<S>, N> contact_;  ///< of the held contacts; world frame
};

}  // namespace rbres
