#pragma once

#include <limits>
#include <rbres/contact/impact_event.hpp>
#include <rbres/contact/pair_newton.hpp>
#include <type_traits>

namespace rbres::RBRES_ABI {

/// What two surfaces agree on.
template <class S>
struct Surface {
  /// Of the two surfaces together.
  /// @{
  S restitution, friction;
  /// @}
};

namespace detail {

/// One point of an impact: what is asked of it, and what friction does to it.
template <class S>
struct ImpactPoint {
  MaskOf<S> active;            ///< takes part
  MaskOf<S> approaches;        ///< before the impact
  S target;                    ///< least speed along the normal after the impact, m/s
  std::array<S, 3> before;     ///< relative velocity before the impact, m/s
  std::array<S, 3> impulse{};  ///< of the solution with friction, N s
  std::array<S, 3> after{};    ///< relative velocity that it leaves, m/s
};

/// Finds the impulses of an impact in the lanes where `hit` holds, such that kinetic energy does not rise.
/// `rows` has each(f), which calls f(ImpactPoint&, contact point, first motion, second motion) for the points
/// that take part, and solve(friction, where), which brings them to their targets.
///
/// Newton's restitution together with Coulomb's friction may create energy (Kane and Levinson 1985). There
/// the impulses are drawn back towards those without friction, which create none, until energy does not rise.
/// Targets and cones are convex, so whatever lies between two solutions keeps them, too.
template <class S, class Rows>
void solve_impact(Rows& rows, const MaskOf<S>& hit) {
  using std::abs;
  rows.solve(true, hit);
  // The work of an impulse: the impulse times the mean of the velocities before and after.
  S gained(0), passed(0);
  rows.each([&](ImpactPoint<S>& row, auto& point, auto& first, auto& second) {
    row.impulse = point.impulse();
    for (std::size_t d = 0; d < 3; ++d) {
      row.after[d] = point.velocity(d, first, second);
      gained += select(row.active, S(S(0.5) * row.impulse[d] * (row.before[d] + row.after[d])), S(0));
      passed += select(row.active, S(abs(S(row.impulse[d] * row.before[d]))), S(0));
    }
  });
  const MaskOf<S> created = hit & (gained > S(4) * S(Constants<S>::epsilon) * passed);
  if (!any(created)) return;

  rows.each([&](ImpactPoint<S>& row, auto& point, auto& first, auto& second) {
    std::array<S, 3> back;
    for (std::size_t d = 0; d < 3; ++d) back[d] = select(created, S(-row.impulse[d]), S(0));
    point.add(back, first, second);
    // Points that leave are held back by friction alone, if at all: without it they need nothing.
    row.active = row.active & (row.approaches | !created);
  });
  rows.solve(false, created);
  // Without friction the work is p0 v0 + 1/2 p0 (w0 - v0) <= 0: what the solver left undone is scaled away.
  S along(0), bent(0);
  rows.each([&](ImpactPoint<S>& row, auto& point, auto& first, auto& second) {
    const S p = select(row.active & created, point.impulse()[0], S(0));
    along += p * row.before[0];
    bent += p * (point.velocity(0, first, second) - row.before[0]);
  });
  const MaskOf<S> bends = bent > S(0);
  const S scale = select(bends, minimum(S(S(-2) * along / select(bends, bent, S(1))), S(1)), S(1));
  // Energy from the scaled solution (s = 0) to the one with friction (s = 1): a + b s + c s^2, a <= 0 <= c.
  const S a = minimum(S(scale * (along + S(0.5) * scale * bent)), S(0));
  S c(0);
  rows.each([&](ImpactPoint<S>& row, auto& point, auto& first, auto& second) {
    for (std::size_t d = 0; d < 3; ++d) {
      const S plain = row.before[d] + scale * (point.velocity(d, first, second) - row.before[d]);
      const S share = S(0.5) * (row.impulse[d] - scale * point.impulse()[d]) * (row.after[d] - plain);
      c += select(created, share, S(0));
    }
  });
  c = maximum(c, S(0));
  const S b = gained - a - c;
  const S discriminant = root(maximum(S(b * b - S(4) * a * c), S(0)));
  // Of the two forms of the root the one that does not cancel.
  const MaskOf<S> falls = b < S(0);
  const S over = select(falls, S(c + c), S(b + discriminant));
  const MaskOf<S> usable = over > S(0);
  const S way = select(falls, S(discriminant - b), S(S(-2) * a)) / select(usable, over, S(1));
  const S share = select(usable, clamp(way, S(0), S(1)), S(0));
  rows.each([&](ImpactPoint<S>& row, auto& point, auto& first, auto& second) {
    std::array<S, 3> change;
    for (std::size_t d = 0; d < 3; ++d) {
      const S plain = scale * point.impulse()[d];
      change[d] = select(created, S(plain + share * (row.impulse[d] - plain) - point.impulse()[d]), S(0));
    }
    point.add(change, first, second);
  });
}

/// The points of one pair, as solve_impact wants them.
template <bool Fixed, class S, int P, bool Central>
class PairImpact {
 public:
  PairImpact(const Manifold<S, P, Central>& manifold, Motion<S>& first, Motion<S>& second)
      : manifold_(manifold), first_(first), second_(second) {}

