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
/// move from where the axes are closest to these ends: no turn makes them, or a gap, jump.
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
  // Below a sine2 of 1e-5 it is 1: there rounding decides where the axes are closest.
  const S share = clamp(S((as<S>(1e-4) - sine2) * as<S>(1 / 9e-5)), S(0), S(1)) *
                  clamp(S(as<S>(20.0) * overlap / (a.radius + b.radius)), S(0), S(1));
  const MaskOf<S> parallel = share > S(0);

  S s = clamp(S((cosine * f - c) / maximum(sine2, as<S>(1e-6))), S(-a.half_length), a.half_length);
  S t = clamp(S(cosine * s + f), S(-b.half_length), b.half_length);
  s = clamp(S(cosine * t - c), S(-a.half_length), a.half_length);
  t = clamp(S(cosine * s + f), S(-b.half_length), b.half_length);
  const auto on = [&](const Pose<S>& pose, const S& closest, const S& end) {
    return pose.position + S(closest + share * (end - closest)) * pose.axes.z;
  };
  const Vec3<S> on_a[2] = {on(pa, s, low_a), on(pa, s, high_a)};
  const Vec3<S> on_b[2] = {on(pb, t, select(opposed, high_b, low_b)),
                           on(pb, t, select(opposed, low_b, high_b))};

  Manifold<S, 2> m{{}, S(0), {}, {}};
  const Vec3<S> between = as<S>(0.5) * (on_b[0] - on_a[0] + on_b[1] - on_a[1]);
  const Vec3<S> mean = u + select(opposed, S(-1), S(1)) * w;
  const S along = share * dot(mean, between) / squared_norm(mean);
  m.normal = direction_or_z(between - along * mean);
  for (std::size_t i = 0; i < 2; ++i) {
    m.gap[i] = dot(m.normal, on_b[i] - on_a[i]) - a.radius - b.radius;
    m.point[i] = as<S>(0.5) * (on_a[i] + on_b[i] + (a.radius - b.radius) * m.normal);
  }
  m.separation = minimum(m.gap[0], m.gap[1]);
  m.gap[1] = select(parallel, m.gap[1], S(m.none));
  return m;
}

}  // namespace rbres::RBRES_ABI
