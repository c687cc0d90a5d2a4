#pragma once

#include <limits>
#include <rbres/contact/broad_phase.hpp>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/reserved.hpp>
#include <rbres/sim/contact_tally.hpp>
#include <rbres/sim/discrete_overlap.hpp>
#include <span>
#include <tuple>

namespace rbres::RBRES_ABI::detail {

/// The bodies and planes of a system, and their states, whatever their number: what is done to a pair is
/// compiled once for all of them.
template <class S, class Shape_>
class BodiesOfAnyNumber {
 public:
  using Scalar = S;
  using Shape = Shape_;
  class State {
   public:
    template <int N>
    explicit State(SystemState<S, N>& y) : body_(y.body.data()) {}
    RigidState<S>& operator[](int i) const { return body_[i]; }

   private:
    RigidState<S>* body_;
  };

  template <class System>
  explicit BodiesOfAnyNumber(const System& system) : body_(&system[0]), planes_(system.planes()) {}
  const Body<S, Shape>& operator[](int i) const { return body_[i]; }
  std::span<const Plane<S>> planes() const { return planes_; }

 private:
  const Body<S, Shape>* body_;
  std::span<const Plane<S>> planes_;
};

/// Calls f(manifold, is_plane) with how a pair meets: two parts, or a plane and all parts of a body at once.
template <class System, class F>
void with_discrete_manifold(const System& system, const typename System::State& y, int first, int second,
                            const PartPairOf<System>& parts, const F& f) {
  if constexpr (PartPairOf<System>::compound) {
    if (first < 0) {
      const auto& plane = system.planes()[static_cast<std::size_t>(-1 - first)];
      f(detect(plane, system[second].shape(), shape_pose(system[second], y[second])), std::true_type{});
      return;
    }
  }
  with_part_manifold(system, y, first, second, parts, f);
}

/// One pair at the end of a step, in the lanes `where`: impulse where it overlaps and approaches, and the
/// overlap taken away along the normal, shared by inverse mass. What the step's forces alone can have given
/// in two steps is rest, not approach. What the move costs against the forces is taken out of the motion.
template <class System>
void resolve_overlap(const System& system, std::span<const Gain<typename System::Scalar>> gained,
                     typename System::State& y, int first, int second, const PartPairOf<System>& parts,
                     const typename System::Scalar& rest, const MaskOf<typename System::Scalar>& where,
                     ContactTally<typename System::Scalar>& tally) {
  using S = typename System::Scalar;
  with_discrete_manifold(system, y, first, second, parts, [&](auto manifold, auto is_plane) {
    constexpr bool fixed = decltype(is_plane)::value;
    constexpr std::size_t points = std::decay_t<decltype(manifold)>::points;
    std::array<MaskOf<S>, points> touching;
    MaskOf<S> overlaps(false);
    S depth(0);
    for (std::size_t i = 0; i < points; ++i) {
      touching[i] = where & (manifold.gap[i] < S(0));
      overlaps = overlaps | touching[i];
      depth = maximum(depth, S(-manifold.gap[i]));
    }
    if (!any(overlaps)) return;
    if (meets_covered(system, y, {first, second}, parts, manifold, S(0))) return;
    if constexpr (Packed<S>) gather(manifold, touching);
    tally.touching += overlaps;

    Motion<S> b = motion_of(system[second], y[second]);
    Motion<S> a = [&] {
      if constexpr (fixed) {
        return Motion<S>{};
      } else {
        return motion_of(system[first], y[first]);
      }
    }();
    const auto gain = [&](int i) -> const Gain<S>& { return gained[static_cast<std::size_t>(i)]; };
    Vec3<S> change = gain(second).velocity;
    S energy = kinetic_energy(system[second], y[second]) + gain(second).lost;
    S share(0), size = system[second].bounding_radius();
    if constexpr (!fixed) {
      change -= gain(first).velocity;
      energy += kinetic_energy(system[first], y[first]) + gain(first).lost;
      share = a.inverse_mass / (a.inverse_mass + b.inverse_mass);
      size = minimum(size, system[first].bounding_radius());
    }
    const S rest_speed = rest * speed_scale(size);
    const S fallen = maximum(S(S(-2) * dot(manifold.normal, change)), S(0));
    const MaskOf<S> hit = resolve_impact<fixed>(manifold, touching, surface_of(system, first, second),
                                                maximum(rest_speed, fallen), S(0), a, b);
    tally.impacts += hit;
    const S out = select(overlaps, depth, S(0));
    const Vec3<S> shift = out * manifold.normal;
    if constexpr (!fixed) {
      for (const auto& [partner, i, normal, motion] : {std::tuple(first, second, manifold.normal, &b),
                                                       std::tuple(second, first, -manifold.normal, &a)}) {
        if (!system[partner].is_kinematic()) continue;
        resolve_kinematic(y[partner], system[i], normal, out, gain(i), hit, *motion, y[i]);
        return;
      }
    }
    set_velocities_where(hit, y[second], b);
    S cost = (share - S(1)) * system[second].mass() * dot(gain(second).acceleration, shift);
    if constexpr (fixed) {
      push_out(system[second], manifold.normal, out, cost, energy, y[second]);
    } else {
      set_velocities_where(hit, y[first], a);
      cost += share * system[first].mass() * dot(gain(first).acceleration, shift);
      const S excess =
          kinetic_energy(system[first], y[first]) + kinetic_energy(system[second], y[second]) - energy + cost;
      y[first].position -= share * shift;
      y[second].position += (S(1) - share) * shift;
      a.position = y[first].position;
      b.position = y[second].position;
      restore_angular_momentum(shift, overlaps, maximum(excess, S(0)), a, b);
      set_velocities_where(overlaps, y[first], a);
      set_velocities_where(overlaps, y[second], b);
    }
  });
}
/// The same in one piece, which is faster and takes long to compile: for programs without assertions, and not
/// for dual numbers, with which g++ 12 fails on it.
template <class System>
#ifdef NDEBUG
[[gnu::noinline, gnu::flatten]]
#endif
void resolve_overlap_flat(const System& system, std::span<const Gain<typename System::Scalar>> gained,
                          typename System::State& y, int first, int second, const PartPairOf<System>& parts,
                          const typename System::Scalar& rest, const MaskOf<typename System::Scalar>& where,
                          ContactTally<typename System::Scalar>& tally) {
  resolve_overlap(system, gained, y, first, second, parts, rest, where, tally);
}

/// All contacts at the end of a step of h (s) from `before` to y, each pair once. Pairs that share a body are
/// taken deepest first, lane by lane, so that no numbering of bodies and no neighbour in another lane
/// matters, but for pairs of exactly one depth: of these the first in the list is taken first.
template <class System>
class DiscreteContact {
  using S = typename System::Scalar;
  using State = typename System::State;

