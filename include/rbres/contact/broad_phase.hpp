#pragma once

#include <algorithm>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/contact/neighbour_lists.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// In order of (first, second).
inline bool comes_before(const Candidate& a, const Candidate& b) {
  return a.first != b.first ? a.first < b.first : a.second < b.second;
}

/// A ball around a body, grown by how far the body may move.
template <class S>
struct Ball {
  S low;  ///< where it begins along x, m
  Vec3<S> centre;
  S radius;  ///< m
  int body;
};

/// Puts balls around position(i) of radius reach(i) in order. `balls` know their body; they are kept in their
/// order from call to call, so that sorting is nearly free.
template <class Balls, class Position, class Reach>
void sort_along_x(Balls& balls, const Position& position, const Reach& reach) {
  for (auto& ball : balls) {
    ball.centre = position(ball.body);
    ball.radius = reach(ball.body);
    ball.low = ball.centre.x - ball.radius;
  }
  for (std::size_t k = 1; k < balls.size(); ++k) {
    const auto moved = balls[k];
    std::size_t at = k;
    for (; at > 0 && moved.low < balls[at - 1].low; --at) balls[at] = balls[at - 1];
    balls[at] = moved;
  }
}

/// Calls found(Candidate) for all pairs of balls around position(i) of radius reach(i) that overlap: sort and
/// sweep along x (Baraff 1992). See sort_along_x().
template <class Balls, class Position, class Reach, class Found>
void sweep(Balls& balls, const Position& position, const Reach& reach, const Found& found) {
  sort_along_x(balls, position, reach);
  for (std::size_t k = 0; k < balls.size(); ++k) {
    const auto ball = balls[k];
    const auto end = ball.centre.x + ball.radius;
    for (std::size_t l = k + 1; l < balls.size() && balls[l].low < end; ++l) {
      const auto& other = balls[l];
      const auto both = ball.radius + other.radius;
      if (squared_norm(ball.centre - other.centre) < both * both)
        found({std::min(ball.body, other.body), std::max(ball.body, other.body)});
    }
  }
}

}  // namespace detail

/// Finds the pairs that may collide and whose bounding balls, grown by how far each body may move, overlap:
/// sort and sweep along x. Pairs come out in order of (first, second). P is the number of planes that there
/// is room for, as of a System.
template <class S, int N, int P = dynamic>
class BroadPhase {
  static constexpr std::size_t room =
      P == dynamic ? std::dynamic_extent
                   : detail::most_pairs(static_cast<std::size_t>(N), static_cast<std::size_t>(P));
  using Pairs = detail::Reserved<Candidate, room>;

 public:
  /// Few bodies are compared one by one, and so are lanes, which would be sorted differently.
  static constexpr bool sweeps = (N == dynamic || N > 16) && ScalarTraits<S>::lanes == 1;

  /// Whether pairs of some bodies can be found.
  static constexpr bool finds_some = N == dynamic && ScalarTraits<S>::lanes == 1;

  /// Allocates all that it needs for so many bodies among so many planes.
  explicit BroadPhase(std::size_t planes, int bodies = N) {
    if constexpr (N == dynamic) all_ = detail::HeapArray<Ball>(static_cast<std::size_t>(bodies));
    if constexpr (sweeps) some_.reserve(static_cast<std::size_t>(bodies));
    for (int i = 0; i < bodies; ++i) all_[static_cast<std::size_t>(i)].body = i;
    pairs_.reserve(detail::most_pairs(static_cast<std::size_t>(bodies), planes));
  }
  /// Allocates what it needs for pairs of some bodies, too. Balls `grown` times as large say which may meet:
  /// the larger, the more seldom that is found anew, among more pairs.
  void reserve_for_some(const S& grown) requires(finds_some) {
    neighbours_.reserve(all_.size(), detail::most_pairs(all_.size(), 0), grown);
  }

