#pragma once

#include <rbres/learn/analytic_answer.hpp>
#include <rbres/learn/contact_law.hpp>
#include <rbres/learn/physics_terms.hpp>
#include <rbres/learn/scene_forces.hpp>
#include <rbres/learn/scene_step.hpp>

#include <span>
#include <utility>
#include <vector>

namespace rbres::RBRES_ABI::detail {

/// The way back through free flight: adds to the derivative by the state where it begins.
template <class OneBody>
void add_free_flight_gradient(SceneStep::Velocity velocity, const OneBody& alone, const SceneForces& forces,
                              bool resisted, const RigidState<double>& from, double time,
                              const RigidState<double>& by_to, RigidState<double>& by_from) {
  // No force depends on the place.
  by_from.position += by_to.position;
  const auto turn = [&]<int N>(std::integral_constant<int, N>) {
    using D = Dual<N>;
    SystemState<D, 1> y;
    y[0] = {constant_vector<N>(from.position), dual_quaternion<N>(from.orientation, 0),
            constant_vector<N>(from.velocity), dual_vector<N>(from.angular_velocity, 4)};
    if constexpr (N > 7) y[0].velocity = dual_vector<N>(from.velocity, 7);
    fly_on(velocity, alone.template cast<D>(), forces, y, D(time));
    Eigen::Matrix<double, N, 1> g = pull_back<N>(by_to.orientation, y[0].orientation) +
                                    pull_back<N>(by_to.angular_velocity, y[0].angular_velocity);
    if constexpr (N > 7) {
      g += pull_back<N>(by_to.position, y[0].position) + pull_back<N>(by_to.velocity, y[0].velocity);
      by_from.velocity += Vec3<double>{g[7], g[8], g[9]};
    }
    by_from.orientation = by_from.orientation + Quat<double>{g[0], g[1], g[2], g[3]};
    by_from.angular_velocity += Vec3<double>{g[4], g[5], g[6]};
  };
  if (resisted) {
    turn(std::integral_constant<int, 10>{});
  } else {
    by_from.velocity += by_to.velocity + time * by_to.position;
    turn(std::integral_constant<int, 7>{});
  }
}

/// Contacts of a rollout's frame that are answered at once, and where bodies were led before.
template <class Law>
struct RolloutAnswer {
  std::vector<RigidState<double>> before;
  typename Law::Frame contacts;
  typename Law::Network::Record record;
};

/// One frame of a rollout: where bodies begin, where free flight takes them, and how their contacts are
/// answered, one after the other. Where the law corrects the analytic one there is one answer, on top of
/// that.
template <class Law>
struct RolloutFrame {
  std::vector<RigidState<double>> start, flown;
  std::vector<RolloutAnswer<Law>> all;  ///< of which the frame has the first `answers`
  std::size_t answers = 0;

  std::span<RolloutAnswer<Law>> answered() { return std::span(all).first(answers); }
  std::span<const RolloutAnswer<Law>> answered() const { return std::span(all).first(answers); }
  /// One more, whose memory may have been used before.
  RolloutAnswer<Law>& next() {
    if (answers == all.size()) all.emplace_back();
    return all[answers++];
  }
};

/// The way back through a frame of a contact law.
template <class Law>
class FrameGradient {
  using Net = typename Law::Network;
  using T = typename Law::Scalar;
  using States = std::vector<RigidState<double>>;

 public:
  static constexpr RigidState<double> zero{{}, {0, 0, 0, 0}, {}, {}};

  /// From the derivatives by the states where the frame ends to those by the states where it begins. Adds to
  /// the derivatives by the parameters. `shares` is what the terms of each body's contacts are multiplied
  /// with. bodies[i] is a System of body i alone, forces[i] what acts on it; `scenes` are the scenes of the
  /// frame, one behind the other, all of the set.
  void operator()(const Law& law, const Net& network, std::span<const System<double, 1>* const> bodies,
                  std::span<const SceneForces* const> forces, std::span<const SceneSystem* const> scenes,
                  const TrajectorySet& set, SceneStep::Velocity velocity, RolloutFrame<Law>& frame,
                  const PhysicsTerms& terms, std::span<const double> shares, const States& by_end,
                  States& by_start, ParameterGradient<Net>& gradient) {
    const std::size_t count = bodies.size();
    const double time = law.scales.frame_time;
    const bool resisted = set.resistance().any();
    by_start.assign(count, zero);
    by_flights_.assign(count, no_flight());
    by_after_ = by_end;
    for (std::size_t k = frame.answers; k-- > 0;) {
      back_through_answer(law, network, bodies, set.planes(), frame.all[k], terms, shares, gradient);
      if (k > 0) back_to(frame.all[k - 1], frame.all[k], bodies, time);
      by_after_.swap(by_before_);
    }
    if constexpr (Law::corrects) {
      back_through_analytic(scenes, resisted, frame, time, by_start);
    } else {
      by_flown_.swap(by_after_);
    }
    for (std::size_t i = 0; i < count; ++i) {
      add_flight_gradient((*bodies[i])[0], frame.start[i], frame.flown[i], time, by_flights_[i], by_start[i],
                          by_flown_[i]);
      add_free_flight_gradient(velocity, *bodies[i], *forces[i], resisted, frame.start[i], time, by_flown_[i],
                               by_start[i]);
    }
  }

