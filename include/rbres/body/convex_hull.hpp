#pragma once

#include <memory>
#include <rbres/body/hull_mesh.hpp>
#include <rbres/body/inertia.hpp>
#include <rbres/body/shape.hpp>
#include <span>
#include <vector>

namespace rbres::RBRES_ABI {

/// A face of a ConvexHull: the points x with dot(normal, x) = offset are in its plane.
template <class S>
struct HullFace {
  Vec3<S> normal;  ///< unit, outwards
  S offset;        ///< m
  S area;          ///< m^2
  int first;       ///< where its corners begin among ConvexHull::corners()
  int count;       ///< of its corners, 3 or more
};

/// An edge of a ConvexHull, between two vertices and two faces.
struct HullEdge {
  int tail;   ///< a vertex
  int head;   ///< the other
  int left;   ///< the face of which it is a side from tail to head
  int right;  ///< the other
};

namespace detail {

/// What a ConvexHull holds.
template <class S>
struct HullData {
  std::vector<Vec3<S>> vertices;
  std::vector<HullFace<S>> faces;
  std::vector<int> corners;
  std::vector<HullEdge> edges;
  Vec3<S> centre_of_mass;
  PrincipalInertia<S> unit_inertia;
  S volume, bounding_radius, inner_radius;

  /// The same with lengths multiplied, in another scalar.
  template <class T>
  HullData<T> scaled(const T& factor) const {
    const auto vector = [&](const Vec3<S>& v) { return Vec3<T>{as<T>(v.x), as<T>(v.y), as<T>(v.z)}; };
    HullData<T> to;
    to.corners = corners;
    to.edges = edges;
    for (const auto& v : vertices) to.vertices.push_back(factor * vector(v));
    for (const auto& f : faces) {
      to.faces.push_back(
          {vector(f.normal), factor * as<T>(f.offset), square(factor) * as<T>(f.area), f.first, f.count});
    }
    to.centre_of_mass = factor * vector(centre_of_mass);
    const Quat<S>& q = unit_inertia.axes;
    to.unit_inertia = {square(factor) * vector(unit_inertia.moments),
                       {as<T>(q.x), as<T>(q.y), as<T>(q.z), as<T>(q.w)}};
    to.volume = factor * square(factor) * as<T>(volume);
    to.bounding_radius = factor * as<T>(bounding_radius);
    to.inner_radius = factor * as<T>(inner_radius);
    return to;
  }
};

/// Volume, centre of mass and the integral of x x^T over a polyhedron around `origin`: those of the
/// tetrahedra from there to its faces' triangles, which are exact (Tonon 2004).
struct SolidMoments {
  double volume = 0;
  Vec3<double> first;                                ///< integral of x, m^4
  Eigen::Matrix3d second = Eigen::Matrix3d::Zero();  ///< m^5

