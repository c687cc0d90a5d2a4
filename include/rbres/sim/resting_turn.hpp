#pragma once

#include <algorithm>
#include <limits>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/lie.hpp>
#include <rbres/sim/resting_work.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// Impulses change the angular velocity at the end of a part of so many `seconds` as if the body were there
/// as it is in y. What its turn changes about that, world frame, rad/s: its angular momentum is that of the
/// `free` flight and their own, where they take it; to the second order in the time. `change` is what they do
/// to its angular velocity, world frame, rad/s.
template <class S, class Shape>
Vec3<S> change_by_turn(const Body<S, Shape>& body, const RigidState<S>& y, const RigidState<S>& free,
                       const Vec3<S>& change, const S& seconds) {
  const Vec3<S>&inertia = body.inertia(), &inverse = body.inverse_inertia();
  const Vec3<S> impulse = rotate(y.orientation, scale(inertia, rotate_back(y.orientation, change)));
  // In the frame in which free flight ends.
  const Vec3<S> momentum = scale(inertia, free.angular_velocity) + rotate_back(free.orientation, impulse);
  const Vec3<S> spin = scale(inverse, momentum), changed = rotate_back(free.orientation, change);
  const Vec3<S> turn = S(as<S>(0.5) * seconds) * changed;
  const Vec3<S> turned = spin + cross(turn, spin) - scale(inverse, cross(turn, momentum));
  return rotate(free.orientation, turned - free.angular_velocity - changed);
}

/// What it means for resting contacts that bodies turn while their forces act.
template <class System>
class RestingTurns {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pair = ContactPair<System>;
  using Pairs = ContactPairs<System>;
  using Motions = typename Pair::Motions;
  using Contacts = Reserved<typename Pair::Contact, pair_room<System>>;
  using Island = std::span<const std::size_t>;

 public:
  explicit RestingTurns(const System& system)
      : half_(per_body<Vec3<S>>(system)),
        upright_(half_),
        planes_(per_body<S>(system)),
        turns_(per_body<MaskOf<S>>(system)),
        spins_(turns_),
        motion_(per_body<Motion<S>>(system)),
        state_(state_of(system)),
        foreseen_(half_),
        most_(planes_),
        seen_(per_body<int>(system)) {
    moves_.reserve(most_part_pairs(system));
  }

  /// A part of so many seconds, of `bodies` and this many pairs.
  void start(const BodyIndices<System>& bodies, const Motions& motion, const S& seconds, std::size_t pairs) {
    moves_.resize(pairs);
    for (const int i : bodies) {
      half_[index(i)] = S(as<S>(0.5) * seconds) * motion[index(i)].angular_velocity;
      upright_[index(i)] = {};
      planes_[index(i)] = S(0);
      const S turn2 = squared_norm(half_[index(i)]);
      turns_[index(i)] = turn2 > as<S>(least_turn2);
      spins_[index(i)] = turn2 > as<S>(1e-12);  // its third power is, too
      foreseen_[index(i)] = {};
      most_[index(i)] = S(std::numeric_limits<typename Constants<S>::Real>::max());
    }
  }

  /// Finds where an island's bodies touch their planes, and round bodies one another, halfway through the
  /// part of so many seconds: a constant force acts with that arm, to the second order.
  void find_halfway(const System& system, const Pairs& pairs, Island island, const State& y,
                    const Motions& motion, const S& seconds, Contacts& halfway) {
    for (const std::size_t k : island) {
      const Pair& pair = pairs[k];
      if (!pair.plane()) {
        moves_[k] = pair.round && find_halfway(system, pair, y, motion, S(as<S>(0.5) * seconds), halfway[k]);
        continue;
      }
      const MaskOf<S>& turns = turns_[index(pair.who.second)];
      moves_[k] = !Pair::central && any(turns);
      if (!moves_[k]) continue;
      note_plane(index(pair.who.second), pair.manifold.normal,
                 pair.any_resting & spins_[index(pair.who.second)]);
      const Vec3<S> turn = select(turns, half_[index(pair.who.second)], Vec3<S>{});
      pair.find_turned(system, y[pair.who.second], turn, halfway[k]);
    }
  }
  /// Whether pair k touches somewhere else there.
  bool moves(std::size_t k) const { return moves_[k]; }
  /// The bodies there, of pairs that move and are not with a plane; as fast as at the start.
  Motions& motion() { return motion_; }

  /// The torque on body i, mean over the part (1 / `rate` s), turns with it about the normal of the plane on
  /// which it rests: so does what that keeps from tilting.
  void turn(int i, const S& rate, RestingForce<S>& contact) const {
    const Vec3<S>& normal = upright_[index(i)];
    const Vec3<S> half = cross(dot(normal, half_[index(i)]) * normal, contact.torque);
    contact.torque -= half;
    contact.drift += S(as<S>(2.0) * rate) * half;
  }

