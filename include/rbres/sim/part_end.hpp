#pragma once

#include <algorithm>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// How pairs meet at the end of a part of a step.
template <class System>
class PartEnd {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pair = ContactPair<System>;
  using Pairs = ContactPairs<System>;

 public:
  using Contacts = Reserved<typename Pair::Contact, pair_room<System>>;

  explicit PartEnd(const System& system) : system_(&system), in_crowd_(is_crowd(system)) {
    contacts_.reserve(most_part_pairs(system));
    found_.reserve(most_part_pairs(system));
  }

  /// One for each pair: those that sunk() or find() has found.
  const Contacts& contacts() const { return contacts_; }
  /// The same to write to, after room().
  Contacts& contacts() { return contacts_; }
  /// How pair k meets in `flown`, for which sunk() was asked.
  const typename Pair::Contact& find(const Pairs& pairs, std::size_t k, const State& flown) {
    if (!found_[k]) pairs[k].find(*system_, flown, contacts_[k]);
    found_[k] = true;
    return contacts_[k];
  }
  /// Whether pair k touches there, so many seconds after the part began.
  bool touches(const Pairs& pairs, std::size_t k, const State& flown, const S& seconds) {
    const Pair& pair = pairs[k];
    if (const MaskOf<S> may_be_near = pair.apart_for <= seconds; !any(may_be_near)) return false;
    const auto& contact = find(pairs, k, flown);
    return std::any_of(contact.gap.begin(), contact.gap.begin() + std::ptrdiff_t(contact.used),
                       [&](const S& gap) { return any(gap <= pair.touch); });
  }
  /// Makes room for those of other places than the end, before sunk() is asked.
  void room(const Pairs& pairs) { contacts_.resize(pairs.size()); }

  /// How much deeper than at the start of a part the deepest point is in `flown`, where the contacts' forces
  /// have taken the bodies in so many seconds; 1: as deep as it may get. Of resting pairs, or of all; not of
  /// those that have theirs later on their course, and of which nothing rests. In a crowd a new point may end
  /// the part, which is cheap; else parts are so short there that runs do not depend on rounding. `sinking`:
  /// see impact_time(), of pairs that is_moving(pair).
  template <class IsMoving>
  S sunk(const Pairs& pairs, const State& flown, const S& seconds, const MaskOf<S>& all, const S& sinking,
         const IsMoving& is_moving) {
    room(pairs);
    found_.assign(pairs.size(), false);
    S worst(0);
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const Pair& pair = pairs[k];
      if (!any(pair.any_resting) && (pair.foreseen || !any(all))) continue;
      const MaskOf<S> may_be_near = pair.apart_for <= seconds;
      if (in_crowd_ && !any(pair.any_resting | may_be_near)) continue;
      worst = maximum(worst, sunk(pair, find(pairs, k, flown), all, sinking, is_moving(pair)));
    }
    return worst;
  }
  /// The same of a pair that meets like this there.
  S sunk(const Pair& pair, const typename Pair::Contact& contact, const MaskOf<S>& all, const S& sinking,
         bool moves) const {
    S most = pair.most_sinking();
    // A part may end where a new point of a resting pair shows: as deep as impact_time() lets it get.
    if (in_crowd_ && any(all) && !pair.fixed_points())
      most = select(pair.any_resting, S(as<S>(1.05) * pair.near), most);
    const auto share = [&](const S& before, const S& after) {
      const S depth = -minimum(before, S(0));
      const S sinks = moves ? S(as<S>(1.05) * (sinking * pair.size - depth)) : S(0);
      return S((-after - depth) / maximum(most, sinks));
    };
    if (!pair.fixed_points()) {
      const S deeper = share(pair.manifold.separation, contact.separation);
      return select(all | pair.any_resting, deeper, S(0));
    }
    S worst(0);
    for (std::size_t i = 0; i < contact.used; ++i) {
      const S deeper = share(pair.manifold.gap[i], contact.gap[i]);
      worst = maximum(worst, select(pair.resting[i] | all, deeper, S(0)));
    }
    return worst;
  }

  /// Notes in the pairs how they meet where a part has ended, y, where that is known: of bodies that are
  /// still as sunk() saw them in `flown`.
  void note_manifolds(Pairs& pairs, const State& flown, const State& y) const {
    const auto stayed = [&](int i) {
      return i < 0 || (y[i].position == flown[i].position && y[i].orientation == flown[i].orientation);
    };
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      Pair& pair = pairs[k];
      pair.known = found_[k] && stayed(pair.who.first) && stayed(pair.who.second);
      if (pair.known) pair.manifold = contacts_[k];
    }
  }

 private:
  const System* system_;
  bool in_crowd_;
  Contacts contacts_;
  Reserved<char, pair_room<System>> found_;  ///< whether they are
};

}  // namespace rbres::RBRES_ABI::detail
