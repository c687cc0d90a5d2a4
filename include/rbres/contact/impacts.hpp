#pragma once

#include <rbres/contact/contact_rows.hpp>
#include <rbres/contact/islands.hpp>
#include <rbres/core/reserved.hpp>

namespace rbres::RBRES_ABI::detail {

/// Resolves all impacts of one instant. Contacts that approach are answered together, island by island, each
/// with its restitution; those that approach because of that follow, and so on (generalized reflections:
/// Smith, Kaufman, Vouga, Tamstorf, Grinspun 2012). So a row of balls hands a blow on to its last one, and no
/// order of bodies is preferred. Plastic contacts and those that rest on them are answered at once.
template <class System>
class Impacts {
  using S = typename System::Scalar;
  using Pair = ContactPair<System>;
  using Motions = typename Pair::Motions;

 public:
  explicit Impacts(const System& system)
      : answered_(per_body<S>(system)),
        changed_(per_body<MaskOf<S>>(system)),
        used_(changed_),
        islands_(system),
        rows_(system) {
    info_.reserve(rows_.capacity());
    where_.reserve(rows_.capacity());
    hit_.reserve(most_part_pairs(system));
    touching_.reserve(most_part_pairs(system));
  }

  /// A new step of `bodies`: none has been hit yet.
  void start_step(const BodyIndices<System>& bodies) {
    for (const int i : bodies) answered_[std::size_t(i)] = S(0);
    rows_.start_step();
    unresolved_ = MaskOf<S>(false);
  }
  /// For how many impulses note() may have been called, whether or not anybody listens, since
  /// start_count().
  std::size_t noted() const { return noted_; }
  void start_count() { noted_ = 0; }
  /// Where impacts of this step went on without an end.
  const MaskOf<S>& unresolved() const { return unresolved_; }

  /// Changes the velocities in `motion` until no touching pair approaches faster than its rest speed. `pairs`
  /// know where they touch, and are of `bodies`. Returns the lanes in which there was an impact; `count`
  /// counts pairs. Calls note(who, normal, point, impulse) for each point that may have taken part (world
  /// frame, m and N s).
  template <class Note>
  MaskOf<S> resolve(const BodyIndices<System>& bodies, ContactPairs<System>& pairs, Motions& motion,
                    CountOf<S>& count, const Note& note) {
    MaskOf<S> changed(false);
    for (const int i : bodies) changed_[std::size_t(i)] = changed;
    touching_.clear();
    hit_.resize(pairs.size());
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      MaskOf<S> touches(false);
      for (const MaskOf<S>& point : pairs[k].touching) touches = touches | point;
      hit_[k] = {changed, changed, changed, touches, pairs[k].surface};
      if (any(touches)) touching_.push_back(k);
    }
    for (int pass = 0; pass < passes; ++pass) {
      if (!find_hits(pairs, motion, pass == passes - 1)) break;
      for (const std::size_t k : touching_) {
        const MaskOf<S>& hit = hit_[k].hit;
        if (!any(hit)) continue;
        changed = changed | hit;
        count += hit;
        for (const int i : {pairs[k].moved.first, pairs[k].moved.second}) {
          if (i >= 0) answered_[std::size_t(i)] += select(hit, S(1), S(0));
        }
      }
      for (std::size_t i = 0; i < islands_.count(); ++i) resolve_island(islands_[i], pairs, motion, note);
      if (pass == passes - 1) {
        for (const std::size_t k : touching_) unresolved_ = unresolved_ | hit_[k].hit;
      }
    }
    return changed;
  }

  /// Where the last call changed body i's velocities.
  const MaskOf<S>& changed(int i) const { return changed_[static_cast<std::size_t>(i)]; }

