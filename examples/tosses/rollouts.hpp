#pragma once

#include <Eigen/Core>  // AutoDiff does not include it itself
#include <unsupported/Eigen/AutoDiff>

#include "adjoint.hpp"
#include "predictor.hpp"

namespace rbres::tosses {

/// Forward and backward pass of some rollouts at once, a network call per frame for all corners of all
/// rollouts.
template <class Net>
class Rollouts {
  /// Where an error in a frame would grow more than this by later frames, the way back is damped: impacts
  /// make gradients through rollouts explode now and then, and such a rollout says nothing.
  static constexpr double largest_adjoint = 2;

  using T = typename Net::Scalar;
  using Columns = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
  /// A number with its derivatives by a state: by height, rotation (3), velocity (3), angular velocity (3).
  using Dual = Eigen::AutoDiffScalar<Eigen::Matrix<double, 10, 1>>;

 public:
  /// `count` rollouts of `frames` frames.
  Rollouts(int count, int frames)
      : backpropagation_(count * Corner<double>::count),
        steps_(static_cast<std::size_t>(frames)),
        loss_{.output_weights = std::vector<T>(Net::output_size)},
        gradient_(Net::block_size),
        adjoints_(static_cast<std::size_t>(count)),
        slopes_(adjoints_.size()),
        learned_(adjoints_.size()) {
    for (Step& step : steps_) {
      step.frames.resize(adjoints_.size());
      step.inputs.resize(Net::input_size, count * Corner<double>::count);
      step.outputs.resize(Net::output_size, count * Corner<double>::count);
    }
    pulled_.resize(Net::output_size, count * Corner<double>::count);
    for (std::uint32_t i = 0; i < static_cast<std::uint32_t>(count * Corner<double>::count); ++i)
      order_.push_back(i);
    // The loss whose derivative by output column i is column i of pulled_.
    loss_.extra = [this](Eigen::Index i, auto, auto, auto gradient) {
      gradient += static_cast<T>(pulled_columns_) * pulled_.col(i);
      return 0.0;
    };
  }
  Rollouts(const Rollouts&) = delete;

  /// Rolls out from measured[i][0] and compares with measured[i][1], ..., measured[i][frames]; turns[i]
  /// numbers the edges of rollout i's corners. Returns the sum over rollouts of the mean error over frames;
  /// gradient() and adjoints() are of that sum.
  double run(const CornerPredictor<Net>& predictor, const std::vector<const State*>& measured,
             const std::vector<int>& turns) {
    double sum = 0;
    std::vector<State> states;
    for (const State* start : measured) states.push_back(*start);
    std::fill(gradient_.begin(), gradient_.end(), T{});
    for (Adjoint& adjoint : adjoints_) adjoint.setZero();
    for (Step& step : steps_) forward(predictor, turns, states, step);
    for (std::size_t t = steps_.size(); t-- > 0;) {
      for (std::size_t i = 0; i < measured.size(); ++i) {
        sum +=
            pose_error(states[i], measured[i][t + 1], 1 / static_cast<double>(steps_.size()), adjoints_[i]);
        states[i] = steps_[t].frames[i].before;
      }
      backward(predictor, turns, steps_[t]);
    }
    return sum / static_cast<double>(steps_.size());
  }

  const AlignedBuffer<T>& gradient() const { return gradient_; }      ///< by the network's parameters
  const std::vector<Adjoint>& adjoints() const { return adjoints_; }  ///< by the first state of each rollout

 private:
  struct Contact {
    std::size_t rollout;
    int corner;
  };
  /// One frame of one rollout.
  struct Frame {
    State before, prior;
    Vec3<double> push, twist;   ///< the prior's velocities above those of free flight
    Vec3<double> change, spin;  ///< what the network adds to the prior's velocities
    Posture<double> posture(double floor) const { return {before, floor, push, twist}; }
  };
  /// One frame of all rollouts.
  struct Step {
    std::vector<Frame> frames;
    std::vector<Contact> contacts;  ///< a column of inputs and outputs for each
    Columns inputs, outputs;
  };

