#pragma once

#include <rbres/contact/detect_hull.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// The face along whose normal another polytope is farthest away, and how far.
template <class S>
struct FaceAxis {
  int face = 0;
  S gap = S(-Manifold<S, 1>::none);
  S largest = gap;  ///< exactly: `face` is one that clearly beats those before it

  FaceAxis() = default;
  /// Of several faces whose gaps differ by less than `clearly` (m) the first.
  FaceAxis(const Polytope<S>& of, const Polytope<S>& other, const S& clearly) {
    for (int i = 0; i < static_cast<int>(of.faces.size()); ++i) {
      const S found = other.lowest(of.face(i).normal).first - of.face(i).offset;
      largest = maximum(largest, found);
      if (!(found > gap + clearly)) continue;
      face = i;
      gap = found;
    }
  }
};

/// The pair of edges along whose common normal two polytopes are farthest apart.
template <class S>
struct EdgeAxis {
  const HullEdge* edge_a = nullptr;
  const HullEdge* edge_b = nullptr;
  S gap = S(-Manifold<S, 1>::none);
  Vec3<S> normal;  ///< from a to b

  /// Only pairs that span a face of the polytopes' Minkowski difference can separate them: those whose arcs
  /// cross on the Gauss map (Gregorius: The separating axis test between convex polyhedra, GDC 2013).
  EdgeAxis(const Polytope<S>& a, const Polytope<S>& b) {
    std::array<S, 2 * ConvexHull<S>::most_vertices - 4> rise;  // of a's edge along b's normals
    for (const HullEdge& ea : a.edges) {
      const Vec3<S> u = a.along(ea);
      const Vec3<S>&left = a.face(ea.left).normal, &right = a.face(ea.right).normal;
      for (std::size_t k = 0; k < b.faces.size(); ++k) rise[k] = dot(b.faces[k].normal, u);
      for (const HullEdge& eb : b.edges) {
        const S rise_left = rise[static_cast<std::size_t>(eb.left)],
                rise_right = rise[static_cast<std::size_t>(eb.right)];
        if (rise_left * rise_right >= S(0)) continue;
        const Vec3<S> w = b.along(eb);
        const S turn_right = dot(right, w);
        if (dot(left, w) * turn_right >= S(0) || rise_left * turn_right >= S(0)) continue;
        const Vec3<S> across = cross(u, w);
        const S squared = squared_norm(across);
        if (squared <= as<S>(16 * Constants<S>::epsilon) * squared_norm(u) * squared_norm(w)) continue;
        const S side = dot(across, left + right) < S(0) ? S(-1) : S(1);
        const Vec3<S> n = (side * inverse_root(squared)) * across;
        const S found = dot(n, b.vertex(eb.tail) - a.vertex(ea.tail));
        if (!(found > gap)) continue;
        gap = found;
        normal = n;
        edge_a = &ea;
        edge_b = &eb;
      }
    }
  }
};

/// Copies points under a face to a manifold: where there are too many, the deepest and those farthest out in
/// so many directions. put(place, point) stores one.
template <std::size_t Places, class S, class Put>
void spread(const std::span<const Vec3<S>>& points, const Vec3<S>& normal, const Put& put) {
  if (points.size() <= Places) {
    for (std::size_t i = 0; i < points.size(); ++i) put(i, points[i]);
    return;
  }
  std::array<bool, FaceClip<S>::capacity> taken{};
  std::size_t place = 0;
  const auto take = [&](const Vec3<S>& way) {
    std::size_t best = 0;
    for (std::size_t i = 1; i < points.size(); ++i) {
      if (dot(way, points[i]) > dot(way, points[best])) best = i;
    }
    if (!taken[best]) put(place++, points[best]);
    taken[best] = true;
  };
  take(-normal);
  const Vec3<S> side = direction_or_z(points[1] - points[0]), across = cross(normal, side);
  for (std::size_t k = 1; k < Places; ++k) {
    const double angle = 2 * std::numbers::pi * static_cast<double>(k) / static_cast<double>(Places - 1);
    take(as<S>(std::cos(angle)) * side + as<S>(std::sin(angle)) * across);
  }
}

