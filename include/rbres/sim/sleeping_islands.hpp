#pragma once

#include <algorithm>
#include <cmath>
#include <rbres/contact/contact_memory.hpp>
#include <rbres/contact/islands.hpp>
#include <rbres/contact/pair_search.hpp>
#include <rbres/core/reserved.hpp>
#include <span>
#include <type_traits>

namespace rbres::RBRES_ABI::detail {

/// The islands that sleep: bodies that rest on one another, on planes or on still kinematic bodies, and whose
/// velocities have been rounding for some time. A step leaves them as they are while nothing changes: their
/// states and where the forces would take them without contacts, to the bit; what they rest on; and what
/// comes near. To the solver's tolerance that is where it would take them. Plain doubles alone sleep: lanes
/// would have to agree, dual numbers have derivatives that change, and float's rounding hides slow starts.
template <class System>
class SleepingIslands {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pairs = ContactPairs<System>;
  using Bodies = BodyIndices<System>;

 public:
  static constexpr bool possible = std::is_same_v<S, double>;

  explicit SleepingIslands(const System& system) : system_(&system), data_(system) {}

  /// Whether body i sleeps.
  bool has(int i) const {
    if constexpr (possible) return data_.island[index(i)] >= 0;
    return false;
  }
  /// Whether nothing moves body i but what wakes it.
  bool stays_put(int i, const State& y) const {
    if constexpr (possible) return has(i) || is_still(i, y);
    return false;
  }
  /// Whether any body sleeps, or is about to.
  bool any() const {
    if constexpr (possible) return data_.sleepers > 0 || data_.drowsy;
    return false;
  }
  /// Whether a step changes no body.
  bool all_sleep(const State& y) const {
    if constexpr (possible) {
      if (data_.sleepers == 0) return false;
      for (int i = 0; i < system_->size(); ++i) {
        if (!has(i) && !is_still(i, y)) return false;
      }
      return true;
    }
    return false;
  }

  /// A step from y, whose end without contacts would be `free`. Wakes islands of which something has changed.
  void start_step(const State& y, const State& free) {
    if constexpr (possible) {
      data_.free = free;
      for (int i = 0; i < system_->size(); ++i) {
        const bool same = y[i] == data_.base[i];
        if (!same) data_.lies_down[index(i)] = false;
        if (has(i) && !(same && free[i] == data_.resting_free[i])) wake(i);
      }
      for (std::size_t k = 0; k < data_.supports.size();) {
        const auto [kinematic, body] = data_.supports[k];
        if (y[kinematic] == data_.base[kinematic]) {
          ++k;
        } else {
          wake(body);  // which takes its supports off the list
          k = 0;
        }
      }
      for (int i = 0; i < system_->size(); ++i) {
        if (!(*system_)[i].is_kinematic()) continue;
        data_.moved[index(i)] = !(y[i] == data_.base[i]);
        data_.base[i] = y[i];
      }
    }
  }
  /// Whether a body woke up since start_groups().
  bool woke() const {
    if constexpr (possible) return data_.sleepers != data_.slept;
    return false;
  }
  void start_groups() {
    if constexpr (possible) data_.slept = data_.sleepers;
  }
  /// The step's rests are collected anew.
  void forget_rests() {
    if constexpr (possible) data_.rests.clear();
  }

  /// Keeps sleeping bodies where they are in y, however `end` has moved them.
  void hold(const Bodies& bodies, const State& y, State& end) const {
    if constexpr (possible) {
      if (data_.sleepers == 0) return;
      for (const int i : bodies) {
        if (has(i)) end[i] = y[i];
      }
    }
  }

  /// Takes pairs of sleeping bodies out of those that may touch within `time` s from y, on these `ways` (m)
  /// to `free`, but for those with a body that may reach one. False, with its island awake, where that is
  /// near already: then the pairs are to be found again.
  template <class Ways>
  bool sift(const State& y, const State& free, const Ways& ways, const S& time, Pairs& pairs) {
    if constexpr (possible) {
      if (data_.sleepers == 0) return true;
      bool as_they_were = true;
      std::size_t left = 0;
      for (std::size_t k = 0; k < pairs.size(); ++k) {
        ContactPair<System>& pair = pairs[k];
        const auto [first, second] = pair.who;
        if (has_one_of(pair.who)) {
          if (first < 0 || (stays_put(first, y) && stays_put(second, y))) continue;
          pair.know_manifold(*system_, y);
          const S gap = pair.manifold.separation;
          if (gap <= pair.near) {
            wake(pair.who);
            as_they_were = false;
          } else if (gap > pair.near + reach(has(first) ? second : first, y, free, ways, time)) {
            continue;
          }
        }
        if (left != k) pairs[left] = pairs[k];
        ++left;
      }
      pairs.resize(left);
      return as_they_were;
    }
    return true;
  }
  /// Whether a body would hit a sleeping one within `time` (s), as ContactPair::impact says: then that wakes,
  /// and the part is to be found again.
  bool disturbed(const Pairs& pairs, const S& time) {
    if constexpr (possible) {
      if (data_.sleepers == 0) return false;
      bool woke = false;
      for (const auto& pair : pairs) {
        if (!(pair.impact < time) || !has_one_of(pair.who)) continue;
        wake(pair.who);
        woke = true;
      }
      return woke;
    }
    return false;
  }

