#pragma once

#include <cstddef>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/core/reserved.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// Groups pairs of bodies into islands: pairs that share a body, directly or through others, are solved
/// together; islands are independent of one another. Planes and kinematic bodies join nothing.
template <class System>
class Islands {
 public:
  explicit Islands(const System& system)
      : parent_(per_body<std::size_t>(system)), end_(parent_), island_(parent_), size_(parent_) {
    pairs_.reserve(most_part_pairs(system));
    order_.reserve(most_part_pairs(system));
  }

  void clear() { pairs_.clear(); }
  /// `first` is negative for what contacts do not move.
  void add(std::size_t pair, int first, int second) { pairs_.push_back({pair, first, second}); }

  /// Finds the islands, by union and find; or takes all pairs as one (`together`), because lanes would
  /// disagree. The pairs of an island keep their order.
  void group(bool together) {
    order_.clear();
    count_ = 0;
    if (together) {
      for (const Pair& pair : pairs_) order_.push_back(pair.index);
      if (!pairs_.empty()) end_[count_++] = order_.size();
      return;
    }
    const std::size_t none = parent_.size();
    for (const Pair& pair : pairs_) {  // the others cost nothing, however many they are
      for (const int body : {pair.first, pair.second}) {
        if (body < 0) continue;
        const auto i = std::size_t(body);
        parent_[i] = i;
        island_[i] = none;
      }
    }
    for (const Pair& pair : pairs_) {
      if (pair.first >= 0) parent_[root(std::size_t(pair.first))] = root(std::size_t(pair.second));
    }
    for (const Pair& pair : pairs_) {
      std::size_t& k = island_[root(std::size_t(pair.second))];
      if (k == none) {
        k = count_++;
        size_[k] = 0;
      }
      ++size_[k];
    }
    std::size_t end = 0;
    for (std::size_t k = 0; k < count_; ++k) {
      end_[k] = end;
      end += size_[k];
    }
    order_.resize(end);
    for (const Pair& pair : pairs_) order_[end_[island_[root(std::size_t(pair.second))]]++] = pair.index;
  }

  std::size_t count() const { return count_; }
  /// The pairs of island k.
  std::span<const std::size_t> operator[](std::size_t k) const {
    const std::size_t start = k == 0 ? 0 : end_[k - 1];
    return {order_.data() + start, end_[k] - start};
  }

 private:
  struct Pair {
    std::size_t index;
    int first, second;
  };
  std::size_t root(std::size_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  Reserved<Pair, pair_room<System>> pairs_;
  Reserved<std::size_t, pair_room<System>> order_;
  PerBody<std::size_t, System::bodies> parent_, end_;
  PerBody<std::size_t, System::bodies> island_, size_;  ///< of each root the island, of each island its pairs
  std::size_t count_ = 0;
};

}  // namespace rbres::RBRES_ABI::detail