/// Two polytopes by the separating axis theorem. A face's axis gives the cut of two faces, two edges' axis
/// one point.
template <class S>
HullManifold<S> detect_polytopes(const Polytope<S>& a, const Pose<S>& pa, const Polytope<S>& from,
                                 const Pose<S>& pb) {
  const Pose<S> pose = relative(pa, pb);
  const MovedPolytope<S> moved(from, pose.axes, pose.position);
  const Polytope<S> b = moved.view();

  // Faces that lie flat are equally good: the first keeps its place, or points would change theirs from step
  // to step. Edges must win by more than rounding, or what lies flat would lose its face.
  const S size = minimum(a.inner_radius, b.inner_radius), clearly = as<S>(1e-5) * size;
  const FaceAxis<S> face_a(a, b, clearly), face_b(b, a, clearly);
  const EdgeAxis<S> edges(a, b);
  const bool by_b = face_b.gap > face_a.gap + clearly;
  const S face_gap = by_b ? face_b.gap : face_a.gap;
  const S separation = maximum(maximum(face_a.largest, face_b.largest), edges.gap);

  const auto in_world = [&](const Vec3<S>& p) { return pa.position + pa.axes * p; };
  using M = HullManifold<S>;
  if (edges.gap > face_gap + as<S>(1e-4) * size) {
    M m = without_points<M>(pa.axes * edges.normal, separation, pa.position);
    const Vec3<S>&on_a = a.vertex(edges.edge_a->tail), &on_b = b.vertex(edges.edge_b->tail);
    const Vec3<S> u = a.along(*edges.edge_a), w = b.along(*edges.edge_b), between = on_b - on_a;
    const S uu = squared_norm(u), ww = squared_norm(w), uw = dot(u, w);
    const S over = S(1) / (uu * ww - uw * uw), du = dot(between, u), dw = dot(between, w);
    const Vec3<S> nearest_a = on_a + ((du * ww - uw * dw) * over) * u;
    const Vec3<S> nearest_b = on_b + ((uw * du - uu * dw) * over) * w;
    m.point[0] = in_world(as<S>(0.5) * (nearest_a + nearest_b));
    m.gap[0] = edges.gap;
    return m;
  }

  const Polytope<S>&reference = by_b ? b : a, &other = by_b ? a : b;
  const HullFace<S>& face = reference.face(by_b ? face_b.face : face_a.face);
  // Of the other's faces at its deepest vertex the one that looks most against the reference face.
  const int deepest = other.lowest(face.normal).second;
  const HullFace<S>* incident = nullptr;
  for (const HullFace<S>& f : other.faces) {
    const auto corners =
        other.corners.subspan(static_cast<std::size_t>(f.first), static_cast<std::size_t>(f.count));
    if (std::find(corners.begin(), corners.end(), deepest) == corners.end()) continue;
    if (incident == nullptr || dot(f.normal, face.normal) < dot(incident->normal, face.normal)) incident = &f;
  }
  FaceClip<S> clip(reference, face);
  for (int k = 0; k < incident->count; ++k) clip.add(other.vertex(other.corner(*incident, k)));
  const Vec3<S> normal = pa.axes * face.normal;
  M m = without_points<M>(by_b ? -normal : normal, separation, pa.position);
  spread<std::size_t(M::points)>(clip.cut(), face.normal, [&](std::size_t place, const Vec3<S>& at) {
    m.gap[place] = dot(face.normal, at) - face.offset;
    m.point[place] = in_world(at - S(as<S>(0.5) * m.gap[place]) * face.normal);
  });
  return m;
}

template <class A, class B, class S>
HullManifold<S> detect_solids(const A& a, const Pose<S>& pa, const B& b, const Pose<S>& pb) {
  return with_polytope(a, [&](const Polytope<S>& first) {
    return with_polytope(b,
                         [&](const Polytope<S>& second) { return detect_polytopes(first, pa, second, pb); });
  });
}

}  // namespace detail

/// Two convex hulls, and a box and one: the cut of two faces, or a point of two edges.
/// @{
template <class S>
auto detect(const ConvexHull<S>& a, const Pose<S>& pa, const ConvexHull<S>& b, const Pose<S>& pb) {
  return detail::detect_solids(a, pa, b, pb);
}
template <class S>
auto detect(const Box<S>& a, const Pose<S>& pa, const ConvexHull<S>& b, const Pose<S>& pb) {
  return detail::detect_solids(a, pa, b, pb);
}
template <class S>
auto detect(const ConvexHull<S>& a, const Pose<S>& pa, const Box<S>& b, const Pose<S>& pb) {
  return detail::detect_solids(a, pa, b, pb);
}
/// @}

}  // namespace rbres::RBRES_ABI
