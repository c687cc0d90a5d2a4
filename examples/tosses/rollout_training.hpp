#pragma once

#include <algorithm>
#include <rbres/core/parallel.hpp>
#include <memory>
#include <numbers>
#include <rbres/core/philox.hpp>

#include <Eigen/Core>  // AutoDiff does not include it itself
#include <unsupported/Eigen/AutoDiff>

#include "predictor.hpp"

namespace rbres::tosses {

/// A gradient by a state: by position, by a small rotation in the body frame, by velocity, by angular velocity.
using Adjoint = Eigen::Matrix<double, 12, 1>;

/// How far a predicted pose is from the measured one, m: sqrt(|dx|^2 + (2 w sin(angle / 2))^2 + (4 mm)^2), w the half
/// width. Adds its gradient by the pose times `scale`.
inline double pose_error(const State& predicted, const State& measured, double scale, Adjoint& gradient) {
  const Vec3<double> dx = predicted.position - measured.position;
  const Quat<double> d = measured.orientation.conjugate() * predicted.orientation;
  constexpr double arm = 4 * half_width * half_width;
  const double error = std::sqrt(squared_norm(dx) + arm * squared_norm(d.imaginary()) + 0.004 * 0.004);
  const double s = scale / error, r = s * arm * d.w / 2;
  const double by[6] = {s * dx.x, s * dx.y, s * dx.z, r * d.x, r * d.y, r * d.z};
  for (int i = 0; i < 6; ++i) gradient[i] += by[i];
  return error;
}

/// From the gradient by a rotation that ended with a turn (rotation vector in rad; both in the body frame) to that by the rotation before it,
/// in place, and that by the turn, which is returned: the right Jacobian of the exponential map (Sola, Deray, Atchuthan
/// 2018, "A micro Lie theory", equation 143), transposed.
inline Eigen::Vector3d pull_back_turn(const Vec3<double>& turn, Eigen::Ref<Eigen::Vector3d> gradient) {
  const Vec3<double> after(gradient);
  const double square = squared_norm(turn), angle = std::sqrt(square);
  const bool small = angle < 1e-4;
  const double a = small ? 0.5 : (1 - std::cos(angle)) / square;
  const double b = small ? 1.0 / 6 : (angle - std::sin(angle)) / (square * angle);
  const Vec3<double> once = cross(turn, after), twice = cross(turn, once);
  gradient = Eigen::Vector3d(rotate(rotation_of(turn), after));
  return after + a * once + b * twice;
}

/// Forward and backward pass of some rollouts at once, a network call per frame for all corners of all rollouts.
/// The prior's own change of velocity is taken as a constant in the backward pass (for free flight, it is one).
template <class Net>
class Rollouts {
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
        learned_(adjoints_.size()) {
    for (Step& step : steps_) {
      step.before.resize(adjoints_.size());
      step.after.resize(adjoints_.size());
      step.inputs.resize(Net::input_size, count * Corner<double>::count);
      step.outputs.resize(Net::output_size, count * Corner<double>::count);
    }
    pulled_.resize(Net::output_size, count * Corner<double>::count);
    for (std::uint32_t i = 0; i < static_cast<std::uint32_t>(count * Corner<double>::count); ++i) order_.push_back(i);
    // The loss whose derivative by output column i is column i of pulled_.
    loss_.extra = [this](Eigen::Index i, auto, auto, auto gradient) {
      gradient += static_cast<T>(pulled_columns_) * pulled_.col(i);
      return 0.0;
    };
  }
  Rollouts(const Rollouts&) = delete;

