#pragma once

#include <rbres/contact/detect_box.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// One box's face as seen from the other: middle, normal and the two axes along the face, with half extents.
template <class S>
struct Face {
  Vec3<S> normal, u, v;
  S half_normal, half_u, half_v;
};

}  // namespace detail

/// a where the mask holds, else b, lane by lane.
template <Packed S>
detail::Face<S> select(const MaskOf<S>& m, const detail::Face<S>& a, const detail::Face<S>& b) {
  return {select(m, a.normal, b.normal), select(m, a.u, b.u),
          select(m, a.v, b.v),           select(m, a.half_normal, b.half_normal),
          select(m, a.half_u, b.half_u), select(m, a.half_v, b.half_v)};
}

namespace detail {

/// The three faces of a box that look along its axes.
template <class S>
std::array<Face<S>, 3> faces(const Box<S>& box, const Pose<S>& pose) {
  const Vec3<S>&x = pose.axes.x, &y = pose.axes.y, &z = pose.axes.z, &h = box.half;
  return {{{x, y, z, h.x, h.y, h.z}, {y, z, x, h.y, h.z, h.x}, {z, x, y, h.z, h.x, h.y}}};
}

/// Cuts the incident face to the reference face. Each of its four edges is clipped to the rectangle (Liang
/// and Barsky 1984) and gives its entry, and its exit where it was cut; the rectangle's corners inside the
/// incident face are the rest. A fixed set of 12 candidates needs no branch, so that lanes may disagree.
template <class S>
void clip_faces(const Vec3<S>& origin, const Face<S>& reference, const Vec3<S>& middle,
                const Face<S>& incident, Manifold<S, 12>& m) {
  using std::abs;
  const auto local = [&](const Vec3<S>& v) {
    return Vec3<S>{dot(v, reference.u), dot(v, reference.v), dot(v, reference.normal)};
  };
  Vec3<S> centre = local(middle - origin);
  centre.z -= reference.half_normal;
  const Vec3<S> p = incident.half_u * local(incident.u), q = incident.half_v * local(incident.v);
  // Edges that lie along the rectangle's border count as inside, whatever their rounding.
  const S slack = as<S>(Constants<S>::touch) * (reference.half_u + reference.half_v);
  const S hu = reference.half_u + slack, hv = reference.half_v + slack;
  const auto put = [&](std::size_t slot, const Vec3<S>& at, const MaskOf<S>& valid) {
    m.gap[slot] = select(valid, at.z, S(m.none));
    // Where it is not there it stands in the face: far away it would overflow beside other lanes' points.
    const Vec3<S> place = select(valid, at, Vec3<S>{});
    m.point[slot] = origin + place.x * reference.u + place.y * reference.v +
                    (reference.half_normal + S(0.5) * place.z) * reference.normal;
  };
  const Vec3<S> corner[5] = {centre - p - q, centre + p - q, centre + p + q, centre - p + q, centre - p - q};
  for (std::size_t e = 0; e < 4; ++e) {
    const Vec3<S> d = corner[e + 1] - corner[e];
    S in(0), out(1);
    const auto cut = [&](const S& from, const S& along, const S& half) {
      const S safe = select(abs(along) < S(Constants<S>::tiny), S(Constants<S>::tiny), along);
      const S t1 = (-half - from) / safe, t2 = (half - from) / safe;
      in = maximum(in, minimum(t1, t2));
      out = minimum(out, maximum(t1, t2));
    };
    cut(corner[e].x, d.x, hu);
    cut(corner[e].y, d.y, hv);
    const MaskOf<S> crosses = in <= out;
    put(2 * e, corner[e] + in * d, crosses);
    put(2 * e + 1, corner[e] + out * d, crosses & (out < S(1)));
  }
  const S det = p.x * q.y - p.y * q.x;
  const MaskOf<S> solvable = abs(det) > S(Constants<S>::tiny);
  const S inverse = S(1) / select(solvable, det, S(1));
  for (std::size_t c = 0; c < 4; ++c) {
    const S x = (c & 1 ? hu : S(-hu)) - centre.x, y = (c & 2 ? hv : S(-hv)) - centre.y;
    const S alpha = (x * q.y - y * q.x) * inverse, beta = (p.x * y - p.y * x) * inverse;
    const MaskOf<S> inside_p = abs(alpha) < S(1), inside_q = abs(beta) < S(1);
    put(8 + c, {x + centre.x, y + centre.y, centre.z + alpha * p.z + beta * q.z},
        solvable & inside_p & inside_q);
  }
}

}  // namespace detail

