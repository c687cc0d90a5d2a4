#pragma once

#include <rbres/body/mechanics.hpp>
#include <rbres/contact/contact_pair.hpp>
#include <rbres/core/lie.hpp>
#include <rbres/core/reserved.hpp>
#include <rbres/sim/kept_islands.hpp>
#include <rbres/sim/resting_work.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// In lanes, an island of the bodies of all pairs falls apart into islands of each lane's own: finds which
/// each body belongs to, `name`d by the smallest body in it.
template <class System>
void find_lane_islands(const ContactPairs<System>& pairs, std::span<const std::size_t> island,
                       PerBody<typename System::Scalar, System::bodies>& name) {
  using S = typename System::Scalar;
  for (std::size_t i = 0; i < name.size(); ++i) name[i] = as<S>(double(i));
  for (std::size_t round = 1; round < name.size(); ++round) {
    for (const std::size_t k : island) {
      const auto& pair = pairs[k];
      if (pair.moved.first < 0) continue;
      S &a = name[std::size_t(pair.moved.first)], &b = name[std::size_t(pair.moved.second)];
      const S least = minimum(a, b);
      a = select(pair.any_resting, least, a);
      b = select(pair.any_resting, least, b);
    }
  }
}

/// Of a body's rotation, J.
template <class S>
S rotation_energy(const auto& body, const RigidState<S>& state) {
  return kinetic_energy(S(0), body.inertia(), state);
}

/// Resting contacts do no work but that of friction, which is never positive. Their forces, constant over a
/// part of a step, are of second order: they may do work that contacts cannot do. This takes such energy out
/// of the motion of an island again.
template <class System>
class IslandEnergy {
  using S = typename System::Scalar;
  using State = typename System::State;
  using Pairs = ContactPairs<System>;
  using Contacts = Reserved<typename ContactPair<System>::Contact, pair_room<System>>;
  using Members = PerBody<MaskOf<S>, System::bodies>;

 public:
  /// The part that has passed.
  struct Part {
    const State& y;      ///< where it begins
    const State& flown;  ///< where the contacts' forces have taken the bodies
    const PerBody<RestingForce<S>, System::bodies>& contact;
    const Members& torqued;  ///< where other forces have had a torque
    const S& seconds;
    const KeptIslands<System>& kept;  ///< of the same time
  };

  explicit IslandEnergy(const System& system)
      : in_crowd_(is_crowd(system)),
        listed_(per_body<bool>(system)),
        members_(per_body<MaskOf<S>>(system)),
        name_(per_body<S>(system)) {
    bodies_.reserve(listed_.size());
    listed_.fill(false);
  }

  /// Takes out of `end` what the forces did too much from y to `flown`, and the impulses from there to `end`.
  /// Where a kinematic body drives the island, its contacts may do any work. `at_end`: how its pairs meet
  /// there; `rests`: where bodies have resting contacts.
  void bound(const System& system, const Pairs& pairs, std::span<const std::size_t> island,
             const Contacts& at_end, const Members& rests, const Part& part, State& end) {
    if constexpr (!Packed<S>) {
      bound_members(system, pairs, island, at_end, rests, part, end);
    } else {  // one group of pairs, in which each lane has islands of its own
      find_lane_islands<System>(pairs, island, name_);
      for (std::size_t i = 0; i < name_.size(); ++i) {
        for (std::size_t j = 0; j < members_.size(); ++j)
          members_[j] = rests[j] & (name_[j] == as<S>(double(i)));
        bound_members(system, pairs, island, at_end, members_, part, end);
      }
    }
  }