  /// Rolls out from measured[i][0] and compares with measured[i][1], ..., measured[i][frames]; turns[i] numbers the edges of
  /// rollout i's corners. Returns the sum over rollouts of the mean error over frames; gradient() and adjoints() are of
  /// that sum.
  double run(const CornerPredictor<Net>& predictor, const std::vector<const State*>& measured,
             const std::vector<int>& turns) {
    double sum = 0;
    for (std::size_t i = 0; i < measured.size(); ++i) steps_[0].before[i] = measured[i][0];
    for (std::size_t t = 0; t < steps_.size(); ++t) {
      forward(predictor, turns, steps_[t]);
      if (t + 1 < steps_.size()) steps_[t + 1].before = steps_[t].after;
    }
    std::fill(gradient_.begin(), gradient_.end(), T{});
    backpropagation_.transpose(predictor.network);
    for (Adjoint& adjoint : adjoints_) adjoint.setZero();
    for (std::size_t t = steps_.size(); t-- > 0;) {
      for (std::size_t i = 0; i < measured.size(); ++i) {
        sum += pose_error(steps_[t].after[i], measured[i][t + 1], 1 / static_cast<double>(steps_.size()), adjoints_[i]);
      }
      backward(predictor, turns, steps_[t]);
    }
    return sum / static_cast<double>(steps_.size());
  }

  const AlignedBuffer<T>& gradient() const { return gradient_; }         ///< by the network's parameters
  const std::vector<Adjoint>& adjoints() const { return adjoints_; }     ///< by the first state of each rollout

 private:
  struct Contact {
    std::size_t rollout;
    int corner;
  };
  struct Step {
    std::vector<State> before, after;
    std::vector<Vec3<double>> push, twist, change, spin;
    std::vector<Contact> contacts;
    Columns inputs, outputs;
  };

  void forward(const CornerPredictor<Net>& predictor, const std::vector<int>& turns, Step& step) {
    step.contacts.clear();
    step.push.clear();
    step.twist.clear();
    step.change.assign(step.before.size(), {});
    step.spin.assign(step.before.size(), {});
    for (std::size_t i = 0; i < step.before.size(); ++i) {
      const State& state = step.before[i];
      const State free = free_flight(state);
      const State& next = step.after[i] = predictor.prior(state);
      step.push.push_back(next.velocity - free.velocity);
      step.twist.push_back(next.angular_velocity - free.angular_velocity);
      const Posture<double> posture(state, predictor.floor, step.push[i], step.twist[i]);
      for (int c = 0; c < Corner<double>::count; ++c) {
        const Corner<double> corner(posture, c, turns[i]);
        if (!corner.active()) continue;
        const auto x = corner.encode();
        auto column = step.inputs.col(static_cast<Eigen::Index>(step.contacts.size()));
        for (int k = 0; k < Net::input_size; ++k) column[k] = static_cast<T>(x[static_cast<std::size_t>(k)]);
        step.contacts.push_back({i, c});
      }
    }
    const auto columns = static_cast<Eigen::Index>(step.contacts.size());
    predictor.network.forward(step.inputs.leftCols(columns), step.outputs.leftCols(columns), workspace_);
    for (Eigen::Index n = 0; n < columns; ++n) {
      const auto [i, c] = step.contacts[static_cast<std::size_t>(n)];
      const Posture<double> posture(step.before[i], predictor.floor, step.push[i], step.twist[i]);
      const Corner<double> corner(posture, c, turns[i]);
      const Vec3<double> impulse = corner.impulse(step.outputs.col(n));
      step.change[i] += impulse;
      step.spin[i] += corner.spin_of(impulse);
    }
    for (std::size_t i = 0; i < step.after.size(); ++i) add_velocity(step.after[i], step.change[i], step.spin[i]);
  }

