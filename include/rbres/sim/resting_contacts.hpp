#pragma once

#include <rbres/contact/contact_memory.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/sim/held_flight.hpp>
#include <rbres/sim/island_energy.hpp>
#include <rbres/sim/part_end.hpp>
#include <rbres/sim/resting_islands.hpp>
#include <rbres/sim/resting_points.hpp>
#include <rbres/sim/resting_turn.hpp>
#include <rbres/sim/resting_work.hpp>

namespace rbres::RBRES_ABI::detail {

/// The contacts that rest, slide or roll over a part of a step, island by island: first they stop what still
/// approaches slowly, then constant forces hold the bodies over the part, and at its end impulses take away
/// what these forces, of second order, have left over.
template <class System>
class RestingContacts {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pair = ContactPair<System>;
  using Pairs = ContactPairs<System>;
  using Motions = typename Pair::Motions;
  using Bodies = BodyIndices<System>;
  static constexpr int most_rounds = 12;  ///< in which forces are found again for what they turn

 public:
  /// What the contacts do to each body.
  using Forces = PerBody<RestingForce<S>, System::bodies>;

  explicit RestingContacts(const System& system)
      : system_(&system),
        in_crowd_(is_crowd(system)),
        islands_(system),
        rows_(system),
        memory_(system, rows_.capacity()),
        energy_(system),
        forces_(per_body<RestingForce<S>>(system)),
        torqued_(per_body<MaskOf<S>>(system)),
        turns_(system),
        held_(system),
        end_(per_body<Motion<S>>(system)),
        unheld_(end_),
        flown_(state_of(system)),
        last_(flown_),
        at_end_(system) {}

  /// A state that did not come out of the last step owes nothing to it.
  void continue_from(const State& y) {
    MaskOf<S> same(true);
    const S *now = &y[0].position.x, *then = &last_[0].position.x;
    const std::size_t numbers = RigidState<S>::size * y.body.size();
    for (std::size_t k = 0; k < numbers; ++k) {
      const MaskOf<S> equal = now[k] == then[k];
      same = same & equal;
    }
    if (all(same)) return;
    memory_.forget_unless(same);
    for (int i = 0; i < system_->size(); ++i) held_.forget(i);
  }
  void end_step(const State& y) { last_ = y; }

  /// A new step of `bodies`.
  void start_step(const Bodies& bodies) {
    islands_.start_step(bodies);
    rows_.start_step();
  }
  /// Those that have been found.
  const RestingIslands<System>& islands() const { return islands_; }
  /// What is known of their forces.
  ContactMemory<System>& memory() { return memory_; }

  /// See RestingIslands::find().
  bool find(const Bodies& bodies, Pairs& pairs, const Motions& motion, const MaskOf<S>& running,
            const OnCourse<System>& course) {
    if (islands_.find(bodies, pairs, motion, running, course)) return true;
    for (const int i : islands_.others()) forces_[index(i)] = {};
    return false;
  }

  /// Slow approaches of resting points end at once, without bounce: changes the velocities in `motion`.
  /// Returns where there were any.
  MaskOf<S> stop_approaches(const Pairs& pairs, Motions& motion, const ClosingRate<S>& pull) {
    MaskOf<S> stopped(false);
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      if (islands_.keeps(pairs, island)) continue;
      MaskOf<S> slow(false);
      for (const std::size_t k : islands_[island]) {
        const Pair& pair = pairs[k];
        for (std::size_t i = 0; i < pair.manifold.used; ++i) {
          const S allowed = pair.still + pull.largest() * maximum(pair.manifold.gap[i], S(0));
          const MaskOf<S> approaches = pair.speed[i] < -allowed;
          slow = slow | (pair.resting[i] & approaches);
        }
      }
      if (!any(slow)) continue;
      stopped = stopped | slow;
      take_up(pairs, island, [&](std::size_t, const Pair& pair, std::size_t i) {
        const S target = minimum(closing_speed(pair, pair.manifold, i, pull), S(0));
        rows_.add(pair, pair.manifold, i, pair.resting[i], target, pair.surface.friction, motion);
      });
      correct(motion, slow, islands_.is_moving(pairs, island));
    }
    return stopped;
  }

