#pragma once

#include <rbres/contact/broad_phase.hpp>
#include <rbres/learn/contact_impulses.hpp>
#include <rbres/learn/contact_network.hpp>
#include <rbres/predict/encoding.hpp>

#include <algorithm>
#include <limits>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// The bodies of one scene and the planes around them.
template <class Shape>
struct SceneView {
  std::span<const Body<double, Shape>> bodies;
  std::span<const Plane<double>> planes;
};

/// Impacts of a frame that share a body are answered one after the other, up to so many of a body; after that
/// all that are left at once.
inline constexpr int most_impacts = 8;

/// All contacts of a frame that are answered at once, of one scene or of several that do not know of one
/// another: what stands between free flight and the states after it. Bodies are counted through all scenes.
template <std::floating_point T>
struct ContactFrame {
  using Columns = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
  using Normal = Normalizer<T, Contact::features>;

  Reserved<ContactFlight> flights;
  Reserved<Contact> contacts;
  Reserved<ContactEnds> ends;
  Reserved<T> presence;
  Reserved<BodyResponse> responses;  ///< of the bodies
  Reserved<BodyImpulse> sums;
  Columns inputs, outputs;

  ContactFrame() = default;
  /// Room for one scene, after which nothing allocates: contacts that find none are left out.
  ContactFrame(std::size_t bodies, std::size_t most_contacts)
      : inputs(Contact::features, most_contacts), outputs(ContactImpulse::outputs, most_contacts) {
    flights.reserve(bodies);
    responses.reserve(bodies);
    sums.reserve(bodies);
    contacts.reserve(most_contacts);
    ends.reserve(most_contacts);
    presence.reserve(most_contacts);
    since_.reserve(bodies);
    first_.reserve(bodies);
    reach_.reserve(bodies);
    balls_.reserve(bodies);
    pairs_.reserve(most_contacts);
    most_ = most_contacts;
  }

  void clear() {
    flights.clear();
    since_.clear();
    clear_contacts();
  }

  /// Adds a scene that flies freely from `start` to `flown`, with all its contacts where none are to follow.
  template <class Shape>
  void add(const SceneView<Shape>& scene, std::span<const RigidState<double>> start,
           std::span<const RigidState<double>> flown, const ContactScales& scales, bool last = false) {
    const std::size_t base = flights.size();
    for (std::size_t i = 0; i < scene.bodies.size(); ++i)
      flights.push_back(contact_flight(scene.bodies[i], start[i], flown[i], scales.frame_time));
    since_.resize(flights.size(), 0);
    find(scene, base, scales, last);
  }

