#pragma once

#include <rbres/paper/scenario_data.hpp>

namespace rbres::RBRES_ABI {

/// Scenario c as it starts, or where truth is at a horizon. Absent bodies stand at the origin. (Templates, so
/// that only those who call them compile them.)
template <class Columns>
SystemState<double, ScenarioData::bodies> state_of(const Columns& columns, Eigen::Index c, int present) {
  SystemState<double, ScenarioData::bodies> y;
  const auto* from = columns.data() + c * columns.rows();
  std::copy_n(from, 13 * present, &y[0].position.x);
  return y;
}
/// The wrenches of scenario c.
template <class Data>
std::array<Wrench<double>, ScenarioData::bodies> wrench_of(const Data& data, Eigen::Index c) {
  std::array<Wrench<double>, ScenarioData::bodies> w;
  std::copy_n(data.wrench.data() + c * data.wrench.rows(), 30, &w[0].force.x);
  return w;
}

/// Scenarios up to one of their horizons, with the members of Transitions: what TrainingSet, measure and
/// predict_all take. Views the data, which must outlive it.
class ScenarioTransitions {
 public:
  static constexpr int bodies = ScenarioData::bodies;  ///< most bodies of a scenario

  double horizon;  ///< s

  /// Horizon number h of the data; Error where it has no such, and where parts of the data do not fit
  /// together.
  ScenarioTransitions(const ScenarioData& data, std::size_t h)
      : horizon(h < data.horizons.size() ? data.horizons[h] : 0), data_(&data), h_(h) {
    if (h >= data.horizons.size())
      detail::refuse("horizon number", detail::text("less than ", data.horizons.size()), h);
    const auto expect = [](const char* what, Eigen::Index wanted, Eigen::Index found) {
      if (found != wanted) detail::refuse(what, detail::text(wanted), found);
    };
    expect("lists of states", std::ssize(data.horizons), std::ssize(data.states));
    const Eigen::Index count = data.states[h].cols();
    expect("rows of states", 13 * bodies, data.states[h].rows());
    expect("rows of initial states", 13 * bodies, data.initial.rows());
    expect("initial states", count, data.initial.cols());
    expect("rows of wrenches", 6 * bodies, data.wrench.rows());
    expect("wrenches", count, data.wrench.cols());
    expect("body counts", count, std::ssize(data.body_count));
    if (!data.first_contact.empty()) expect("first contacts", count, std::ssize(data.first_contact));
    for (Eigen::Index c = 0; c < count; ++c) {
      if (present(c) < 1 || present(c) > bodies)
        detail::refuse(detail::text("bodies of scenario ", c), detail::text("1 to ", bodies), present(c));
    }
  }

  /// How many scenarios there are.
  Eigen::Index count() const { return data_->states[h_].cols(); }
  /// How many bodies scenario c has: the first ones.
  int present(Eigen::Index c) const { return data_->body_count[at(c)]; }
  /// The state at the start of scenario c.
  auto start(Eigen::Index c) const { return state_of(data_->initial, c, present(c)); }
  /// The wrench on each body of scenario c.
  auto wrench(Eigen::Index c) const { return wrench_of(*data_, c); }
  /// Truth at the horizon.
  auto end(Eigen::Index c) const { return state_of(data_->states[h_], c, present(c)); }
  /// Whether scenario c is known to have had an impact by the horizon.
  bool had_impact(Eigen::Index c) const {
    return !data_->first_contact.empty() &&
           static_cast<double>(data_->first_contact[at(c)]) <= horizon + 1e-6;
  }

 private:
  static std::size_t at(Eigen::Index c) { return static_cast<std::size_t>(c); }

  const ScenarioData* data_;
  std::size_t h_;
};

}  // namespace rbres::RBRES_ABI
