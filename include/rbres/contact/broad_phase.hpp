#pragma once

#include <algorithm>
#include <numeric>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI {
namespace detail {

/// In order of (first, second).
inline bool comes_before(const Candidate& a, const Candidate& b) {
  return a.first != b.first ? a.first < b.first : a.second < b.second;
}

/// Calls found(Candidate) for all pairs of balls around position(i) of radius reach(i) that overlap: sort and
/// sweep along x (Baraff 1992). `order` holds each i once; it is kept from call to call, so that sorting is
/// nearly free.
template <class Order, class Position, class Reach, class Found>
void sweep(Order& order, const Position& position, const Reach& reach, const Found& found) {
  const auto low = [&](int i) { return position(i).x - reach(i); };
  const auto high = [&](int i) { return position(i).x + reach(i); };
  for (std::size_t k = 1; k < order.size(); ++k) {
    const int moved = order[k];
    std::size_t at = k;
    for (; at > 0 && low(moved) < low(order[at - 1]); --at) order[at] = order[at - 1];
    order[at] = moved;
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    const int i = order[k];
    const auto end = high(i);
    for (std::size_t l = k + 1; l < order.size() && low(order[l]) < end; ++l) {
      const int j = order[l];
      const auto both = reach(i) + reach(j);
      if (squared_norm(position(i) - position(j)) < both * both) found({std::min(i, j), std::max(i, j)});
    }
  }
}

}  // namespace detail

/// Finds the pairs that may collide and whose bounding balls, grown by how far each body may move, overlap:
/// sort and sweep along x. Pairs come out in order of (first, second).
template <class S, int N>
class BroadPhase {
 public:
  /// Few bodies are compared one by one, and so are lanes, which would be sorted differently.
  static constexpr bool sweeps = (N == dynamic || N > 16) && ScalarTraits<S>::lanes == 1;

  /// Allocates all that it needs for so many bodies among so many planes.
  explicit BroadPhase(std::size_t planes, int bodies = N) {
    if constexpr (N == dynamic) order_ = detail::HeapArray<int>(static_cast<std::size_t>(bodies));
    std::iota(order_.begin(), order_.end(), 0);
    pairs_.reserve(detail::most_pairs(static_cast<std::size_t>(bodies), planes));
  }

  /// `reach` is each body's bounding radius plus the way it may go (m).
  template <class System>
  const std::vector<Candidate>& find(const System& system, const SystemState<S, N>& state,
                                     const detail::PerBody<S, N>& reach) {
    using detail::Partners;
    const auto reach_of = [&](int i) -> const S& { return reach[static_cast<std::size_t>(i)]; };
    pairs_.clear();
    for (const auto& pair : detail::near_pairs<sweeps ? Partners::planes : Partners::planes_and_bodies>(
             system, state, reach_of)) {
      pairs_.push_back(pair.who);
    }
    if constexpr (sweeps) {
      const auto planes_end = static_cast<std::ptrdiff_t>(pairs_.size());
      detail::sweep(
          order_, [&](int i) -> const Vec3<S>& { return state[i].position; }, reach_of,
          [&](const Candidate& pair) {
            if (system.collides(pair.first, pair.second)) pairs_.push_back(pair);
          });
      std::sort(pairs_.begin() + planes_end, pairs_.end(), detail::comes_before);
    }
    return pairs_;
  }

 private:
  detail::PerBody<int, N> order_;
  detail::Reserved<Candidate> pairs_;
};

}  // namespace rbres::RBRES_ABI
