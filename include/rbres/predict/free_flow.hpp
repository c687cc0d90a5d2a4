#pragma once

#include <algorithm>
#include <bit>
#include <limits>
#include <rbres/core/pack.hpp>
#include <rbres/dynamics/forces.hpp>
#include <rbres/dynamics/free_flight.hpp>
#include <rbres/dynamics/integrators.hpp>
#include <utility>

namespace rbres::RBRES_ABI {

/// Where bodies would be if nothing were in their way: gravity, fluid friction, damping and each body's own
/// wrench, without contacts. The base that a predictor of residuals corrects, and the trivial predictor that
/// any other must beat.
template <int N>
struct FreeFlow {
  /// The bodies that fly, without the planes of the system that they come from.
  class System : public rbres::System<double, N, AnyShape<double>, 0> {
    using Base = rbres::System<double, N, AnyShape<double>, 0>;

   public:
    using Base::Base;
    /// The bodies of a system.
    template <class Shape, int P>
    System(const rbres::System<double, N, Shape, P>& system) : Base(bodies_of(system)) {}

   private:
    template <class Other>
    static typename Base::Bodies bodies_of(const Other& system) {
      return [&]<std::size_t... I>(std::index_sequence<I...>) {
        return typename Base::Bodies{typename Base::BodyType(system[int(I)])...};
      }
      (std::make_index_sequence<std::size_t(N)>{});
    }
  };

  /// What flies.
  System system;
  /// Acts on all bodies.
  Gravity<double> gravity{};
  /// Acts on all bodies.
  FluidFriction<double> friction{};
  /// Acts on all bodies.
  Damping<double> damping{};

  /// Step of the fourth-order integration, s.
  static constexpr double step = 0.02;
  static constexpr double longest = 3600;   ///< time that is followed, s
  static constexpr double shortest = 1e-6;  ///< horizon of a predictor, s

  /// The states after `duration` (s, at most `longest`); NaN for any other duration. Bodies do not act on one
  /// another, so those with one kind of shape share registers.
  SystemState<double, N> operator()(SystemState<double, N> y,
                                    const std::array<Wrench<double>, std::size_t(N)>& wrench,
                                    double duration) const noexcept {
    if constexpr (N == 1) {
      follow(system, ConstantWrench<double, N>{wrench}, y, duration);
    } else {
      std::array<bool, std::size_t(N)> done{};
      for (int b = 0; b < N; ++b)
        if (!done[std::size_t(b)]) follow_kind(b, done, y, wrench, duration);
    }
    return y;
  }

  /// The same for `count` starts, several in the lanes of a register: calls next(i, state) with the state
  /// after start(i) under wrench(i). Agrees with the above but for rounding.
  template <class Start, class WrenchOf, class Next>
  void each(std::ptrdiff_t count, const Start& start, const WrenchOf& wrench, double duration,
            const Next& next) const noexcept {
    constexpr int L = detail::double_lanes;
    using S = Pack<double, L>;
    const auto lanes = [&]<std::size_t... I>(std::index_sequence<I...>) {
      return rbres::System<S, N, AnyShape<S>, 0>({system[I].template cast<S>()...});
    }
    (std::make_index_sequence<std::size_t(N)>{});
    for (std::ptrdiff_t first = 0; first < count; first += L) {
      SystemState<S, N> y;
      ConstantWrench<S, N> own;
      for (int l = 0; l < L; ++l) {
        const std::ptrdiff_t i = std::min(first + l, count - 1);
        set_lane(y, l, start(i));
        set_lane(own, l, wrench(i));
      }
      follow(lanes, own, y, duration);
      for (int l = 0; l < L && first + l < count; ++l) next(first + l, lane(y, l));
    }
  }

 private:
  /// Takes body b and as many others of its kind of shape as fit into a register to their states after the
  /// duration.
  void follow_kind(int b, std::array<bool, std::size_t(N)>& done, SystemState<double, N>& y,
                   const std::array<Wrench<double>, std::size_t(N)>& wrench, double duration) const noexcept {
    constexpr int L = std::min(detail::double_lanes, int(std::bit_ceil(unsigned(N))));
    using S = Pack<double, L>;
    auto body = system[b].template cast<S>();
    SystemState<S, 1> states;
    ConstantWrench<S, 1> own;
    std::array<int, std::size_t(L)> members;
    int count = 0;
    for (int k = b; k < N && count < L; ++k) {
      if (done[std::size_t(k)] || system[k].shape().index() != system[b].shape().index()) continue;
      done[std::size_t(k)] = true;
      members[std::size_t(count++)] = k;
    }
    for (int l = 0; l < L; ++l) {
      const int k = members[std::size_t(std::min(l, count - 1))];
      body.set_lane(l, system[k]);
      set_lane(states, l, SystemState<double, 1>{{y[k]}});
      set_lane(own, l, std::array{wrench[std::size_t(k)]});
    }
    follow(rbres::System<S, 1, AnyShape<S>, 0>({body}), own, states, duration);
    for (int l = 0; l < count; ++l) y[members[std::size_t(l)]] = lane(states, l)[0];
  }

  /// Takes the states to those after the duration.
  template <class AnySystem, class Own>
  void follow(const AnySystem& bodies, const Own& own, typename AnySystem::State& y,
              double duration) const noexcept {
    using S = typename AnySystem::Scalar;
    if (!(duration >= 0 && duration <= longest)) {
      for (auto& body : y.body) {
        S* number = &body.position.x;
        std::fill_n(number, RigidState<S>::size, S(std::numeric_limits<double>::quiet_NaN()));
      }
      return;
    }
    const long steps = std::max(1L, std::lround(std::ceil(duration / step - 1e-9)));
    const double h = duration / static_cast<double>(steps);
    const auto fly = [&](const auto& forces) {
      for (long k = 0; k < steps; ++k) fly_on(bodies, forces, Rk4{}, y, S(static_cast<double>(k) * h), S(h));
    };
    // Without resistance no force depends on how a body moves, which saves more than half of the time.
    if (friction.density == 0 && damping.linear == 0 && damping.angular == 0) {
      fly(Forces{gravity, own});
    } else {
      fly(Forces{gravity, friction, damping, own});
    }
  }
};

}  // namespace rbres::RBRES_ABI
