#pragma once

#include <rbres/contact/contact_pair.hpp>

namespace rbres::RBRES_ABI::detail {

/// Forces such as drag are others on a body that its contacts hold than in the free flight from which the
/// contacts' forces are found: a body that is nearly at rest would never come to rest. What the last part has
/// taught is where the next begins.
template <class System>
class HeldFlight {
  using S = typename System::Scalar;

 public:
  explicit HeldFlight(const System& system)
      : system_(&system), in_crowd_(is_crowd(system)), change_(per_body<Change>(system)), last_(change_) {}

  void forget(int i) { change_[index(i)] = {}; }

  /// Changes the velocities at the end of body i's free flight by what the last part has taught.
  void expect(int i, RigidState<S>& free) const { change_[index(i)].add_to(free); }

  /// The contacts' forces were to take body i, which began a part in the motion `start`, to `end` instead of
  /// `unheld`, and have taken it to `flown`: changes the velocities of `free` such that this is foreseen.
  /// False where they are as they were, but for what contacts are solved to. `again`: these are the forces
  /// that were found with what the last call has foreseen.
  bool learn(int i, const Motion<S>& start, const Motion<S>& unheld, const Motion<S>& end,
             const RigidState<S>& flown, RigidState<S>& free, bool again) {
    const S size = (*system_)[i].bounding_radius();
    const auto product = [&](const Change& a, const Change& b) {
      return dot(a.velocity, b.velocity) + square(size) * dot(a.spin, b.spin);
    };
    const S solved = square(S(as<S>(Constants<S>::solved) * speed_scale(size)));
    const Change held{end.velocity - unheld.velocity, end.angular_velocity - unheld.angular_velocity};
    const Change begin{start.velocity, start.angular_velocity};
    // In a crowd what is little beside the motion of a body is not worth it.
    const S moves = in_crowd_ ? S(as<S>(0.25) * product(begin, begin)) : S(0);
    Change& known = change_[index(i)];
    Change& last = last_[index(i)];
    Change all{
        known.velocity + (flown.velocity - end.velocity),
        known.spin + rotate_back(free.orientation, flown.angular_velocity_world() - end.angular_velocity)};
    const S size_of_all = product(all, all);
    // Where forces change by more than they are, to foresee it may make it worse.
    if (!(size_of_all > maximum(solved, moves) && size_of_all < as<S>(0.5) * product(held, held))) all = {};
    Change news{all.velocity - known.velocity, all.spin - known.spin};
    if (!(product(news, news) > solved)) {
      last = {};
      return false;
    }
    // Each time as much less as the time before: straight to the limit (Aitken 1926).
    const S before = again ? product(last, last) : S(0),
            share = product(news, last) / maximum(before, solved);
    if (before > S(0) && square(share) < as<S>(0.64)) {
      const S onward = S(1) / (S(1) - share);
      news = {onward * news.velocity, onward * news.spin};
    }
    last = news;
    news.add_to(free);
    known = {known.velocity + news.velocity, known.spin + news.spin};
    return true;
  }

 private:
  struct Change {
    Vec3<S> velocity, spin;  ///< m/s; rad/s, of what is kept in the body's frame

    void add_to(RigidState<S>& body) const {
      body.velocity += velocity;
      body.angular_velocity += spin;
    }
  };
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  const System* system_;
  bool in_crowd_;
  PerBody<Change, System::bodies> change_;  ///< of the velocities at the end of a part
  PerBody<Change, System::bodies> last_;    ///< how learn() has changed that
};

}  // namespace rbres::RBRES_ABI::detail
