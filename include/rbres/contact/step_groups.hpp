#pragma once

#include <algorithm>
#include <rbres/contact/islands.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/core/reserved.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// How far a shape reaches along a unit vector of its frame, or farther, m.
/// @{
template <class Shape, class S>
S extent_along(const Shape& shape, const Vec3<S>&) {
  return shape.bounding_radius();
}
template <class S>
S extent_along(const Box<S>& box, const Vec3<S>& direction) {
  return dot(box.half, absolute(direction));
}
template <class S>
S extent_along(const Capsule<S>& capsule, const Vec3<S>& direction) {
  using std::abs;
  return capsule.radius + capsule.half_length * abs(direction.z);
}
/// @}

/// The groups of bodies that cannot meet one another within a step, whatever happens inside them: each takes
/// the step by itself. Kinematic bodies and those that sleep join nothing, and belong to each group that may
/// meet them.
template <class System>
class StepGroups {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Ways = PerBody<S, System::bodies>;
  using Broad = BroadPhase<S, System::bodies, System::most_planes>;

 public:
  explicit StepGroups(const System& system)
      : system_(&system),
        broad_(system.planes().size(), system.size()),
        islands_(system),
        reach_(per_body<S>(system)),
        ball_(reach_),
        wanted_(reach_),
        stays_(per_body<bool>(system)),
        meets_(per_body<std::size_t>(system)) {
    if constexpr (Broad::finds_some) broad_.reserve_for_some(as<S>(1.5));
    const auto n = static_cast<std::size_t>(system.size());
    alone_.reserve(n);
    kinematic_.reserve(n);
    bodies_.reserve(n + 2 * most_pairs(system));
    end_.reserve(n);
    for (int i = 0; i < system.size(); ++i) {
      if (system[i].is_kinematic()) kinematic_.push_back(i);
    }
  }

  /// A new step.
  void start_step() { wanted_.fill(S(0)); }
  /// Finds the groups of `all` bodies for a step of `time` seconds from y, in which bodies alone go `way` m
  /// and end at `free`. `stays(i)`: whether body i sleeps, or is a still kinematic body. False where the
  /// system is one group.
  template <class Stays>
  bool find(std::span<const int> all, const State& y, const State& free, const Ways& way, const S& time,
            const Stays& stays) {
    for (int i = 0; i < system_->size(); ++i) {
      stays_[index(i)] = stays(i);
      // No other body decides this: what happens far away changes nothing here.
      const S little = as<S>(0.1) * (*system_)[i].bounding_radius();
      reach_[index(i)] = maximum(maximum(way[index(i)], little), wanted_[index(i)]);
    }
    // Bodies that meet may go as far as the fastest of them, and then meet others.
    for (;;) {
      for (int i = 0; i < system_->size(); ++i)
        ball_[index(i)] = (*system_)[i].bounding_radius() * as<S>(1.001) + reach_[index(i)];
      const auto& pairs = find_pairs(all, y);
      if (join(pairs, y, way, time)) continue;
      list(pairs, y, free, way, time);
      return count() > 1 || !alone_.empty();
    }
  }

  std::size_t count() const { return end_.size(); }
  /// The bodies of group k, whose indices rise.
  std::span<const int> operator[](std::size_t k) const {
    const std::size_t start = k == 0 ? 0 : end_[k - 1];
    return {bodies_.data() + start, end_[k] - start};
  }
  /// The bodies that meet nothing.
  std::span<const int> alone() const { return alone_; }
  /// The kinematic bodies.
  std::span<const int> kinematic() const { return kinematic_; }

  /// Whether bodies of a group, which began the step at `start`, are at y where a further `way` takes them to
  /// no other group. If not, groups that are found again will let them go there.
  bool hold(std::span<const int> bodies, const State& start, const State& y, const Ways& way) {
    bool all = true;
    for (const int i : bodies) {
      const S goes = norm(y[i].position - start[i].position) + way[index(i)];
      if (!joins(i) || goes <= reach_[index(i)]) continue;
      wanted_[index(i)] = as<S>(1.5) * goes;
      all = false;
    }
    return all;
  }

