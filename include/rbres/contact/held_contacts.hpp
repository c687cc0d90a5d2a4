#pragma once

#include <rbres/contact/contact_pair.hpp>
#include <vector>

namespace rbres::detail {

/// The contacts that rest, slide or roll, and the impulses that hold them: projected Gauss-Seidel over all of
/// their points, to and fro. It starts from the forces of the step before, so that a stack at rest takes a
/// sweep or two.
template <class System>
class HeldContacts {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  using Motions = typename Pair::Motions;

 public:
  explicit HeldContacts(const System& system) : planes_(static_cast<long>(system.planes().size())) {
    // More than 6 N pairs of bodies do not touch at once unless they overlap.
    const std::size_t N = System::bodies;
    const std::size_t most = Pair::points * (std::min(N * (N - 1) / 2, 6 * N) + N * system.planes().size());
    rows_.reserve(most);
    last_.reserve(most);
  }

  bool empty() const { return rows_.empty(); }
  void clear() { rows_.clear(); }
  /// Forgets the forces of the step before, except in the lanes where `same` holds.
  void forget_unless(const MaskOf<S>& same) {
    for (Last& last : last_) {
      for (S& force : last.force) force = select(same, force, S(0));
    }
  }

  /// Takes up the held points of a pair.
  void add(const Pair& pair, Motions& motion) {
    for (std::size_t i = 0; i < Pair::points; ++i) {
      if (!any(pair.held[i])) continue;
      Row row;
      row.who = pair.who;
      row.key = key(pair.who, i);
      row.active = pair.held[i];
      row.gap = pair.manifold.gap[i];
      row.leaving = maximum(pair.speed[i], S(0));
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
      with(row, motion, [&](auto& point, auto& a, auto& b) { point.start(impulse, a, b); });
    }
  }
  /// Keeps the forces for the next step; those over less than `shortest` (s) are rounding, and dropped.
  void remember(const S& duration, const S& shortest) {
    const MaskOf<S> lasts = duration > shortest;
    const S rate = select(lasts, S(S(1) / select(lasts, duration, S(1))), S(0));
    last_.clear();
    for (const Row& row : rows_) {
      const auto& impulse = row.who.first < 0 ? row.fixed.impulse() : row.free.impulse();
      last_.push_back({row.key, {rate * impulse[0], rate * impulse[1], rate * impulse[2]}});
    }
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
    ContactPoint<S, false> free;  ///< between two bodies
    ContactPoint<S, true> fixed;  ///< with a plane
  };
  struct Last {
    long key;
    std::array<S, 3> force;
  };

  static S target(const Row& row, const S& pull, bool landing) {
    return -pull * row.gap - (landing ? row.leaving : S(0));
  }
  template <class Relax>
  void sweep(Motions& motion, const MaskOf<S>& where, const Relax& relax) {
    constexpr int sweeps = 200;
    const S enough = as<S>(Constants<S>::touch / 10);  // m/s
    MaskOf<S> working = where;
    for (int sweep = 0; sweep < sweeps && any(working); ++sweep) {
      S worst(0);
      for (std::size_t k = 0; k < rows_.size(); ++k) {
        Row& row = rows_[sweep % 2 == 0 ? k : rows_.size() - 1 - k];
        with(row, motion, [&](auto& point, auto& a, auto& b) {
          worst = maximum(worst, relax(row, point, a, b, row.active & working));
        });
      }
      working = working & (worst > enough);
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
  std::vector<Last> last_;
};

}  // namespace rbres::detail
