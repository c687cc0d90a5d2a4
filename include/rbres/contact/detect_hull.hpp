#pragma once

#include <rbres/contact/detect_box.hpp>
#include <rbres/contact/polytope.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// What two polytopes, or a plane and one, have: a place for each vertex of a hull.
template <class S>
using HullManifold = Manifold<S, ConvexHull<S>::most_vertices>;

/// A manifold without a point, whose places for points stand at `place`.
template <class Manifold, class S>
Manifold without_points(const Vec3<S>& normal, const S& separation, const Vec3<S>& place) {
  Manifold m{normal, separation, {}, {}};
  m.point.fill(place);
  m.gap.fill(S(m.none));
  return m;
}

}  // namespace detail

/// The vertices, in their order.
template <class S>
detail::HullManifold<S> detect(const Plane<S>& plane, const ConvexHull<S>& b, const Pose<S>& pb) {
  using M = detail::HullManifold<S>;
  M m = detail::without_points<M>(plane.normal, S(M::none), pb.position);
  for (std::size_t i = 0; i < b.vertices().size(); ++i) {
    m.point[i] = pb.position + pb.axes * b.vertices()[i];
    m.gap[i] = dot(plane.normal, m.point[i]) - plane.offset;
    m.separation = minimum(m.separation, m.gap[i]);
  }
  return m;
}

namespace detail {

/// The direction from a hull to a point, and how far it is; negative inside.
template <class S>
struct HullDistance {
  Vec3<S> normal;
  S distance;
};

/// Of a point: out of the nearest face where it is inside; else from the nearest point of the faces that it
/// sees, which lies in one of them or on an edge.
template <class S>
HullDistance<S> distance_to(const Polytope<S>& hull, const Vec3<S>& p) {
  const auto above = [&](const HullFace<S>& face) { return S(dot(face.normal, p) - face.offset); };
  const auto over = [&](const HullFace<S>& face) {
    for (int k = 0; k < face.count; ++k) {
      const Vec3<S>& corner = hull.vertex(hull.corner(face, k));
      const Vec3<S> side = hull.vertex(hull.corner(face, k + 1)) - corner;
      if (dot(cross(side, face.normal), p - corner) > S(0)) return false;
    }
    return true;
  };
  HullDistance<S> best{hull.faces[0].normal, above(hull.faces[0])};
  for (const HullFace<S>& face : hull.faces) {
    const S d = above(face);
    if (d > S(0) && over(face)) return {face.normal, d};
    if (d > best.distance) best = {face.normal, d};
  }
  if (best.distance <= S(0)) return best;
  Vec3<S> out;
  S squared(Manifold<S, 1>::none);
  for (const HullEdge& edge : hull.edges) {
    if (above(hull.face(edge.left)) <= S(0) && above(hull.face(edge.right)) <= S(0)) continue;
    const Vec3<S> from = p - hull.vertex(edge.tail), along = hull.along(edge);
    const Vec3<S> here = from - clamp(S(dot(from, along) / squared_norm(along)), S(0), S(1)) * along;
    if (const S d = squared_norm(here); d < squared) {
      squared = d;
      out = here;
    }
  }
  if (squared <= S(Constants<S>::tiny)) return {best.normal, S(0)};
  const S distance = root(squared);
  return {(S(1) / distance) * out, distance};
}

/// How a capsule's axis meets a hull.
template <class S>
struct HullSegment {
  Vec3<S> normal;  ///< from the hull to the axis
  S distance;      ///< negative: inside
  Vec3<S> point;   ///< of the axis, where it is nearest or deepest
};

/// A capsule's axis, in the frame of a hull.
template <class S>
struct Segment {
  Vec3<S> middle, along;  ///< along: a unit vector
  S half_length;

