#pragma once

#include <algorithm>
#include <array>
#include <iterator>
#include <rbres/body/body.hpp>
#include <rbres/body/state.hpp>
#include <rbres/core/fixed_list.hpp>
#include <span>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI {

/// A fixed half-space that bodies rest on and bounce off: the points p with dot(normal, p) < offset are
/// solid.
template <class S>
struct Plane {
  Vec3<S> normal{S(0), S(0), S(1)};  ///< unit vector out of the solid, world frame
  S offset = S(0);                   ///< m
  /// Of its surface.
  Material<S> material{};

  /// The same plane in another scalar.
  template <class T>
  Plane<T> cast() const {
    return {{as<T>(normal.x), as<T>(normal.y), as<T>(normal.z)},
            as<T>(offset),
            {as<T>(material.restitution), as<T>(material.friction)}};
  }
};

/// The floor z = 0.
template <class S>
Plane<S> floor_plane(const Material<S>& material = {}) {
  return {{S(0), S(0), S(1)}, S(0), material};
}

/// The six inner faces of a room: |x|, |y| <= half_width, 0 <= z <= height (m).
template <class S>
std::vector<Plane<S>> room(S half_width, S height, const Material<S>& material = {}) {
  const S o(0), i(1);
  return {{{o, o, i}, o, material},           {{o, o, -i}, -height, material},
          {{i, o, o}, -half_width, material}, {{-i, o, o}, -half_width, material},
          {{o, i, o}, -half_width, material}, {{o, -i, o}, -half_width, material}};
}

namespace detail {

/// The planes with normals of length 1: a length off by 1e-5 would make energy. Throws Error where a normal
/// is no unit vector, an offset not finite, or a material none.
template <class Planes>
Planes checked_planes(Planes planes) {
  using S = decltype(Planes::value_type::offset);
  if constexpr (std::is_floating_point_v<S>) {
    for (std::size_t i = 0; i < planes.size(); ++i) {
      auto& p = planes[i];
      const S length = norm(p.normal);
      naming([&] { return text("plane ", i, ", "); },
             [&] {
               if (!(std::abs(length - S(1)) < as<S>(1e-5)))
                 refuse("normal", "a unit vector", Line("one of length ", length));
               if (!is_finite(p.offset)) refuse("offset", "a finite number", p.offset);
               check_material(p.material);
             });
      if (std::abs(length - S(1)) > S(4) * S(Constants<S>::epsilon)) p.normal = (S(1) / length) * p.normal;
    }
  }
  return planes;
}

/// Puts pairs in order, each with its smaller index first. Throws Error for one that is no pair of so many
/// bodies and planes. Never inlined: GCC 12 warns of sorting a list that has room for one.
[[gnu::noinline]] inline void check_pairs(std::span<std::array<int, 2>> pairs, int bodies,
                                          std::ptrdiff_t planes) {
  for (auto& [first, second] : pairs) {
    if (first > second) std::swap(first, second);
    if (second < 0 || second >= bodies || first >= second || first < -planes) {
      refuse("pair without contact",
             Line("two bodies from 0 to ", bodies - 1, ", or a plane from ", -planes, " to -1 and a body"),
             Line(first, " and ", second));
    }
  }
  std::sort(pairs.begin(), pairs.end());
}
/// The pairs after check_pairs().
template <class Pairs>
Pairs checked_pairs(Pairs pairs, int bodies, std::ptrdiff_t planes) {
  check_pairs({pairs.data(), pairs.size()}, bodies, planes);
  return pairs;
}

/// Whether contacts move one of two bodies; `first` is negative for a plane.
template <class Bodies>
bool one_moves(const Bodies& bodies, int first, int second) {
  const auto moves = [&](int i) { return i >= 0 && !bodies[static_cast<std::size_t>(i)].is_kinematic(); };
  return moves(first) || moves(second);
}

}  // namespace detail

/// A pair that shall not collide: two bodies, or a plane and a body, in either order. Plane p is -1 - p.
using PairWithoutContact = std::array<int, 2>;

/// N bodies and the planes around them: everything that does not change while they move. A System is read
/// only; where the bodies are stands in a SystemState. With N = dynamic it has as many bodies as it is given
/// when the program runs; else all is the same. So with P, the number of planes that there is room for: where
/// N and P are numbers, all that a run needs has its size in its type, and nothing allocates. Throws Error
/// where there is no body, a plane's normal is not a unit vector, there are more planes than P, or a pair
/// that shall not collide is none.
template <class S, int N, class Shape_ = AnyShape<S>, int P = dynamic>
class System {
  static_assert(N >= 1 || N == dynamic, "a System has at least one body");
  static_assert(P == dynamic || (P >= 0 && N != dynamic),
                "a System of N bodies has room for 0 planes or more");

 public:
  /// Its numbers.
  using Scalar = S;
  /// Of its bodies.
  using Shape = Shape_;
  /// A body of it.
  using BodyType = Body<S, Shape>;
  /// Where its bodies are.
  using State = SystemState<S, N>;
  /// How many there are, or dynamic; see size().
  static constexpr int bodies = N;
  /// For how many planes there is room, or dynamic: for any number.
  static constexpr int most_planes = P;
  /// Its bodies, one after the other.
  using Bodies = detail::BodyList<BodyType, N>;
  /// Its planes.
  using Planes = detail::ListOf<Plane<S>, P == dynamic ? std::dynamic_extent : std::size_t(P)>;
  /// Pairs of them.
  using PairsWithoutContact =
      detail::ListOf<PairWithoutContact,
                     P == dynamic ? std::dynamic_extent : std::size_t(N*(N - 1) / 2 + N * P)>;