 private:
  static ContactFlight no_flight() {
    ContactFlight none{};
    none.turned = {0, 0, 0, 0};
    return none;
  }

  /// From the derivatives by the states after an answer, by_after_, to those before it, by_before_, and by
  /// flights.
  void back_through_answer(const Law& law, const Net& network,
                           std::span<const System<double, 1>* const> bodies,
                           const std::vector<Plane<double>>& planes, RolloutAnswer<Law>& answer,
                           const PhysicsTerms& terms, std::span<const double> shares,
                           ParameterGradient<Net>& gradient) {
    by_before_.assign(bodies.size(), zero);
    by_sums_.resize(bodies.size());
    for (std::size_t i = 0; i < bodies.size(); ++i)
      by_sums_[i] = add_pushed_gradient((*bodies[i])[0], answer.before[i],
                                        answer.contacts.sums[i] * law.weight, by_after_[i], by_before_[i]) *
                    law.weight;
    back_through_contacts(law, network, answer, terms, shares, gradient);
    for (std::size_t k = 0; k < answer.contacts.contacts.size();)
      k = back_through_places(bodies, planes, answer.contacts, law.scales, k);
  }

  /// From the derivatives by the flights of an answer to those by the states and flights of the one before
  /// it, which has changed some.
  void back_to(const RolloutAnswer<Law>& earlier, const RolloutAnswer<Law>& answer,
               std::span<const System<double, 1>* const> bodies, double time) {
    for (std::size_t i = 0; i < bodies.size(); ++i) {
      if (!earlier.contacts.sums[i].touched) continue;
      const ContactFlight by_flight = std::exchange(by_flights_[i], no_flight());
      Vec3<double> by_gained;
      add_flight_after_gradient((*bodies[i])[0], answer.before[i], time, by_flight, by_before_[i], by_gained);
      by_flights_[i].velocity += by_gained;
      by_flights_[i].mean_velocity -= by_gained;
    }
  }

  /// From the derivatives by what the analytic law made of the frame, by_after_, to those by its free flight.
  void back_through_analytic(std::span<const SceneSystem* const> scenes, bool resisted,
                             const RolloutFrame<Law>& frame, double time, States& by_start) {
    const States& answered = frame.all[0].before;
    by_flown_.assign(by_after_.size(), zero);
    for (std::size_t i = 0; i < by_after_.size(); ++i) {
      // The impulses turn a body about where it was answered to be.
      by_after_[i].position += by_flights_[i].end;
      by_flights_[i].end = {};
    }
    std::size_t base = 0;
    for (const SceneSystem* scene : scenes) {
      const auto n = static_cast<std::size_t>(scene->size());
      const auto part = [&](const States& all) {
        return std::span<const RigidState<double>>(all).subspan(base, n);
      };
      analytic_.add_gradient(*scene, part(frame.start), part(frame.flown), part(answered), time, resisted,
                             part(by_after_), std::span(by_flown_).subspan(base, n),
                             std::span(by_start).subspan(base, n));
      base += n;
    }
  }