  /// Whether impulses have changed paths in such a way that other impacts may follow within the frame.
  bool goes_on(const ContactScales& scales) const {
    return scales.moment == ContactMoment::impact && !contacts.empty();
  }
  /// Starts with what contacts that have been answered, its own or another frame's, leave for those that
  /// follow. `states` is where the impulses have led; body(i) is body i.
  template <class BodyOf>
  void go_on(const ContactFrame& earlier, const BodyOf& body, std::span<const RigidState<double>> states,
             const ContactScales& scales) {
    if (&earlier != this) flights = earlier.flights, since_ = earlier.since_;
    for (const Contact& c : earlier.contacts)
      for (std::size_t b = c.plane() ? 1 : 0; b < 2; ++b) {
        double& since = since_[static_cast<std::size_t>(b == 0 ? c.first : c.second)];
        since = std::max(since, c.moment.share);
      }
    for (std::size_t i = 0; i < flights.size(); ++i) {
      if (!earlier.sums[i].touched) continue;
      const Vec3<double> gained = flights[i].velocity - flights[i].mean_velocity;
      flights[i] = flight_after(body(i), states[i], gained, scales.frame_time);
    }
    clear_contacts();
  }
  /// Adds the contacts of a scene whose bodies are known, from number `base` on; all that there are where
  /// they are the `last`.
  template <class Shape>
  void find(const SceneView<Shape>& scene, std::size_t base, const ContactScales& scales, bool last) {
    const std::size_t known = contacts.size();
    reach_.clear();
    for (std::size_t i = 0; i < scene.bodies.size(); ++i) {
      const ContactFlight& f = flights[base + i];
      const double radius = scene.bodies[i].bounding_radius();
      const double way = norm(f.mean_velocity) + 0.5 * norm(f.velocity - f.mean_velocity);
      reach_.push_back(radius + 0.5 * scales.frame_time * (way + radius * norm(f.spin)) +
                       0.5 * scales.margin);
    }
    const auto middle = [&](int i) -> const Vec3<double>& {
      return flights[base + static_cast<std::size_t>(i)].middle;
    };
    const auto reach = [&](int i) { return reach_[static_cast<std::size_t>(i)]; };
    const auto from_plane = [&](int i) { return reach(i) + 0.5 * scales.margin; };
    const auto collides = [&](int first, int second) { return one_moves(scene.bodies, first, second); };
    const int n = static_cast<int>(scene.bodies.size());
    using ByPlanes =
        NearPairs<double, Partners::planes, decltype(middle), decltype(from_plane), decltype(collides)>;
    for (const auto& pair : ByPlanes(scene.planes, n, middle, from_plane, collides))
      add_plane(scene, static_cast<std::size_t>(-1 - pair.who.first),
                static_cast<std::size_t>(pair.who.second), base, scales);
    find_pairs(middle, reach, collides);
    for (const Candidate& pair : pairs_)
      add_pair(scene, static_cast<std::size_t>(pair.first), static_cast<std::size_t>(pair.second), base,
               scales);
    if (scales.moment == ContactMoment::impact && !last) keep_first(known);
    responses.resize(base + scene.bodies.size());
    measure_responses(std::span(contacts).subspan(known), flights, base, scales, responses);
  }