  /// These bodies among these planes; without_contact are the pairs that shall not collide.
  System(Bodies all, Planes planes = {}, PairsWithoutContact without_contact = {})
      : bodies_(std::move(all)),
        planes_(detail::checked_planes(std::move(planes))),
        without_contact_(detail::checked_pairs(std::move(without_contact), size(), std::ssize(planes_))) {
    if (bodies_.empty()) detail::refuse("system", "a body or more", "none");
    for (const BodyType& body : bodies_) any_kinematic_ = any_kinematic_ || body.is_kinematic();
  }
  /// A system of one shape where any shape may stand.
  template <class Other>
  requires(!std::is_same_v<Other, Shape_> && std::is_constructible_v<BodyType, const Body<S, Other>&>)
      System(const System<S, N, Other, P>& other)
      : System(each(other, [](const auto& body) { return BodyType(body); }), other.planes(),
               other.without_contact()) {}
  /// N times the same body.
  static System of(const BodyType& every, Planes planes = {}) requires(N != dynamic) {
    const auto repeat = [&]<std::size_t... I>(std::index_sequence<I...>) {
      return Bodies{((void)I, every)...};
    };
    return System(repeat(std::make_index_sequence<std::size_t(N)>{}), std::move(planes));
  }
  /// So many times the same body.
  static System of(int count, const BodyType& every, Planes planes = {}) requires(N == dynamic) {
    if (count < 1) detail::refuse("system", "a body or more", count);
    return System(Bodies(static_cast<std::size_t>(count), every), std::move(planes));
  }

  /// How many bodies it has.
  constexpr int size() const noexcept {
    if constexpr (N == dynamic) {
      return static_cast<int>(bodies_.size());
    } else {
      return N;
    }
  }

  /// Body i, from 0.
  const BodyType& operator[](int i) const { return bodies_[static_cast<std::size_t>(i)]; }
  /// The planes, in the order in which they were given.
  const Planes& planes() const { return planes_; }

  /// Whether two bodies may collide, or a plane and a body (-1 - p for plane p; the smaller index first).
  bool collides(int first, int second) const noexcept {
    if (any_kinematic_ && !detail::one_moves(bodies_, first, second)) return false;
    return without_contact_.empty() || !std::binary_search(without_contact_.begin(), without_contact_.end(),
                                                           PairWithoutContact{first, second});
  }
  /// The pairs that are kept from colliding, in order, the smaller index first.
  const PairsWithoutContact& without_contact() const { return without_contact_; }

  /// The same system in another scalar; packs get it in every lane.
  template <class T>
  auto cast() const {
    using Other = System<T, N, typename detail::CastShape<Shape, T>::type, P>;
    typename Other::Planes planes;
    for (const auto& plane : planes_) planes.push_back(plane.template cast<T>());
    return Other(Other::each(*this, [](const auto& body) { return body.template cast<T>(); }),
                 std::move(planes), without_contact_);
  }

 private:
  template <class, int, class, int>
  friend class System;
  /// What f makes of each body of another system.
  template <class Other, class F>
  static Bodies each(const Other& other, const F& f) {
    if constexpr (N == dynamic) {
      Bodies all;
      all.reserve(static_cast<std::size_t>(other.size()));
      for (int i = 0; i < other.size(); ++i) all.push_back(f(other[i]));
      return all;
    } else {
      return [&]<std::size_t... I>(std::index_sequence<I...>) { return Bodies{f(other[int(I)])...}; }
      (std::make_index_sequence<std::size_t(N)>{});
    }
  }
  Bodies bodies_;
  Planes planes_;
  PairsWithoutContact without_contact_;  ///< sorted, the smaller index first
  bool any_kinematic_ = false;
};

namespace detail {

/// `count` where a system's type says how many bodies and planes it has: room of which its type knows the
/// size. Else that of a vector.
template <class System>
constexpr std::size_t room_for(std::size_t count) {
  return System::most_planes == dynamic ? std::dynamic_extent : count;
}
/// The number of a system's bodies as a size; that of its planes.
/// @{
template <class System>
constexpr std::size_t body_room = room_for<System>(static_cast<std::size_t>(System::bodies));
template <class System>
constexpr std::size_t plane_room = room_for<System>(static_cast<std::size_t>(System::most_planes));
/// @}

/// A state for a system, its numbers not set.
template <class System>
typename System::State state_of(const System& system) {
  typename System::State y{};
  if constexpr (System::bodies == dynamic) y.body.resize(static_cast<std::size_t>(system.size()));
  return y;
}

/// Refuses a state of another number of bodies than the system has.
template <class System>
void check_size(const System& system, const typename System::State& y) {
  if constexpr (System::bodies == dynamic) {
    if (y.size() != system.size())
      refuse("state", Line(system.size(), " bodies, as the system has"), y.size());
  }
}
}  // namespace detail

}  // namespace rbres::RBRES_ABI