  SolidMoments(const HullMesh& mesh, const Vec3<double>& origin) {
    const auto vertex = [&](int i) { return mesh.vertices()[static_cast<std::size_t>(i)] - origin; };
    for (const auto& face : mesh.faces()) {
      const Vec3<double> a = vertex(face[0]);
      for (std::size_t k = 2; k < face.size(); ++k) {
        const Vec3<double> b = vertex(face[k - 1]), c = vertex(face[k]), sum = a + b + c;
        const double six = dot(a, cross(b, c));  // times the tetrahedron's volume
        volume += six / 6;
        first += (six / 24) * sum;
        for (const Vec3<double>& v : {a, b, c, sum}) {
          const Eigen::Vector3d e = v;
          second += (six / 120) * e * e.transpose();
        }
      }
    }
  }
};

/// Everything of the hull of a mesh. `precision` is the relative one of its vertices.
inline HullData<double> hull_data(const HullMesh& mesh, double precision) {
  const Vec3<double> inside = [&] {
    Vec3<double> sum;
    for (const auto& v : mesh.vertices()) sum += v;
    return (1.0 / static_cast<double>(mesh.vertices().size())) * sum;
  }();
  const SolidMoments about_inside(mesh, inside);
  HullData<double> hull;
  hull.centre_of_mass = inside + (1 / about_inside.volume) * about_inside.first;
  const SolidMoments moments(mesh, hull.centre_of_mass);
  hull.volume = moments.volume;
  const Eigen::Matrix3d tensor =
      (1 / moments.volume) * (moments.second.trace() * Eigen::Matrix3d::Identity() - moments.second);
  hull.unit_inertia = principal_inertia_to(tensor, precision);

  hull.bounding_radius = 0;
  for (const auto& v : mesh.vertices()) {
    hull.vertices.push_back(v - hull.centre_of_mass);
    hull.bounding_radius = std::max(hull.bounding_radius, norm(hull.vertices.back()));
  }
  const auto vertex = [&](int i) { return hull.vertices[static_cast<std::size_t>(i)]; };
  hull.inner_radius = hull.bounding_radius;
  std::map<std::pair<int, int>, int> owner;
  for (const auto& loop : mesh.faces()) {
    const int number = static_cast<int>(hull.faces.size());
    Vec3<double> twice;  // its area, along its normal
    for (std::size_t k = 2; k < loop.size(); ++k)
      twice += cross(vertex(loop[k - 1]) - vertex(loop[0]), vertex(loop[k]) - vertex(loop[0]));
    const Vec3<double> normal = (1 / norm(twice)) * twice;
    double offset = 0;  // no vertex stands out of a face
    for (const auto& v : hull.vertices) offset = std::max(offset, dot(normal, v));
    hull.inner_radius = std::min(hull.inner_radius, offset);
    hull.faces.push_back({normal, offset, 0.5 * norm(twice), static_cast<int>(hull.corners.size()),
                          static_cast<int>(loop.size())});
    for (std::size_t k = 0; k < loop.size(); ++k) {
      hull.corners.push_back(loop[k]);
      owner.emplace(std::pair(loop[k], loop[(k + 1) % loop.size()]), number);
    }
  }
  for (const auto& [edge, left] : owner) {
    if (edge.first < edge.second)
      hull.edges.push_back({edge.first, edge.second, left, owner.at({edge.second, edge.first})});
  }
  return hull;
}

}  // namespace detail

/// The convex hull of points: a solid with flat faces. It does not change, and copies share what they hold.
/// As every shape it is centred at its centre of mass: vertices() are the points moved there, along the axes
/// in which they were given. centre_of_mass() says where that was; Body::shape_rotation() and
/// Body::shape_origin() say where the frame of the points stands in the body's.
///
/// For plain scalars, and for dual numbers by cast(); not for lanes.
template <class S>
class ConvexHull {
  static_assert(!Packed<S>, "a ConvexHull is not for lanes: simulate it with a plain scalar");

 public:
  /// More vertices are refused.
  static constexpr int most_vertices = 32;

  /// The hull of points (m) in any order, in a frame of the user's; those inside, on its faces or there twice
  /// are passed over. Throws Error for fewer than 4, for ones that are not finite, span no volume or are
  /// beyond BodyLimits, and for more than most_vertices vertices.
  explicit ConvexHull(const std::vector<Vec3<S>>& points)
      : ConvexHull(hull_of(checked(points), static_cast<double>(Constants<S>::epsilon))) {}

  /// A prism of so many sides around z, with its vertices on the cylinder of this radius (m) from
  /// -half_length to half_length (m), the first of them towards x. From 3 to most_vertices / 2 sides.
  static ConvexHull cylinder(const S& radius, const S& half_length, int sides) {
    check_cylinder("cylinder", radius, "half length", half_length, sides, most_vertices / 2);
    const auto r = static_cast<double>(radius), z = static_cast<double>(half_length);
    std::vector<Vec3<double>> points = circle(r, -z, sides);
    for (const auto& p : circle(r, z, sides)) points.push_back(p);
    return hull_of(points, Constants<double>::epsilon);
  }
  /// A pyramid of so many sides around z, with its base in z = 0, on the circle of this radius (m), the first
  /// vertex towards x, and its tip at z = height (m). From 3 to most_vertices - 1 sides.
  static ConvexHull cone(const S& radius, const S& height, int sides) {
    check_cylinder("cone", radius, "height", height, sides, most_vertices - 1);
    std::vector<Vec3<double>> points = circle(static_cast<double>(radius), 0, sides);
    points.push_back({0, 0, static_cast<double>(height)});
    return hull_of(points, Constants<double>::epsilon);
  }

