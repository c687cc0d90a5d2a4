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
  explicit HeldFlight(const System& system) : system_(&system), change_(per_body<Change>(system)) {}

  void forget(int i) { change_[index(i)] = {}; }

  /// Changes the velocities at the end of body i's free flight by what the last part has taught.
  void expect(int i, RigidState<S>& free) const { change_[index(i)].add_to(free); }

  /// The contacts' forces were to take body i, which began a part in the motion `start`, to `end` instead of
  /// `unheld`, and have taken it to `flown`: changes the velocities of `free` such that this is foreseen.
  /// False where they are as they were, but for what contacts are solved to.
  bool learn(int i, const Motion<S>& start, const Motion<S>& unheld, const Motion<S>& end,
             const RigidState<S>& flown, RigidState<S>& free) {
    const S size = (*system_)[i].bounding_radius();
    const auto square_of = [&](const Vec3<S>& v, const Vec3<S>& w) {
      return squared_norm(v) + square(size) * squared_norm(w);
    };
    const S moves = square_of(start.velocity, start.angular_velocity);
    const S held = square_of(end.velocity - unheld.velocity, end.angular_velocity - unheld.angular_velocity);
    const S solved = square(S(as<S>(Constants<S>::solved) * speed_scale(size)));
    Change& known = change_[index(i)];
    Change all{
        known.velocity + (flown.velocity - end.velocity),
        known.spin + rotate_back(free.orientation, flown.angular_velocity_world() - end.angular_velocity)};
    const S size_of_all = square_of(all.velocity, all.spin);
    // What is little beside the motion of the body keeps it from nothing. Where forces change more than that,
    // as of a stiff damper, to foresee it may make it worse.
    const bool counts =
        size_of_all > maximum(solved, S(as<S>(0.25) * moves)) && size_of_all < as<S>(0.01) * held;
    if (!counts) all = {};
    const Change news{all.velocity - known.velocity, all.spin - known.spin};
    if (!(square_of(news.velocity, news.spin) > solved)) return false;
    news.add_to(free);
    known = all;
    return true;
  }

 private:
  struct Change {
    Vec3<S> velocity, spin;  ///< m/s; rad/s in the body's frame

    void add_to(RigidState<S>& body) const {
      body.velocity += velocity;
      body.angular_velocity += spin;
    }
  };
  static std::size_t index(int i) { return static_cast<std::size_t>(i); }

  const System* system_;
  PerBody<Change, System::bodies> change_;  ///< of the velocities at the end of a part
};

}  // namespace rbres::RBRES_ABI::detail
