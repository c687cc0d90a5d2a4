#pragma once

#include <rbres/contact/detect_sphere.hpp>

namespace rbres {

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

template <class S>
Manifold<S, 1> detect(const Sphere<S>& a, const Pose<S>& pa, const Capsule<S>& b, const Pose<S>& pb) {
  const S along = clamp(dot(pb.axes.z, pa.position - pb.position), S(-b.half_length), b.half_length);
  return detail::detect_balls(pa.position, a.radius, pb.position + along * pb.axes.z, b.radius);
}

/// Closest points of the two axes (Ericson: Real-Time Collision Detection, 5.1.9); both ends of the overlap
/// where the axes are nearly parallel, so that one capsule can lie on another.
template <class S>
Manifold<S, 2> detect(const Capsule<S>& a, const Pose<S>& pa, const Capsule<S>& b, const Pose<S>& pb) {
  using std::abs;
  const Vec3<S>&u = pa.axes.z, &w = pb.axes.z;
  const Vec3<S> r = pa.position - pb.position;
  const S cosine = dot(u, w), c = dot(u, r), f = dot(w, r);
  const S sine2 = S(1) - square(cosine);
  const S low = maximum(S(-a.half_length), S(-c - b.half_length * abs(cosine)));
  const S high = minimum(a.half_length, S(-c + b.half_length * abs(cosine)));
  const MaskOf<S> aligned = sine2<as<S>(1e-4), overlap = high> low;
  const MaskOf<S> parallel = aligned & overlap;

  S s = clamp(S((cosine * f - c) / maximum(sine2, as<S>(1e-6))), S(-a.half_length), a.half_length);
  const S t = clamp(S(cosine * s + f), S(-b.half_length), b.half_length);
  s = clamp(S(cosine * t - c), S(-a.half_length), a.half_length);
  const S ends[2] = {select(parallel, low, s), select(parallel, high, s)};

  Manifold<S, 2> m{{}, S(0), {}, {}};
  const S middle = S(0.5) * (ends[0] + ends[1]);
  m.normal =
      direction_or_z(pb.position + clamp(S(cosine * middle + f), S(-b.half_length), b.half_length) * w -
                     pa.position - middle * u);
  for (std::size_t i = 0; i < 2; ++i) {
    const Vec3<S> on_a = pa.position + ends[i] * u;
    const S along = clamp(S(cosine * ends[i] + f), S(-b.half_length), b.half_length);
    m.gap[i] = dot(m.normal, pb.position + along * w - on_a) - a.radius - b.radius;
    m.point[i] = on_a + (a.radius + S(0.5) * m.gap[i]) * m.normal;
  }
  m.separation = minimum(m.gap[0], m.gap[1]);
  m.gap[1] = select(parallel, m.gap[1], S(m.none));
  return m;
}

}  // namespace rbres
