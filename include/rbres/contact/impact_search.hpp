#pragma once

#include <rbres/contact/contact_pair.hpp>
#include <rbres/contact/time_of_impact.hpp>

namespace rbres::RBRES_ABI::detail {

/// No point of the pair's surfaces approaches faster than this between the two states, m/s.
template <class System>
typename System::Scalar speed_bound(const System& system, const Candidate& who,
                                    const typename System::State& start, const typename System::State& end) {
  using S = typename System::Scalar;
  const auto lever = [&](int i) {
    return with_shape(system[i].shape(), [](const auto& s) { return s.lever(); });
  };
  const auto bound = [&](const typename System::State& y) {
    Vec3<S> v = y[who.second].velocity;
    S spin = lever(who.second) * norm(y[who.second].angular_velocity);
    if (who.first >= 0) {
      v -= y[who.first].velocity;
      spin += lever(who.first) * norm(y[who.first].angular_velocity);
    }
    return S(norm(v) + spin);
  };
  return maximum(bound(start), bound(end));
}

/// No point of the pair's surfaces is farther from where it was, relative to the other body, m.
template <class System>
typename System::Scalar displacement_bound(const System& system, const Candidate& who,
                                           const typename System::State& start,
                                           const typename System::State& end) {
  using S = typename System::Scalar;
  Vec3<S> way = end[who.second].position - start[who.second].position;
  if (who.first >= 0) way -= end[who.first].position - start[who.first].position;
  S bound = norm(way);
  for (const int i : {who.first, who.second}) {
    if (i < 0) continue;
    // A turn by an angle t moves a point by 2 sin(t / 2) levers.
    const S lever = with_shape(system[i].shape(), [](const auto& s) { return s.lever(); });
    bound += S(2) * lever * chord(start[i].orientation, end[i].orientation);
  }
  return bound;
}

/// speed_bound() with room for rounding, m/s.
template <class System>
typename System::Scalar fastest_approach(const System& system, const ContactPair<System>& pair,
                                         const typename System::State& start,
                                         const typename System::State& end) {
  using S = typename System::Scalar;
  return speed_bound(system, pair.who, start, end) + as<S>(1e-6) * pair.speed_scale;
}

/// For how long the pair certainly comes no nearer than `near` between the two states, s: see ContactPair.
template <class System>
typename System::Scalar time_apart(const System& system, const ContactPair<System>& pair,
                                   const typename System::State& start, const typename System::State& end) {
  using S = typename System::Scalar;
  return maximum(S(pair.manifold.separation - pair.near), S(0)) / fastest_approach(system, pair, start, end);
}

/// When a pair touches between `start` and `end`, `part` seconds later, at a point that does not rest; `part`
/// where it does not; earlier where the walk ended before. `pair` knows the start; `end_motion` is that of
/// `end`, `at` any state. A pair may get as deep as `sinking` (share of its size) before it has an impact.
/// `lost` gains the lanes in which the pair goes so far that no number of looks would do.
template <class System>
typename System::Scalar impact_time(const System& system, const ContactPair<System>& pair,
                                    const typename System::State& start, const typename System::State& end,
                                    const typename ContactPair<System>::Motions& end_motion,
                                    const typename System::Scalar& part,
                                    const typename System::Scalar& sinking, typename System::State& at,
                                    MaskOf<typename System::Scalar>& lost) {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  constexpr std::size_t P = Pair::points;
  const S none(Pair::PlanePair::none);
  const MaskOf<S> open = part > S(0);
  std::array<MaskOf<S>, P> counts;  // points that may start a contact
  MaskOf<S> counted(false);
  for (std::size_t i = 0; i < P; ++i) {
    const MaskOf<S> held = pair.fixed_points() ? pair.resting[i] : MaskOf<S>(false);
    counts[i] = open & !held;
    counted = counted | counts[i];
  }
  if (!any(counted)) return part;

  // A point that overlaps and leaves comes back when it is as deep again. Where two bodies touch, their
  // points cannot be told apart, and edges may slide deeper while all points leave: there a new point shows
  // by a depth that others do not reach. What that adds up to stays below most_sinking(), except in a heap:
  // there pairs may be deeper already, where a face that the edges have passed has no point any more, and
  // time must go on.
  const MaskOf<S> heap = sinking > S(0), overlaps = pair.manifold.separation <= S(0);
  MaskOf<S> touching = heap & overlaps;
  for (std::size_t i = 0; i < pair.manifold.used; ++i) touching = touching | pair.touching[i];
  const S room = select(heap, pair.near, S(0));
  const auto allowance_of = [&] {
    if (pair.plane() || P == 1) return S(0);
    if (pair.fixed_points()) return select(touching, room, S(0));
    const S spare = clamp(S(pair.most_sinking() + minimum(pair.manifold.separation, S(0))), room, pair.near);
    return select(pair.any_resting, pair.near, select(touching, spare, S(0)));
  };
  const S allowance = allowance_of();
  const S deep = sinking * pair.size;
  const auto lowest = [&](const typename Pair::Contact& contact) {
    const auto above = [&](const S& gap, const S& before) {  // the depth at which an impact is due
      return S(gap + maximum(deep, S(allowance - minimum(before, S(0)))));
    };
    if (!pair.fixed_points()) return above(contact.separation, pair.manifold.separation);
    S least = none;
    for (std::size_t i = 0; i < contact.used; ++i) {
      const S gap = above(contact.gap[i], pair.manifold.gap[i]);
      least = minimum(least, select(counts[i], gap, none));
    }
    return least;
  };

  const S fastest = fastest_approach(system, pair, start, end), gap_start = lowest(pair.manifold);
  // What can neither reach the other on its way nor end there is not looked at.
  const MaskOf<S> passes = gap_start < fastest * part;
  if (!any(counted & passes)) {
    const MaskOf<S> ends_near = gap_start <= displacement_bound(system, pair.who, start, end);
    if (!any(counted & ends_near)) return part;
  }
  typename Pair::Contact after;
  pair.find(system, end, after);
  Approach<S> approach{part, gap_start, lowest(after), fastest, part, pair.touch, pair.size};
  MaskOf<S> dips(!pair.fixed_points());
  for (std::size_t i = 0; i < pair.manifold.used; ++i) {
    const MaskOf<S>& counted_here = counts[i];
    if (!pair.fixed_points() || !any(counted_here)) continue;
    const S later = pair.opening(after, i, end_motion);
    const MaskOf<S> came = pair.speed[i]<S(0), leaves = later> S(0);
    dips = dips | (counted_here & came & leaves);
    // A point that has just left is apart when gravity has turned it round, if that comes soon.
    const MaskOf<S> leaving = counted_here & pair.touching[i];
    const S slowed = maximum(S(pair.speed[i] - later), S(Constants<S>::tiny));
    const S turn = part * clamp(S(pair.speed[i] / slowed), as<S>(1e-3), S(1));
    approach.first_look = select(leaving, minimum(approach.first_look, turn), approach.first_look);
  }
  // Bodies that go far may pass one another, whatever their speeds at both ends.
  const MaskOf<S> far = approach.speed_bound * part > as<S>(0.5) * pair.size;
  dips = dips | far;
  const MaskOf<S> ends_below = approach.gap_end < S(0);
  const MaskOf<S> near = approach.gap_start + approach.gap_end < approach.speed_bound * part;
  const MaskOf<S> search = counted & (ends_below | (dips & near));
  if (!any(search)) return part;
  lost = lost | (search & (part > as<S>(1e9) * least_look(approach)));

  typename Pair::Contact probe;
  MaskOf<S> found(false);
  const auto gap = [&](const S& when) {
    for (const int i : {pair.who.first, pair.who.second}) {
      if (i >= 0) at[i] = interpolate(start[i], end[i], part, when);
    }
    pair.find(system, at, probe);
    return lowest(probe);
  };
  return time_of_impact(approach, search, gap, found);
}

}  // namespace rbres::RBRES_ABI::detail