 private:
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  /// The same for the island of `members`.
  void bound_members(const System& system, const Pairs& pairs, std::span<const std::size_t> island,
                     const Contacts& at_end, const Members& members, const Part& part, State& end) {
    start();
    MaskOf<S> driven(false);    // by a kinematic body, whose contacts do any work
    MaskOf<S> overlaps(false);  // and is pushed apart, which is work, too: deeper than motion takes bodies
    for (const std::size_t k : island) {
      const auto& pair = pairs[k];
      const MaskOf<S> member = pair.any_resting & members[index(pair.moved.second)];
      add(pair.moved, at_end[k].normal, pair.surface.friction, member);
      const S sinks = in_crowd_ ? S(as<S>(2 * heap_sinking) * pair.size) : S(as<S>(0.01) * pair.touch);
      const MaskOf<S> deep = pair.manifold.separation < -sinks;
      overlaps = overlaps | (member & deep);
      if (pair.moved.first >= 0 || pair.plane()) continue;
      const RigidState<S>& partner =
          part.y[pair.moved.second == pair.who.first ? pair.who.second : pair.who.first];
      const MaskOf<S> moves = squared_norm(partner.velocity) + squared_norm(partner.angular_velocity) > S(0);
      driven = driven | (member & moves);
    }
    S excess(0);
    for (const int i : bodies_) {
      const auto& body = system[i];
      const RigidState<S>&y = part.y[i], &flown = part.flown[i];
      const RestingForce<S>& contact = part.contact[index(i)];
      // Of the rotation it is what no impact or other torque did: so integrators' errors count, too.
      S turning = rotation_energy(body, flown) - rotation_energy(body, y) - part.kept.struck(i);
      if (const MaskOf<S> torqued = part.torqued[index(i)]; any(torqued))
        turning = select(torqued, contact.turning_work(y, flown, part.seconds), turning);
      const S gained = dot(contact.force, flown.position - y.position) + turning +
                       kinetic_energy(body, end[i]) - kinetic_energy(body, flown);
      excess += select(members[index(i)], gained, S(0));
    }
    excess = remove_normal(system, part, end, select(driven, S(0), excess), members);
    const MaskOf<S> gains = excess > S(0);
    if (!any(gains)) return;
    const Rigid carried = rigid_motion(system, members, [&](int i) { return end[i]; });
    const S taken =
        shrink(system, end, excess, members, gains, [&](int i) { return remainder(carried, end[i]); });
    const S left = excess - taken;
    const MaskOf<S> more = gains & (left > S(0)), too_far = more & !overlaps;
    if (any(too_far)) hold_back(system, part, members, too_far, left, end);
  }

  /// A rigid motion of an island.
  struct Rigid {
    Vec3<S> centre, velocity, turn;  ///< turn: angular velocity, world frame
  };

  /// What is left of a body's motion without a rigid one.
  static RigidState<S> remainder(const Rigid& rigid, RigidState<S> body) {
    body.velocity -= rigid.velocity + cross(rigid.turn, body.position - rigid.centre);
    body.angular_velocity -= rotate_back(body.orientation, rigid.turn);
    return body;
  }

  /// Bodies that have stopped, but for the rigid motion of their island, and would still gain `left` (J) get
  /// no farther than their energy takes them against the other forces, but for a rigid way of their island.
  void hold_back(const System& system, const Part& part, const Members& members, const MaskOf<S>& where,
                 const S& left, State& end) const {
    const Rigid motion = rigid_motion(system, members, [&](int i) { return part.y[i]; });
    S before(0);
    for (const int i : bodies_) {
      const S energy = kinetic_energy(system[i], remainder(motion, part.y[i]));
      before += select(members[index(i)], energy, S(0));
    }
    const S share = before / select(where, S(before + left), S(1));
    const auto way_of = [&](int i) {  // from where the part begins: as if it were a velocity
      const RigidState<S>& from = part.y[i];
      const Vec3<S> turn = quaternion_log(end[i].orientation * from.orientation.conjugate());
      return RigidState<S>{from.position, from.orientation, end[i].position - from.position,
                           rotate_back(from.orientation, turn)};
    };
    const Rigid rigid_way = rigid_motion(system, members, way_of);
    for (const int i : bodies_) {
      const RigidState<S>& from = part.y[i];
      const MaskOf<S> stays = where & members[index(i)];
      const RigidState<S> way = way_of(i), own = remainder(rigid_way, way);
      const S back = S(1) - share;
      const Vec3<S> turn = rotate(from.orientation, way.angular_velocity - back * own.angular_velocity);
      const Vec3<S> to = from.position + (way.velocity - back * own.velocity);
      end[i].position = select(stays, to, end[i].position);
      end[i].orientation = select(stays, quaternion_exp(turn) * from.orientation, end[i].orientation);
    }
  }