  /// From the adjoints of the states after to those of the states before, adding to the parameters' gradient.
  void backward(const CornerPredictor<Net>& predictor, const std::vector<int>& turns, const Step& step) {
    // What the learned velocities change, and then free flight, which stands for the prior.
    for (std::size_t i = 0; i < adjoints_.size(); ++i) {
      Adjoint& adjoint = adjoints_[i];
      auto rotation = adjoint.segment<3>(3);
      learned_[i] << adjoint.segment<3>(6) + frame_time * adjoint.segment<3>(0),
          adjoint.segment<3>(9) + frame_time * pull_back_turn(frame_time * step.spin[i], rotation);
      adjoint.segment<3>(6) += frame_time * adjoint.segment<3>(0);
      adjoint.segment<3>(9) += frame_time * pull_back_turn(frame_time * step.before[i].angular_velocity, rotation);
    }
    const std::size_t columns = step.contacts.size();
    if (columns == 0) return;
    for (std::size_t n = 0; n < columns; ++n) {
      const auto [i, c] = step.contacts[n];
      const Posture<double> posture(step.before[i], predictor.floor, step.push[i], step.twist[i]);
      const Corner<double> corner(posture, c, turns[i]);
      const Vec3<double> by_velocity(learned_[i].template head<3>()), by_spin(learned_[i].template tail<3>());
      const Vec3<double> by_impulse = by_velocity + (mass / inertia) * cross(posture.axes * by_spin, corner.arm());
      std::array<double, Corner<double>::coefficients> by_output;
      corner.pull_back(by_impulse, by_output);
      for (std::size_t k = 0; k < by_output.size(); ++k) {
        pulled_(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(n)) = static_cast<T>(by_output[k]);
      }
    }
    pulled_columns_ = columns;
    backpropagation_.run(predictor.network, {columns_of(step.inputs), columns_of(step.outputs)}, loss_,
                         std::span(order_).first(columns), DropoutMask{}, 1, true);
    backpropagation_.parameter_gradient(1, [this](std::size_t place, detail::Simd<T> g, bool) {
      detail::store(gradient_.data() + place, detail::load(gradient_.data() + place) + g);
    });
    const auto by_input = backpropagation_.input_gradient();
    for (std::size_t n = 0; n < columns; ++n) {
      const auto [i, c] = step.contacts[n];
      const Posture<Dual> posture(with_derivatives(step.before[i]), predictor.floor, step.push[i], step.twist[i]);
      const Corner<Dual> corner(posture, c, turns[i]);
      const auto column = static_cast<Eigen::Index>(n);
      const Vec3<Dual> impulse = corner.impulse(step.outputs.col(column));
      const Vec3<Dual> spin = corner.spin_of(impulse);
      const auto& by = learned_[i];
      Eigen::Matrix<double, 10, 1> by_state = by[0] * impulse.x.derivatives() + by[1] * impulse.y.derivatives() +
                                              by[2] * impulse.z.derivatives() + by[3] * spin.x.derivatives() +
                                              by[4] * spin.y.derivatives() + by[5] * spin.z.derivatives();
      const auto x = corner.encode();
      for (std::size_t k = 0; k < x.size(); ++k) {
        by_state += static_cast<double>(by_input(static_cast<Eigen::Index>(k), column)) * x[k].derivatives();
      }
      adjoints_[i].template tail<10>() += by_state;
    }
  }

  static ColumnsView<T> columns_of(const Columns& matrix) { return {matrix.data(), matrix.rows(), matrix.cols()}; }

  static RigidState<Dual> with_derivatives(const State& state) {
    const auto number = [](double x, int place) { return Dual(x, 10, place); };
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
    return s;
  }