  /// Notes the pairs that rest where a part of the step ends.
  void collect(const Pairs& pairs) {
    if constexpr (possible) {
      for (const auto& pair : pairs) {
        if (pair.any_resting && data_.rests.size() < data_.rests.capacity())
          data_.rests.push_back({pair.who, pair.moved});
      }
    }
  }

  /// Ends a step of so many seconds at y: islands that have been quiet for long enough fall asleep, and lose
  /// velocities that are rounding. `memory` lays their forces by.
  void end_step(State& y, const S& seconds, ContactMemory<System>& memory) {
    if constexpr (possible) {
      const bool was_drowsy = data_.drowsy;
      data_.drowsy = false;
      if (!data_.rests.empty()) find_sleepers(y, seconds, memory);
      if (!was_drowsy) return;
      for (int i = 0; i < system_->size(); ++i) {
        bool& lies = data_.lies_down[index(i)];
        lies = lies && y[i] == data_.base[i];
        data_.drowsy |= lies;
      }
    }
  }

 private:
  /// Puts the islands to sleep, or has them lie down, that have been quiet for long enough.
  void find_sleepers(State& y, const S& seconds, ContactMemory<System>& memory) {
    auto& islands = data_.islands;
    islands.clear();
    for (std::size_t k = 0; k < data_.rests.size(); ++k) {
      const Rest& rest = data_.rests[k];
      islands.add(k, rest.moved.first, rest.moved.second);
      for (const int i : {rest.moved.first, rest.moved.second}) {
        if (i >= 0) data_.counted[index(i)] = false;
      }
    }
    islands.group(false);
    bool slept = false;
    for (std::size_t k = 0; k < islands.count(); ++k) slept |= end_step_of(islands[k], y, seconds);
    if (slept) memory.lay_by([&](int i) { return has(i); });
  }
  struct Rest {
    Candidate who, moved;
  };
  /// A kinematic body on which a body of a sleeping island lies.
  struct Support {
    int kinematic, body;
  };
  struct Data {
    explicit Data(const System& system)
        : island(per_body<int>(system)),
          lies_down(per_body<bool>(system)),
          counted(lies_down),
          moved(lies_down),
          quiet(per_body<S>(system)),
          base(state_of(system)),
          free(base),
          resting_free(base),
          islands(system) {
      island.fill(-1);
      lies_down.fill(false);
      moved.fill(false);
      quiet.fill(S(0));
      rests.reserve(most_part_pairs(system));
      supports.reserve(most_part_pairs(system));
    }
    PerBody<int, System::bodies> island;      ///< the number of one of its bodies; -1: awake
    PerBody<bool, System::bodies> lies_down;  ///< whether it sleeps after one step more without a change
    PerBody<bool, System::bodies> counted;    ///< in this step
    PerBody<bool, System::bodies> moved;      ///< kinematic bodies, since the last step, by the program
    PerBody<S, System::bodies> quiet;         ///< for how long its velocities have been rounding, s
    State base;                               ///< where bodies sleep, and lie down
    State free, resting_free;  ///< where free flight takes them: in this step, and in which they fell asleep
    int sleepers = 0;          ///< bodies that sleep
    int slept = 0;             ///< that slept when the groups of a step were found
    bool drowsy = false;       ///< whether any lies down
    Islands<System> islands;
    Reserved<Rest, pair_room<System>> rests;
    Reserved<Support, pair_room<System>> supports;
  };
  struct NoData {
    explicit NoData(const System&) {}
  };