  /// Begins an island.
  void start() {
    for (const int i : bodies_) listed_[index(i)] = false;
    bodies_.clear();
    mobile_ = {{S(1), S(0), S(0)}, {S(0), S(1), S(0)}, {S(0), S(0), S(1)}};
    axis_ = {};
    planes_ = S(0);
    normal_ = {};
    smooth_ = MaskOf<S>(true);
  }
  /// A pair of the island: its bodies, and in the lanes `where` what a plane or a static body (`first` is -1)
  /// keeps them from: with friction from all motion, without from motion along the normal.
  void add(const Candidate& who, const Vec3<S>& normal, const S& friction, const MaskOf<S>& where) {
    for (const int body : {who.first, who.second}) {
      if (body < 0 || listed_[std::size_t(body)]) continue;
      listed_[std::size_t(body)] = true;
      bodies_.push_back(body);
    }
    const MaskOf<S> first = squared_norm(normal_) <= S(0);
    normal_ = select(where & first, normal, normal_);
    const MaskOf<S> rubs = friction > S(0), elsewhere = square(dot(normal, normal_)) < as<S>(0.999);
    smooth_ = smooth_ & !(where & (rubs | elsewhere));
    if (who.first >= 0) return;
    const Vec3<S> n = mobile_ * normal;
    const S length = squared_norm(n);
    const MaskOf<S> sticks = where & (friction > S(0)), other = where & (length > as<S>(1e-6));
    const S weight = S(1) / select(other, length, S(1));
    const auto without = [&](Vec3<S>& column, const S& along) {
      const Vec3<S> left = column - S(weight * along) * n;
      column = select(sticks, Vec3<S>{}, select(other, left, column));
    };
    without(mobile_.x, n.x);
    without(mobile_.y, n.y);
    without(mobile_.z, n.z);
    axis_ = select(other, select(planes_ > S(0), Vec3<S>{}, normal), axis_);
    axis_ = select(sticks, Vec3<S>{}, axis_);
    planes_ = select(other, S(planes_ + S(1)), planes_);
    planes_ = select(sticks, S(2), planes_);
  }

  /// Takes `excess` (J) where it is positive from smooth bodies that lie on one another and on a plane, all
  /// with one normal: from motion along that, and how they tilt. They slide, and turn about it, as they like.
  /// Returns what is left of it, but for rounding and what solvers leave, which would stop them.
  S remove_normal(const System& system, const Part& part, State& y, const S& excess,
                  const Members& moves) const {
    const MaskOf<S> lies = planes_ > S(0), gains = excess > S(0), smooth = smooth_ & lies & gains;
    if (!any(smooth)) return excess;
    const S energy = shrink(system, y, excess, moves, smooth, [&](int i) {
      RigidState<S> body = y[i];
      body.velocity = dot(normal_, body.velocity) * normal_;
      // What impulses along the normal change, which shares no energy with the turn about it.
      const Vec3<S> up = rotate_back(body.orientation, normal_), about_up = scale(system[i].inertia(), up);
      const S turns = dot(about_up, body.angular_velocity) / select(smooth, dot(about_up, up), S(1));
      body.angular_velocity -= turns * up;
      return body;
    });
    S rounding(0);
    for (const int i : bodies_) {
      const S place = S(as<S>(8) * S(Constants<S>::epsilon)) * norm(part.y[i].position);
      const S speed = as<S>(Constants<S>::solved) * speed_scale(system[i].bounding_radius());
      const S work = norm(part.contact[index(i)].force) * (place + part.seconds * speed);
      rounding += select(moves[index(i)], work, S(0));
    }
    const S left = excess - energy;
    const MaskOf<S> counts = left > rounding;
    return select(smooth, select(counts, left, S(0)), excess);
  }