/// Two boxes by the separating axis theorem (Gottschalk, Lin, Manocha 1996): 6 face normals and 9 products of
/// edges. The axis of largest separation gives the normal; a face axis the cut of two faces, an edge axis one
/// point.
template <class S>
Manifold<S, 12> detect(const Box<S>& a, const Pose<S>& pa, const Box<S>& b, const Pose<S>& pb) {
  using std::abs;
  const Vec3<S> between = pb.position - pa.position;
  const auto fa = detail::faces(a, pa), fb = detail::faces(b, pb);
  S cosine[3][3];
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) cosine[i][j] = dot(fa[i].normal, fb[j].normal);
  }

  const S size =
      minimum(minimum(a.half.x, minimum(a.half.y, a.half.z)), minimum(b.half.x, minimum(b.half.y, b.half.z)));
  // Faces that lie flat are equally good: the first keeps its place, or points would change theirs from step
  // to step.
  const S clearly = as<S>(1e-5) * size;
  S face_gap(-Manifold<S, 12>::none), largest = face_gap;
  detail::Face<S> reference = fa[0];
  MaskOf<S> reference_is_b(false);
  for (std::size_t i = 0; i < 3; ++i) {
    S ga = abs(dot(between, fa[i].normal)) - fa[i].half_normal,
      gb = abs(dot(between, fb[i].normal)) - fb[i].half_normal;
    for (std::size_t j = 0; j < 3; ++j) {
      ga -= fb[j].half_normal * abs(cosine[i][j]);
      gb -= fa[j].half_normal * abs(cosine[j][i]);
    }
    largest = maximum(largest, maximum(ga, gb));
    const MaskOf<S> better_a = ga > face_gap + clearly;
    face_gap = select(better_a, ga, face_gap);
    reference = select(better_a, fa[i], reference);
    reference_is_b = reference_is_b & !better_a;
    const MaskOf<S> better_b = gb > face_gap + clearly;
    face_gap = select(better_b, gb, face_gap);
    reference = select(better_b, fb[i], reference);
    reference_is_b = reference_is_b | better_b;
  }

  S edge_gap(-Manifold<S, 12>::none);
  Vec3<S> edge_axis, edge_a, edge_b;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) {
      const S length2 = S(1) - square(cosine[i][j]);
      const MaskOf<S> apart = length2 > as<S>(1e-6);
      const S inverse = inverse_root(select(apart, length2, S(1)));
      const Vec3<S> axis = inverse * cross(fa[i].normal, fb[j].normal);
      S gap = abs(dot(between, axis));
      for (std::size_t k = 0; k < 3; ++k) {
        gap -= fa[k].half_normal * abs(dot(axis, fa[k].normal)) +
               fb[k].half_normal * abs(dot(axis, fb[k].normal));
      }
      const MaskOf<S> better = apart & (gap > edge_gap);
      edge_gap = select(better, gap, edge_gap);
      edge_axis = select(better, axis, edge_axis);
      edge_a = select(better, fa[i].normal, edge_a);
      edge_b = select(better, fb[j].normal, edge_b);
    }
  }

  // Edges must win by more than rounding, or boxes that lie flat would lose their face.
  const MaskOf<S> by_edge = edge_gap > face_gap + as<S>(1e-4) * size;

  Manifold<S, 12> m{{}, maximum(largest, edge_gap), {}, {}};
  const S side = select(reference_is_b, S(-1), S(1));  // from the reference box to the other
  reference.normal =
      select(side * dot(between, reference.normal) < S(0), -reference.normal, reference.normal);
  m.normal = side * reference.normal;
  detail::Face<S> incident = select(reference_is_b, fa[0], fb[0]);
  for (std::size_t i = 1; i < 3; ++i) {
    const detail::Face<S> other = select(reference_is_b, fa[i], fb[i]);
    incident = select(abs(dot(other.normal, reference.normal)) > abs(dot(incident.normal, reference.normal)),
                      other, incident);
  }
  incident.normal = select(dot(incident.normal, reference.normal) > S(0), -incident.normal, incident.normal);
  const Vec3<S> origin = select(reference_is_b, pb.position, pa.position);
  const Vec3<S> other = select(reference_is_b, pa.position, pb.position);
  detail::clip_faces(origin, reference, other + incident.half_normal * incident.normal, incident, m);

  if (any(by_edge)) {
    const Vec3<S> n = select(dot(between, edge_axis) < S(0), -edge_axis, edge_axis);
    // A point of each box's edge that lies farthest towards the other box.
    Vec3<S> on_a = pa.position, on_b = pb.position;
    for (std::size_t k = 0; k < 3; ++k) {
      const S along_a = dot(n, fa[k].normal), along_b = dot(n, fb[k].normal);
      on_a += select(along_a < S(0), S(-fa[k].half_normal), fa[k].half_normal) * fa[k].normal;
      on_b -= select(along_b < S(0), S(-fb[k].half_normal), fb[k].half_normal) * fb[k].normal;
    }
    const S c = dot(edge_a, edge_b), da = dot(on_b - on_a, edge_a), db = dot(on_b - on_a, edge_b);
    const S inverse = S(1) / maximum(S(S(1) - c * c), as<S>(1e-6));
    const Vec3<S> nearest_a = on_a + ((da - c * db) * inverse) * edge_a;
    const Vec3<S> nearest_b = on_b + ((c * da - db) * inverse) * edge_b;
    m.normal = select(by_edge, n, m.normal);
    m.point[0] = select(by_edge, S(0.5) * (nearest_a + nearest_b), m.point[0]);
    m.gap[0] = select(by_edge, edge_gap, m.gap[0]);
    for (std::size_t i = 1; i < 12; ++i) m.gap[i] = select(by_edge, S(m.none), m.gap[i]);
  }
  return m;
}

}  // namespace rbres::RBRES_ABI
