#pragma once

#include <rbres/contact/islands.hpp>
#include <rbres/contact/on_course.hpp>
#include <rbres/sim/kept_islands.hpp>
#include <rbres/sim/moving_islands.hpp>
#include <rbres/sim/resting_points.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// The contacts that rest, slide or roll where a part of a step begins, in islands, and what is known of
/// these: which keep their forces, and which move.
template <class System>
class RestingIslands {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  using Pairs = ContactPairs<System>;
  using Motions = typename Pair::Motions;
  using Bodies = BodyIndices<System>;

 public:
  explicit RestingIslands(const System& system)
      : islands_(system), kept_(system), rests_(per_body<MaskOf<S>>(system)), moving_(system) {}

  /// A new step of `bodies`.
  void start_step(const Bodies& bodies) {
    kept_.clear(bodies);
    within_step_ = false;
  }
  /// Marks the points that touch, or nearly so, and move slowly; groups their pairs, of `bodies`, into
  /// islands. False where there are none.
  bool find(const Bodies& bodies, Pairs& pairs, const Motions& motion, const MaskOf<S>& running,
            const OnCourse<System>& course) {
    all_ = bodies;
    others_ = course.others();
    islands_.clear();
    moving_.start_part(others_, motion);
    for (const int i : others_) rests_[index(i)] = MaskOf<S>(false);
    bool found = false;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      Pair& pair = pairs[k];
      if (!course.has(pair) && !kept_.mark(pair)) mark_resting(pair, running);
      if (!any(pair.any_resting)) continue;
      found = true;
      for (const int body : {pair.moved.first, pair.moved.second}) {
        if (body >= 0) rests_[index(body)] = rests_[index(body)] | pair.any_resting;
      }
      islands_.add(k, pair.moved.first, pair.moved.second);
    }
    if (!found) {
      kept_.clear(all_);
      return false;
    }
    islands_.group(Packed<S>);
    moving_.group(islands_, pairs);
    return true;
  }
  /// Chooses the islands that keep their forces: where it `may` be, see KeptIslands::choose().
  template <class Touches>
  void keep_undisturbed(const Pairs& pairs, bool may, const Touches& touches, const S& seconds,
                        const S& most) {
    within_step_ = may;
    may ? kept_.choose(all_, pairs, touches, seconds, most) : kept_.clear(all_);
  }

  /// All bodies of the step, and those of which more is to be found than that they go on as they did.
  /// @{
  const Bodies& all() const { return all_; }
  const Bodies& others() const { return others_; }
  /// @}
  std::size_t count() const { return islands_.count(); }
  /// The pairs of island k.
  std::span<const std::size_t> operator[](std::size_t k) const { return islands_[k]; }

  /// Those that keep their forces.
  KeptIslands<System>& kept() { return kept_; }
  const KeptIslands<System>& kept() const { return kept_; }
  /// Whether island k does.
  bool keeps(const Pairs& pairs, std::size_t k) const { return kept_.has(pairs[islands_[k].front()]); }
  /// Whether an impact in a crowd has ended the part before.
  bool within_step() const { return within_step_; }
  /// Where a body has a resting contact and new forces.
  MaskOf<S> moves(int i) const { return kept_.has(i) ? MaskOf<S>(false) : rests_[index(i)]; }
  /// Where a body has a resting contact, of bodies that are not on course.
  const PerBody<MaskOf<S>, System::bodies>& rests() const { return rests_; }

  /// Those that move.
  const MovingIslands<System>& moving() const { return moving_; }
  /// Whether island k does.
  bool is_moving(const Pairs& pairs, std::size_t k) const {
    return moving_.has_island_of(pairs[islands_[k].front()].moved.second);
  }
  /// Whether a body that contacts hold is so slow that HeldFlight is for it.
  bool nearly_rests(int i, const Motions& motion) const {
    return any(moves(i)) && !moving_.is_moving(i, motion[index(i)]);
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  Bodies all_, others_;
  Islands<System> islands_;
  KeptIslands<System> kept_;
  bool within_step_ = false;
  PerBody<MaskOf<S>, System::bodies> rests_;
  MovingIslands<System> moving_;
};

}  // namespace rbres::RBRES_ABI::detail
