#pragma once

#include <algorithm>
#include <rbres/contact/broad_phase.hpp>
#include <rbres/core/reserved.hpp>
#include <span>
#include <utility>

namespace rbres::RBRES_ABI::detail {

/// The groups of bodies that cannot meet one another within a step, whatever happens inside them: each takes
/// the step by itself. Kinematic bodies join nothing, and belong to each group that may meet them. For
/// systems of a number of bodies known when the program runs.
template <class System>
class StepGroups {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Ways = PerBody<S, System::bodies>;

 public:
  explicit StepGroups(const System& system)
      : system_(&system),
        broad_(system.planes().size(), system.size()),
        reach_(per_body<S>(system)),
        ball_(reach_),
        fastest_(reach_),
        parent_(per_body<int>(system)),
        group_(parent_),
        meets_(per_body<bool>(system)) {
    const auto n = static_cast<std::size_t>(system.size());
    alone_.reserve(n);
    kinematic_.reserve(n);
    members_.reserve(2 * n);
    bodies_.reserve(2 * n);
    end_.reserve(n);
    for (int i = 0; i < system.size(); ++i) {
      if (system[i].is_kinematic()) kinematic_.push_back(i);
    }
  }

  /// Finds the groups for a step of `time` seconds from y, in which bodies alone go `way` m. False where the
  /// system is one group.
  bool find(const State& y, const Ways& way, const S& time) {
    S fastest(0);
    for (int i = 0; i < system_->size(); ++i) fastest = maximum(fastest, far(y, way, time, i));
    for (int i = 0; i < system_->size(); ++i) {
      const S little = as<S>(0.5) * (*system_)[i].bounding_radius();
      reach_[index(i)] = maximum(way[index(i)], minimum(S(as<S>(2) * fastest), little));
    }
    // Bodies that meet may go as far as the fastest of them, and then meet others.
    constexpr int rounds = 4;
    for (int round = 0; join(y, way, time); ++round) {
      if (round == rounds) return false;
    }
    list();
    return count() > 1 || !alone_.empty();
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

  /// Whether the bodies of a group, which began the step at `start`, are at y where a further `way` takes
  /// them to no other group.
  bool hold(std::span<const int> group, const State& start, const State& y, const Ways& way) const {
    return std::all_of(group.begin(), group.end(), [&](int i) {
      const S gone = norm(y[i].position - start[i].position);
      return (*system_)[i].is_kinematic() || gone + way[index(i)] <= reach_[index(i)];
    });
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  bool moves(int i) const { return i >= 0 && !(*system_)[i].is_kinematic(); }
  int root(int i) {
    while (parent_[index(i)] != i) i = parent_[index(i)] = parent_[index(parent_[index(i)])];
    return i;
  }

  /// How far a point of a body may go that flies `way`, m.
  S far(const State& y, const Ways& way, const S& time, int i) const {
    return way[index(i)] + (*system_)[i].bounding_radius() * time * norm(y[i].angular_velocity);
  }

  /// Joins the bodies that may meet. Returns whether that lets one of them go farther than its reach was.
  bool join(const State& y, const Ways& way, const S& time) {
    for (int i = 0; i < system_->size(); ++i) {
      ball_[index(i)] = (*system_)[i].bounding_radius() * as<S>(1.001) + reach_[index(i)];
      parent_[index(i)] = i;
      meets_[index(i)] = false;
      fastest_[index(i)] = S(0);
    }
    pairs_ = &broad_.find(*system_, y, ball_);
    for (const Candidate& who : *pairs_) {
      for (const int i : {who.first, who.second}) {
        if (moves(i)) meets_[index(i)] = true;
      }
      if (moves(who.first) && moves(who.second)) parent_[index(root(who.first))] = root(who.second);
    }
    for (const Candidate& who : *pairs_) {
      const int group = moves(who.first) ? who.first : who.second;
      for (const int i : {who.first, who.second}) {
        if (i < 0) continue;
        S& fastest = fastest_[index(root(group))];
        fastest = maximum(fastest, far(y, way, time, i));
      }
    }
    bool grown = false;
    for (int i = 0; i < system_->size(); ++i) {
      if (!meets_[index(i)]) continue;
      const S most = as<S>(2) * fastest_[index(root(i))];
      if (reach_[index(i)] < most) {
        reach_[index(i)] = most;
        grown = true;
      }
    }
    return grown;
  }

  /// Lists the bodies of each group, and those that are alone.
  void list() {
    alone_.clear();
    members_.clear();
    int groups = 0;
    for (int i = 0; i < system_->size(); ++i) group_[index(i)] = -1;
    for (int i = 0; i < system_->size(); ++i) {
      if (!moves(i)) continue;
      if (!meets_[index(i)]) {
        alone_.push_back(i);
        continue;
      }
      int& group = group_[index(root(i))];
      if (group < 0) group = groups++;
      members_.push_back({group, i});
    }
    for (const Candidate& who : *pairs_) {
      if (who.first < 0 || (moves(who.first) && moves(who.second))) continue;
      const auto [body, kinematic] =
          moves(who.first) ? std::pair(who.first, who.second) : std::pair(who.second, who.first);
      members_.push_back({group_[index(root(body))], kinematic});
    }
    std::sort(members_.begin(), members_.end());
    members_.erase(std::unique(members_.begin(), members_.end()), members_.end());
    bodies_.clear();
    end_.clear();
    for (const auto& [group, body] : members_) {
      if (static_cast<std::size_t>(group) == end_.size()) end_.push_back(bodies_.size());
      bodies_.push_back(body);
      end_.back() = bodies_.size();
    }
  }

  const System* system_;
  BroadPhase<S, System::bodies> broad_;
  const std::vector<Candidate>* pairs_ = nullptr;  ///< that may meet
  Ways reach_, ball_;  ///< how far bodies may get in the step, m; the same with their size
  Ways fastest_;       ///< of each root, the way of its fastest body, m
  PerBody<int, System::bodies> parent_, group_;
  PerBody<bool, System::bodies> meets_;
  Reserved<std::pair<int, int>> members_;  ///< group, body
  Reserved<int> alone_, kinematic_, bodies_;
  Reserved<std::size_t> end_;
};

}  // namespace rbres::RBRES_ABI::detail