 private:
  /// A body that was hit so often in one step goes on without bounce: bounces that would have no end end.
  static constexpr int most_answers = 200;
  static constexpr int passes = most_answers + 50;
  struct Hit {
    MaskOf<S> hit;      ///< approaches faster than the rest speed
    MaskOf<S> plastic;  ///< does not bounce
    MaskOf<S> joins;    ///< is solved together with its neighbours
    MaskOf<S> touches;
    Surface<S> surface;
  };
  using Infos = Reserved<ImpactPoint<S>, row_room<System>>;
  struct IslandImpact {
    ContactRows<System>& rows;
    Infos& info;
    Motions& motion;
    S tolerance;

    template <class F>
    void each(const F& f) {
      std::size_t k = 0;
      rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
        f(info[k], point, first, second);
        row.active = info[k++].active;
      });
    }
    void solve(bool friction, const MaskOf<S>& where) {
      const MaskOf<S> normals = friction ? where & !rows.pairs_apart() : where;
      if (any(normals)) rows.solve(motion, normals, false, tolerance);
      if (friction) rows.solve(motion, where, true, tolerance);
    }
  };

  /// Finds the pairs that have an impact, and their islands. False where there is none.
  bool find_hits(const ContactPairs<System>& pairs, const Motions& motion, bool last) {
    MaskOf<S> none(false), found(false);
    for (const std::size_t k : touching_) {
      const Pair& pair = pairs[k];
      Hit& h = hit_[k];
      h.hit = none;
      h.surface = pair.surface;
      for (std::size_t i = 0; i < pair.manifold.used; ++i) {
        if (!any(pair.touching[i])) continue;
        const MaskOf<S> fast = pair.opening(pair.manifold, i, motion) < -pair.rest_speed;
        h.hit = h.hit | (pair.touching[i] & fast);
      }
      S answers = answered_[std::size_t(pair.moved.second)];
      if (pair.moved.first >= 0) answers = maximum(answers, answered_[std::size_t(pair.moved.first)]);
      const MaskOf<S> tired = answers > as<S>(double(last ? -1 : most_answers));
      h.surface.restitution = select(tired, S(0), h.surface.restitution);
      h.plastic = h.surface.restitution <= S(0);
      h.joins = h.hit | (h.touches & h.plastic);
      found = found | h.hit;
    }
    if (!any(found)) return false;

    for (const std::size_t k : touching_) {
      for (const int i : {pairs[k].moved.first, pairs[k].moved.second}) {
        if (i >= 0) used_[std::size_t(i)] = none;
      }
    }
    MaskOf<S> shared(false);
    islands_.clear();
    for (const std::size_t k : touching_) {
      if (!any(hit_[k].joins)) continue;
      islands_.add(k, pairs[k].moved.first, pairs[k].moved.second);
      for (const int i : {pairs[k].moved.first, pairs[k].moved.second}) {
        if (i < 0) continue;
        MaskOf<S>& u = used_[std::size_t(i)];
        const MaskOf<S>& joins = hit_[k].joins;
        shared = shared | (u & joins);
        u = u | joins;
      }
    }
    // Lanes disagree about islands: they solve all as one. Balls that share none need no more than their
    // closed form.
    shared_ = shared;
    islands_.group(Packed<S> && (!Pair::central || any(shared)));
    return true;
  }

  template <class Note>
  void resolve_island(std::span<const std::size_t> island, ContactPairs<System>& pairs, Motions& motion,
                      const Note& note) {
    using std::abs;
    MaskOf<S> hit(false);
    for (const std::size_t k : island) hit = hit | hit_[k].hit;
    if (!any(hit)) return;
    for (const std::size_t k : island) {
      for (const int i : {pairs[k].moved.first, pairs[k].moved.second}) {
        if (i < 0) continue;
        MaskOf<S>& changed = changed_[std::size_t(i)];
        changed = changed | (hit_[k].joins & hit);
      }
    }
    MaskOf<S> together(true);
    if constexpr (Pair::central) {
      together = Packed<S> ? shared_ : MaskOf<S>(island.size() > 1);
      if (!all(together)) {
        for (const std::size_t k : island) resolve_alone(pairs[k], hit_[k], !together, motion, note);
      }
    }
    if (!any(hit & together)) return;
    rows_.clear();
    info_.clear();
    where_.clear();
    S fastest(0);
    for (const std::size_t k : island) {
      const Pair& pair = pairs[k];
      const Hit& h = hit_[k];
      if (rows_.full()) {
        resolve_alone(pairs[k], h, together, motion, note);
        continue;
      }
      for (std::size_t i = 0; i < pair.manifold.used; ++i) {
        if (!any(pair.touching[i] & h.joins & together)) continue;
        ImpactPoint<S>& info = info_.emplace_back();
        if constexpr (!std::is_same_v<Note, Unheard>) where_.push_back(pair.manifold.point[i]);
        const S speed = pair.opening(pair.manifold, i, motion);
        const MaskOf<S> slow = speed <= select(h.plastic, pair.rest_speed, S(0));
        const MaskOf<S> bounces = speed < -pair.rest_speed;
        info.active = pair.touching[i] & h.joins & slow & together;
        info.approaches = speed <= S(0);
        info.target = select(bounces, S(-h.surface.restitution * speed), S(0));
        rows_.add(pair, pair.manifold, i, info.active, info.target, h.surface.friction, motion);
      }
    }
    noted_ += rows_.size();
    IslandImpact impact{rows_, info_, motion, S(0)};
    impact.each([&](ImpactPoint<S>& info, auto& point, auto& first, auto& second) {
      for (std::size_t d = 0; d < 3; ++d) {
        info.before[d] = point.velocity(d, first, second);
        fastest = maximum(fastest, select(info.active, S(abs(info.before[d])), S(0)));
      }
    });
    impact.tolerance = S(64) * S(Constants<S>::epsilon) * fastest;
    solve_impact<S>(impact, hit & together);
    if constexpr (!std::is_same_v<Note, Unheard>) {
      std::size_t at = 0;
      rows_.each(motion, [&](auto& row, auto& point, auto&, auto&) {
        note(row.who, point.direction(0), where_[at++], impulse_of(point));
      });
    }
  }

  template <class Note>
  void resolve_alone(const Pair& pair, const Hit& h, const MaskOf<S>& where, Motions& motion,
                     const Note& note) {
    noted_ += Pair::points;
    auto touching = pair.touching;
    for (auto& t : touching) t = t & where;
    const auto resolve = [&](auto fixed) {
      const auto note_pair = [&] {
        if constexpr (std::is_same_v<Note, Unheard>) {
          return note;
        } else {
          return [&](const Vec3<S>& point, const Vec3<S>& impulse) {
            note(pair.who, pair.manifold.normal, point, impulse);
          };
        }
      }();
      resolve_pair<decltype(fixed)::value>(pair.manifold, touching, h.surface, pair.rest_speed,
                                           pair.rest_speed, pair.first(motion), pair.second(motion),
                                           note_pair);
    };
    pair.plane() ? resolve(std::true_type{}) : resolve(std::false_type{});
  }

  PerBody<S, System::bodies> answered_;  ///< impacts of each body in this step
  PerBody<MaskOf<S>, System::bodies> changed_;
  PerBody<MaskOf<S>, System::bodies> used_;  ///< by a pair that has an impact
  MaskOf<S> unresolved_{false};
  std::size_t noted_ = 0;
  Islands<System> islands_;
  ContactRows<System> rows_;
  Infos info_;
  Reserved<Vec3<S>, row_room<System>> where_;  ///< they are, where somebody listens
  Reserved<Hit, pair_room<System>> hit_;
  Reserved<std::size_t, pair_room<System>> touching_;  ///< pairs
  MaskOf<S> shared_{false};                            ///< where two pairs that have an impact share a body
};

}  // namespace rbres::RBRES_ABI::detail