  /// `reach` is each body's bounding radius plus the way it may go (m).
  template <class System>
  const Pairs& find(const System& system, const SystemState<S, N>& state,
                    const detail::PerBody<S, N>& reach) {
    using detail::Partners;
    const auto reach_of = [&](int i) -> const S& { return reach[static_cast<std::size_t>(i)]; };
    pairs_.clear();
    if constexpr (finds_some) neighbours_.forget();
    for (const auto& pair : detail::near_pairs<sweeps ? Partners::planes : Partners::planes_and_bodies>(
             system, state, reach_of)) {
      pairs_.push_back(pair.who);
    }
    if constexpr (sweeps) sweep(system, state, reach_of, all_);
    return pairs_;
  }
  /// The same pairs among `bodies` alone, whose indices rise.
  template <class System>
  const Pairs& find(const System& system, const SystemState<S, N>& state, const detail::PerBody<S, N>& reach,
                    std::span<const int> bodies) requires(ScalarTraits<S>::lanes == 1) {
    const auto reach_of = [&](int i) -> const S& { return reach[static_cast<std::size_t>(i)]; };
    if (std::ssize(bodies) == system.size()) return find(system, state, reach);
    find_on_planes(system, state, bodies, reach_of);
    if constexpr (finds_some) neighbours_.forget();
    if constexpr (!sweeps) {
      for (std::size_t k = 0; k < bodies.size(); ++k) {
        for (std::size_t l = k + 1; l < bodies.size(); ++l) {
          const int i = bodies[k], j = bodies[l];
          if (detail::balls_overlap(state[i].position, reach_of(i), state[j].position, reach_of(j)) &&
              system.collides(i, j)) {
            pairs_.push_back({i, j});
          }
        }
      }
      return pairs_;
    }
    some_.clear();
    for (const int i : bodies) some_.push_back({state[i].position.x - reach_of(i), {}, S(0), i});
    std::sort(some_.begin(), some_.end(), [](const Ball& a, const Ball& b) { return a.low < b.low; });
    sweep(system, state, reach_of, some_);
    return pairs_;
  }

  /// The same pairs that have one of `some` in it: has(i) says which. `bodies` are all, or those of the last
  /// call without; there must be room, see reserve_for_some().
  template <class System, class Has>
  const Pairs& find(const System& system, const SystemState<S, N>& state, const detail::PerBody<S, N>& reach,
                    std::span<const int> bodies, std::span<const int> some,
                    const Has& has) requires(finds_some) {
    const auto position = [&](int i) -> const Vec3<S>& { return state[i].position; };
    const auto reach_of = [&](int i) -> const S& { return reach[static_cast<std::size_t>(i)]; };
    find_on_planes(system, state, some, reach_of);
    const auto planes_end = static_cast<std::ptrdiff_t>(pairs_.size());
    neighbours_.find(bodies, position, reach_of, [&](const auto& wide, const auto& found) {
      if (std::ssize(bodies) == system.size()) {
        detail::sweep(all_, position, wide, found);
      } else {
        detail::sweep(some_, position, wide, found);
      }
    });
    for (const int i : some) {
      for (const int k : neighbours_.of(i)) {
        if (k < i && has(k)) continue;
        const Candidate pair{std::min(i, k), std::max(i, k)};
        if (detail::balls_overlap(position(i), reach_of(i), position(k), reach_of(k)) &&
            system.collides(pair.first, pair.second))
          pairs_.push_back(pair);
      }
    }
    std::sort(pairs_.begin() + planes_end, pairs_.end(), detail::comes_before);
    return pairs_;
  }

 private:
  using Ball = detail::Ball<S>;

  /// The pairs of `bodies` and planes alone.
  template <class System, class Reach>
  void find_on_planes(const System& system, const SystemState<S, N>& state, std::span<const int> bodies,
                      const Reach& reach_of) {
    pairs_.clear();
    for (int plane = 0; plane < std::ssize(system.planes()); ++plane) {
      for (const int i : bodies) {
        if (detail::near_plane(system.planes()[static_cast<std::size_t>(plane)], state[i].position,
                               reach_of(i)) &&
            system.collides(-1 - plane, i)) {
          pairs_.push_back({-1 - plane, i});
        }
      }
    }
  }
  /// Adds the pairs of the bodies of `balls`.
  template <class System, class Reach, class Balls>
  void sweep(const System& system, const SystemState<S, N>& state, const Reach& reach_of, Balls& balls) {
    const auto planes_end = static_cast<std::ptrdiff_t>(pairs_.size());
    detail::sweep(
        balls, [&](int i) -> const Vec3<S>& { return state[i].position; }, reach_of,
        [&](const Candidate& pair) {
          if (system.collides(pair.first, pair.second)) pairs_.push_back(pair);
        });
    std::sort(pairs_.begin() + planes_end, pairs_.end(), detail::comes_before);
  }

  detail::PerBody<Ball, N> all_;  ///< in order along x, and so are some_
  detail::Reserved<Ball, !sweeps        ? 0
                         : N == dynamic ? std::dynamic_extent
                                        : static_cast<std::size_t>(N)>
      some_;
  Pairs pairs_;
  struct None {};
  [[no_unique_address]] std::conditional_t<finds_some, detail::NeighbourLists<S>, None> neighbours_;
};

}  // namespace rbres::RBRES_ABI
