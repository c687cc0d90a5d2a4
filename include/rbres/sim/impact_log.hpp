#pragma once

#include <algorithm>
#include <limits>
#include <rbres/contact/contact_pair.hpp>
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
    if constexpr (!has_groups<System>) return;
    if (is_crowd(system)) return;
    most_ = most_rows<System>(parts_of(system), system.planes().size());
    later_.reserve(most_);
  }

  /// A step, or the same anew. `in_groups`: impacts come group by group.
  void start_step(bool in_groups) {
    in_groups_ = in_groups;
    later_.clear();
  }
  /// Whether as many impulses can be told later. Few bodies are refused alike with room in their type and
  /// without, listened to or not: they move to the same bits.
  bool has_room(std::size_t impulses) const { return impulses <= most_; }
  template <class Observer>
  void hear(const Impact<S>& impact, Observer& observer) {
    if (!in_groups_) return observer.impact(impact);
    if (has_room(later_.size() + 1)) later_.push_back(impact);
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
  std::size_t most_ = std::numeric_limits<std::size_t>::max();
  Reserved<Impact<S>, has_groups<System> ? row_room<System> : 0> later_;
};

}  // namespace rbres::RBRES_ABI::detail