  /// Takes the states a frame further, and keeps in `step` what the way back needs.
  void forward(const CornerPredictor<Net>& predictor, const std::vector<int>& turns,
               std::vector<State>& states, Step& step) {
    step.contacts.clear();
    for (std::size_t i = 0; i < states.size(); ++i) {
      const State free = free_flight(states[i]), prior = predictor.prior(states[i]);
      const Vec3<double> push = prior.velocity - free.velocity;
      const Vec3<double> twist = prior.angular_velocity - free.angular_velocity;
      step.frames[i] = {states[i], prior, push, twist, {}, {}};
      const Posture<double> posture = step.frames[i].posture(predictor.floor);
      for (int c = 0; c < Corner<double>::count; ++c) {
        const Corner<double> corner(posture, c, turns[i]);
        if (!corner.active()) continue;
        const auto x = corner.encode();
        auto column = step.inputs.col(std::ssize(step.contacts));
        for (int k = 0; k < Net::input_size; ++k) column[k] = static_cast<T>(x[static_cast<std::size_t>(k)]);
        step.contacts.push_back({i, c});
      }
    }
    const auto columns = std::ssize(step.contacts);
    predictor.network.forward(step.inputs.leftCols(columns), step.outputs.leftCols(columns), workspace_);
    for (std::ptrdiff_t n = 0; n < columns; ++n) {
      const auto [i, c] = step.contacts[static_cast<std::size_t>(n)];
      const Posture<double> posture = step.frames[i].posture(predictor.floor);
      const Corner<double> corner(posture, c, turns[i]);
      const Vec3<double> impulse = corner.impulse(step.outputs.col(n));
      step.frames[i].change += impulse;
      step.frames[i].spin += corner.spin_of(impulse);
    }
    for (std::size_t i = 0; i < states.size(); ++i) {
      states[i] = step.frames[i].prior;
      add_velocity(states[i], step.frames[i].change, step.frames[i].spin);
    }
  }

  /// From the adjoints of the states after `step` to those of the states before, adding to the parameters'
  /// gradient.
  void backward(const CornerPredictor<Net>& predictor, const std::vector<int>& turns, const Step& step) {
    for (std::size_t i = 0; i < adjoints_.size(); ++i) {
      const Frame& frame = step.frames[i];
      Adjoint& adjoint = adjoints_[i];
      if (const double size = adjoint.norm(); !(size <= largest_adjoint)) {
        adjoint *= std::isfinite(size) ? largest_adjoint / size : 0.0;
      }
      learned_[i] << adjoint.segment<3>(6) + frame_time * adjoint.segment<3>(0),
          adjoint.segment<3>(9) + frame_time * pull_back_turn(frame_time * frame.spin, adjoint.segment<3>(3));
      slopes_[i] = slope_of(predictor.prior, frame.before, frame.prior);
      adjoint.tail<10>() = (slopes_[i].transpose() * adjoint).eval();
    }
    if (step.contacts.empty()) return;
    pull_back_to_outputs(predictor.floor, turns, step);
    backpropagation_.run(predictor.network, {columns_of(step.inputs), columns_of(step.outputs)}, loss_,
                         std::span(order_).first(step.contacts.size()), DropoutMask{}, Team{}, true);
    backpropagation_.parameter_gradient(Team{}, [this](std::size_t place, detail::Simd<T> g, bool) {
      detail::store(gradient_.data() + place, detail::load(gradient_.data() + place) + g);
    });
    pull_back_to_states(predictor.floor, turns, step);
  }

  /// From learned_ to pulled_.
  void pull_back_to_outputs(double floor, const std::vector<int>& turns, const Step& step) {
    pulled_columns_ = step.contacts.size();
    for (std::size_t n = 0; n < pulled_columns_; ++n) {
      const auto [i, c] = step.contacts[n];
      const Posture<double> posture = step.frames[i].posture(floor);
      const Corner<double> corner(posture, c, turns[i]);
      const Vec3<double> by_change(learned_[i].template head<3>()), by_spin(learned_[i].template tail<3>());
      std::array<double, Corner<double>::coefficients> by_output;
      corner.pull_back(by_change, by_spin, by_output);
      for (std::size_t k = 0; k < by_output.size(); ++k) {
        pulled_(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(n)) = static_cast<T>(by_output[k]);
      }
    }
  }