 public:
  explicit DiscreteContact(const System& system)
      : system_(&system), broad_(system.planes().size(), system.size()), reach_(per_body<S>(system)) {
    for (int i = 0; i < system.size(); ++i) reach_[static_cast<std::size_t>(i)] = system[i].bounding_radius();
    const auto n = static_cast<std::size_t>(system.size());
    pairs_.reserve(most_part_pairs(system));
    used_.reserve(n);
    gained_.reserve(n);
  }

  void resolve(const State& before, State& y, const S& h, const S& rest_speed, ContactTally<S>& tally) {
    find_pairs(y);
    if (pairs_.empty()) return;
    gained_.clear();
    const S rate = S(1) / select(h > S(0), h, S(1));
    for (int i = 0; i < system_->size(); ++i) {
      const Vec3<S> gained = y[i].velocity - before[i].velocity;
      const Vec3<S> mean = rate * (y[i].position - before[i].position);
      const S lost = dot(gained, mean - as<S>(0.5) * (y[i].velocity + before[i].velocity));
      gained_.push_back({gained, rate * gained, maximum(S((*system_)[i].mass() * lost), S(0))});
    }
    using Any = BodiesOfAnyNumber<S, typename System::Shape>;
    const Any system(*system_);
    typename Any::State states(y);
    const auto resolve_pair = [&](const Pair& pair, const MaskOf<S>& where) {
      if constexpr (std::is_floating_point_v<typename ScalarTraits<S>::Value>) {
        resolve_overlap_flat(system, gained_, states, pair.first, pair.second, pair.parts, rest_speed, where,
                             tally);
      } else {
        resolve_overlap(system, gained_, states, pair.first, pair.second, pair.parts, rest_speed, where,
                        tally);
      }
    };
    if (!any(shared_)) {
      for (const Pair& pair : pairs_) resolve_pair(pair, pair.open);
      return;
    }
    for (Pair& pair : pairs_) {
      with_discrete_manifold(*system_, y, pair.first, pair.second, pair.parts, [&](const auto& m, auto) {
        pair.depth = S(-m.gap[0]);
        for (std::size_t i = 1; i < std::decay_t<decltype(m)>::points; ++i)
          pair.depth = maximum(pair.depth, S(-m.gap[i]));
      });
    }
    // The deepest first. Those that are apart count, too: others may push them into one another.
    if constexpr (!Packed<S>) {
      const auto order = [](const Pair& pair) {
        return std::pair(is_finite(pair.depth) ? S(-pair.depth) : S(0), pair.place);
      };
      std::sort(pairs_.begin(), pairs_.end(),
                [&](const Pair& a, const Pair& b) { return order(a) < order(b); });
      for (const Pair& pair : pairs_) resolve_pair(pair, pair.open);
      return;
    }
    // In each round every lane takes the deepest of the pairs that it has left.
    for (std::size_t round = 0; round < pairs_.size(); ++round) {
      S deepest(std::numeric_limits<typename Constants<S>::Real>::lowest());
      for (const Pair& pair : pairs_) deepest = select(pair.open, maximum(deepest, pair.depth), deepest);
      MaskOf<S> free(true);
      for (Pair& pair : pairs_) {
        const MaskOf<S> turn = free & pair.open & (pair.depth >= deepest);
        if (!any(turn)) continue;
        free = free & !turn;
        pair.open = pair.open & !turn;
        resolve_pair(pair, turn);
      }
    }
  }