  /// Takes up point i where `touching` and it does not leave. Returns where it approaches faster than
  /// `least_speed`.
  MaskOf<S> take(std::size_t i, const MaskOf<S>& touching, const Surface<S>& surface, const S& rest_speed,
                 const S& least_speed) {
    using std::abs;
    friction_ = surface.friction;
    info_[i].value.active = touching;
    if (P > 1 && !any(touching)) return touching;
    auto& point =
        *std::construct_at(&points_[i].value, manifold_.normal, manifold_.point[i], first_, second_);
    ImpactPoint<S>& row = info_[i].value;
    for (std::size_t d = 0; d < 3; ++d) row.before[d] = point.velocity(d, first_, second_);
    const S& speed = row.before[0];
    const MaskOf<S> comes = speed <= S(0), bounces = speed < -rest_speed, hits = speed < -least_speed;
    row.active = touching & comes;
    row.approaches = comes;
    row.target = select(bounces, S(-surface.restitution * speed), S(0));
    for (std::size_t d = 0; d < 3; ++d)
      fastest_ = maximum(fastest_, select(row.active, S(abs(row.before[d])), S(0)));
    return row.active & hits;
  }

  const ContactPoint<S, Fixed, Central>& point(std::size_t i) const { return points_[i].value; }
  template <class F>
  void each(const F& f) {
    for (std::size_t i = 0; i < P; ++i) {
      if (any(info_[i].value.active)) f(info_[i].value, points_[i].value, first_, second_);
    }
  }
  /// Newton's method, then Gauss-Seidel over the points, which is done at once where the former was.
  void solve(bool friction, const MaskOf<S>& where) {
    constexpr int sweeps = Central ? 1 : 400, patience = 12;
    const S enough = S(64) * S(Constants<S>::epsilon) * fastest_;
    if constexpr (!Central) start(friction ? friction_ : S(0), where, enough);
    MaskOf<S> working = where;
    S rate(1), mark(std::numeric_limits<typename Constants<S>::Real>::max());
    for (int k = 1; k <= sweeps && any(working); ++k) {
      S worst(0);
      each([&](ImpactPoint<S>& row, auto& point, auto& first, auto& second) {
        const MaskOf<S> active = row.active & working;
        worst = maximum(worst, friction ? point.relax(row.target, friction_, active, first, second, rate)
                                        : point.relax_normal(row.target, active, first, second));
      });
      working = working & (worst > enough);
      if (k % patience == 0) {
        // Points that chase one another with their friction agree sooner when they go slower.
        rate = select(worst < as<S>(0.8) * mark, rate, S(S(0.5) * rate));
        working = working & (rate > as<S>(0.1));
        mark = worst;
      }
    }
  }

 private:
  /// Starts from the impulses that Newton's method finds.
  void start(const S& friction, const MaskOf<S>& where, const S& enough) {
    std::size_t some = 0;
    while (!any(info_[some].value.active)) ++some;
    PairNewton<S, Fixed, std::size_t(P)> newton(points_[some].value.frame(), first_, second_);
    each([&](const ImpactPoint<S>& row, const auto& point, auto&, auto&) {
      newton.add(point, row.target, row.active & where);
    });
    newton.solve(friction, enough);
    std::size_t i = 0;
    each([&](auto&, auto& point, auto& first, auto& second) {
      newton.apply(i++, friction, point, first, second);
    });
  }

  const Manifold<S, P, Central>& manifold_;
  Motion<S>& first_;
  Motion<S>& second_;
  S friction_{0}, fastest_{0};
  std::array<Unset<ImpactPoint<S>>, std::size_t(P)> info_;
  std::array<Unset<ContactPoint<S, Fixed, Central>>, std::size_t(P)> points_;
};

/// See resolve_impact(). Calls note(point, impulse) for each point that took part (world frame, m and N s).
template <bool Fixed, class S, int P, bool Central, class Note>
MaskOf<S> resolve_pair(const Manifold<S, P, Central>& manifold,
                       const std::array<MaskOf<S>, std::size_t(P)>& touching, const Surface<S>& surface,
                       const S& rest_speed, const S& least_speed, Motion<S>& first, Motion<S>& second,
                       const Note& note) {
  PairImpact<Fixed, S, P, Central> pair(manifold, first, second);
  MaskOf<S> hit(false);
  for (std::size_t i = 0; i < P; ++i) hit = hit | pair.take(i, touching[i], surface, rest_speed, least_speed);
  if (!any(hit)) return hit;
  if constexpr (Central) {
    pair.solve(true, hit);  // normal and tangent do not mix: the law is dissipative as it is
  } else {
    solve_impact<S>(pair, hit);
  }
  if constexpr (!std::is_same_v<Note, Unheard>) {
    for (std::size_t i = 0; i < P; ++i) {
      if (any(touching[i])) note(manifold.point[i], impulse_of(pair.point(i)));
    }
  }
  return hit;
}

}  // namespace detail

/// Resolves the impact of one pair: all its points at once, each leaving with restitution times the speed it
/// came with (plastic below `rest_speed`), friction by Coulomb's law; energy never rises, see
/// detail::solve_impact. Points take part where `touching` holds and they do not part; nothing happens in
/// lanes where none approaches faster than `least_speed`. Returns where an impact happened. `first` is not
/// touched where it is a plane (Fixed).
template <bool Fixed, class S, int P, bool Central>
MaskOf<S> resolve_impact(const Manifold<S, P, Central>& manifold,
                         const std::type_identity_t<std::array<MaskOf<S>, std::size_t(P)>>& touching,
                         const Surface<S>& surface, const S& rest_speed, const S& least_speed,
                         Motion<S>& first, Motion<S>& second) {
  return detail::resolve_pair<Fixed>(manifold, touching, surface, rest_speed, least_speed, first, second,
                                     detail::Unheard{});
}

}  // namespace rbres::RBRES_ABI