  /// Through the impulses' directions, and through the network's inputs.
  void pull_back_to_states(double floor, const std::vector<int>& turns, const Step& step) {
    const auto by_input = backpropagation_.input_gradient();
    for (std::size_t n = 0; n < step.contacts.size(); ++n) {
      const auto [i, c] = step.contacts[n];
      const auto column = static_cast<Eigen::Index>(n);
      const Posture<Dual> posture = with_derivatives(step.frames[i], slopes_[i], floor);
      const Corner<Dual> corner(posture, c, turns[i]);
      const Vec3<Dual> change = corner.impulse(step.outputs.col(column));
      const Vec3<Dual> spin = corner.spin_of(change);
      const auto& by = learned_[i];
      auto adjoint = adjoints_[i].template tail<10>();
      adjoint += by[0] * change.x.derivatives() + by[1] * change.y.derivatives() +
                 by[2] * change.z.derivatives() + by[3] * spin.x.derivatives() +
                 by[4] * spin.y.derivatives() + by[5] * spin.z.derivatives();
      const auto x = corner.encode();
      for (std::size_t k = 0; k < x.size(); ++k) {
        adjoint += static_cast<double>(by_input(static_cast<Eigen::Index>(k), column)) * x[k].derivatives();
      }
    }
  }

  /// The posture with its derivatives by the frame's state, the prior's among them.
  static Posture<Dual> with_derivatives(const Frame& frame, const Slope& slope, double floor) {
    const auto number = [](double x, int place) { return Dual(x, 10, place); };
    const State& state = frame.before;
    RigidState<Dual> s;
    s.position = {Dual(state.position.x), Dual(state.position.y), number(state.position.z, 0)};
    const Quat<double>& q = state.orientation;
    s.orientation = {Dual(q.x), Dual(q.y), Dual(q.z), Dual(q.w)};
    for (int k = 0; k < 3; ++k) {
      const Quat<double> rate = quaternion_rate(q, Vec3<double>(Eigen::Vector3d::Unit(k)));
      s.orientation.x.derivatives()[1 + k] = rate.x;
      s.orientation.y.derivatives()[1 + k] = rate.y;
      s.orientation.z.derivatives()[1 + k] = rate.z;
      s.orientation.w.derivatives()[1 + k] = rate.w;
    }
    s.velocity = {number(state.velocity.x, 4), number(state.velocity.y, 5), number(state.velocity.z, 6)};
    s.angular_velocity = {number(state.angular_velocity.x, 7), number(state.angular_velocity.y, 8),
                          number(state.angular_velocity.z, 9)};
    // Above free flight, whose velocities only move with the state's.
    const auto above = [&](double x, int row) {
      Dual d(x, slope.row(row).transpose());
      d.derivatives()[row - 2] -= 1;
      return d;
    };
    return {s,
            floor,
            {above(frame.push.x, 6), above(frame.push.y, 7), above(frame.push.z, 8)},
            {above(frame.twist.x, 9), above(frame.twist.y, 10), above(frame.twist.z, 11)}};
  }

  static ColumnsView<T> columns_of(const Columns& matrix) {
    return {matrix.data(), matrix.rows(), matrix.cols()};
  }

  typename Net::Workspace workspace_;
  Backpropagation<Net> backpropagation_;
  std::vector<Step> steps_;
  Loss<T> loss_;
  std::vector<std::uint32_t> order_;
  Columns pulled_;  ///< gradients by the network's outputs
  std::size_t pulled_columns_ = 0;
  AlignedBuffer<T> gradient_;
  std::vector<Adjoint> adjoints_;
  std::vector<Slope> slopes_;                         ///< of the prior in each rollout
  std::vector<Eigen::Matrix<double, 6, 1>> learned_;  ///< gradients by each rollout's change and spin
};

}  // namespace rbres::tosses
