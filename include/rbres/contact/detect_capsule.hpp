#pragma once

#include <rbres/contact/detect_sphere.hpp>

namespace rbres::RBRES_ABI {

/// A plane and a capsule: a point for each end.
template <class S>
Manifold<S, 2> detect(const Plane<S>& plane, const Capsule<S>& b, const Pose<S>& pb) {
  const Vec3<S> half = b.half_length * pb.axes.z;
  Manifold<S, 2> m{plane.normal, S(0), {pb.position + half, pb.position - half}, {}};
  for (std::size_t i = 0; i < 2; ++i) {
    m.gap[i] = dot(plane.normal, m.point[i]) - plane.offset - b.radius;
    m.point[i] -= b.radius * plane.normal;
  }
  m.separation = minimum(m.gap[0], m.gap[1]);
  return m;
}

/// A ball and a capsule: one point.
template <class S>
Manifold<S, 1> detect(const Sphere<S>& a, const Pose<S>& pa, const Capsule<S>& b, const Pose<S>& pb) {
  const S along = clamp(dot(pb.axes.z, pa.position - pb.position), S(-b.half_length), b.half_length);
  return detail::detect_balls(pa.position, a.radius, pb.position + along * pb.axes.z, b.radius);
}

/// Closest points of the two axes (Ericson: Real-Time Collision Detection, 5.1.9). Where the axes are nearly
/// parallel, so that one capsule can lie on another, both ends of their overlap: between where they stand on
/// either axis, across the mean of both, so that no order of the two is preferred. In between, the points
/// move from where the axes are closest to these ends: no turn makes them, or a gap, jump. Below a skew of
/// 0.1 rad they are the ends of a short line, over which the gap grows by 5e-6 of the radii: where axes are
/// closest moves along them by the tilt over the square of the skew, faster than a step can follow.
template <class S>
Manifold<S, 2> detect(const Capsule<S>& a, const Pose<S>& pa, const Capsule<S>& b, const Pose<S>& pb) {
  using std::abs;
  const Vec3<S>&u = pa.axes.z, &w = pb.axes.z;
  const Vec3<S> r = pa.position - pb.position;
  const S cosine = dot(u, w), c = dot(u, r), f = dot(w, r);
  const S sine2 = S(1) - square(cosine);
  const MaskOf<S> opposed = cosine < S(0);
  const S low_a = maximum(S(-a.half_length), S(-c - b.half_length * abs(cosine)));
  const S high_a = minimum(a.half_length, S(-c + b.half_length * abs(cosine)));
  const S low_b = maximum(S(-b.half_length), S(f - a.half_length * abs(cosine)));
  const S high_b = minimum(b.half_length, S(f + a.half_length * abs(cosine)));
  const S overlap = minimum(S(high_a - low_a), S(high_b - low_b));
  const S wide = a.radius + b.radius;
  const S lies = clamp(S(as<S>(20.0) * overlap / wide), S(0), S(1));
  // Below a sine2 of 1e-5 it is 1: there rounding decides where the axes are closest.
  const S share = lies * clamp(S((as<S>(1e-4) - sine2) * as<S>(1 / 9e-5)), S(0), S(1));
  // Half of the line.
  const S skew = positive_root(maximum(sine2, as<S>(1e-12)));
  const S half_line = as<S>(3e-3) * lies * wide * maximum(S(inverse(skew) - as<S>(10.0)), S(0));
  const MaskOf<S> two = half_line > S(0);

  S s = clamp(S((cosine * f - c) / maximum(sine2, as<S>(1e-6))), S(-a.half_length), a.half_length);
  S t = clamp(S(cosine * s + f), S(-b.half_length), b.half_length);
  s = clamp(S(cosine * t - c), S(-a.half_length), a.half_length);
  t = clamp(S(cosine * s + f), S(-b.half_length), b.half_length);
  // Where the points stand on an axis, and how far it is from there to the end of the line.
  const auto at = [&](const S& closest, const S& end) { return S(closest + share * (end - closest)); };
  const auto rest = [&](const S& from, const S& end) {
    return clamp(S(end - from), S(-half_line), half_line);
  };
  const S end_b[2] = {select(opposed, high_b, low_b), select(opposed, low_b, high_b)};
  const S at_a[2] = {at(s, low_a), at(s, high_a)}, at_b[2] = {at(t, end_b[0]), at(t, end_b[1])};

  Manifold<S, 2> m{{}, S(0), {}, {}};
  const Vec3<S> between =
      pb.position - pa.position + as<S>(0.5) * (at_b[0] + at_b[1]) * w - as<S>(0.5) * (at_a[0] + at_a[1]) * u;
  const Vec3<S> mean = u + select(opposed, S(-1), S(1)) * w;
  const S along = share * dot(mean, between) / squared_norm(mean);
  m.normal = direction_or_z(between - along * mean);
  for (std::size_t i = 0; i < 2; ++i) {
    const Vec3<S> on_a = pa.position + S(at_a[i] + rest(at_a[i], i == 0 ? low_a : high_a)) * u;
    const Vec3<S> on_b = pb.position + S(at_b[i] + rest(at_b[i], end_b[i])) * w;
    m.gap[i] = dot(m.normal, on_b - on_a) - a.radius - b.radius;
    m.point[i] = as<S>(0.5) * (on_a + on_b + (a.radius - b.radius) * m.normal);
  }
  m.separation = minimum(m.gap[0], m.gap[1]);
  m.gap[1] = select(two, m.gap[1], S(m.none));
  return m;
}

}  // namespace rbres::RBRES_ABI