  /// Fills the network's inputs.
  void encode(const Normal& normal, const ContactScales& scales) {
    if (inputs.cols() < std::ssize(contacts)) {
      inputs.resize(Contact::features, 2 * std::ssize(contacts));
      outputs.resize(ContactImpulse::outputs, 2 * std::ssize(contacts));
    }
    for (std::size_t k = 0; k < contacts.size(); ++k)
      inputs.col(static_cast<Eigen::Index>(k)) = normal.normalize(raw(k, scales));
  }
  /// The features of contact k as the law measures them.
  typename Normal::Vector raw(std::size_t k, const ContactScales& scales) const {
    const auto features = features_of(contacts[k], scales);
    return Eigen::Map<const Eigen::Matrix<double, Contact::features, 1>>(features.data()).template cast<T>();
  }
  ContactImpulse::Outputs output(std::size_t k) const {
    ContactImpulse::Outputs o;
    for (std::size_t i = 0; i < o.size(); ++i)
      o[i] = static_cast<double>(outputs(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)));
    return o;
  }

  /// Sums up what the network's outputs do to every body.
  void sum_impulses(const ContactScales& scales) {
    sums.assign(flights.size(), BodyImpulse{});
    for (std::size_t k = 0; k < contacts.size(); ++k)
      add_impulse(contacts[k], impulse_of(contacts[k], output(k), scales),
                  pair_of(contacts[k], std::as_const(flights)), scales, pair_of(contacts[k], sums));
  }

 private:
  void clear_contacts() {
    responses.clear();
    contacts.clear();
    ends.clear();
    presence.clear();
  }

  /// Of the contacts from number `known` on, leaves those before which neither of their bodies has another.
  void keep_first(std::size_t known) {
    first_.assign(flights.size(), 1);
    for (std::size_t k = known; k < contacts.size(); ++k)
      for (double* first : pair_of(contacts[k], first_))
        if (first) *first = std::min(*first, contacts[k].moment.share);
    std::size_t kept = known;
    for (std::size_t k = known; k < contacts.size(); ++k) {
      bool is_first = true;
      for (const double* first : pair_of(contacts[k], first_))
        is_first = is_first && (!first || contacts[k].moment.share <= *first);
      if (!is_first) continue;
      contacts[kept] = contacts[k];
      ends[kept] = ends[k];
      presence[kept] = presence[k];
      ++kept;
    }
    contacts.resize(kept);
    ends.resize(kept);
    presence.resize(kept);
  }

  /// The pairs of bodies of the last scene that may touch within the frame.
  template <class Position, class Reach, class Collides>
  void find_pairs(const Position& position, const Reach& reach, const Collides& collides) {
    if (balls_.size() != reach_.size()) {
      balls_.resize(reach_.size());
      for (std::size_t i = 0; i < balls_.size(); ++i) balls_[i].body = static_cast<int>(i);
    }
    pairs_.clear();
    sweep(balls_, position, reach, [&](const Candidate& pair) {
      if (pairs_.size() < most_ && collides(pair.first, pair.second)) pairs_.push_back(pair);
    });
    std::sort(pairs_.begin(), pairs_.end(), comes_before);
  }

  template <class Shape>
  void add_plane(const SceneView<Shape>& scene, std::size_t p, std::size_t i, std::size_t base,
                 const ContactScales& scales) {
    const Plane<double>& plane = scene.planes[p];
    const auto& body = scene.bodies[i];
    const ContactFlight& f = flights[base + i];
    Contact contact;
    contact.first = -1 - static_cast<int>(p);
    contact.second = static_cast<int>(base + i);
    contact.surface = {combined_restitution(plane.material, body.material()),
                       combined_friction(plane.material, body.material())};
    with_places(plane, body, f, scales, since_[base + i], [&](const auto& m, const Moment& moment) {
      contact.moment = moment;
      add_points(contact, m, 1, scales);
    });
  }

  template <class Shape>
  void add_pair(const SceneView<Shape>& scene, std::size_t i, std::size_t j, std::size_t base,
                const ContactScales& scales) {
    const auto &first = scene.bodies[i], &second = scene.bodies[j];
    const ContactFlight &f = flights[base + i], &g = flights[base + j];
    Contact contact;
    contact.first = static_cast<int>(base + i);
    contact.second = static_cast<int>(base + j);
    contact.surface = {combined_restitution(first.material(), second.material()),
                       combined_friction(first.material(), second.material())};
    const double from = std::max(since_[base + i], since_[base + j]);
    with_places(first, f, second, g, scales, from, [&](const auto& m, const Moment& moment) {
      contact.moment = moment;
      add_points(contact, m, second.inverse_mass() / (first.inverse_mass() + second.inverse_mass()), scales);
    });
  }

  /// `share` is the second body's of the mobility.
  template <class Manifold>
  void add_points(Contact& contact, const Manifold& m, double share, const ContactScales& scales) {
    each_point(m, [&](int place, const Vec3<double>& point, double gap) {
      if (contacts.size() == most_) return;
      contact.place = place;
      contact.at = {m.normal, point, gap};
      measure(contact, pair_of(contact, std::as_const(flights)), scales);
      if (!(contact.nearest(scales) < scales.margin)) return;
      contacts.push_back(contact);
      ends.push_back({contact.plane() ? -1 : contact.first, contact.second, static_cast<float>(1 - share),
                      static_cast<float>(share)});
      presence.push_back(static_cast<T>(contact.presence));
    });
  }

  Reserved<double> since_;        ///< share of the frame from which each body's flight holds
  Reserved<double> first_;        ///< each body's first impact
  Reserved<double> reach_;        ///< how far from its middle a body of the last scene may touch something, m
  Reserved<Ball<double>> balls_;  ///< around its bodies, in order along x
  Reserved<Candidate> pairs_;
  std::size_t most_ = std::numeric_limits<std::size_t>::max();
};

}  // namespace rbres::RBRES_ABI::detail