 private:
  static constexpr auto none = static_cast<std::size_t>(-1);
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  /// Whether body i joins those that it may meet.
  bool joins(int i) const { return !stays_[index(i)] && !(*system_)[i].is_kinematic(); }
  /// The pairs of balls that overlap. Which bodies are near one another changes little from step to step.
  const auto& find_pairs(std::span<const int> all, const State& y) {
    if constexpr (Broad::finds_some) {
      return broad_.find(*system_, y, ball_, all, all, [](int) { return true; });
    } else {
      return broad_.find(*system_, y, ball_);
    }
  }
  /// How far a point of a body may go that flies `way`, m.
  S far(const State& y, const Ways& way, const S& time, int i) const {
    return way[index(i)] + (*system_)[i].bounding_radius() * time * norm(y[i].angular_velocity);
  }
  /// Calls f(body) for the bodies of the pairs of group k, those that join nothing too, some of them many
  /// times.
  template <class Pairs, class F>
  void each_of(std::size_t k, const Pairs& pairs, const F& f) const {
    for (const std::size_t pair : islands_[k]) {
      if (pairs[pair].first >= 0) f(pairs[pair].first);
      f(pairs[pair].second);
    }
  }

  /// Joins the bodies that may meet. Returns whether that lets one of them go farther than its reach was.
  template <class Pairs>
  bool join(const Pairs& pairs, const State& y, const Ways& way, const S& time) {
    islands_.clear();
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const auto [first, second] = pairs[k];
      const bool joins_first = first >= 0 && joins(first);
      if (joins(second)) {
        islands_.add(k, joins_first ? first : -1, second);
      } else if (joins_first) {
        islands_.add(k, -1, first);
      } else if (first >= 0 && !(stays_[index(first)] && stays_[index(second)])) {
        islands_.add(k, -1, moved_of(*system_, pairs[k]).second);  // a kinematic body that may wake another
      }
    }
    islands_.group(false);
    bool grown = false;
    for (std::size_t k = 0; k < islands_.count(); ++k) {
      S fastest(0);
      each_of(k, pairs, [&](int i) { fastest = maximum(fastest, far(y, way, time, i)); });
      each_of(k, pairs, [&](int i) {
        if (!joins(i) || !(reach_[index(i)] < as<S>(2) * fastest)) return;
        reach_[index(i)] = as<S>(2) * fastest;
        grown = true;
      });
    }
    return grown;
  }

  /// Whether group k is a body that can meet planes alone, and flies clear of them.
  template <class Pairs>
  bool is_clear(std::size_t k, const Pairs& pairs, const State& y, const State& free, const Ways& way,
                const S& time) const {
    const auto island = islands_[k];
    return std::all_of(island.begin(), island.end(), [&](std::size_t pair) {
      const auto& [first, second] = pairs[pair];
      if (first >= 0) return false;
      const auto& body = (*system_)[second];
      const RigidState<S>& state = y[second];
      const Plane<S>& plane = system_->planes()[index(-1 - first)];
      const Vec3<S> normal = rotate_back(body.shape_rotation(), rotate_back(state.orientation, plane.normal));
      const S extent = with_shape(body.shape(), [&](const auto& s) { return extent_along(s, normal); });
      const S moves =
          way[index(second)] + body.bounding_radius() * (as<S>(1e-3) + turn_of(state, free[second], time));
      return dot(plane.normal, state.position) - plane.offset > extent + moves;
    });
  }

  /// Lists the bodies of each group, and those that are alone.
  template <class Pairs>
  void list(const Pairs& pairs, const State& y, const State& free, const Ways& way, const S& time) {
    meets_.fill(none);
    bodies_.clear();
    end_.clear();
    for (std::size_t k = 0; k < islands_.count(); ++k) {
      if (is_clear(k, pairs, y, free, way, time)) continue;
      const auto start = static_cast<std::ptrdiff_t>(bodies_.size());
      each_of(k, pairs, [&](int i) {
        if (meets_[index(i)] != k) bodies_.push_back(i);
        meets_[index(i)] = k;
      });
      std::sort(bodies_.begin() + start, bodies_.end());
      end_.push_back(bodies_.size());
    }
    alone_.clear();
    for (int i = 0; i < system_->size(); ++i) {
      if (meets_[index(i)] == none && !(*system_)[i].is_kinematic()) alone_.push_back(i);
    }
  }

  const System* system_;
  Broad broad_;
  Islands<System> islands_;              ///< of the pairs that may meet
  Ways reach_, ball_;                    ///< how far bodies may get in the step, m; the same with their size
  Ways wanted_;                          ///< the reach of those that went farther, m
  PerBody<bool, System::bodies> stays_;  ///< asleep, or kinematic and still
  PerBody<std::size_t, System::bodies> meets_;  ///< the last group of each body
  Reserved<int, body_room<System>> alone_, kinematic_;
  Reserved<int, room_for<System>(static_cast<std::size_t>(System::bodies) + 2 * pair_room<System>)> bodies_;
  Reserved<std::size_t, body_room<System>> end_;  ///< of each group among bodies_
};

}  // namespace rbres::RBRES_ABI::detail
