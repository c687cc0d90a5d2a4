#pragma once

#include <limits>
#include <rbres/contact/broad_phase.hpp>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/contact/on_course.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// By how much a body may turn on its way from `from` to `to`, `time` seconds later, rad: its spin times the
/// time, or, where it has spun faster in between, what the interpolation of both ends (see interpolate())
/// adds to the turn that is left.
template <class S>
S turn_of(const RigidState<S>& from, const RigidState<S>& to, const S& time) {
  const Vec3<S>&w = from.angular_velocity, &end = to.angular_velocity;
  const S spun = time * (maximum(norm(w), norm(end)) + as<S>(0.5) * norm(end - w));
  // A cubic leaves its chord by 4/27 of each end's slope less that of the chord; an angle t is at most 2.3
  // times the distance of the quaternions.
  const S turned = as<S>(2.3 * 35 / 27) * chord(from.orientation, to.orientation) +
                   as<S>(4.0 / 27) * time * (norm(w) + norm(end));
  return maximum(spun, turned);
}

/// Finds the pairs that may touch over a part of a step: those whose bounding balls, grown by the ways that
/// their bodies may go, overlap.
template <class System>
class PairSearch {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Bodies = BodyIndices<System>;
  using Broad = BroadPhase<S, System::bodies, System::most_planes>;
  static constexpr bool compound = PartsOf<typename System::Shape>::compound;
  static constexpr bool remembers = may_be_crowd<System>;

 public:
  using Ways = PerBody<S, System::bodies>;  ///< m

  /// `rest_speed` as in SimulationOptions.
  PairSearch(const System& system, const S& rest_speed)
      : system_(&system),
        rest_speed_(rest_speed),
        broad_(system.planes().size(), system.size()),
        way_(per_body<S>(system)),
        wanted_(way_),
        reach_(way_),
        turned_(way_) {
    pairs_.reserve(most_part_pairs(system));
    if constexpr (remembers) broad_.reserve_for_some(as<S>(1.1));
  }

  /// The state is another than that in which pairs were found.
  void forget() {
    if constexpr (remembers) {
      for (auto& pair : pairs_) pair.known = false;
    }
  }

  /// A new part, in which no forces are known that carry one of `bodies` farther than its free flight.
  void start_part(const Bodies& bodies) {
    for (const int i : bodies) wanted_[index(i)] = S(0);
  }

  /// How far the bodies' centres may get while they go from `from` to `to`, `time` seconds later.
  const Ways& ways(const Bodies& bodies, const State& from, const State& to, const S& time) {
    for (const int i : bodies) {
      way_[index(i)] = maximum(way_of(from[i], to[i], time), wanted_[index(i)]);
      if constexpr (compound) turned_[index(i)] = turned_way_of(i, from[i], to[i], time);
    }
    return way_;
  }
  /// The same as before.
  const Ways& ways() const { return way_; }
  /// The pairs that may touch on these ways, in the lanes `running`. Those of two bodies that are on course
  /// stay as they were.
  ContactPairs<System>& find(const Bodies& bodies, const State& from, const MaskOf<S>& running,
                             const OnCourse<System>& course) {
    constexpr auto nan = std::numeric_limits<typename Constants<S>::Real>::quiet_NaN();
    for (const int i : bodies) {
      // Nothing meets a body whose reach is NaN: lanes that are done need no pairs.
      const S ball = (*system_)[i].bounding_radius() * as<S>(1.001);
      reach_[index(i)] = select(running, S(ball + way_[index(i)]), S(nan));
    }
    using Parts = typename ContactPair<System>::Parts;
    const auto go_on = [&](auto& pairs) {
      course.has(pairs.next()) ? void(pairs.keep_next()) : pairs.drop_next();
    };
    const auto add_pair = [&](const Candidate& who, const Parts& parts) {
      if constexpr (remembers) {
        struct {
          Candidate who;
          Parts parts;
        } const found{who, parts};
        while (pairs_.left() && found_before(pairs_.next(), found)) go_on(pairs_);
        if (pairs_.left() && !found_before(found, pairs_.next())) return pairs_.keep_next().start_part();
      }
      pairs_.emplace_back(*system_, who, rest_speed_, parts);
    };
    const auto add = [&](const auto& found) {
      for (const Candidate& who : found) {
        if constexpr (compound) {
          each_near_part(
              *system_, from, who, [&](int i) { return S(way_[index(i)] + turned_[index(i)]); },
              [&](const auto& parts) { add_pair(who, parts); });
        } else {
          add_pair(who, Parts{});
        }
      }
    };
    if constexpr (remembers) {
      pairs_.renew();
      if (const auto others = course.others(); others.size() < bodies.size()) {
        add(broad_.find(*system_, from, reach_, bodies, others, [&](int i) { return !course.has(i); }));
      } else {
        add(broad_.find(*system_, from, reach_, bodies));
      }
      while (pairs_.left()) go_on(pairs_);
    } else {
      pairs_.clear();
      if constexpr (has_groups<System>) {
        add(broad_.find(*system_, from, reach_, bodies));
      } else {
        add(broad_.find(*system_, from, reach_));
      }
    }
    return pairs_;
  }

