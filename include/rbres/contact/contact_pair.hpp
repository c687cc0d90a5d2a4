#pragma once

#include <algorithm>
#include <rbres/contact/covered.hpp>
#include <rbres/contact/detect.hpp>
#include <rbres/contact/impact.hpp>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/core/pool.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// The pair's combined material.
template <class System>
Surface<typename System::Scalar> surface_of(const System& system, int first, int second) {
  const auto& b = system[second].material();
  const auto& a =
      first < 0 ? system.planes()[static_cast<std::size_t>(-1 - first)].material : system[first].material();
  return {combined_restitution(a, b), combined_friction(a, b)};
}

/// The speed of a fall as deep as the body is large, over that of a body of 0.1 m: sqrt(10 / m * size).
/// Thresholds of speed grow with it, so that large and small worlds behave alike (Froude's similarity).
template <class S>
S speed_scale(const S& size) {
  return root(S(as<S>(10.0) * size));
}

/// How deep bodies of a crowd may be in one another before they have an impact, as a share of their size: so
/// dozens of impacts of a heap that are due within one step are resolved a few times together.
inline constexpr double heap_sinking = 1e-4;

/// A pair that may touch during a part of a step: its manifold where the part begins, and what its points do.
template <class System>
struct ContactPair {
  using S = typename System::Scalar;
  using BodyPair = PairManifold<S, typename System::Shape>;
  using PlanePair = PlaneManifold<S, typename System::Shape>;
  static constexpr std::size_t points = std::max(BodyPair::points, PlanePair::points);
  using Parts = PartPairOf<System>;
  static constexpr bool central = !Parts::compound && BodyPair::central && PlanePair::central;
  using Motions = MotionsOf<System>;

  /// How the two meet, with room for what any pair needs.
  struct Contact : Manifold<S, int(points), central> {
    std::size_t used;  ///< there is no point from this one on
  };

  // What is asked of every pair at every impact of a crowd comes first, to lie together in memory.
  Candidate who;
  Candidate moved;  ///< see moved_of()
  [[no_unique_address]] Parts parts;
  MaskOf<S> any_resting;
  bool known = false;     ///< whether the manifold is that of the present state
  bool round = false;     ///< of a crowd: a ball and another body, or two capsules
  bool foreseen = false;  ///< whether `impact` was found where an earlier part began
  S impact;               ///< when it has one, s after the part begins, if that is before its end
  S apart_for{0};         ///< of a crowd: for how long it certainly comes no nearer than `near`, s
  std::array<MaskOf<S>, points> touching{}, resting{};
  S size;   ///< the smaller bounding radius, of the whole bodies, m
  S touch;  ///< points closer than this touch, m
  S near;   ///< slow points closer than this rest, m
  Surface<S> surface;
  S speed_scale;                ///< see detail::speed_scale
  S rest_speed;                 ///< slower impacts do not bounce, m/s
  S still;                      ///< points that open slower than this do not part, m/s
  std::array<S, points> speed;  ///< at which each point's gap opens, m/s
  Contact manifold;

  ContactPair() = default;
  ContactPair(const System& system, const Candidate& candidate, const S& rest, const Parts& of = {})
      : who(candidate),
        moved(moved_of(system, candidate)),
        parts(of),
        surface(surface_of(system, who.first, who.second)) {
    size = system[who.second].bounding_radius();
    if (!plane()) size = minimum(size, system[who.first].bounding_radius());
    touch = as<S>(Constants<S>::touch) * size;
    near = as<S>(100.0) * touch;
    speed_scale = detail::speed_scale(size);
    round = is_round(system);
    // A perfectly elastic contact never comes to rest by bouncing.
    rest_speed = select(surface.restitution < S(1), rest, minimum(rest, as<S>(1e-7))) * speed_scale;
    still = minimum(rest_speed, S(as<S>(100 * Constants<S>::touch) * speed_scale));
  }

  /// The pair is found again, for a part that starts where its manifold may be known.
  void start_part() {
    foreseen = false;
    apart_for = S(0);
    touching = resting = {};
  }

  bool plane() const { return who.first < 0; }
  /// The number of point i among those of all parts of the two bodies.
  std::size_t place(std::size_t i) const { return parts.number() * points + i; }
  /// How many such numbers there are.
  static constexpr std::size_t places = Parts::count * points;
  /// A plane's points are corners, always the same; those of round bodies move, and others come and go.
  bool fixed_points() const { return plane() || points == 1 || round; }
  /// How much deeper the pair may get in one part of a step, m. Bodies that rest on one another show a new
  /// point by its depth.
  S most_sinking() const {
    const S most = as<S>(2e-5) * size;
    return fixed_points() ? most : select(any_resting, minimum(most, S(as<S>(0.5) * near)), most);
  }
  /// The motion of the second body where the first is a plane: nothing reads or changes a plane's.
  Motion<S>& first(Motions& m) const { return m[static_cast<std::size_t>(plane() ? who.second : who.first)]; }
  Motion<S>& second(Motions& m) const { return m[static_cast<std::size_t>(who.second)]; }

