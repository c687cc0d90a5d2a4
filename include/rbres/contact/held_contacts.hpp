#pragma once

#include <limits>
#include <rbres/contact/contact_pair.hpp>
#include <vector>

namespace rbres::detail {

/// The contacts that rest, slide or roll, and the impulses that hold them: found by relaxing their points in
/// turn. It starts from the forces of the step before, so that a stack at rest takes a sweep or two.
template <class System>
class HeldContacts {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  using Motions = typename Pair::Motions;

 public:
  explicit HeldContacts(const System& system) : planes_(static_cast<long>(system.planes().size())) {
    // Twice what equal balls can reach: none has more than twelve neighbours.
    const std::size_t N = System::bodies;
    const std::size_t most = Pair::points * (std::min(N * (N - 1) / 2, 12 * N) + N * system.planes().size());
    rows_.reserve(most);
    last_.reserve(most);
    next_.reserve(most);
  }

  /// Whether there is no room for another pair: memory is never asked for.
  bool full() const { return rows_.size() + Pair::points > rows_.capacity(); }
  void clear() { rows_.clear(); }
  /// Forgets the forces of the step before, except in the lanes where `same` holds.
  void forget_unless(const MaskOf<S>& same) {
    for (Last& last : last_) {
      for (S& force : last.force) force = select(same, force, S(0));
    }
  }

  /// Takes up the held points of a pair, if there is room.
  void add(const Pair& pair, Motions& motion) {
    if (full()) return;
    for (std::size_t i = 0; i < Pair::points; ++i) {
      if (!any(pair.held[i])) continue;
      Row row;
      row.who = pair.who;
      row.key = key(pair.who, i);
      row.active = pair.held[i];
      row.gap = pair.manifold.gap[i];
      row.leaving = pair.speed[i];
      row.friction = pair.surface.friction;
      const Vec3<S>&normal = pair.manifold.normal, &point = pair.manifold.point[i];
      if (pair.plane()) {
        row.fixed = ContactPoint<S, true>(normal, point, pair.first(motion), pair.second(motion));
      } else {
        row.free = ContactPoint<S, false>(normal, point, pair.first(motion), pair.second(motion));
      }
      rows_.push_back(row);
    }
  }

  /// Starts every row with the force of the step before, over `duration` (s).
  void warm_start(Motions& motion, const S& duration) {
    std::size_t at = 0;
    for (Row& row : rows_) {
      while (at < last_.size() && last_[at].key < row.key) ++at;
      if (at == last_.size()) return;
      if (last_[at].key != row.key) continue;
      std::array<S, 3> impulse;
      for (std::size_t d = 0; d < 3; ++d)
        impulse[d] = select(row.active, S(duration * last_[at].force[d]), S(0));
      with(row, motion, [&](auto& point, auto& a, auto& b) { point.add(impulse, a, b); });
    }
  }
  /// Keeps the forces for the next step; those over less than `shortest` (s) are rounding, and dropped. Lanes
  /// without a duration keep what they have.
  void remember(const S& duration, const S& shortest) {
    const MaskOf<S> open = duration > S(0), lasts = duration > shortest;
    const S rate = select(lasts, S(S(1) / select(lasts, duration, S(1))), S(0));
    const auto keep = [&](const Last& old, const std::array<S, 3>& force) {
      Last kept{old.key, {}};
      for (std::size_t d = 0; d < 3; ++d) kept.force[d] = select(open, force[d], old.force[d]);
      if (next_.size() < next_.capacity()) next_.push_back(kept);
    };
    next_.clear();
    std::size_t at = 0;
    const auto keep_until = [&](long key) {
      for (; at < last_.size() && last_[at].key < key; ++at) {
        if (!all(open)) keep(last_[at], {S(0), S(0), S(0)});
      }
    };
    for (const Row& row : rows_) {
      keep_until(row.key);
      const auto& impulse = row.impulse();
      const bool known = at < last_.size() && last_[at].key == row.key;
      keep(known ? last_[at++] : Last{row.key, {S(0), S(0), S(0)}},
           {rate * impulse[0], rate * impulse[1], rate * impulse[2]});
    }
    keep_until(std::numeric_limits<long>::max());
    std::swap(last_, next_);
  }

