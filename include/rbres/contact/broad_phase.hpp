#pragma once

#include <algorithm>
#include <rbres/body/system.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres {

/// Two bodies, or a plane and a body, that may touch during the coming step.
struct Candidate {
  int first;   ///< index of a body; -1 - p for plane p
  int second;  ///< index of a body, larger than first
};

namespace detail {

/// In order of (first, second).
inline bool comes_before(const Candidate& a, const Candidate& b) {
  return a.first != b.first ? a.first < b.first : a.second < b.second;
}

/// Calls found(i, j) for all pairs of intervals [low(i), high(i)] that overlap: sort and sweep (Baraff 1992).
/// `order` holds each i once; it is kept from call to call, so that sorting is nearly free.
template <class Order, class Low, class High, class Found>
void sweep(Order& order, const Low& low, const High& high, const Found& found) {
  for (std::size_t k = 1; k < order.size(); ++k) {
    const int moved = order[k];
    std::size_t at = k;
    for (; at > 0 && low(moved) < low(order[at - 1]); --at) order[at] = order[at - 1];
    order[at] = moved;
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    const auto end = high(order[k]);
    for (std::size_t l = k + 1; l < order.size() && low(order[l]) < end; ++l) found(order[k], order[l]);
  }
}

}  // namespace detail

/// Finds the pairs whose bounding balls, grown by how far each body may move, overlap: sort and sweep along
/// x. Pairs come out in order of (first, second).
template <class S, int N>
class BroadPhase {
 public:
  explicit BroadPhase(std::size_t planes) {
    for (int i = 0; i < N; ++i) order_[static_cast<std::size_t>(i)] = i;
    pairs_.reserve(N * (N - 1) / 2 + N * planes);
  }

  /// `reach` is each body's bounding radius plus the way it may go (m).
  template <class System>
  const std::vector<Candidate>& find(const System& system, const SystemState<S, N>& state,
                                     const std::array<S, N>& reach) {
    pairs_.clear();
    for (std::size_t p = 0; p < system.planes().size(); ++p) {
      const auto& plane = system.planes()[p];
      for (int i = 0; i < N; ++i) {
        if (any(dot(plane.normal, state[i].position) - plane.offset < reach[static_cast<std::size_t>(i)])) {
          pairs_.push_back({-1 - static_cast<int>(p), i});
        }
      }
    }
    const std::size_t planes_end = pairs_.size();
    const auto add = [&](int i, int j) {
      const S r = reach[static_cast<std::size_t>(i)] + reach[static_cast<std::size_t>(j)];
      if (any(squared_norm(state[i].position - state[j].position) < r * r)) {
        pairs_.push_back({std::min(i, j), std::max(i, j)});
      }
    };
    if constexpr (N <= 16 || ScalarTraits<S>::lanes > 1) {
      for (int i = 0; i < N; ++i) {
        for (int j = i + 1; j < N; ++j) add(i, j);
      }
    } else {
      const auto place = [](int i) { return static_cast<std::size_t>(i); };
      detail::sweep(
          order_, [&](int i) { return state[i].position.x - reach[place(i)]; },
          [&](int i) { return state[i].position.x + reach[place(i)]; }, add);
      std::sort(pairs_.begin() + static_cast<std::ptrdiff_t>(planes_end), pairs_.end(), detail::comes_before);
    }
    return pairs_;
  }

 private:
  std::array<int, N> order_;
  detail::Reserved<Candidate> pairs_;
};

}  // namespace rbres