  /// From the derivatives by the bodies' sums to those by places and flights.
  void back_through_contacts(const Law& law, const Net& network, RolloutAnswer<Law>& answer,
                             const PhysicsTerms& terms, std::span<const double> shares,
                             ParameterGradient<Net>& gradient) {
    auto& frame = answer.contacts;
    const std::size_t contacts = frame.contacts.size();
    const auto columns = static_cast<Eigen::Index>(contacts);
    if (by_outputs_.cols() < columns) {
      by_outputs_.resize(ContactImpulse::outputs, 2 * columns);
      by_inputs_.resize(Contact::features, 2 * columns);
    }
    by_presence_.resize(contacts);
    by_contacts_.assign(contacts, {});
    for (std::size_t k = 0; k < contacts; ++k) {
      const Contact& c = frame.contacts[k];
      auto by =
          add_impulse_gradient(c, frame.output(k), pair_of(c, std::as_const(frame.flights)), law.scales,
                               pair_of(c, std::as_const(by_sums_)), by_contacts_[k], pair_of(c, by_flights_));
      if (terms.any()) {
        const ContactCost cost = contact_cost(terms, c, frame.output(k)[0], law.scales);
        const double share = shares[static_cast<std::size_t>(c.second)];
        by[0] += share * cost.by_output;
        by_contacts_[k].presence += share * cost.by_presence;
        by_contacts_[k].gap_before += share * cost.by_gap_before;
        by_contacts_[k].gap_after += share * cost.by_gap_after;
      }
      for (std::size_t i = 0; i < by.size(); ++i)
        by_outputs_(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = static_cast<T>(by[i]);
    }
    answer.record.backward(network, frame.presence, frame.ends, std::ssize(answer.before), by_outputs_,
                           gradient.numbers(), by_inputs_, by_presence_);
    by_features_.resize(contacts);
    by_responses_.assign(frame.responses.size(), {});
    for (std::size_t k = 0; k < contacts; ++k) {
      const Contact& c = frame.contacts[k];
      Contact::Features& by = by_features_[k];
      for (std::size_t i = 0; i < by.size(); ++i) {
        const auto row = static_cast<Eigen::Index>(i);
        by[i] = static_cast<double>(by_inputs_(row, static_cast<Eigen::Index>(k)) / law.input.deviation[row]);
      }
      by_contacts_[k].presence += static_cast<double>(by_presence_[k]);
      add_response_features_gradient(c, law.scales, by, by_contacts_[k]);
      add_response_gradient(c, pair_of(c, std::as_const(frame.flights)),
                            pair_of(c, std::as_const(frame.responses)), by_contacts_[k],
                            pair_of(c, by_flights_), pair_of(c, by_responses_));
    }
    for (std::size_t i = 0; i < by_responses_.size(); ++i)
      complete_response_gradient(frame.flights[i], frame.responses[i], by_responses_[i], by_flights_[i]);
    for (std::size_t k = 0; k < contacts; ++k) {
      const Contact& c = frame.contacts[k];
      add_push_gradient(c, law.scales, pair_of(c, std::as_const(by_responses_)), by_contacts_[k]);
      add_measure_gradient(c, pair_of(c, std::as_const(frame.flights)), law.scales, by_features_[k],
                           by_contacts_[k], pair_of(c, by_flights_));
    }
  }

  /// From the derivatives by the places of the pair of contact k to those by flights; the first contact of
  /// another pair.
  std::size_t back_through_places(std::span<const System<double, 1>* const> bodies,
                                  const std::vector<Plane<double>>& planes, const typename Law::Frame& frame,
                                  const ContactScales& scales, std::size_t k) {
    const Contact& c = frame.contacts[k];
    std::size_t end = k;
    std::array<const ContactPlace*, 12> by_place{};
    double by_share = 0;
    for (; end < frame.contacts.size(); ++end) {
      const Contact& other = frame.contacts[end];
      if (other.first != c.first || other.second != c.second) break;
      by_place[static_cast<std::size_t>(other.place)] = &by_contacts_[end].at;
      by_share += by_contacts_[end].share;
    }
    const auto by = [&](int place) { return by_place[static_cast<std::size_t>(place)]; };
    const auto second = static_cast<std::size_t>(c.second);
    if (c.plane()) {
      add_place_gradient(planes[static_cast<std::size_t>(-1 - c.first)], (*bodies[second])[0],
                         frame.flights[second], c.moment, scales, by, by_share, by_flights_[second]);
    } else {
      const auto first = static_cast<std::size_t>(c.first);
      add_place_gradient((*bodies[first])[0], frame.flights[first], (*bodies[second])[0],
                         frame.flights[second], c.moment, scales, by, by_share, by_flights_[first],
                         by_flights_[second]);
    }
    return end;
  }

  States by_flown_, by_before_, by_after_;
  std::vector<ContactFlight> by_flights_;
  std::vector<BodyImpulse> by_sums_;
  std::vector<ContactGradient> by_contacts_;
  std::vector<Contact::Features> by_features_;
  std::vector<BodyResponse> by_responses_;
  typename Law::Frame::Columns by_outputs_, by_inputs_;
  std::vector<T> by_presence_;
  AnalyticAnswer<SceneSystem> analytic_;
};

}  // namespace rbres::RBRES_ABI::detail
