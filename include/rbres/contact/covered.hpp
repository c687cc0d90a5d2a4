#pragma once

#include <rbres/contact/part_pair.hpp>

namespace rbres::RBRES_ABI::detail {

/// Whether a point (world frame) is in a shape, or off it by `slack` (m) at most. Of shapes of the user's own
/// it is not known: false.
template <class S, class Shape>
bool holds(const Shape& shape, const Pose<S>& pose, const Vec3<S>& point, const S& slack) {
  const Vec3<S> p = pose.axes.transposed_times(point - pose.position);
  return with_shape(shape, [&](const auto& s) {
    using Own = std::decay_t<decltype(s)>;
    if constexpr (std::is_same_v<Own, Sphere<S>>) {
      return norm(p) <= s.radius + slack;
    } else if constexpr (std::is_same_v<Own, Box<S>>) {
      const Vec3<S> out = absolute(p) - s.half;
      return maximum(out.x, maximum(out.y, out.z)) <= slack;
    } else if constexpr (std::is_same_v<Own, Capsule<S>>) {
      const S along = clamp(p.z, S(-s.half_length), s.half_length);
      return norm(p - Vec3<S>{S(0), S(0), along}) <= s.radius + slack;
    } else if constexpr (std::is_same_v<Own, ConvexHull<S>>) {
      const auto faces = s.faces();
      return std::all_of(faces.begin(), faces.end(),
                         [&](const HullFace<S>& face) { return dot(face.normal, p) - face.offset <= slack; });
    } else {
      return false;
    }
  });
}

/// Calls f(point) for the corners of a shape, world frame; of a capsule for the two points that lie farthest
/// along the unit vector `out`. Round shapes and those of the user's own have none.
template <class S, class Shape, class F>
void each_corner(const Shape& shape, const Pose<S>& pose, const Vec3<S>& out, const F& f) {
  with_shape(shape, [&](const auto& s) {
    using Own = std::decay_t<decltype(s)>;
    if constexpr (std::is_same_v<Own, Box<S>>) {
      for (int i = 0; i < 8; ++i) {
        const auto side = [&](int axis, const S& half) { return i >> axis & 1 ? half : S(-half); };
        f(pose.position + pose.axes * Vec3<S>{side(0, s.half.x), side(1, s.half.y), side(2, s.half.z)});
      }
    } else if constexpr (std::is_same_v<Own, Capsule<S>>) {
      for (const S& end : {S(-s.half_length), s.half_length})
        f(pose.position + end * pose.axes.z + s.radius * out);
    } else if constexpr (std::is_same_v<Own, ConvexHull<S>>) {
      for (const Vec3<S>& v : s.vertices()) f(pose.position + pose.axes * v);
    }
  });
}

/// Whether other parts of a body cover one of its parts around a point of its surface, where the unit vector
/// `out` leads out of it. `size`: of the body; `depth`: how deep something is in it there; m.
template <class S, class Shape>
bool is_covered(const Body<S, Shape>& body, const Pose<S>& whole, int part, const Vec3<S>& point,
                const Vec3<S>& out, const S& size, const S& depth) {
  const auto& shape = body.shape();
  // Axes whose gaps differ by a tenth of this may take one another's place in a manifold.
  const S little = as<S>(1e-4) * size;
  const auto shape_of = [&](int k) -> const auto& {
    return shape.parts()[static_cast<std::size_t>(k)].shape;
  };
  const auto pose_of = [&](int k) { return part_pose(whole, shape.placed()[static_cast<std::size_t>(k)]); };
  const auto hidden = [&](const Vec3<S>& p, const S& slack) {
    for (int k = 0; k < shape.size(); ++k) {
      if (k != part && holds(shape_of(k), pose_of(k), p + little * out, slack)) return true;
    }
    return false;
  };
  if (!hidden(point, as<S>(0.2) * little)) return false;
  // In an inner corner of the body the face or the edge of the part that has this normal goes on, uncovered,
  // beside the point.
  using std::abs;
  const Pose<S> own = pose_of(part);
  const S around = maximum(S(as<S>(10) * little), S(as<S>(4) * depth)), slack = as<S>(0.1) * around;
  const Vec3<S> axis = abs(out.x) < as<S>(0.7) ? Vec3<S>{S(1), S(0), S(0)} : Vec3<S>{S(0), S(1), S(0)};
  const Vec3<S> u = direction_or_z(cross(out, axis)), v = cross(out, u);
  for (const Vec3<S>& side : {u, -u, v, -v}) {
    const Vec3<S> beside = point + around * side;
    if (holds(shape_of(part), own, beside, slack) && !hidden(beside, slack)) return false;
  }
  S top(-Manifold<S, 1>::none);
  each_corner(shape_of(part), own, out, [&](const Vec3<S>& corner) { top = maximum(top, dot(out, corner)); });
  bool covered = true;
  each_corner(shape_of(part), own, out, [&](const Vec3<S>& corner) {
    const Vec3<S> way = corner - point;
    const S length = norm(way);
    if (!covered || !(length > slack) || dot(out, corner) < top - slack) return;
    covered = hidden(point + minimum(S(around / length), S(1)) * way, slack);
  });
  return covered;
}

/// Whether all points within a gap (m) of `contact` (a Manifold), between a part of one body and a ball or a
/// capsule, lie in another part of that body, which is nearer: the edge at a seam towards which something
/// rolls. `of_first`: the part is of the first body of the pair.
template <class System, class Contact>
bool another_is_nearer(const System& system, const typename System::State& y, const Candidate& who,
                       const PartPairOf<System>& parts, const Contact& contact,
                       const typename System::Scalar& within, bool of_first) {
  using S = typename System::Scalar;
  const int i = of_first ? who.first : who.second, other = of_first ? who.second : who.first;
  const bool round = with_part(system[other], y[other], of_first ? parts.second : parts.first,
                               [](const auto& shape, const auto&) {
                                 return with_shape(shape, [](const auto& s) {
                                   using Own = std::decay_t<decltype(s)>;
                                   return std::is_same_v<Own, Sphere<S>> || std::is_same_v<Own, Capsule<S>>;
                                 });
                               });
  if (!round) return false;
  const auto& body = system[i];
  const S slack = as<S>(Constants<S>::touch) * body.bounding_radius();
  for (int k = 0; k < body.shape().size(); ++k) {
    PartPairOf<System> with = parts;
    int& part = of_first ? with.first : with.second;
    if (k == part) continue;
    part = k;
    bool all = true;
    with_part(body, y[i], k, [&](const auto& shape, const Pose<S>& pose) {
      each_point(contact, [&](int, const Vec3<S>& point, const S& gap) {
        if (!all || !(gap <= within)) return;
        const Vec3<S> half = S(as<S>(of_first ? -0.5 : 0.5) * gap) * contact.normal;
        all = holds(shape, pose, point + half, slack);
      });
    });
    if (!all) continue;
    bool nearer = false;
    with_part_manifold(system, y, who.first, who.second, with,
                       [&](const auto& m, auto) { nearer = m.separation < contact.separation; });
    if (nearer) return true;
  }
  return false;
}

/// Whether two parts have points within a gap (m), as `contact` (a Manifold) says, but all of them where one
/// of the two is covered by other parts of its body: on a face between two parts, say, which is no surface of
/// the whole. What slides over a seam would stop there. Planes cover nothing.
template <class System, class Contact>
bool meets_covered(const System& system, const typename System::State& y, const Candidate& who,
                   const PartPairOf<System>& parts, const Contact& contact,
                   const typename System::Scalar& within) {
  using S = typename System::Scalar;
  if constexpr (PartPairOf<System>::compound) {
    if (who.first < 0) return false;
    const auto &a = system[who.first], &b = system[who.second];
    if (a.shape().size() == 1 && b.shape().size() == 1) return false;
    const Pose<S> pose_a = shape_pose(a, y[who.first]), pose_b = shape_pose(b, y[who.second]);
    const S size = minimum(a.bounding_radius(), b.bounding_radius());
    bool any = false, all = true;
    each_point(contact, [&](int, const Vec3<S>& point, const S& gap) {
      if (!all || !(gap <= within)) return;
      any = true;
      const Vec3<S> half = S(as<S>(0.5) * gap) * contact.normal;
      const S depth = maximum(S(-gap), S(0));
      all = is_covered(b, pose_b, parts.second, point + half, -contact.normal, size, depth) ||
            is_covered(a, pose_a, parts.first, point - half, contact.normal, size, depth);
    });
    return any && (all || another_is_nearer(system, y, who, parts, contact, within, true) ||
                   another_is_nearer(system, y, who, parts, contact, within, false));
  } else {
    return false;
  }
}

}  // namespace rbres::RBRES_ABI::detail