  /// The vertices, from the centre of mass, along the axes in which the points were given, m.
  std::span<const Vec3<S>> vertices() const& { return data_->vertices; }
  /// The faces; triangles in one plane are one face.
  std::span<const HullFace<S>> faces() const& { return data_->faces; }
  /// The vertices of the faces, one face after the other, counter-clockwise from outside.
  std::span<const int> corners() const& { return data_->corners; }
  /// The vertices of one face, counter-clockwise from outside.
  std::span<const int> corners(const HullFace<S>& face) const& {
    return corners().subspan(static_cast<std::size_t>(face.first), static_cast<std::size_t>(face.count));
  }
  /// The edges, each once.
  std::span<const HullEdge> edges() const& { return data_->edges; }
  /// What a hull holds ends with the last copy of it.
  /// @{
  void vertices() const&& = delete;
  void faces() const&& = delete;
  void corners() const&& = delete;
  void corners(const HullFace<S>& face) const&& = delete;
  void edges() const&& = delete;
  /// @}
  /// Where the centre of mass stands in the frame of the points, m.
  const Vec3<S>& centre_of_mass() const { return data_->centre_of_mass; }
  /// From the centre of mass to the nearest face's plane, m.
  const S& inner_radius() const { return data_->inner_radius; }

  /// What every shape gives: the radius of the ball around it (m), the largest speed at which a unit spin
  /// moves the surface along its normal (m), volume (m^3), the principal inertia of a uniform solid over its
  /// mass (m^2), `factor` times the area turned towards the body-frame velocity v times |v| (m^3/s), the
  /// shape with all lengths multiplied, or in another scalar, words for messages, and check(), which throws
  /// Error for sizes that no shape has.
  /// @{
  S bounding_radius() const { return data_->bounding_radius; }
  S lever() const { return data_->bounding_radius; }
  S volume() const { return data_->volume; }
  PrincipalInertia<S> unit_inertia() const { return data_->unit_inertia; }
  S frontal(const Vec3<S>& v, const S& factor) const {
    using std::abs;
    S twice(0);
    for (const HullFace<S>& face : faces()) twice += face.area * abs(dot(face.normal, v));
    return as<S>(0.5) * factor * twice;
  }
  ConvexHull scaled(const S& factor) const { return ConvexHull(data_->scaled(factor)); }
  template <class T>
  ConvexHull<T> cast() const {
    return ConvexHull<T>(data_->scaled(T(1)));
  }
  std::string describe() const {
    return detail::text("convex hull of ", vertices().size(), " vertices and bounding radius ",
                        bounding_radius(), " m");
  }
  void check() const {
    detail::check_length("convex hull bounding radius", bounding_radius());
    detail::check_length("convex hull inner radius", inner_radius());
  }
  /// @}

 private:
  template <class>
  friend class ConvexHull;

  explicit ConvexHull(detail::HullData<S> data)
      : data_(std::make_shared<const detail::HullData<S>>(std::move(data))) {}

  /// The hull of points that are finite, to this relative precision.
  static ConvexHull hull_of(const std::vector<Vec3<double>>& points, double precision) {
    const auto data = detail::hull_data(detail::HullMesh(points, most_vertices), precision);
    const ConvexHull hull(data.template scaled<S>(S(1)));
    hull.check();
    return hull;
  }
  static std::vector<Vec3<double>> checked(const std::vector<Vec3<S>>& points) {
    constexpr double most = BodyLimits<S>::length;
    std::vector<Vec3<double>> all;
    for (const Vec3<S>& p : points) {
      for (const S& x : {p.x, p.y, p.z}) {
        if (!is_finite(x)) detail::refuse("points of a convex hull", "finite numbers", x);
        detail::check_within("points of a convex hull", x, -most, most, " m");
      }
      all.push_back({static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z)});
    }
    return all;
  }
  static void check_cylinder(const std::string& what, const S& radius, const std::string& other,
                             const S& length, int sides, int most) {
    detail::check_length(what + " radius", radius);
    detail::check_length(what + " " + other, length);
    if (sides < 3 || sides > most) detail::refuse(what + " sides", detail::text("from 3 to ", most), sides);
  }
  static std::vector<Vec3<double>> circle(double radius, double z, int sides) {
    std::vector<Vec3<double>> points;
    for (int i = 0; i < sides; ++i) {
      const double angle = 2 * std::numbers::pi * i / sides;
      points.push_back({radius * std::cos(angle), radius * std::sin(angle), z});
    }
    return points;
  }

  std::shared_ptr<const detail::HullData<S>> data_;
};

/// Any of the shapes, convex hulls too, chosen at run time: as in System<S, N, AnyConvexShape<S>>.
template <class S>
using AnyConvexShape = std::variant<Sphere<S>, Box<S>, Capsule<S>, ConvexHull<S>>;

}  // namespace rbres::RBRES_ABI