  /// Changes the velocities at the end of `free` flight, for find_forces(), by what is known of it: see
  /// HeldFlight.
  void expect_held(const Motions& motion, State& free) {
    for (const int i : islands_.others()) {
      if (islands_.nearly_rests(i, motion)) {
        held_.expect(i, free[i]);
      } else {
        held_.forget(i);
      }
    }
  }
  /// The forces that find_forces() found have taken the bodies to `flown`. False where `free` was as it had
  /// to be for them, or where it is not worth it to find them again: in islands of a crowd that move, this
  /// is for the next part alone. `again`: see HeldFlight.
  bool learn_held(const Motions& motion, const State& flown, State& free, bool again) {
    bool news = false;
    for (const int i : islands_.others()) {
      if (!islands_.nearly_rests(i, motion)) continue;
      const Motion<S>&unheld = unheld_[index(i)], &end = end_[index(i)];
      const bool more = held_.learn(i, motion[index(i)], unheld, end, flown[i], free[i], again);
      news |= more && !islands_.moving().has_island_of(i);
    }
    return news;
  }

  /// Finds the constant forces with which no resting point approaches when `left` is over, where the bodies
  /// would then be at `free`. A point may come back as fast as it left: its gap over the time between is then
  /// none.
  void find_forces(const Pairs& pairs, const State& y, const Motions& motion, const State& free,
                   const S& left, const ClosingRate<S>& pull) {
    start_forces(y, motion, free);
    const MaskOf<S> open = left > S(0);
    const S rate = S(1) / select(open, left, S(1));
    // Forces over short parts make up for what is left of an impact: those before are nearer to the next.
    const MaskOf<S> lasts = left * pull.largest() > as<S>(0.01), keeps_forces = open & lasts;
    memory_.start();
    at_end_.room(pairs);
    turns_.start(islands_.others(), motion, left, pairs.size());
    for (const Pair& pair : pairs) {
      if (any(pair.any_resting) && islands_.kept().has(pair)) memory_.keep(pair);
    }
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      if (islands_.keeps(pairs, island)) continue;
      take_up_halfway(pairs, island, y, motion, left, pull);
      rows_.each(end_, [&](auto& row, auto& point, auto& first, auto& second) {
        std::array<S, 3> impulse = memory_.force(row);
        for (S& p : impulse) p = select(row.active, S(left * p), S(0));
        point.add(impulse, first, second);
      });
      solve_forces(pairs, island, y, free, left, open);
      rows_.each(end_, [&](auto& row, auto& point, auto&, auto&) {
        memory_.keep(row, rate, keeps_forces);
        if (row.moved.first < 0) return;
        if (row.way_halfway) {
          add_moving_force(row, point, *row.way_halfway, motion, rate, forces_);
        } else {
          add_paired_force(row, point, y, end_, rate, forces_);
        }
      });
    }
    memory_.finish(open);
    for (const int i : islands_.others()) {
      if (!any(islands_.moves(i))) continue;
      const Motion<S>&m = end_[index(i)], &b = unheld_[index(i)];
      const Mat3<S> axes = rotation_matrix(y[i].orientation);
      const Vec3<S> spin = axes.transposed_times(m.angular_velocity - b.angular_velocity);
      RestingForce<S>& contact = forces_[index(i)];
      contact.force = (rate * (*system_)[i].mass()) * (m.velocity - b.velocity);
      contact.torque += rate * (axes * scale((*system_)[i].inertia(), spin));
      turns_.turn(i, rate, contact);
    }
  }
  /// What find_forces() found.
  const Forces& forces() const { return forces_; }
  /// An impact has changed how body i moves while these act.
  void note_impact(int i, const RigidState<S>& before, const RigidState<S>& after) {
    const auto& body = (*system_)[i];
    if (islands_.kept().has(i))
      islands_.kept().strike(i, rotation_energy(body, after) - rotation_energy(body, before));
  }
  /// Other forces have this torque on body i while these act.
  void note_torque(int i, const Vec3<S>& torque) {
    const MaskOf<S> turns = squared_norm(torque) > S(0);
    torqued_[index(i)] = torqued_[index(i)] | turns;
  }

  /// See PartEnd::sunk(), of bodies that the contacts' forces have taken to `flown`.
  S sunk(const Pairs& pairs, const State& flown, const S& seconds, const MaskOf<S>& all, const S& sinking) {
    return at_end_.sunk(pairs, flown, seconds, all, sinking,
                        [&](const Pair& pair) { return islands_.moving().has(pair); });
  }

  /// Whether a resting pair would be too deep at `end`, where its forces take its bodies if no impact does.
  bool sinks(const Pair& pair, const State& end, const S& sinking) const {
    typename Pair::Contact contact;
    pair.find(*system_, end, contact);
    return any(at_end_.sunk(pair, contact, MaskOf<S>(true), sinking, islands_.moving().has(pair)) > S(1));
  }

  /// Chooses the islands that keep their forces after a part of so many seconds, for whose end, `flown`,
  /// sunk() was asked: where it `may` be, those that no impact there reaches.
  void keep_undisturbed(const Pairs& pairs, bool may, const State& flown, const S& seconds, const S& most) {
    const auto touches = [&](std::size_t k) { return at_end_.touches(pairs, k, flown, seconds); };
    islands_.keep_undisturbed(pairs, may, touches, seconds, most);
  }

  /// Changes the velocities of `end`, for which sunk() was asked, in islands that do not keep their forces,
  /// so that no resting point approaches, and contacts have done no work that they cannot do from y on, in
  /// `part` seconds. `bodies`: those that keep_undisturbed() has left.
  void correct_velocities(const Bodies& bodies, const Pairs& pairs, const State& y, State& end, const S& part,
                          const ClosingRate<S>& pull) {
    for (const int i : islands_.all()) flown_[i] = end[i];
    set_motions(*system_, bodies, end, end_);
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      if (islands_.keeps(pairs, island)) continue;
      rows_.clear();
      for (const std::size_t k : islands_[island]) {
        const Pair& pair = pairs[k];
        const typename Pair::Contact& at_end = at_end_.find(pairs, k, flown_);
        if (rows_.full()) continue;
        for (std::size_t i = 0; i < at_end.used; ++i) {
          const MaskOf<S> near = at_end.gap[i] <= pair.near;  // points may have changed places
          const MaskOf<S> resting = pair.fixed_points() ? pair.resting[i] : pair.any_resting & near;
          if (any(resting))
            rows_.add(pair, at_end, i, resting, closing_speed(pair, at_end, i, pull), pair.surface.friction,
                      end_);
        }
      }
      const MaskOf<S> every(true);
      correct(end_, every, islands_.is_moving(pairs, island));
    }
    take_velocities(
        bodies, [&](int i) { return islands_.moves(i); }, end, end_);
    const KeptIslands<System>& kept = islands_.kept();
    for (std::size_t island = 0; island < islands_.count(); ++island) {
      if (islands_.keeps(pairs, island)) continue;
      const S seconds = kept.age(pairs[islands_[island].front()].moved.second, part);
      energy_.bound(*system_, pairs, islands_[island], at_end_.contacts(), islands_.rests(),
                    {kept.start(y), flown_, forces_, torqued_, seconds, kept}, end);
    }
    islands_.kept().end_part(islands_.all(), pairs, part);
  }

  /// See PartEnd::note_manifolds().
  void note_manifolds(Pairs& pairs, const State& y) const { at_end_.note_manifolds(pairs, flown_, y); }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  /// Takes away what approaches in the rows of an island: coarsely where forces that are found next take up
  /// what is left.
  void correct(Motions& motion, const MaskOf<S>& where, bool moving) {
    if (islands_.within_step()) {
      rows_.sweep_within_step(motion, where);
    } else if (moving) {
      rows_.correct_moving(motion, where);
    } else {
      rows_.solve(motion, where);
    }
  }

  /// Bodies that do not keep their forces have none yet: they end a part as they do in `free` flight.
  void start_forces(const State& y, const Motions& motion, const State& free) {
    for (const int i : islands_.others()) {
      if (islands_.kept().has(i)) continue;
      islands_.kept().start(i, y);
      end_[index(i)] = motion[index(i)];
      end_[index(i)].velocity = free[i].velocity;
      end_[index(i)].angular_velocity = free[i].angular_velocity_world();
      unheld_[index(i)] = end_[index(i)];
      forces_[index(i)] = {};
      torqued_[index(i)] = MaskOf<S>(false);
    }
  }
  /// Takes up the resting points of an island where they are when half of a part is over.
  void take_up_halfway(const Pairs& pairs, std::size_t island, const State& y, const Motions& motion,
                       const S& left, const ClosingRate<S>& pull) {
    auto& halfway = at_end_.contacts();
    turns_.find_halfway(*system_, pairs, islands_[island], y, motion, left, halfway);
    take_up(pairs, island, [&](std::size_t k, const Pair& pair, std::size_t i) {
      const S leaves = closing_speed(pair, pair.manifold, i, pull);
      const auto add = [&](const typename Pair::Contact& there, const S& speed, Motions& bodies) -> auto& {
        const S target = leaves - speed;
        return rows_.add(pair, there, i, pair.resting[i], target, pair.surface.friction, bodies);
      };
      if (!turns_.moves(k)) {
        add(pair.manifold, pair.speed[i], end_);
        return;
      }
      const Vec3<S> way = halfway[k].point[i] - pair.manifold.point[i];
      if (pair.plane()) {
        const Vec3<S> drift = cross(motion[index(pair.who.second)].angular_velocity, way);
        add(halfway[k], pair.speed[i], end_).set_drift(drift);
      } else {
        add(halfway[k], pair.opening(halfway[k], i, turns_.motion()), turns_.motion()).way_halfway = way;
      }
    });
  }
  /// Solves the rows of an island in the lanes `open`, and again while forces turn its bodies.
  void solve_forces(const Pairs& pairs, std::size_t island, const State& y, const State& free, const S& left,
                    const MaskOf<S>& open) {
    const bool moving = islands_.is_moving(pairs, island);
    const auto foresee = [&](const MaskOf<S>& where, bool guess) {
      return turns_.foresee(*system_, pairs, islands_[island], y, free, left, where, guess, unheld_, end_);
    };
    const auto solve = [&](const MaskOf<S>& where) {
      islands_.within_step() ? rows_.solve_within_step(end_, where) : rows_.solve(end_, where, moving);
    };
    foresee(open, true);
    solve(open);
    // A crowd is solved from the forces of the step before, which are near enough. Others owe nothing to
    // them but where they start.
    MaskOf<S> news = in_crowd_ ? MaskOf<S>(false) : open;
    for (int round = 0; round < most_rounds && any(news); ++round) {
      news = foresee(news, false);
      if (any(news)) solve(news);
    }
  }

  /// Takes up the resting points i of an island by add(k, pair k, i).
  template <class Add>
  void take_up(const Pairs& pairs, std::size_t island, const Add& add) {
    rows_.clear();
    for (const std::size_t k : islands_[island]) {
      const Pair& pair = pairs[k];
      if (rows_.full()) return;  // points that find no room bounce when they have sunk in
      for (std::size_t i = 0; i < pair.manifold.used; ++i) {
        if (any(pair.resting[i])) add(k, pair, i);
      }
    }
  }

  const System* system_;
  bool in_crowd_;
  RestingIslands<System> islands_;
  ContactRows<System> rows_;
  ContactMemory<System> memory_;
  IslandEnergy<System> energy_;
  Forces forces_;
  PerBody<MaskOf<S>, System::bodies> torqued_;  ///< whether other forces turn it
  RestingTurns<System> turns_;
  HeldFlight<System> held_;
  Motions end_;             ///< at the end of a part
  Motions unheld_;          ///< the same without the contacts' forces
  State flown_;             ///< where these forces have taken the bodies
  State last_;              ///< where the last step ended
  PartEnd<System> at_end_;  ///< while forces are found, halfway
};

}  // namespace rbres::RBRES_ABI::detail
