#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <utility>
#include <vector>

#include <rbres/core/error.hpp>
#include <rbres/core/vector.hpp>

namespace rbres::RBRES_ABI::detail {

/// Builds the convex hull of points by quickhull (Barber, Dobkin and Huhdanpaa 1996): beginning with a
/// tetrahedron, the point farthest outside comes next. Triangles in one plane become one face. What is off by
/// less than a millionth of the points' size counts as inside a face, and as in its plane.
class HullMesh {
 public:
  /// Three numbers.
  using Point = Vec3<double>;

  /// `points` are finite; those that are no vertices of the hull are passed over. Throws Error where they
  /// span no volume, or need more than `most` vertices.
  HullMesh(const std::vector<Point>& points, int most) {
    normalise(points);
    // Points that are off a plane by just what counts as seen may fold the surface over: another measure
    // helps.
    bool closed = false;
    for (const double seen : {1e-9, 1e-7, 1e-11}) {
      closed = build(seen, most) && merge();
      if (closed) break;
    }
    if (!closed) refuse_flat("ones that rounding folds over");
    take_vertices(points);
    if (std::ssize(vertices_) > most)
      refuse("vertices of a convex hull", text("at most ", most), vertices_.size());
  }

  /// The hull's vertices.
  const std::vector<Point>& vertices() const { return vertices_; }
  /// The vertices of each face by number, counter-clockwise from outside.
  const std::vector<std::vector<int>>& faces() const { return faces_; }

 private:
  // In units of the points' size.
  static constexpr double flat = 1e-6;   ///< nearer points are inside a face, or in its plane
  static constexpr double alike = 1e-9;  ///< points are equally far within this

  struct Triangle {
    std::array<int, 3> corner;
    Point normal;
    double offset, area;
  };
  struct Farthest {
    int point = -1;
    std::size_t triangle = 0;
    double distance = 0;
  };
  /// The triangle, or face, that has an edge from one point to another: each is there once each way.
  using Edges = std::map<std::pair<int, int>, std::size_t>;

  [[noreturn]] static void refuse_flat(const char* found) {
    refuse("points of a convex hull", "points that span a volume", found);
  }
  static constexpr auto none = static_cast<std::size_t>(-1);

  /// The edges of the triangles; empty where one is there twice the same way.
  Edges edges() const {
    Edges all;
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      const auto& c = triangles_[t].corner;
      for (std::size_t k = 0; k < 3; ++k) {
        if (!all.emplace(std::pair(c[k], c[(k + 1) % 3]), t).second) return {};
      }
    }
    return all;
  }
  static std::size_t owner(const Edges& all, int from, int to) {
    const auto found = all.find({from, to});
    return found == all.end() ? none : found->second;
  }

  void normalise(const std::vector<Point>& points) {
    if (points.size() < 4) refuse("points of a convex hull", "4 or more", points.size());
    Point low = points[0], high = low;
    for (const Point& p : points) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    const Point middle = 0.5 * (low + high), half = 0.5 * (high - low);
    const double size = std::max({half.x, half.y, half.z});
    if (!(size > 0)) refuse_flat("one point");
    for (const Point& p : points) points_.push_back((1 / size) * (p - middle));
  }

  const Point& at(int i) const { return points_[static_cast<std::size_t>(i)]; }
  /// The point for which measure(point) is largest, and that number.
  template <class Measure>
  std::pair<int, double> largest(const Measure& measure) const {
    std::pair<int, double> best(0, measure(points_[0]));
    for (int i = 1; i < static_cast<int>(points_.size()); ++i) {
      if (const double m = measure(at(i)); m > best.second) best = {i, m};
    }
    return best;
  }

  Triangle triangle(int a, int b, int c) const {
    const Point product = cross(at(b) - at(a), at(c) - at(a));
    const double twice = norm(product);
    const Point normal = (1 / twice) * product;
    return {{a, b, c}, normal, dot(normal, at(a)), 0.5 * twice};
  }
  static double above(const Triangle& t, const Point& p) { return dot(t.normal, p) - t.offset; }

  /// The hull in triangles, where a point sees those that it is above by more than `seen`. False where they
  /// do not close.
  bool build(double seen, int most) {
    start();
    for (Farthest next = farthest(); next.distance > flat; next = farthest()) {
      if (!insert(next.point, next.triangle, seen)) return false;
      if (triangles_.size() > 16 * static_cast<std::size_t>(most))
        refuse("vertices of a convex hull", text("at most ", most), text("more than ", 8 * most));
    }
    return true;
  }
  void start() {
    const int a = largest([](const Point& p) { return squared_norm(p); }).first;
    const int b = largest([&](const Point& p) { return squared_norm(p - at(a)); }).first;
    const Point along = (1 / norm(at(b) - at(a))) * (at(b) - at(a));
    const auto [c, width] = largest([&](const Point& p) { return norm(cross(along, p - at(a))); });
    if (!(width > flat)) refuse_flat("ones on a line");
    const Triangle base = triangle(a, b, c);
    const auto [d, height] = largest([&](const Point& p) { return std::abs(above(base, p)); });
    if (!(height > flat)) refuse_flat("ones in a plane");
    const bool under = above(base, at(d)) < 0;
    const int first = under ? a : b, second = under ? b : a;
    triangles_ = {triangle(first, second, c), triangle(second, first, d), triangle(c, second, d),
                  triangle(first, c, d)};
    middle_ = 0.25 * (at(a) + at(b) + at(c) + at(d));
  }

