#pragma once

#include <algorithm>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/core/reserved.hpp>
#include <span>
#include <utility>

namespace rbres::RBRES_ABI::detail {

/// Which balls each of many may meet, for as long as all keep to balls a little larger than they were
/// (Verlet 1967).
template <class S>
class NeighbourLists {
 public:
  /// Balls are known `grown` times as large.
  void reserve(std::size_t bodies, std::size_t pairs, const S& grown) {
    grown_ = grown;
    pairs_.reserve(pairs);
    for (auto* list : {&begin_, &end_}) list->resize(bodies);
    around_.resize(bodies);
    neighbours_.reserve(2 * pairs);
  }
  /// The bodies are others.
  void forget() { known_ = false; }

  /// Finds the neighbours of `bodies`, whose balls are around position(i) and have the radius reach(i), m,
  /// unless those known are still theirs. each_pair(reach, found) calls found(Candidate) for all pairs of
  /// balls that overlap.
  template <class Position, class Reach, class EachPair>
  void find(std::span<const int> bodies, const Position& position, const Reach& reach,
            const EachPair& each_pair) {
    if (known_ && std::all_of(bodies.begin(), bodies.end(), [&](int i) {
          const auto& [centre, radius] = around_[index(i)];
          const S slack = radius - reach(i);
          return slack >= S(0) && squared_norm(position(i) - centre) <= square(slack);
        })) {
      return;
    }
    known_ = true;
    for (const int i : bodies) {
      around_[index(i)] = {position(i), grown_ * reach(i)};
      end_[index(i)] = 0;
    }
    pairs_.clear();
    each_pair([&](int i) { return around_[index(i)].radius; },
              [&](const Candidate& pair) {
                pairs_.push_back(pair);
                ++end_[index(pair.first)];
                ++end_[index(pair.second)];
              });
    std::size_t from = 0;
    for (const int i : bodies) {
      begin_[index(i)] = from;
      from += std::exchange(end_[index(i)], from);
    }
    neighbours_.resize(from);
    for (const auto& [i, k] : pairs_) {
      neighbours_[end_[index(i)]++] = k;
      neighbours_[end_[index(k)]++] = i;
    }
  }
  /// Those of body i.
  std::span<const int> of(int i) const {
    return {neighbours_.data() + begin_[index(i)], end_[index(i)] - begin_[index(i)]};
  }

 private:
  struct Around {
    Vec3<S> centre;
    S radius;
  };
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  bool known_ = false;
  S grown_{1};
  Reserved<Around> around_;
  Reserved<Candidate> pairs_;
  Reserved<std::size_t> begin_, end_;
  Reserved<int> neighbours_;
};

}  // namespace rbres::RBRES_ABI::detail