  Vec3<S> at(const S& s) const { return middle + s * along; }
  /// Where it is nearest to an edge, from its middle (Ericson: Real-Time Collision Detection, 5.1.9), and the
  /// way from the edge to there.
  std::pair<S, Vec3<S>> nearest(const Vec3<S>& tail, const Vec3<S>& edge) const {
    const Vec3<S> r = middle - tail;
    const S e = squared_norm(edge), b = dot(along, edge), c = dot(along, r), f = dot(edge, r);
    const S det = e - b * b;
    const bool parallel = det <= as<S>(16 * Constants<S>::epsilon) * e;
    S s = parallel ? S(0) : clamp(S((b * f - c * e) / det), S(-half_length), half_length);
    const S t = clamp(S((b * s + f) / e), S(0), S(1));
    s = clamp(S(b * t - c), S(-half_length), half_length);
    return {s, r + s * along - t * edge};
  }
};

/// Whether some of a segment is inside a hull (Cyrus and Beck 1978).
template <class S>
bool enters(const Polytope<S>& hull, const Segment<S>& segment) {
  S in = -segment.half_length, out = segment.half_length;
  for (const HullFace<S>& face : hull.faces) {
    const S above = dot(face.normal, segment.middle) - face.offset, rise = dot(face.normal, segment.along);
    if (rise > S(0)) {
      out = minimum(out, S(-above / rise));
    } else if (rise < S(0)) {
      in = maximum(in, S(-above / rise));
    } else if (above > S(0)) {
      return false;
    }
    if (in > out) return false;
  }
  return true;
}

/// Where a segment that is outside of a hull is nearest: at an end, or where it crosses an edge.
template <class S>
HullSegment<S> nearest_outside(const Polytope<S>& hull, const Segment<S>& segment) {
  HullSegment<S> best{{}, S(Manifold<S, 1>::none), {}};
  for (const S& end : {S(-segment.half_length), segment.half_length}) {
    const Vec3<S> p = segment.at(end);
    const HullDistance<S> here = distance_to(hull, p);
    if (here.distance < best.distance) best = {here.normal, here.distance, p};
  }
  S squared = square(best.distance);
  for (const HullEdge& edge : hull.edges) {
    const auto [s, way] = segment.nearest(hull.vertex(edge.tail), hull.along(edge));
    const S d = squared_norm(way);
    if (!(d < squared) || d <= S(Constants<S>::tiny)) continue;
    squared = d;
    best.distance = root(d);
    best.normal = (S(1) / best.distance) * way;
    best.point = segment.at(s);
  }
  return best;
}

/// The shortest way out for a segment that enters a hull, by the separating axis theorem: out of a face, or
/// across an edge.
template <class S>
HullSegment<S> way_out(const Polytope<S>& hull, const Segment<S>& segment) {
  using std::abs;
  HullSegment<S> best{{}, S(-Manifold<S, 1>::none), {}};
  for (const HullFace<S>& face : hull.faces) {
    const S rise = dot(face.normal, segment.along);
    const S distance = dot(face.normal, segment.middle) - face.offset - segment.half_length * abs(rise);
    if (distance > best.distance) {
      const S end = rise > S(0) ? S(-segment.half_length) : segment.half_length;
      best = {face.normal, distance, segment.at(end)};
    }
  }
  for (const HullEdge& edge : hull.edges) {
    const Vec3<S>&left = hull.face(edge.left).normal, &right = hull.face(edge.right).normal;
    if (dot(left, segment.along) * dot(right, segment.along) >= S(0)) continue;
    const Vec3<S> along = hull.along(edge), across = cross(along, segment.along);
    const S squared = squared_norm(across);
    if (squared <= as<S>(16 * Constants<S>::epsilon) * squared_norm(along)) continue;
    const S side = dot(across, left + right) < S(0) ? S(-1) : S(1);
    const Vec3<S> normal = (side * inverse_root(squared)) * across;
    const S distance = dot(normal, segment.middle - hull.vertex(edge.tail));
    if (distance > best.distance)
      best = {normal, distance, segment.at(segment.nearest(hull.vertex(edge.tail), along).first)};
  }
  return best;
}

template <class S>
Pose<S> relative(const Pose<S>& frame, const Pose<S>& pose) {
  const auto turned = [&](const Vec3<S>& v) { return frame.axes.transposed_times(v); };
  return {turned(pose.position - frame.position),
          {turned(pose.axes.x), turned(pose.axes.y), turned(pose.axes.z)}};
}

}  // namespace detail

/// A ball and a convex hull: one point.
template <class S>
Manifold<S, 1> detect(const Sphere<S>& a, const Pose<S>& pa, const ConvexHull<S>& b, const Pose<S>& pb) {
  return detail::with_polytope(b, [&](const auto& hull) {
    const auto nearest = detail::distance_to(hull, pb.axes.transposed_times(pa.position - pb.position));
    const Vec3<S> n = -(pb.axes * nearest.normal);
    const S gap = nearest.distance - a.radius;
    return Manifold<S, 1>{n, gap, {pa.position + (a.radius + S(0.5) * gap) * n}, {gap}};
  });
}

/// The point of the capsule's axis that is nearest to the hull, and where that is a face the ends of what
/// stands over it.
template <class S>
Manifold<S, 3> detect(const Capsule<S>& a, const Pose<S>& pa, const ConvexHull<S>& b, const Pose<S>& pb) {
  return detail::with_polytope(b, [&](const auto& hull) {
    const Pose<S> pose = detail::relative(pb, pa);
    const detail::Segment<S> axis{pose.position, pose.axes.z, a.half_length};
    const auto nearest =
        detail::enters(hull, axis) ? detail::way_out(hull, axis) : detail::nearest_outside(hull, axis);
    auto m = detail::without_points<Manifold<S, 3>>(S(-1) * (pb.axes * nearest.normal),
                                                    S(nearest.distance - a.radius), pa.position);
    const auto put = [&](std::size_t i, const Vec3<S>& at, const S& distance) {
      m.gap[i] = distance - a.radius;
      m.point[i] = pb.position + pb.axes * at + (a.radius + S(0.5) * m.gap[i]) * m.normal;
    };
    put(0, nearest.point, nearest.distance);
    S most = as<S>(0.9999);
    const HullFace<S>* under = nullptr;
    for (const HullFace<S>& face : hull.faces) {
      if (const S cosine = dot(face.normal, nearest.normal); cosine > most) {
        most = cosine;
        under = &face;
      }
    }
    if (under == nullptr) return m;
    detail::FaceClip<S> clip(hull, *under);
    clip.add(axis.at(S(-a.half_length)));
    clip.add(axis.at(a.half_length));
    std::size_t place = 1;
    for (const Vec3<S>& at : clip.cut()) {
      if (place == 3) break;
      put(place++, at, maximum(S(dot(under->normal, at) - under->offset), nearest.distance));
    }
    return m;
  });
}

}  // namespace rbres::RBRES_ABI
