#pragma once

#include <algorithm>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// The islands of resting contacts that an impact elsewhere does not disturb: they keep their forces when it
/// ends a part of a step, and go on as they would have without it. Only in dynamic systems of more than 12
/// bodies: in others every part ends for all.
template <class System>
class KeptIslands {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pair = ContactPair<System>;
  using Pairs = ContactPairs<System>;
  using Bodies = BodyIndices<System>;
  static constexpr bool possible = may_be_crowd<System>;

 public:
  explicit KeptIslands(const System& system) : in_crowd_(is_crowd(system)) {
    if constexpr (possible) {
      kept_ = disturbed_ = per_body<bool>(system);
      elapsed_ = struck_ = per_body<S>(system);
      start_ = state_of(system);
      pairs_.reserve(most_part_pairs(system));
    }
  }

  /// No island of `bodies` keeps its forces.
  void clear(const Bodies& bodies) {
    if constexpr (possible) {
      for (const int i : bodies) kept_[index(i)] = false;
      pairs_.clear();
    }
  }

  /// Whether an impact at the end of the last part reached body i: see choose().
  bool disturbed(int i) const {
    if constexpr (possible) return disturbed_[index(i)];
    return true;
  }
  /// Whether body i is in an island that keeps its forces.
  bool has(int i) const {
    if constexpr (possible) return in_crowd_ && kept_[index(i)];
    return false;
  }
  bool has(const Pair& pair) const { return has(pair.moved.second); }

  /// Sets which points of a pair with a body of a kept island rest: those that did, and none of a pair that
  /// is new to it. False for other pairs.
  bool mark(Pair& pair) const {
    if constexpr (possible) {
      if (pairs_.empty() || !(has(pair) || (pair.moved.first >= 0 && has(pair.moved.first)))) return false;
      const auto at = std::lower_bound(pairs_.begin(), pairs_.end(), pair,
                                       [](const Rests& a, const Pair& b) { return found_before(a, b); });
      const bool known = at != pairs_.end() && !found_before(pair, *at);
      for (std::size_t i = 0; i < Pair::points; ++i) pair.resting[i] = known && at->points[i];
      pair.any_resting = known;
      return true;
    }
    return false;
  }

  /// Body i, which is in no kept island, gets new forces from y on.
  void start(int i, const State& y) {
    if constexpr (possible) {
      start_[i] = y[i];
      elapsed_[index(i)] = struck_[index(i)] = S(0);
    }
  }
  /// An impact has given body i so much energy (J) of its rotation.
  void strike(int i, const S& energy) {
    if constexpr (possible) struck_[index(i)] += energy;
  }
  /// What impacts have given its rotation since it has its forces, J.
  S struck(int i) const {
    if constexpr (possible) return struck_[index(i)];
    return S(0);
  }
  /// Where the forces of all bodies began, in a part that began at y.
  const State& start(const State& y) const {
    if constexpr (possible) return start_;
    return y;
  }
  /// For how long body i has had its forces, so many `seconds` after this part began, s.
  S age(int i, const S& seconds) const {
    if constexpr (possible) return elapsed_[index(i)] + seconds;
    return seconds;
  }

  /// Chooses the islands that keep their forces after a part of at `most` so many seconds that an impact has
  /// ended when it was so many `seconds` old: those that no impact reaches, however it is handed on. Pairs
  /// that touch there and have theirs later have it then, too. touches(k): whether pair k does.
  template <class Touches>
  void choose(const Bodies& bodies, const Pairs& pairs, const Touches& touches, const S& seconds,
              const S& most) {
    if constexpr (possible) {
      for (const int i : bodies) disturbed_[index(i)] = false;
      for (std::size_t k = 0; k < pairs.size(); ++k) {
        const Pair& pair = pairs[k];
        const bool due = pair.impact <= seconds || (pair.impact < most && !pair.any_resting && touches(k));
        if (!due) continue;
        disturbed_[index(pair.moved.second)] = true;
        if (pair.moved.first >= 0) disturbed_[index(pair.moved.first)] = true;
      }
      for (bool more = true; more;) {  // ends: each time a body more is disturbed
        more = false;
        for (std::size_t k = 0; k < pairs.size(); ++k) {
          const Pair& pair = pairs[k];
          if (pair.moved.first < 0) continue;
          bool &a = disturbed_[index(pair.moved.first)], &b = disturbed_[index(pair.moved.second)];
          if (a == b || !(pair.any_resting || touches(k))) continue;
          a = b = more = true;
        }
      }
      for (const int i : bodies) kept_[index(i)] = false;
      for (const Pair& pair : pairs) {
        if (!pair.any_resting || disturbed_[index(pair.moved.second)]) continue;
        kept_[index(pair.moved.second)] = true;
        if (pair.moved.first >= 0) kept_[index(pair.moved.first)] = true;
      }
    }
  }
  /// Ends a part of so many seconds.
  void end_part(const Bodies& bodies, const Pairs& pairs, const S& seconds) {
    if constexpr (possible) {
      for (const int i : bodies) elapsed_[index(i)] += seconds;
      pairs_.clear();
      for (const Pair& pair : pairs) {
        if (pair.any_resting && has(pair)) pairs_.push_back({pair.who, pair.resting, pair.parts});
      }
    }
  }

 private:
  /// A pair of a kept island, and which of its points rest.
  struct Rests {
    Candidate who;
    std::array<MaskOf<S>, Pair::points> points;
    [[no_unique_address]] typename Pair::Parts parts;
  };
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  bool in_crowd_;
  PerBody<bool, System::bodies> kept_{}, disturbed_{};
  PerBody<S, System::bodies> elapsed_{};  ///< before this part, s
  PerBody<S, System::bodies> struck_{};
  State start_{};
  Reserved<Rests, room_for<System>(0)> pairs_;
};

}  // namespace rbres::RBRES_ABI::detail
