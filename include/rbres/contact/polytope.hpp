#pragma once

#include <array>
#include <rbres/body/convex_hull.hpp>
#include <rbres/contact/manifold.hpp>

namespace rbres::RBRES_ABI::detail {

/// A solid with flat faces, as in ConvexHull, whose numbers stand elsewhere.
template <class S>
struct Polytope {
  std::span<const Vec3<S>> vertices;
  std::span<const HullFace<S>> faces;
  std::span<const int> corners;
  std::span<const HullEdge> edges;
  S inner_radius, bounding_radius;

  const Vec3<S>& vertex(int i) const { return vertices[static_cast<std::size_t>(i)]; }
  const HullFace<S>& face(int i) const { return faces[static_cast<std::size_t>(i)]; }
  /// Corner k of a face; its first comes again behind its last.
  int corner(const HullFace<S>& face, int k) const {
    return corners[static_cast<std::size_t>(face.first + (k == face.count ? 0 : k))];
  }
  Vec3<S> along(const HullEdge& edge) const { return vertex(edge.head) - vertex(edge.tail); }

  /// How far along `way` the vertices reach the least, and which one does.
  std::pair<S, int> lowest(const Vec3<S>& way) const {
    std::pair<S, int> best(dot(way, vertices[0]), 0);
    for (int i = 1; i < static_cast<int>(vertices.size()); ++i) {
      if (const S x = dot(way, vertex(i)); x < best.first) best = {x, i};
    }
    return best;
  }
};

/// Calls f(polytope) with a shape's.
/// @{
template <class S, class F>
auto with_polytope(const ConvexHull<S>& hull, const F& f) {
  return f(Polytope<S>{hull.vertices(), hull.faces(), hull.corners(), hull.edges(), hull.inner_radius(),
                       hull.bounding_radius()});
}
template <class S, class F>
auto with_polytope(const Box<S>& box, const F& f) {
  // Vertices are numbered by the signs of their coordinates; faces are those towards +x, -x, +y, -y, +z, -z.
  static constexpr int corners[24] = {1, 3, 7, 5, 0, 4, 6, 2, 2, 6, 7, 3, 0, 1, 5, 4, 4, 5, 7, 6, 0, 2, 3, 1};
  static constexpr HullEdge edges[12] = {{1, 3, 0, 5}, {3, 7, 0, 2}, {5, 7, 4, 0}, {1, 5, 3, 0},
                                         {0, 4, 1, 3}, {4, 6, 1, 4}, {2, 6, 2, 1}, {0, 2, 5, 1},
                                         {6, 7, 2, 4}, {2, 3, 5, 2}, {0, 1, 3, 5}, {4, 5, 4, 3}};
  const Vec3<S>& h = box.half;
  const S o(0), i(1), yz = S(4) * h.y * h.z, zx = S(4) * h.z * h.x, xy = S(4) * h.x * h.y;
  const std::array<HullFace<S>, 6> faces{{{{i, o, o}, h.x, yz, 0, 4},
                                          {{-i, o, o}, h.x, yz, 4, 4},
                                          {{o, i, o}, h.y, zx, 8, 4},
                                          {{o, -i, o}, h.y, zx, 12, 4},
                                          {{o, o, i}, h.z, xy, 16, 4},
                                          {{o, o, -i}, h.z, xy, 20, 4}}};
  std::array<Vec3<S>, 8> vertices;
  for (std::size_t v = 0; v < 8; ++v)
    vertices[v] = {v & 1 ? h.x : S(-h.x), v & 2 ? h.y : S(-h.y), v & 4 ? h.z : S(-h.z)};
  return f(Polytope<S>{vertices, faces, corners, edges, minimum(h.x, minimum(h.y, h.z)), norm(h)});
}
/// @}

/// A polytope turned and moved.
template <class S>
class MovedPolytope {
 public:
  MovedPolytope(const Polytope<S>& from, const Mat3<S>& axes, const Vec3<S>& shift) : from_(from) {
    for (std::size_t i = 0; i < from.vertices.size(); ++i) vertices_[i] = shift + axes * from.vertices[i];
    for (std::size_t i = 0; i < from.faces.size(); ++i) {
      HullFace<S>& face = faces_[i];
      face = from.faces[i];
      face.normal = axes * face.normal;
      face.offset += dot(face.normal, shift);
    }
  }
  /// Good as long as this object.
  Polytope<S> view() const {
    Polytope<S> to = from_;
    to.vertices = {vertices_.data(), from_.vertices.size()};
    to.faces = {faces_.data(), from_.faces.size()};
    return to;
  }

 private:
  static constexpr std::size_t most_vertices = ConvexHull<S>::most_vertices;

  Polytope<S> from_;
  std::array<Vec3<S>, most_vertices> vertices_;
  std::array<HullFace<S>, 2 * most_vertices - 4> faces_;
};

/// Cuts away the part of a convex polygon, or of a segment, that stands out of a face by its sides: by more
/// than rounding, as what lies along a side counts as inside.
template <class S>
class FaceClip {
 public:
  /// What the faces of two polytopes can leave of one another.
  static constexpr std::size_t capacity = 2 * ConvexHull<S>::most_vertices;

  FaceClip(const Polytope<S>& of, const HullFace<S>& face) : of_(of), face_(face) {}

  void add(const Vec3<S>& point) {
    if (size_ < capacity) points_[size_++] = point;
  }
  /// What is left of the points so far: corners of a polygon in their order.
  std::span<const Vec3<S>> cut() {
    const S slack = S(2 * Constants<S>::touch) * of_.bounding_radius;
    for (int k = 0; k < face_.count; ++k) {
      const Vec3<S>& corner = of_.vertex(of_.corner(face_, k));
      const Vec3<S> side = cross(of_.vertex(of_.corner(face_, k + 1)) - corner, face_.normal);
      cut(side, dot(side, corner) + slack * norm(side));
    }
    return {points_.data(), size_};
  }

 private:
  /// Keeps the points x with dot(normal, x) <= offset (Sutherland and Hodgman 1974).
  void cut(const Vec3<S>& normal, const S& offset) {
    const std::array<Vec3<S>, capacity> from = points_;
    const std::size_t count = size_;
    size_ = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3<S>&a = from[i], &b = from[i + 1 == count ? 0 : i + 1];
      const S out_a = dot(normal, a) - offset, out_b = dot(normal, b) - offset;
      if (out_a <= S(0)) add(a);
      const bool back = count == 2 && i == 1;  // a segment has one side
      if (!back && ((out_a < S(0) && out_b > S(0)) || (out_a > S(0) && out_b < S(0))))
        add(a + (out_a / (out_a - out_b)) * (b - a));
    }
  }

  const Polytope<S>& of_;
  const HullFace<S>& face_;
  std::array<Vec3<S>, capacity> points_;
  std::size_t size_ = 0;
};

}  // namespace rbres::RBRES_ABI::detail
