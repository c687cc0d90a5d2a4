#pragma once

#include <algorithm>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/contact/islands.hpp>

namespace rbres::RBRES_ABI::detail {

/// Which bodies of a crowd move where a part of a step begins, and which of its islands have such a body:
/// what contacts do wrong there is soon over. In a system that is no crowd none counts as one.
template <class System>
class MovingIslands {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  using Motions = typename Pair::Motions;

 public:
  explicit MovingIslands(const System& system)
      : system_(&system),
        in_crowd_(is_crowd(system)),
        body_moves_(per_body<bool>(system)),
        island_moves_(body_moves_) {}

  /// Whether body i is not nearly at rest, in any system.
  bool is_moving(int i, const Motion<S>& motion) const {
    const S size = (*system_)[i].bounding_radius(), slow = as<S>(1e-3) * speed_scale(size);
    return any(squared_norm(motion.velocity) + square(size) * squared_norm(motion.angular_velocity) >
               square(slow));
  }

  /// A new part of `bodies`.
  void start_part(const BodyIndices<System>& bodies, const Motions& motion) {
    if (!in_crowd_) return;
    for (const int i : bodies) body_moves_[index(i)] = is_moving(i, motion[index(i)]);
  }
  /// Its islands.
  void group(const Islands<System>& islands, const ContactPairs<System>& pairs) {
    if (!in_crowd_) return;
    for (std::size_t island = 0; island < islands.count(); ++island) {
      const auto members = islands[island];
      const bool moves =
          std::any_of(members.begin(), members.end(), [&](std::size_t k) { return has(pairs[k]); });
      for (const std::size_t k : members) {
        for (const int body : {pairs[k].moved.first, pairs[k].moved.second}) {
          if (body >= 0) island_moves_[index(body)] = moves;
        }
      }
    }
  }

  /// Whether a body of the pair moves.
  bool has(const Pair& pair) const {
    const auto& [first, second] = pair.moved;
    return in_crowd_ && (body_moves_[index(second)] || (first >= 0 && body_moves_[index(first)]));
  }
  /// Whether a body moves in the island of body i, which has one.
  bool has_island_of(int i) const { return in_crowd_ && island_moves_[index(i)]; }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  const System* system_;
  bool in_crowd_;
  PerBody<bool, System::bodies> body_moves_, island_moves_;
};

}  // namespace rbres::RBRES_ABI::detail
