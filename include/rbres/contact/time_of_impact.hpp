#pragma once

#include <rbres/contact/detect.hpp>

namespace rbres::RBRES_ABI {

/// The motion of one body over [0, duration], between its states at both ends: cubic Hermite in position and
/// quaternion, so that it is exact for a constant force and off by O(duration^4) otherwise.
template <class S>
RigidState<S> interpolate(const RigidState<S>& from, const RigidState<S>& to, const S& duration,
                          const S& time) {
  const MaskOf<S> moving = duration > S(0);
  const S x = select(moving, S(time / select(moving, duration, S(1))), S(0));
  const S x2 = x * x, end = x2 * (S(3) - S(2) * x), start = S(1) - end;
  const S rise = duration * x * square(S(S(1) - x)), fall = duration * x2 * (x - S(1));
  const Quat<S>&p = from.orientation, &q = to.orientation;
  const Quat<S> dp = quaternion_rate(p, from.angular_velocity), dq = quaternion_rate(q, to.angular_velocity);
  const auto mix = [&](const S& a, const S& da, const S& b, const S& db) {
    return S(start * a + rise * da + end * b + fall * db);
  };
  return {start * from.position + rise * from.velocity + end * to.position + fall * to.velocity,
          normalized(Quat<S>{mix(p.x, dp.x, q.x, dq.x), mix(p.y, dp.y, q.y, dq.y), mix(p.z, dp.z, q.z, dq.z),
                             mix(p.w, dp.w, q.w, dq.w)}),
          start * from.velocity + end * to.velocity,
          start * from.angular_velocity + end * to.angular_velocity};
}

/// What the search for a time of impact knows of one pair.
template <class S>
struct Approach {
  S duration;     ///< of the motion, s
  S gap_start;    ///< m
  S gap_end;      ///< m
  S speed_bound;  ///< no gap changes faster than this, m/s
  S first_look;   ///< a time at which a pair that starts apart from touching is known to be apart, s
  S touch;        ///< a pair that starts closer than this touches, m
  S size;         ///< the smaller bounding radius, m
};

/// The least time between two looks at a pair, s.
template <class S>
S least_look(const Approach<S>& pair) {
  return as<S>(0.02) * pair.size / pair.speed_bound;
}

/// The earliest time in (0, duration] at which gap(time) falls to zero, in the lanes where `search` holds;
/// `duration` in the others, and where it does not happen; `found` says which. The walk advances by no more
/// than the gap allows (conservative advancement, Mirtich 1996), but by at least a fiftieth of the smaller
/// body's way, so that only grazes shallower than about 5e-5 of its radius can be stepped over. After 256
/// looks it ends at the time up to which the pair is known to be apart. The root is enclosed by the Illinois
/// method.
template <class S, class Gap>
S time_of_impact(const Approach<S>& pair, const MaskOf<S>& search, const Gap& gap, MaskOf<S>& found) {
  using std::abs;
  constexpr int looks = 256;
  const S least = least_look(pair);
  S a(0), gap_a = pair.gap_start, b = pair.duration, gap_b = pair.gap_end;
  S time = minimum(maximum(S(pair.gap_start / pair.speed_bound), least), pair.first_look);
  MaskOf<S> walking = search;
  found = MaskOf<S>(false);
  for (int look = 0; look < looks && any(walking); ++look) {
    const MaskOf<S> at_end = time >= pair.duration;
    time = minimum(time, pair.duration);
    const S g = gap(time);
    const MaskOf<S> crossed = walking & (g < S(0));
    found = found | crossed;
    b = select(crossed, time, b);
    gap_b = select(crossed, g, gap_b);
    walking = walking & !crossed & !at_end;
    a = select(walking, time, a);
    gap_a = select(walking, g, gap_a);
    time = time + maximum(S(g / pair.speed_bound), least);
  }
  const S apart = select(walking, a, pair.duration);
  if (!any(found)) return apart;

  const S close = S(4) * S(Constants<S>::epsilon) * pair.size;
  MaskOf<S> working = found;
  // A pair that starts in touch and leaves has a root at the start, too, which is none: halve until past it.
  const MaskOf<S> later = a > S(0), apart_at_start = gap_a > pair.touch;
  MaskOf<S> anchored = later | apart_at_start;
  S root = b;
  MaskOf<S> kept_a(false), kept_b(false);  // which end stayed last time
  for (int i = 0; i < 60 && any(working); ++i) {
    const S width = b - a, fall = gap_a - gap_b;
    const S secant = a + gap_a * width / select(fall > S(0), fall, S(1));
    const MaskOf<S> past_a = secant > a, before_b = secant < b;
    const S t = select(anchored & past_a & before_b, secant, S(a + S(0.5) * width));
    const S g = gap(t);
    root = select(working, t, root);
    // An end that stays twice has its gap halved, so that both ends close in.
    const MaskOf<S> above = g > S(0);
    anchored = anchored | above;
    gap_b = select(above, select(kept_b, S(S(0.5) * gap_b), gap_b), g);
    gap_a = select(above, g, select(kept_a, S(S(0.5) * gap_a), gap_a));
    a = select(above, t, a);
    b = select(above, b, t);
    kept_b = above;
    kept_a = !above;
    const MaskOf<S> off = abs(g) > close, wide = width > S(Constants<S>::epsilon) * b;
    working = working & off & wide;
  }
  return select(found, root, apart);
}

}  // namespace rbres::RBRES_ABI
