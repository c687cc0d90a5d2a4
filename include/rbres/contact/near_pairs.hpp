#pragma once

#include <algorithm>
#include <iterator>
#include <rbres/body/system.hpp>
#include <span>

namespace rbres::RBRES_ABI {

/// Two bodies, or a plane and a body, that may touch.
struct Candidate {
  int first;   ///< index of a body; -1 - p for plane p
  int second;  ///< index of a body, larger than first
};

namespace detail {

/// For how many pairs among so many bodies, and between them and planes, there is room at once: for all, or
/// for as many as crowd around one another where the bodies are many. (More take memory when they come.)
constexpr std::size_t most_pairs(std::size_t bodies, std::size_t planes) {
  return std::min(bodies * (bodies - 1) / 2, 32 * bodies) + bodies * planes;
}
template <class System>
std::size_t most_pairs(const System& system) {
  return most_pairs(static_cast<std::size_t>(system.size()), system.planes().size());
}
/// How many parts the shapes of a system's bodies have.
template <class System>
std::size_t parts_of(const System& system) {
  if constexpr (PartsOf<typename System::Shape>::compound) {
    std::size_t sum = 0;
    for (int i = 0; i < system.size(); ++i) sum += static_cast<std::size_t>(system[i].shape().size());
    return sum;
  } else {
    return static_cast<std::size_t>(system.size());
  }
}
/// The same of pairs of parts, as if each were a body.
template <class System>
std::size_t most_part_pairs(const System& system) {
  return most_pairs(parts_of(system), system.planes().size());
}
/// Of a system's type.
/// @{
template <class System>
constexpr std::size_t part_room = static_cast<std::size_t>(System::bodies) *
                                  static_cast<std::size_t>(PartsOf<typename System::Shape>::most);
template <class System>
constexpr std::size_t pair_room = room_for<System>(most_pairs(part_room<System>,
                                                              static_cast<std::size_t>(System::most_planes)));
/// @}

/// Whether systems of a type may be a crowd: see is_crowd().
template <class System>
inline constexpr bool may_be_crowd = System::bodies == dynamic && !Packed<typename System::Scalar>;

/// A crowd has more bodies.
inline constexpr int few_bodies = 12;

/// Whether a system has so many bodies that each step costs too much for all of them together, and each
/// impact of a heap too much by itself. Fewer move to the same bits whether their number is known when the
/// program is compiled or when it runs.
template <class System>
bool is_crowd(const System& system) {
  return may_be_crowd<System> && system.size() > few_bodies;
}

/// A pair whose bounding balls overlap.
template <class S>
struct NearPair {
  Candidate who;
  MaskOf<S> near;  ///< the lanes in which they do
};

/// Whether a ball overlaps a plane.
template <class S>
MaskOf<S> near_plane(const Plane<S>& plane, const Vec3<S>& centre, const S& radius) {
  return dot(plane.normal, centre) - plane.offset < radius;
}

/// Whether two balls overlap.
template <class S>
MaskOf<S> balls_overlap(const Vec3<S>& first, const S& first_radius, const Vec3<S>& second,
                        const S& second_radius) {
  const S both = first_radius + second_radius;
  return squared_norm(first - second) < both * both;
}

/// A pair without a kinematic body: what contacts do not move is the first, and -1.
template <class System>
Candidate moved_of(const System& system, const Candidate& who) {
  if (system[who.second].is_kinematic()) return {-1, who.first};
  return {who.first < 0 || system[who.first].is_kinematic() ? -1 : who.first, who.second};
}

/// With what a body is compared.
enum class Partners { planes, planes_and_bodies };

/// The pairs among `bodies` bodies at position(i), and between them and `planes`, that may collide(first,
/// second) and whose balls of radius reach(i) (m) overlap in at least one lane: planes first, in order of the
/// plane's or first body's index, then of the second's. Every pair is compared; nothing is stored.
template <class S, Partners partners, class Position, class Reach, class Collides>
class NearPairs {
 public:
  NearPairs(std::span<const Plane<S>> planes, int bodies, const Position& position, const Reach& reach,
            const Collides& collides)
      : planes_(planes), bodies_(bodies), position_(position), reach_(reach), collides_(collides) {}

  class Iterator {
   public:
    explicit Iterator(const NearPairs& pairs)
        : pairs_(&pairs), who_(pairs.planes_.empty() ? Candidate{0, 0} : Candidate{-1, -1}) {
      ++*this;
    }
    NearPair<S> operator*() const { return {who_, near_}; }
    Iterator& operator++() {
      do {
        if (++who_.second >= pairs_->bodies_) next_first();
        if (at_end()) break;
        near_ = pairs_->near(who_);
      } while (!any(near_) || !pairs_->collides_(who_.first, who_.second));
      return *this;
    }
    friend bool operator==(const Iterator& i, std::default_sentinel_t) { return i.at_end(); }

   private:
    void next_first() {
      const bool more_planes = who_.first < 0 && -who_.first < std::ssize(pairs_->planes_);
      who_.first = more_planes ? who_.first - 1 : who_.first < 0 ? 0 : who_.first + 1;
      who_.second = more_planes ? 0 : who_.first + 1;
    }
    bool at_end() const {
      return who_.second >= pairs_->bodies_ || (partners == Partners::planes && who_.first >= 0);
    }

    const NearPairs* pairs_;
    Candidate who_;
    MaskOf<S> near_{false};
  };

  Iterator begin() const { return Iterator(*this); }
  std::default_sentinel_t end() const { return {}; }

 private:
  MaskOf<S> near(const Candidate& who) const {
    const S reach = reach_(who.second);
    if (who.first < 0) {
      return near_plane(planes_[static_cast<std::size_t>(-1 - who.first)], position_(who.second), reach);
    }
    return balls_overlap(position_(who.first), reach_(who.first), position_(who.second), reach);
  }

  std::span<const Plane<S>> planes_;
  int bodies_;
  Position position_;
  Reach reach_;
  Collides collides_;
};

/// Where the bodies of a state are.
template <class State>
struct PositionIn {
  const State* state;
  const auto& operator()(int i) const { return (*state)[i].position; }
};

/// Which pairs of a system may collide.
template <class System>
struct CollidesIn {
  const System* system;
  bool operator()(int first, int second) const { return system->collides(first, second); }
};

/// The near pairs of a system in a state.
template <Partners partners = Partners::planes_and_bodies, class System, class Reach>
auto near_pairs(const System& system, const typename System::State& state, const Reach& reach) {
  using Position = PositionIn<typename System::State>;
  return NearPairs<typename System::Scalar, partners, Position, Reach, CollidesIn<System>>(
      system.planes(), system.size(), Position{&state}, reach, CollidesIn<System>{&system});
}

}  // namespace detail
}  // namespace rbres::RBRES_ABI