  /// Takes the share of part(body), the motion of a body, out of y that has `excess` (J), or all. Returns its
  /// energy (J).
  template <class MotionOf>
  S shrink(const System& system, State& y, const S& excess, const Members& moves, const MaskOf<S>& where,
           const MotionOf& part) const {
    S energy(0);
    for (const int i : bodies_) energy += select(moves[index(i)], kinetic_energy(system[i], part(i)), S(0));
    const MaskOf<S> some = where & (energy > S(0));
    const S share = S(1) - root(maximum(S(S(1) - excess / select(some, energy, S(1))), S(0)));
    for (const int i : bodies_) {
      const RigidState<S> shrinks = part(i);
      const S here = select(some & moves[index(i)], share, S(0));
      y[i].velocity -= here * shrinks.velocity;
      y[i].angular_velocity -= here * shrinks.angular_velocity;
    }
    return energy;
  }

  /// The island's motion that its contacts never resist: a rigid one, along the planes that it lies on, which
  /// carries the momentum that they conserve. What is left has none. `members`: the lanes in which a body
  /// belongs to it; motion(i): a body's place, and its velocities or how far they have taken it.
  template <class MotionOf>
  Rigid rigid_motion(const System& system, const Members& members, const MotionOf& motion) const {
    S mass(0);
    Vec3<S> momentum, centre;
    for (const int i : bodies_) {
      const RigidState<S> y = motion(i);
      const S m = select(members[index(i)], system[i].mass(), S(0));
      mass += m;
      momentum += m * y.velocity;
      centre += m * y.position;
    }
    const S over = S(1) / select(mass > S(0), mass, S(1));
    centre = over * centre;
    Vec3<S> spin, xs, ys, zs;  // about the centre: angular momentum, and the columns of the inertia
    for (const int i : bodies_) {
      const RigidState<S> y = motion(i);
      const S here = select(members[index(i)], S(1), S(0)), m = here * system[i].mass();
      const Mat3<S> axes = rotation_matrix(y.orientation);
      const Mat3<S> inertia = rotated_diagonal(axes, system[i].inertia());
      const Vec3<S> r = y.position - centre;
      spin += m * cross(r, y.velocity) + here * (axes * scale(system[i].inertia(), y.angular_velocity));
      const S r2 = squared_norm(r);
      xs += here * inertia.x + m * (Vec3<S>{r2, S(0), S(0)} - r.x * r);
      ys += here * inertia.y + m * (Vec3<S>{S(0), r2, S(0)} - r.y * r);
      zs += here * inertia.z + m * (Vec3<S>{S(0), S(0), r2} - r.z * r);
    }
    const Mat3<S> inertia{xs, ys, zs};
    const MaskOf<S> there = mass > S(0);
    const MaskOf<S> free = there & (planes_ < S(1));
    const S about = dot(axis_, inertia * axis_);
    const Vec3<S> turn = select(free, symmetric_inverse(inertia) * spin,
                                S(dot(axis_, spin) / select(about > S(0), about, S(1))) * axis_);
    return {centre, mobile_ * (over * momentum), turn};
  }

  bool in_crowd_;
  Reserved<int, body_room<System>> bodies_;
  PerBody<bool, System::bodies> listed_;
  Members members_;                  ///< of an island in each lane
  PerBody<S, System::bodies> name_;  ///< of each body's island in each lane
  Mat3<S> mobile_;                   ///< projects on the velocities that no plane of the island resists
  Vec3<S> axis_;                     ///< about which one plane lets it turn
  S planes_;                         ///< 0, 1, or 2 for more
  Vec3<S> normal_;                   ///< of a contact of the island
  MaskOf<S> smooth_;                 ///< where all contacts have that normal, and no friction
};

}  // namespace rbres::RBRES_ABI::detail
