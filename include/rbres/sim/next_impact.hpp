#pragma once

#include <algorithm>
#include <rbres/contact/impact_search.hpp>
#include <rbres/contact/on_course.hpp>
#include <rbres/contact/pair_search.hpp>

namespace rbres::RBRES_ABI::detail {

/// Finds when in a part of a step the first pair touches that does not rest.
template <class System>
class NextImpact {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Motions = MotionsOf<System>;

 public:
  explicit NextImpact(const System& system)
      : system_(&system),
        in_crowd_(is_crowd(system)),
        end_motion_(per_body<Motion<S>>(system)),
        probe_(state_of(system)) {}

  /// s after the part begins, at `start` and with `motion`; it would end at `end`, `seconds` later, which it
  /// returns where nothing touches. Bodies on `course` meet as was found before. `sinking`, `lost`: see
  /// impact_time().
  S find(ContactPairs<System>& pairs, const OnCourse<System>& course, const State& start, Motions& motion,
         const State& end, const S& seconds, const S& sinking, MaskOf<S>& lost) {
    for (const int i : course.others()) {
      Motion<S>& m = end_motion_[static_cast<std::size_t>(i)];
      m.position = end[i].position;
      m.velocity = end[i].velocity;
      m.angular_velocity = end[i].angular_velocity_world();
    }
    const auto find = [&](auto& pair) {
      pair.impact = impact_time(*system_, pair, start, end, end_motion_, seconds, sinking, probe_, lost);
      if (in_crowd_) pair.apart_for = time_apart(*system_, pair, start, end);
      pair.foreseen = false;
    };
    S earliest = seconds;
    for (auto& pair : pairs) {
      if (!course.has(pair)) find(pair);
      earliest = minimum(earliest, pair.impact);
    }
    if constexpr (may_be_crowd<System>) {
      // What was foreseen from afar may be too early.
      const auto before = [](const auto& a, const auto& b) { return a.impact < b.impact; };
      for (;;) {
        const auto first = std::min_element(pairs.begin(), pairs.end(), before);
        earliest = minimum(seconds, first->impact);
        if (!first->foreseen || !(first->impact < seconds)) break;
        for (const int i : {first->who.first, first->who.second}) {
          if (i >= 0) motion[static_cast<std::size_t>(i)] = motion_of((*system_)[i], start[i]);
        }
        measure(*system_, start, motion, MaskOf<S>(true), *first);
        find(*first);
      }
    }
    return earliest;
  }

 private:
  const System* system_;
  bool in_crowd_;
  Motions end_motion_;
  State probe_;
};

}  // namespace rbres::RBRES_ABI::detail