  /// Moves `end`, which impulses have reached from `unheld`, and that with it, by what the turn of an
  /// island's bodies changes about them, in the lanes `where`: impulses that are found next know of it.
  /// Returns where that was not known and gets less each time; what does not is not foreseen. `guess`: from
  /// impulses that are not yet those of this part.
  MaskOf<S> foresee(const System& system, const Pairs& pairs, Island island, const State& y,
                    const State& free, const S& seconds, const MaskOf<S>& where, bool guess, Motions& unheld,
                    Motions& end) {
    using Real = typename Constants<S>::Real;
    constexpr double epsilon = std::numeric_limits<Real>::epsilon();
    constexpr double counts = std::max(1e-22, 64 * epsilon * epsilon);  // of the square of a spin
    MaskOf<S> news(false);
    if constexpr (Pair::central) return news;  // balls alone: their arms do not turn
    ++round_;
    for (const std::size_t k : island) {
      for (const int i : {pairs[k].moved.first, pairs[k].moved.second}) {
        if (i < 0 || seen_[index(i)] == round_ || !any(where & spins_[index(i)])) continue;
        seen_[index(i)] = round_;
        Vec3<S>&from = unheld[index(i)].angular_velocity, &to = end[index(i)].angular_velocity,
        &known = foreseen_[index(i)];
        const S noise = as<S>(counts) * squared_norm(to);
        const S given = squared_norm(to - from);
        const MaskOf<S> loud = given + squared_norm(known) > noise, spins = spins_[index(i)],
                        counts_here = where & spins & loud;
        if (!any(counts_here)) continue;
        const Vec3<S> change = change_by_turn(system[i], y[i], free[i], Vec3<S>(to - from), seconds);
        // Of thin bodies that spin fast a turn may change more than there is, and that more each time.
        const MaskOf<S> converges = squared_norm(change) <= given;
        const Vec3<S> more = select(counts_here, select(converges, change, Vec3<S>{}) - known, Vec3<S>{});
        if (!guess) spins_[index(i)] = spins_[index(i)] & (converges | !counts_here);
        const S size = squared_norm(more);
        S& most = most_[index(i)];
        const MaskOf<S> differs = size > noise, shrinks = size < most;
        news = news | (differs & shrinks);
        if (!guess) most = select(where, S(as<S>(0.25) * size), most);
        known += more;
        from += more;
        to += more;
      }
    }
    return news;
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  /// Finds how two round bodies meet after `seconds` in which nothing acts on them. False where they do not
  /// turn, or meet otherwise there, or so far away that torques would change faster than the integrator sees.
  bool find_halfway(const System& system, const Pair& pair, const State& y, const Motions& motion,
                    const S& seconds, typename Pair::Contact& contact) {
    const auto turn = [&](int i) { return seconds * motion[index(i)].angular_velocity; };
    const auto turns = [&](int i) { return any(squared_norm(turn(i)) > as<S>(least_turn2)); };
    if (!turns(pair.who.first) && !turns(pair.who.second)) return false;
    for (const int i : {pair.who.first, pair.who.second}) {
      Motion<S>& there = motion_[index(i)];
      there = motion[index(i)];
      there.position += seconds * there.velocity;
      state_[i] = y[i];
      state_[i].position = there.position;
      state_[i].orientation = quaternion_exp(turn(i)) * y[i].orientation;
    }
    pair.find(system, state_, contact);
    const S none(contact.none / 2), farthest2 = square(S(as<S>(0.2) * pair.size));
    if (contact.used != pair.manifold.used) return false;
    for (std::size_t i = 0; i < contact.used; ++i) {
      const bool there = any(contact.gap[i] < none);
      if (there != any(pair.manifold.gap[i] < none)) return false;
      if (there && any(squared_norm(contact.point[i] - pair.manifold.point[i]) > farthest2)) return false;
    }
    return true;
  }

  /// A body rests on a plane in the lanes `where`. Another one leaves it no axis.
  void note_plane(std::size_t body, const Vec3<S>& normal, const MaskOf<S>& where) {
    const MaskOf<S> other = where & (dot(normal, upright_[body]) < as<S>(0.999));
    upright_[body] = select(other, select(planes_[body] > S(0), Vec3<S>{}, normal), upright_[body]);
    planes_[body] += select(where, S(1), S(0));
  }

  static constexpr double least_turn2 = 1e-20;  ///< square of a turn whose square is more than rounding

  PerBody<Vec3<S>, System::bodies> half_;             ///< turn until halfway, rad, world frame
  PerBody<Vec3<S>, System::bodies> upright_;          ///< normal of the only plane on which it rests, or zero
  PerBody<S, System::bodies> planes_;                 ///< on which it rests
  PerBody<MaskOf<S>, System::bodies> turns_, spins_;  ///< where the square, the third power of that counts
  Motions motion_;                                    ///< of round bodies halfway
  State state_;                                       ///< the same
  PerBody<Vec3<S>, System::bodies> foreseen_;         ///< change of the end's angular velocity, rad/s
  PerBody<S, System::bodies> most_;                   ///< square of what it may change by next
  PerBody<int, System::bodies> seen_;                 ///< in which round that was
  int round_ = 0;
  Reserved<char, pair_room<System>> moves_;  ///< which pairs touch somewhere else halfway
};

}  // namespace rbres::RBRES_ABI::detail