  /// Changes the velocities in `motion` until no held point approaches; less `pull` (1/s) times its gap, so
  /// that gaps close and overlaps part. With `landing`, a point may come back as fast as it left: its gap
  /// over the time between is then none. Only in the lanes `where`.
  void relax(Motions& motion, const S& pull, const MaskOf<S>& where, bool landing) {
    // Friction comes second: what it answers before the normals agree only slows them down.
    sweep(motion, where, [&](Row& row, auto& point, auto& a, auto& b, const MaskOf<S>& active) {
      return point.relax_normal(target(row, pull, landing), active, a, b);
    });
    sweep(motion, where, [&](Row& row, auto& point, auto& a, auto& b, const MaskOf<S>& active) {
      return point.relax(target(row, pull, landing), row.friction, active, a, b);
    });
  }

 private:
  struct Row {
    Candidate who;
    long key;
    MaskOf<S> active;
    S gap, leaving, friction;
    ContactPoint<S, false> free;   ///< between two bodies
    ContactPoint<S, true> fixed;   ///< with a plane
    std::array<S, 3> before, way;  ///< impulse before a round, and the way it has gone, N s

    const std::array<S, 3>& impulse() const { return who.first < 0 ? fixed.impulse() : free.impulse(); }
  };
  struct Last {
    long key;
    std::array<S, 3> force;
  };

  static S target(const Row& row, const S& pull, bool landing) {
    return -pull * row.gap - (landing ? row.leaving : S(0));
  }
  /// Sweeps to and fro, each time going on along the way so far: nonlinear conjugate gradients over projected
  /// Gauss-Seidel (Silcowitz-Hansen, Niebe, Erleben 2010). Ends with a sweep, so that every law holds.
  template <class Relax>
  void sweep(Motions& motion, const MaskOf<S>& where, const Relax& relax) {
    constexpr int rounds = 100, patience = 12;
    const S enough = as<S>(0.3 * Constants<S>::touch);  // m/s
    MaskOf<S> working = where;
    S last_length(0), mark(std::numeric_limits<typename Constants<S>::Real>::max());
    for (Row& row : rows_) row.way = {S(0), S(0), S(0)};
    for (int round = 1; round <= rounds; ++round) {
      for (Row& row : rows_) row.before = row.impulse();
      S worst(0);
      for (const bool back : {false, true}) {
        for (std::size_t k = 0; k < rows_.size(); ++k) {
          Row& row = rows_[back ? rows_.size() - 1 - k : k];
          with(row, motion, [&](auto& point, auto& a, auto& b) {
            worst = maximum(worst, relax(row, point, a, b, row.active & working));
          });
        }
        if (!any(working & (worst > enough))) return;
      }
      working = working & (worst > enough);
      // Points whose targets do not agree push against one another for ever: what is left then stays.
      if (round % patience == 0) {
        working = working & (worst < as<S>(0.8) * mark);
        mark = worst;
      }
      if (!any(working) || round == rounds) return;
      S length(0);
      for (const Row& row : rows_) {
        for (std::size_t d = 0; d < 3; ++d) length += square(S(row.impulse()[d] - row.before[d]));
      }
      const MaskOf<S> onward = working & (length < last_length);
      const S share = select(onward, S(length / select(onward, last_length, S(1))), S(0));
      last_length = length;
      for (Row& row : rows_) {
        std::array<S, 3> further;
        for (std::size_t d = 0; d < 3; ++d) {
          further[d] = share * row.way[d];
          row.way[d] = further[d] + (row.impulse()[d] - row.before[d]);
        }
        with(row, motion, [&](auto& point, auto& a, auto& b) { point.add(further, a, b); });
      }
    }
  }

  /// Grows in the order in which pairs are found.
  long key(const Candidate& who, std::size_t point) const {
    const long major = who.first < 0 ? -1 - who.first : planes_ + who.first;
    return (major * System::bodies + who.second) * static_cast<long>(Pair::points) + static_cast<long>(point);
  }
  template <class F>
  static void with(Row& row, Motions& motion, const F& f) {
    Motion<S>& second = motion[static_cast<std::size_t>(row.who.second)];
    if (row.who.first < 0) {
      f(row.fixed, second, second);
    } else {
      f(row.free, motion[static_cast<std::size_t>(row.who.first)], second);
    }
  }

  long planes_;
  std::vector<Row> rows_;
  std::vector<Last> last_, next_;
};

}  // namespace rbres::detail
