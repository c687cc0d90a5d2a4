#pragma once

#include <rbres/contact/detect_capsule.hpp>

namespace rbres::RBRES_ABI {

/// The eight corners, numbered by the signs of their coordinates.
template <class S>
Manifold<S, 8> detect(const Plane<S>& plane, const Box<S>& b, const Pose<S>& pb) {
  Manifold<S, 8> m{plane.normal, S(m.none), {}, {}};
  const Vec3<S> x = b.half.x * pb.axes.x, y = b.half.y * pb.axes.y, z = b.half.z * pb.axes.z;
  for (std::size_t i = 0; i < 8; ++i) {
    Vec3<S> corner = pb.position;
    corner = i & 1 ? corner + x : corner - x;
    corner = i & 2 ? corner + y : corner - y;
    corner = i & 4 ? corner + z : corner - z;
    m.point[i] = corner;
    m.gap[i] = dot(plane.normal, corner) - plane.offset;
    m.separation = minimum(m.separation, m.gap[i]);
  }
  return m;
}

namespace detail {

/// A ball against a box; the normal points from the box to the ball. Inside, the nearest face counts.
template <class S>
Manifold<S, 1> detect_box_ball(const Box<S>& box, const Pose<S>& pose, const Vec3<S>& centre,
                               const S& radius) {
  const Vec3<S> p = pose.axes.transposed_times(centre - pose.position);
  const Vec3<S>& h = box.half;
  const Vec3<S> nearest{clamp(p.x, S(-h.x), h.x), clamp(p.y, S(-h.y), h.y), clamp(p.z, S(-h.z), h.z)};
  const Vec3<S> out = p - nearest;
  const S squared = squared_norm(out);
  const MaskOf<S> outside = squared > S(Constants<S>::tiny);

  const Vec3<S> depth = h - absolute(p);
  const MaskOf<S> x_below_y = depth.x <= depth.y, x_below_z = depth.x <= depth.z,
                  y_below_z = depth.y <= depth.z;
  const MaskOf<S> x_least = x_below_y & x_below_z, y_least = (!x_least) & y_below_z;
  const Vec3<S> sign{select(p.x < S(0), S(-1), S(1)), select(p.y < S(0), S(-1), S(1)),
                     select(p.z < S(0), S(-1), S(1))};
  const Vec3<S> inner = select(x_least, Vec3<S>{sign.x, S(0), S(0)},
                               select(y_least, Vec3<S>{S(0), sign.y, S(0)}, Vec3<S>{S(0), S(0), sign.z}));
  const S least = minimum(depth.x, minimum(depth.y, depth.z));

  const Vec3<S> n = pose.axes * select(outside, direction_or_z(out), inner);
  const S distance = select(outside, S(root(select(outside, squared, S(1)))), S(-least));
  const S gap = distance - radius;
  return {n, gap, {centre - (radius + S(0.5) * gap) * n}, {gap}};
}

template <class S, int P>
Manifold<S, P> flipped(Manifold<S, P> m) {
  m.normal = -m.normal;
  return m;
}

}  // namespace detail

/// A ball and a box: one point.
template <class S>
Manifold<S, 1> detect(const Sphere<S>& a, const Pose<S>& pa, const Box<S>& b, const Pose<S>& pb) {
  return detail::flipped(detail::detect_box_ball(b, pb, pa.position, a.radius));
}

/// The point of the capsule's axis that is nearest to the box, and the ends of what of the axis lies over the
/// same face or edge, where they lie under the same normal. The squared distance to a box is convex along the
/// axis with a piecewise linear slope, so its zero is found exactly between the slope's kinks, where the axis
/// crosses the planes of the faces.
template <class S>
Manifold<S, 3> detect(const Capsule<S>& a, const Pose<S>& pa, const Box<S>& b, const Pose<S>& pb) {
  using std::abs;
  const Vec3<S> middle = pb.axes.transposed_times(pa.position - pb.position);
  const Vec3<S> u = pb.axes.transposed_times(pa.axes.z);
  const Vec3<S>& h = b.half;
  const auto slope = [&](const S& s) {
    const Vec3<S> p = middle + s * u;
    return dot(u, p - Vec3<S>{clamp(p.x, S(-h.x), h.x), clamp(p.y, S(-h.y), h.y), clamp(p.z, S(-h.z), h.z)});
  };
  S low = -a.half_length, high = a.half_length;
  S slope_low = slope(low), slope_high = slope(high);
  const auto narrow = [&](const S& kink) {
    const S k = clamp(kink, S(-a.half_length), a.half_length), at = slope(k);
    const MaskOf<S> falls = at <= S(0), rises = at > S(0), past_low = k > low, before_high = k < high;
    const MaskOf<S> up = falls & past_low, down = rises & before_high;
    low = select(up, k, low);
    slope_low = select(up, at, slope_low);
    high = select(down, k, high);
    slope_high = select(down, at, slope_high);
  };
  const auto crossings = [&](const S& m, const S& d, const S& half) {
    const S inverse = S(1) / select(abs(d) < as<S>(1e-12), as<S>(1e-12), d);
    narrow((half - m) * inverse);
    narrow((-half - m) * inverse);
    return inverse;
  };
  const Vec3<S> inverse{crossings(middle.x, u.x, h.x), crossings(middle.y, u.y, h.y),
                        crossings(middle.z, u.z, h.z)};
  const S rise = slope_high - slope_low;
  const S share = select(rise > S(Constants<S>::tiny),
                         S(-slope_low / select(rise > S(Constants<S>::tiny), rise, S(1))), S(0.5));
  const S nearest =
      select(slope_low >= S(0), low,
             select(slope_high <= S(0), high, S(low + clamp(share, S(0), S(1)) * (high - low))));

  // From where to where the axis lies over the same face, or along the same edge. One that lies on the border
  // of a face is over it, on whichever side rounding puts it.
  S from(-a.half_length), to = a.half_length;
  const auto stay = [&](const S& m, const S& d, const S& inverse_d, const S& half) {
    const S wide = as<S>(1 + 1e-6) * half;
    const S one = (wide - m) * inverse_d, other = (-wide - m) * inverse_d;
    const MaskOf<S> over = abs(S(m + nearest * d)) <= wide;
    from = select(over, maximum(from, minimum(one, other)), from);
    to = select(over, minimum(to, maximum(one, other)), to);
  };
  stay(middle.x, u.x, inverse.x, h.x);
  stay(middle.y, u.y, inverse.y, h.y);
  stay(middle.z, u.z, inverse.z, h.z);
  const S along[3] = {nearest, minimum(from, nearest), maximum(to, nearest)};
  Manifold<S, 3> m{{}, S(0), {}, {}};
  for (std::size_t i = 0; i < 3; ++i) {
    const auto ball = detail::detect_box_ball(b, pb, pa.position + along[i] * pa.axes.z, a.radius);
    m.point[i] = ball.point[0];
    if (i == 0) {
      m.normal = -ball.normal;
      m.separation = ball.separation;
      m.gap[0] = ball.gap[0];
    } else {
      m.gap[i] = select(dot(m.normal, ball.normal) < as<S>(-0.9999), ball.gap[0], S(m.none));
    }
  }
  return m;
}

}  // namespace rbres::RBRES_ABI
