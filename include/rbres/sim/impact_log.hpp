#pragma once

#include <algorithm>
#include <rbres/contact/near_pairs.hpp>
#include <rbres/core/reserved.hpp>
#include <rbres/sim/observer.hpp>

namespace rbres::RBRES_ABI::detail {

/// Tells an observer of impulses: at once, or at the end of a step whose groups of bodies are each at a time
/// of their own.
template <class System>
class ImpactLog {
  using S = typename System::Scalar;

 public:
  explicit ImpactLog(const System& system) {
    if constexpr (System::bodies == dynamic) later_.reserve(most_part_pairs(system));
  }

  /// A step, or the same anew. `in_groups`: impacts come group by group.
  void start_step(bool in_groups) {
    in_groups_ = in_groups;
    later_.clear();
  }
  template <class Observer>
  void hear(const Impact<S>& impact, Observer& observer) {
    if constexpr (System::bodies == dynamic) {
      if (in_groups_) return later_.push_back(impact);
    }
    observer.impact(impact);
  }
  /// Tells of the impacts of all groups, in order of time.
  template <class Observer>
  void end_groups(Observer& observer) {
    const auto earlier = [](const Impact<S>& a, const Impact<S>& b) { return a.time < b.time; };
    for (auto at = later_.begin(); at != later_.end(); ++at)
      std::rotate(std::upper_bound(later_.begin(), at, *at, earlier), at, at + 1);
    for (const Impact<S>& impact : later_) observer.impact(impact);
  }

 private:
  bool in_groups_ = false;
  Reserved<Impact<S>, room_for<System>(0)> later_;
};

}  // namespace rbres::RBRES_ABI::detail