  /// The point that lies farthest above a triangle. Of several as far, as a face's are, the one farthest out.
  Farthest farthest() const {
    Farthest best;
    double best_out = 0;
    for (int i = 0; i < static_cast<int>(points_.size()); ++i) {
      Farthest here{i, 0, 0};
      for (std::size_t t = 0; t < triangles_.size(); ++t) {
        if (const double d = above(triangles_[t], at(i)); d > here.distance) here = {i, t, d};
      }
      const double out = squared_norm(at(i) - middle_);
      if (here.distance > best.distance + alike ||
          (here.distance > best.distance - alike && out > best_out)) {
        best = here;
        best_out = out;
      }
    }
    return best;
  }

  /// Replaces the triangles that point p sees, `from` among them, by those from their border to p.
  bool insert(int p, std::size_t from, double seen_above) {
    const Edges all = edges();
    std::vector<char> seen(triangles_.size(), false);
    std::vector<std::size_t> open{from};
    std::vector<Triangle> added;
    seen[from] = true;
    while (!open.empty()) {
      const auto c = triangles_[open.back()].corner;
      open.pop_back();
      for (std::size_t k = 0; k < 3; ++k) {
        const int a = c[k], b = c[(k + 1) % 3];
        const std::size_t next = owner(all, b, a);
        if (next == none) return false;
        if (seen[next]) continue;
        if (above(triangles_[next], at(p)) > seen_above) {
          seen[next] = true;
          open.push_back(next);
        } else {
          added.push_back(triangle(a, b, p));
        }
      }
    }
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      if (!seen[t]) added.push_back(triangles_[t]);
    }
    triangles_ = std::move(added);
    return true;
  }

  /// Makes one face of the triangles in the plane of the largest of them. False where they do not close.
  bool merge() {
    faces_.clear();
    std::sort(triangles_.begin(), triangles_.end(),
              [](const Triangle& a, const Triangle& b) { return a.area > b.area; });
    const Edges all = edges();
    for (const auto& [edge, t] : all) {
      if (owner(all, edge.second, edge.first) == none) return false;
    }
    if (all.empty()) return false;
    std::vector<std::size_t> face_of(triangles_.size(), none);
    std::size_t faces = 0;
    for (std::size_t t = 0; t < triangles_.size(); ++t) {
      if (face_of[t] != none) continue;
      face_of[t] = faces;
      std::vector<std::size_t> open{t};
      while (!open.empty()) {
        const auto c = triangles_[open.back()].corner;
        open.pop_back();
        for (std::size_t k = 0; k < 3; ++k) {
          const std::size_t next = owner(all, c[(k + 1) % 3], c[k]);
          if (face_of[next] != none) continue;
          const auto& corner = triangles_[next].corner;
          const bool in_plane = std::all_of(corner.begin(), corner.end(), [&](int i) {
            return std::abs(above(triangles_[t], at(i))) <= flat;
          });
          if (!in_plane) continue;
          face_of[next] = faces;
          open.push_back(next);
        }
      }
      ++faces;
    }
    // Each face's border, and what is left of it without the points in the middle of an edge: those of two
    // faces.
    std::vector<std::map<int, int>> next(faces);
    std::vector<int> count(points_.size(), 0);
    for (const auto& [edge, t] : all) {
      if (face_of[t] == face_of[owner(all, edge.second, edge.first)]) continue;
      if (!next[face_of[t]].emplace(edge).second) return false;
      ++count[static_cast<std::size_t>(edge.first)];
    }
    for (const auto& border : next) {
      std::vector<int>& loop = faces_.emplace_back();
      int i = border.begin()->first;
      for (std::size_t k = 0; k < border.size(); ++k) {
        if (count[static_cast<std::size_t>(i)] > 2) loop.push_back(i);
        const auto found = border.find(i);
        if (found == border.end()) return false;
        i = found->second;
      }
      if (loop.size() < 3 || i != border.begin()->first) return false;
    }
    return true;
  }

  /// Takes the points that faces have, and numbers them anew.
  void take_vertices(const std::vector<Point>& points) {
    std::vector<int> number(points.size(), -1);
    for (auto& face : faces_) {
      for (int& i : face) {
        int& n = number[static_cast<std::size_t>(i)];
        if (n < 0) {
          n = static_cast<int>(vertices_.size());
          vertices_.push_back(points[static_cast<std::size_t>(i)]);
        }
        i = n;
      }
    }
  }

  std::vector<Point> points_;  ///< around their middle, in units of their size
  Point middle_;               ///< a point inside
  std::vector<Triangle> triangles_;
  std::vector<Point> vertices_;
  std::vector<std::vector<int>> faces_;
};

}  // namespace rbres::RBRES_ABI::detail