  static std::size_t index(int i) { return static_cast<std::size_t>(i); }
  bool is_still(int i, const State& y) const {
    return (*system_)[i].is_kinematic() && !data_.moved[index(i)] && y[i].velocity == Vec3<S>{} &&
           y[i].angular_velocity == Vec3<S>{};
  }
  bool has_one_of(const Candidate& who) const {
    return (who.first >= 0 && has(who.first)) || has(who.second);
  }
  /// The kinematic body of a pair that has one.
  static int kinematic_of(const Candidate& who, const Candidate& moved) {
    return moved.second == who.first ? who.second : who.first;
  }
  void wake(int body) {
    const int island = data_.island[index(body)];
    if (island < 0) return;
    for (int i = 0; i < system_->size(); ++i) {
      if (data_.island[index(i)] != island) continue;
      data_.island[index(i)] = -1;
      data_.quiet[index(i)] = S(0);
      --data_.sleepers;
    }
    remove_where(data_.supports, [&](const Support& s) { return !has(s.body); });
  }
  /// Wakes the islands of a pair.
  void wake(const Candidate& who) {
    if (who.first >= 0) wake(who.first);
    wake(who.second);
  }
  /// How far a point of body i may get within `time`, m.
  template <class Ways>
  S reach(int i, const State& y, const State& free, const Ways& ways, const S& time) const {
    return ways[index(i)] + turn_of(y[i], free[i], time) * (*system_)[i].bounding_radius();
  }

  /// Whether a body that has lain down is where it was, but for `little` (m) and rounding: an overlap may
  /// open without a velocity.
  bool stays(int i, const State& y, const S& size, const S& little) const {
    const RigidState<S>& from = data_.base[i];
    const Quat<S>&p = from.orientation, &q = y[i].orientation;
    const S turn = norm(Vec3<S>{q.x - p.x, q.y - p.y, q.z - p.z}) + std::abs(q.w - p.w);
    const S rounding = S(16) * S(Constants<S>::epsilon) * (size + norm(from.position));
    return norm(y[i].position - from.position) + S(2) * size * turn <= little + rounding;
  }
  /// The same for one island of resting pairs. True where it falls asleep.
  bool end_step_of(std::span<const std::size_t> island, State& y, const S& seconds) {
    bool quiet = true, lay = true;
    const auto each = [&](const auto& f) {
      for (const std::size_t k : island) {
        if (data_.rests[k].moved.first >= 0) f(data_.rests[k].moved.first);
        f(data_.rests[k].moved.second);
      }
    };
    // Heaps are solved coarser, and what spins in them goes on for ever.
    constexpr std::size_t most_precise = 12;
    const bool heap = is_crowd(*system_) && island.size() > most_precise;
    const S solved = heap ? as<S>(1e-8) : as<S>(Constants<S>::solved), little = as<S>(heap ? 1e-7 : 1e-9);
    each([&](int i) {
      const S size = (*system_)[i].bounding_radius(), scale = speed_scale(size);
      const S still = S(8) * solved * scale;
      const S speed = norm(y[i].velocity) + size * norm(y[i].angular_velocity);
      const bool rounding = speed <= still, slow = speed <= little * scale;
      S& time = data_.quiet[index(i)];
      if (!data_.counted[index(i)]) time = slow ? time + seconds : S(0);
      data_.counted[index(i)] = true;
      lay = lay && rounding && data_.lies_down[index(i)] && stays(i, y, size, still * seconds);
      // The time of a fall as deep as the body is large: a body that speeds up is faster then.
      quiet = quiet && rounding && time >= as<S>(0.1) * scale;
    });
    for (const std::size_t k : island) {
      const Rest& rest = data_.rests[k];
      if (rest.moved.first < 0 && rest.who.first >= 0) {
        if (!is_still(kinematic_of(rest.who, rest.moved), y)) return false;
      }
    }
    if (!quiet) return false;
    const int name = data_.rests[island.front()].moved.second;
    each([&](int i) {
      if (!lay) {  // one step more, from velocities of zero
        y[i].velocity = y[i].angular_velocity = {S(0), S(0), S(0)};
        data_.base[i] = y[i];
        data_.lies_down[index(i)] = true;
      } else if (data_.island[index(i)] < 0) {
        y[i] = data_.base[i];
        data_.resting_free[i] = data_.free[i];
        data_.lies_down[index(i)] = false;
        data_.island[index(i)] = name;
        ++data_.sleepers;
      }
    });
    data_.drowsy |= !lay;
    if (!lay) return false;
    for (const std::size_t k : island) {
      const auto& [who, moved] = data_.rests[k];
      if (moved.first >= 0 || who.first < 0) continue;
      const int kinematic = kinematic_of(who, moved);
      data_.base[kinematic] = y[kinematic];
      data_.supports.push_back({kinematic, moved.second});
    }
    return true;
  }

  const System* system_;
  std::conditional_t<possible, Data, NoData> data_;
};

}  // namespace rbres::RBRES_ABI::detail