  /// Whether these ways are as long as those of bodies that are at `to` after `time` seconds. If not, the
  /// next will be.
  bool covers(const Bodies& bodies, const State& from, const State& to, const S& time,
              const MaskOf<S>& running) {
    bool all = true;
    for (const int i : bodies) {
      S way = way_of(from[i], to[i], time), covered = way_[index(i)];
      if constexpr (compound) {
        way += turned_way_of(i, from[i], to[i], time);
        covered += turned_[index(i)];
      }
      const S slack = as<S>(5e-4) * (*system_)[i].bounding_radius();
      const MaskOf<S> beyond = running & (way > covered + slack);
      if (!any(beyond)) continue;
      all = false;
      wanted_[index(i)] = select(beyond, S(as<S>(1.5) * way), wanted_[index(i)]);
    }
    return all;
  }

 private:
  /// How far a body's centre may get from where it starts. The path stays near its chord: a constant
  /// acceleration leaves it by an eighth of its velocity change.
  static S way_of(const RigidState<S>& from, const RigidState<S>& to, const S& time) {
    return norm(to.position - from.position) + as<S>(0.5) * time * norm(to.velocity - from.velocity);
  }
  /// How far the centres of a compound's parts may get by its turn.
  S turned_way_of(int i, const RigidState<S>& from, const RigidState<S>& to, const S& time) const {
    return (*system_)[i].shape().lever() * minimum(turn_of(from, to, time), as<S>(2));
  }
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  const System* system_;
  S rest_speed_;
  Broad broad_;
  ContactPairs<System> pairs_;
  Ways way_, wanted_;  ///< wanted_: by contact forces
  Ways reach_;         ///< of each body with its way
  Ways turned_;        ///< how far a turn takes the parts of a compound
};

/// How fast the fastest body of these pairs spins, rad/s.
template <class System>
typename System::Scalar fastest_spin(const ContactPairs<System>& pairs, const typename System::State& y) {
  typename System::Scalar most2(0);
  for (const ContactPair<System>& pair : pairs) {
    most2 = maximum(most2, squared_norm(y[pair.who.second].angular_velocity));
    if (!pair.plane()) most2 = maximum(most2, squared_norm(y[pair.who.first].angular_velocity));
  }
  return root(most2);
}

/// Notes how fast the points of a pair open.
template <class System>
void measure_speeds(const MotionsOf<System>& motion, ContactPair<System>& pair) {
  using S = typename System::Scalar;
  for (std::size_t i = 0; i < pair.manifold.used; ++i) {
    const bool there = any(pair.manifold.gap[i] < S(pair.manifold.none / 2));
    pair.speed[i] = there ? pair.opening(pair.manifold, i, motion) : S(0);
  }
}
/// Notes how a pair meets in a state with these motions; points touch in the lanes `where` at most.
template <class System>
void measure(const System& system, const typename System::State& y, const MotionsOf<System>& motion,
             const MaskOf<typename System::Scalar>& where, ContactPair<System>& pair) {
  pair.know_manifold(system, y);
  for (std::size_t i = 0; i < pair.manifold.used; ++i)
    pair.touching[i] = where & (pair.manifold.gap[i] <= pair.touch);
  measure_speeds(motion, pair);
}

}  // namespace rbres::RBRES_ABI::detail