 private:
  struct Pair {
    int first, second;  ///< as in Candidate
    std::size_t place;  ///< in the list
    S depth;            ///< at the end of the step, m; negative: apart
    MaskOf<S> open;     ///< near each other when the pairs were found, and not yet taken
    [[no_unique_address]] PartPairOf<System> parts;
  };

  /// Whether a pair has the body already. A type of its own, because a vector of bool gives no references.
  struct Used {
    MaskOf<S> yes;
  };

  /// The pairs whose bounding balls overlap; and where two of them share a body.
  void find_pairs(const State& y) {
    const System& system = *system_;
    used_.assign(static_cast<std::size_t>(system.size()), {MaskOf<S>(false)});
    shared_ = MaskOf<S>(false);
    pairs_.clear();
    const auto add_parts = [&](const Candidate& who, const MaskOf<S>& near, const PartPairOf<System>& parts) {
      pairs_.push_back({who.first, who.second, pairs_.size(), S(0), near, parts});
      for (const int i : {who.first, who.second}) {
        if (i < 0) continue;
        MaskOf<S>& u = used_[static_cast<std::size_t>(i)].yes;
        shared_ = shared_ | (u & near);
        u = u | near;
      }
    };
    const auto add = [&](const Candidate& who, const MaskOf<S>& near) {
      if constexpr (PartPairOf<System>::compound) {
        if (who.first >= 0) {
          each_near_part(
              system, y, who, [](int) { return S(0); },
              [&](const auto& parts) { add_parts(who, near, parts); });
          return;
        }
      }
      add_parts(who, near, {});
    };
    if constexpr (Broad::sweeps) {
      for (const Candidate& who : broad_.find(system, y, reach_)) add(who, MaskOf<S>(true));
    } else {
      const auto reach = [&](int i) -> const S& { return reach_[static_cast<std::size_t>(i)]; };
      for (const auto& [who, near] : near_pairs(system, y, reach)) add(who, near);
    }
  }

  using Broad = BroadPhase<S, System::bodies, System::most_planes>;

  const System* system_;
  Broad broad_;
  PerBody<S, System::bodies> reach_;  ///< bounding radii, m
  Reserved<Pair, pair_room<System>> pairs_;
  Reserved<Gain<S>, body_room<System>> gained_;
  Reserved<Used, body_room<System>> used_;
  MaskOf<S> shared_{false};
};

}  // namespace rbres::RBRES_ABI::detail