  /// How the two meet in this state. Where parts cover one another they do not.
  void find(const System& system, const typename System::State& y, Contact& contact) const {
    with_part_manifold(system, y, who.first, who.second, parts, [&](const auto& m, auto) {
      contact.normal = m.normal;
      contact.separation = m.separation;
      constexpr std::size_t there = std::decay_t<decltype(m)>::points;
      contact.used = 0;
      for (std::size_t i = 0; i < there; ++i) {
        contact.gap[i] = m.gap[i];
        contact.point[i] = m.point[i];
        if (any(m.gap[i] < S(m.none / 2))) contact.used = i + 1;
      }
      for (std::size_t i = there; i < points; ++i) contact.gap[i] = S(m.none);
    });
    if constexpr (Parts::compound) {
      const S apart = as<S>(2) * near;
      if (!(contact.separation < apart) || !meets_covered(system, y, who, parts, contact, apart)) return;
      contact.separation = apart;
      for (S& gap : contact.gap) gap = maximum(gap, apart);
    }
  }
  /// How they meet in the present state, y: found where it is not known yet.
  void know_manifold(const System& system, const typename System::State& y) {
    if (!known) find(system, y, manifold);
    known = true;
  }
  /// Where the points of a body on a plane are when it has turned by `turn` (rad, world frame) about its
  /// centre of mass.
  void find_turned(const System& system, RigidState<S> body, const Vec3<S>& turn, Contact& contact) const {
    body.orientation = quaternion_exp(turn) * body.orientation;
    const auto& plane = system.planes()[static_cast<std::size_t>(-1 - who.first)];
    with_part(system[who.second], body, parts.second, [&](const auto& shape, const Pose<S>& pose) {
      const auto m = detect(plane, shape, pose);
      contact.normal = m.normal;
      for (std::size_t i = 0; i < std::size_t(m.points); ++i) contact.point[i] = m.point[i];
    });
  }
  /// Speed at which the gap at one point of `contact` opens, m/s.
  S opening(const Contact& contact, std::size_t i, const Motions& motion) const {
    const auto at = [&](int body) {
      const Motion<S>& m = motion[static_cast<std::size_t>(body)];
      return m.velocity + cross(m.angular_velocity, contact.point[i] - m.position);
    };
    Vec3<S> v = at(who.second);
    if (!plane()) v -= at(who.first);
    return dot(contact.normal, v);
  }

 private:
  bool is_round(const System& system) const {
    if constexpr (Parts::compound) {
      return false;
    } else {
      if (plane() || !is_crowd(system)) return false;
      const auto is_ball = [](const auto& s) { return std::is_same_v<std::decay_t<decltype(s)>, Sphere<S>>; };
      const auto is_capsule = [](const auto& s) {
        return std::is_same_v<std::decay_t<decltype(s)>, Capsule<S>>;
      };
      const auto &a = system[who.first].shape(), &b = system[who.second].shape();
      return with_shape(a, is_ball) || with_shape(b, is_ball) ||
             (with_shape(a, is_capsule) && with_shape(b, is_capsule));
    }
  }
};

/// Whether a pair is found before another (see BroadPhase, each_near_part).
template <class A, class B>
bool found_before(const A& a, const B& b) {
  const Candidate &i = a.who, &k = b.who;
  if (i.first != k.first) return i.first < 0 && k.first < 0 ? i.first > k.first : i.first < k.first;
  return i.second != k.second ? i.second < k.second : a.parts.number() < b.parts.number();
}

/// The pairs of a part of a step. Heaps meet many impacts in a step, which leave most pairs as they are.
template <class System>
using ContactPairs = std::conditional_t<may_be_crowd<System>, Pool<ContactPair<System>>,
                                        Reserved<ContactPair<System>, pair_room<System>>>;

/// For how many contact points there is room: twice what equal balls can reach, none of which has more than
/// twelve neighbours.
template <class System>
constexpr std::size_t most_rows(std::size_t parts, std::size_t planes) {
  return ContactPair<System>::points * (std::min(parts * (parts - 1) / 2, 12 * parts) + parts * planes);
}
/// Of a system's type.
template <class System>
constexpr std::size_t row_room =
    room_for<System>(most_rows<System>(part_room<System>, static_cast<std::size_t>(System::most_planes)));

}  // namespace detail
}  // namespace rbres::RBRES_ABI