  typename Net::Workspace workspace_;
  Backpropagation<Net> backpropagation_;
  std::vector<Step> steps_;
  Loss<T> loss_;
  std::vector<std::uint32_t> order_;
  Columns pulled_;
  std::size_t pulled_columns_ = 0;
  AlignedBuffer<T> gradient_;
  std::vector<Adjoint> adjoints_;
  std::vector<Eigen::Matrix<double, 6, 1>> learned_;  ///< gradients by what the network adds to each rollout's velocities
};

struct RolloutTraining {
  int frames = 16;
  int batch = 256;  ///< rollouts a step
  int steps = 1500;
  double rate = 5e-3;  ///< of Adam at its height; up over the first 100 steps, then down along half a cosine
  double clip = 1;     ///< largest norm of a step's gradient: one wild rollout must not throw the network off
  std::uint64_t seed = 1;
};

/// What the sum of the rollouts' gradients is multiplied with so that its norm is at most `largest`.
template <class Net>
typename Net::Scalar shrinkage(const std::vector<std::unique_ptr<Rollouts<Net>>>& rollouts, double largest) {
  double sum = 0;
  for (std::size_t at = 0; at < Net::block_size; ++at) {
    double g = 0;
    for (const auto& r : rollouts) g += static_cast<double>(r->gradient()[at]);
    sum += g * g;
  }
  return static_cast<typename Net::Scalar>(sum > largest * largest ? largest / std::sqrt(sum) : 1.0);
}

/// Trains a predictor's network on rollouts from random frames of the tosses, up to shortly after the cube has come to rest.
/// progress(steps done, mean error of their rollouts in m) every hundredth of the way. The bits do not depend on the
/// number of threads. Throws Error where no toss is long enough.
template <class Net, class Progress>
void train(CornerPredictor<Net>& predictor, const std::vector<Toss>& tosses, const RolloutTraining& options,
           const Progress& progress) {
  using T = typename Net::Scalar;
  std::vector<const State*> starts;
  for (const Toss& toss : tosses) {
    const auto moves = [](const State& s) {
      return std::sqrt(squared_norm(s.velocity)) + half_width * std::sqrt(squared_norm(s.angular_velocity)) > 0.05;
    };
    const auto rest = std::find_if(toss.rbegin(), toss.rend(), moves).base() - toss.begin() + 5;
    const auto last = std::min<std::ptrdiff_t>(rest, std::ssize(toss) - options.frames);
    for (std::ptrdiff_t t = 0; t < last; ++t) starts.push_back(&toss[static_cast<std::size_t>(t)]);
  }
  if (starts.empty()) {
    detail::refuse("training", detail::text("a toss of more than ", options.frames, " frames"), "none");
  }

  constexpr int chunk = 32;  // rollouts a task: the sum of gradients does not depend on who does which
  std::vector<std::unique_ptr<Rollouts<Net>>> rollouts;
  std::vector<std::vector<const State*>> first;
  std::vector<std::vector<int>> turns;
  for (int begin = 0; begin < options.batch; begin += chunk) {
    const int count = std::min(chunk, options.batch - begin);
    rollouts.push_back(std::make_unique<Rollouts<Net>>(count, options.frames));
    first.emplace_back(static_cast<std::size_t>(count));
    turns.emplace_back(static_cast<std::size_t>(count));
  }
  std::vector<double> errors(rollouts.size());
  AlignedBuffer<T> moments(Adam::moment_count * Net::block_size);
  double sum = 0;
  int summed = 0;
  for (int step = 0; step < options.steps; ++step) {
    Random random(options.seed, static_cast<std::uint64_t>(step));
    for (std::size_t i = 0; i < rollouts.size(); ++i) {
      for (auto& s : first[i]) s = starts[random.below(static_cast<std::uint32_t>(starts.size()))];
      for (int& turn : turns[i]) turn = static_cast<int>(random.below(Corner<double>::turns));
    }
    parallel_for(std::ssize(rollouts), 0, [&](std::ptrdiff_t task) {
      const auto i = static_cast<std::size_t>(task);
      errors[i] = rollouts[i]->run(predictor, first[i], turns[i]);
    });
    for (const double error : errors) sum += error / options.batch;

    const double height = std::min(1.0, (step + 1) / 100.0);
    const double rate = height * options.rate * (1 + std::cos(std::numbers::pi * step / options.steps)) / 2;
    const auto rule = Adam{}.rule<T>(rate, static_cast<std::uint64_t>(step) + 1);
    const T shrink = shrinkage(rollouts, options.batch * options.clip);
    T* parameters = predictor.network.parameters().data();
    for (std::size_t at = 0; at < Net::block_size; at += static_cast<std::size_t>(detail::simd_width<T>)) {
      detail::Simd<T> g{}, m[2] = {detail::load(moments.data() + at), detail::load(moments.data() + Net::block_size + at)};
      for (const auto& r : rollouts) g += shrink * detail::load(r->gradient().data() + at);
      detail::store(parameters + at, rule(detail::load(parameters + at), g, m, true));
      detail::store(moments.data() + at, m[0]);
      detail::store(moments.data() + Net::block_size + at, m[1]);
    }
    ++summed;
    if ((step + 1) % std::max(1, options.steps / 100) == 0 || step + 1 == options.steps) {
      progress(step + 1, sum / summed);
      sum = summed = 0;
    }
  }
}

}  // namespace rbres::tosses
