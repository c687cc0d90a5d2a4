#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <rbres/contact/impulse.hpp>
#include <rbres/core/reserved.hpp>
#include <span>

namespace rbres::detail {

/// A symmetric positive definite matrix of 6 x 6 blocks, one row of blocks for each body of an island, stored
/// row by row from its first block that is not zero; its Cholesky factor stays within the same profile.
template <class S>
class BlockProfile {
 public:
  explicit BlockProfile(std::size_t most_bodies, std::size_t most_numbers) : capacity_(most_numbers) {
    first_.reserve(most_bodies);
    start_.reserve(6 * most_bodies);
    numbers_.reserve(most_numbers);
  }

  /// Sets up a matrix in which the row of block i starts at block first[i] <= i. False where factoring it
  /// would take more than `most_products` multiplications.
  bool shape(std::span<const std::size_t> first, std::size_t most_products) {
    first_.assign(first.begin(), first.end());
    start_.clear();
    std::size_t size = 0, products = 0;
    for (std::size_t i = 0; i < first_.size(); ++i) {
      for (std::size_t k = 0; k < 6; ++k) {
        const std::size_t length = 6 * (i - first_[i]) + k + 1;
        start_.push_back(size);
        size += length;
        products += length * length / 2;
        if (products > most_products || size > capacity_) return false;
      }
    }
    numbers_.resize(size);
    return true;
  }
  void clear() { std::fill(numbers_.begin(), numbers_.end(), S(0)); }
  /// Entry (row, column), column <= row, both inside the profile.
  S& operator()(std::size_t row, std::size_t column) { return numbers_[start_[row] + column - begin(row)]; }

  /// Replaces the matrix by its Cholesky factor L; the diagonal holds one over L's.
  void factor() {
    for (std::size_t i = 0; i < start_.size(); ++i) {
      S* row = &numbers_[start_[i]];
      const std::size_t begin_i = begin(i);
      S rest = row[i - begin_i];
      for (std::size_t j = begin_i; j < i; ++j) {
        const S* other = &numbers_[start_[j]];
        const std::size_t begin_j = begin(j), from = std::max(begin_i, begin_j);
        S sum = row[j - begin_i];
        for (std::size_t k = from; k < j; ++k) sum -= row[k - begin_i] * other[k - begin_j];
        row[j - begin_i] = sum * other[j - begin_j];
        rest -= square(row[j - begin_i]);
      }
      row[i - begin_i] = S(1) / root(maximum(rest, S(Constants<S>::tiny)));
    }
  }
  /// Solves L L^T x = b in place.
  void solve(Reserved<S>& b) const {
    for (std::size_t i = 0; i < start_.size(); ++i) {
      const S* row = &numbers_[start_[i]];
      const std::size_t begin_i = begin(i);
      for (std::size_t j = begin_i; j < i; ++j) b[i] -= row[j - begin_i] * b[j];
      b[i] *= row[i - begin_i];
    }
    for (std::size_t i = start_.size(); i-- > 0;) {
      const S* row = &numbers_[start_[i]];
      const std::size_t begin_i = begin(i);
      b[i] *= row[i - begin_i];
      for (std::size_t j = begin_i; j < i; ++j) b[j] -= row[j - begin_i] * b[i];
    }
  }

 private:
  std::size_t begin(std::size_t row) const { return 6 * first_[row / 6]; }

  std::size_t capacity_;
  Reserved<std::size_t> first_, start_;
  Reserved<S> numbers_;
};

/// Solves the contact laws of one island: u_n >= target, complementary to p_n >= 0, and Coulomb's friction
/// with it. The fixed point p = projection of p - rho (u - target) (Alart and Curnier 1991) is found by the
/// method of multipliers: with the friction cones' radii held, a convex function of the bodies' velocities is
/// minimised by Newton's method, M dv = J^T (projected - p); then impulses and radii follow. Any number of
/// points may share a face, and any mass may rest on any other.
template <class System>
class IslandNewton {
  using S = typename System::Scalar;
  static constexpr std::size_t N = System::bodies;

 public:
  explicit IslandNewton(std::size_t most_rows)
      : matrix_(N, std::min<std::size_t>(6 * N * (6 * N + 1) / 2, most_numbers)) {
    bodies_.reserve(N);
    first_.reserve(N);
    inertia_.reserve(N);
    b_.reserve(6 * N);
    moved_.reserve(6 * N);
    rows_.reserve(most_rows);
  }

  /// Changes the impulses of `rows` (ContactRows) and the velocities in `motion` in the lanes `where`, until
  /// no law is off by more than `tolerance` (m/s), or none gets better. False, with nothing done, for islands
  /// too large for it.
  template <class Rows, class Motions>
  bool solve(Rows& rows, Motions& motion, const MaskOf<S>& where, bool friction, const S& tolerance) {
    if (!number_bodies(rows, motion)) return false;
    constexpr int rounds = 60, patience = 8, newton_steps = 30;
    MaskOf<S> working = where;
    S pace(1);  // at which cones follow their normal impulses
    S mark(std::numeric_limits<typename Constants<S>::Real>::max());
    best_ = mark;
    for (int round = 1; round <= rounds; ++round) {
      // Soft at first, or Newton's method would hunt for the points that touch.
      stiffness_ = as<S>(std::min(hardest, 10 * std::pow(10.0, round)));
      const S worst = read(rows, motion, friction, round == 1 ? S(1) : pace);
      keep_best(worst);
      working = working & (worst > tolerance);
      if (round % patience == 0) {
        // Cones and normal impulses that chase one another agree sooner when they go slower.
        const MaskOf<S> better = worst < as<S>(0.5) * mark;
        pace = select(better, pace, S(as<S>(0.3) * pace));
        working = working & (pace > as<S>(0.02));
        mark = worst;
      }
      if (!any(working) || round == rounds) break;
      MaskOf<S> stepping = working;
      for (int step = 1;; ++step) {
        set_up();
        matrix_.factor();
        matrix_.solve(b_);
        S largest(0);
        for (RowState& r : rows_) {
          apply_jacobian(r);
          for (std::size_t d = 0; d < 3; ++d)
            largest = maximum(largest, select(r.active, S(abs_of(r.change[d])), S(0)));
        }
        stepping = stepping & (largest > as<S>(0.1) * tolerance);
        if (step == newton_steps || !any(stepping)) break;
        advance(step_length(), stepping);
      }
      // Impulses by the linear model of the last step: they and the velocities agree to rounding.
      std::size_t k = 0;
      rows.each(motion, [&](auto&, auto& point, auto& first, auto& second) {
        const RowState& r = rows_[k++];
        std::array<S, 3> change;
        for (std::size_t d = 0; d < 3; ++d) {
          change[d] = r.projected[d] - r.impulse[d];
          for (std::size_t e = 0; e < 3; ++e) change[d] -= r.slope[d][e] * r.change[e];
          change[d] = select(working & r.active, change[d], S(0));
        }
        point.add(change, first, second);
      });
    }
    std::size_t k = 0;
    rows.each(motion, [&](auto&, auto& point, auto& first, auto& second) {
      Three change;
      for (std::size_t d = 0; d < 3; ++d)
        change[d] = select(where, S(rows_[k].best[d] - point.impulse()[d]), S(0));
      point.add(change, first, second);
      ++k;
    });
    return true;
  }

 private:
  /// Of a factorisation: an island of 9 bodies in a heap, or of some 100 in a row. Larger ones take as many
  /// numbers, too.
  static constexpr std::size_t most_products = 40'000, most_numbers = 10'000;
  /// The largest of stiffness_.
  static constexpr double hardest = std::is_same_v<typename Constants<S>::Real, float> ? 1e3 : 1e7;
  using Six = std::array<S, 6>;
  using Three = std::array<S, 3>;

  struct RowState {
    std::size_t first, second;               ///< the bodies' places in the island; N for a plane
    std::array<Six, 3> on_first, on_second;  ///< lines of the Jacobian
    MaskOf<S> active;
    S rho, most;  ///< most: the friction cone's radius, N s
    Three best;   ///< impulse with the least fault, N s
    Three impulse,
        fault;        ///< of the round; fault: relative velocity less target, as Newton's method moves it
    Three projected;  ///< of impulse - rho fault
    std::array<Three, 3> slope;  ///< rho times the projection's derivative
    Three change;                ///< of the relative velocity by the step
  };

  void keep_best(const S& worst) {
    const MaskOf<S> better = worst < best_;
    best_ = select(better, worst, best_);
    for (RowState& r : rows_) {
      for (std::size_t d = 0; d < 3; ++d) r.best[d] = select(better, r.impulse[d], r.best[d]);
    }
  }
  static S abs_of(const S& x) {
    using std::abs;
    return abs(x);
  }

  /// Gives each body a place, in the order in which the rows name them, and the matrix its profile. False
  /// where it would be too large.
  template <class Rows, class Motions>
  bool number_bodies(Rows& rows, Motions& motion) {
    bodies_.clear();
    first_.clear();
    rows_.clear();
    place_.fill(N);
    if constexpr (Packed<S>) {  // the same places, whatever touches in other lanes
      for (std::size_t i = 0; i < N; ++i) {
        place_[i] = i;
        bodies_.push_back(static_cast<int>(i));
        first_.push_back(0);
      }
    }
    const auto place = [&](int body) {
      std::size_t& at = place_[static_cast<std::size_t>(body)];
      if (at == N) {
        at = bodies_.size();
        bodies_.push_back(body);
        first_.push_back(at);
      }
      return at;
    };
    rows.each(motion, [&](auto& row, auto& point, auto&, auto&) {
      RowState& r = rows_.emplace_back();
      const auto line = [](const Vec3<S>& direction, const Vec3<S>& arm) {
        return Six{direction.x, direction.y, direction.z, arm.x, arm.y, arm.z};
      };
      r.active = row.active;
      r.first = N;
      r.second = place(row.who.second);
      for (std::size_t d = 0; d < 3; ++d) r.on_second[d] = line(point.direction(d), point.second_arm(d));
      if constexpr (requires { point.first_arm(0); }) {
        r.first = place(row.who.first);
        for (std::size_t d = 0; d < 3; ++d) r.on_first[d] = line(-point.direction(d), -point.first_arm(d));
        const auto [low, high] = std::minmax(r.first, r.second);
        first_[high] = std::min(first_[high], low);
      }
    });
    b_.resize(6 * bodies_.size());
    moved_.resize(6 * bodies_.size());
    inertia_.clear();
    for (const int body : bodies_) {
      const Motion<S>& m = motion[static_cast<std::size_t>(body)];
      inertia_.push_back({inverse(m.inverse_mass), symmetric_inverse(m.inverse_inertia)});
    }
    return matrix_.shape(first_, most_products);
  }

  /// Where a round starts; cones go the share `pace` of their way to the normal impulses. Returns by how much
  /// the worst law is off, m/s.
  template <class Rows, class Motions>
  S read(Rows& rows, Motions& motion, bool friction, const S& pace) {
    S worst(0);
    std::size_t k = 0;
    std::fill(moved_.begin(), moved_.end(), S(0));
    rows.each(motion, [&](auto& row, auto& point, auto& first, auto& second) {
      RowState& r = rows_[k++];
      r.rho = stiffness_ / point.normal_response();
      r.impulse = point.impulse();
      for (std::size_t d = 0; d < 3; ++d) r.fault[d] = point.velocity(d, first, second);
      r.fault[0] -= row.target;
      const S most = friction ? S(row.friction * maximum(r.impulse[0], S(0))) : S(0);
      r.most = select(pace < S(1), S(r.most + pace * (most - r.most)), most);
      const S& g = point.normal_response();
      const S fair = maximum(S(r.impulse[0] - r.fault[0] / g), S(0));
      worst = maximum(worst, select(row.active, S(g * abs_of(r.impulse[0] - fair)), S(0)));
      if (friction) {
        const S& gt = point.tangent_response();
        const S u = r.impulse[1] - r.fault[1] / gt, v = r.impulse[2] - r.fault[2] / gt;
        const S share = inside(u, v, most);
        const S off = abs_of(S(r.impulse[1] - share * u)) + abs_of(S(r.impulse[2] - share * v));
        worst = maximum(worst, select(row.active, S(gt * off), S(0)));
      }
    });
    return worst;
  }

  /// The share of (u, v) that lies within a circle.
  static S inside(const S& u, const S& v, const S& radius) {
    const S length2 = square(u) + square(v);
    const MaskOf<S> outside = length2 >= square(radius);
    return select(outside, S(radius * inverse_root(S(length2 + S(Constants<S>::tiny)))), S(1));
  }

  /// The projection of impulse - rho (fault + length change).
  static Three project(const RowState& r, const S& length) {
    Three q;
    for (std::size_t d = 0; d < 3; ++d) q[d] = r.impulse[d] - r.rho * (r.fault[d] + length * r.change[d]);
    const S share = inside(q[1], q[2], r.most);
    return {maximum(q[0], S(0)), share * q[1], share * q[2]};
  }

  /// The equations of one step.
  void set_up() {
    matrix_.clear();
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const auto& [mass, inertia] = inertia_[i];
      for (std::size_t d = 0; d < 3; ++d) matrix_(6 * i + d, 6 * i + d) = mass;
      matrix_(6 * i + 3, 6 * i + 3) = inertia.x.x;
      matrix_(6 * i + 4, 6 * i + 3) = inertia.x.y;
      matrix_(6 * i + 4, 6 * i + 4) = inertia.y.y;
      matrix_(6 * i + 5, 6 * i + 3) = inertia.x.z;
      matrix_(6 * i + 5, 6 * i + 4) = inertia.y.z;
      matrix_(6 * i + 5, 6 * i + 5) = inertia.z.z;
      const Six m = momentum(i, &moved_[6 * i]);
      for (std::size_t d = 0; d < 6; ++d) b_[6 * i + d] = -m[d];
    }
    for (RowState& r : rows_) {
      Three q;
      for (std::size_t d = 0; d < 3; ++d) q[d] = r.impulse[d] - r.rho * r.fault[d];
      const S share = inside(q[1], q[2], r.most);
      r.projected = {maximum(q[0], S(0)), share * q[1], share * q[2]};
      const MaskOf<S> pushes = r.active & (q[0] > S(0)), slides = share < S(1);
      const S along = select(slides, S(share / (square(q[1]) + square(q[2]) + S(Constants<S>::tiny))), S(0));
      const S rho = select(r.active, r.rho, S(0));
      for (auto& line : r.slope) line = {S(0), S(0), S(0)};
      r.slope[0][0] = select(pushes, r.rho, S(0));
      r.slope[1][1] = rho * (share - along * square(q[1]));
      r.slope[2][2] = rho * (share - along * square(q[2]));
      r.slope[1][2] = r.slope[2][1] = S(-rho * along * q[1] * q[2]);
      add(r);
    }
  }

  /// J^T slope J and J^T (projected - impulse) of one row.
  void add(const RowState& r) {
    const auto block = [&](std::size_t i, const auto& left, std::size_t j, const auto& right) {
      std::array<Six, 3> sloped;
      for (std::size_t d = 0; d < 3; ++d) {
        for (std::size_t c = 0; c < 6; ++c) {
          sloped[d][c] =
              r.slope[d][0] * right[0][c] + r.slope[d][1] * right[1][c] + r.slope[d][2] * right[2][c];
        }
      }
      for (std::size_t k = 0; k < 6; ++k) {
        S* line = &matrix_(6 * i + k, 6 * j);
        const std::size_t end = i == j ? k + 1 : 6;
        for (std::size_t c = 0; c < end; ++c)
          line[c] += left[0][k] * sloped[0][c] + left[1][k] * sloped[1][c] + left[2][k] * sloped[2][c];
      }
    };
    const auto push = [&](std::size_t i, const auto& side) {
      for (std::size_t d = 0; d < 3; ++d) {
        const S p = select(r.active, S(r.projected[d] - r.impulse[d]), S(0));
        for (std::size_t k = 0; k < 6; ++k) b_[6 * i + k] += side[d][k] * p;
      }
    };
    push(r.second, r.on_second);
    if (r.first != N) push(r.first, r.on_first);
    const MaskOf<S> pushes = r.slope[0][0] > S(0), rubs = r.slope[1][1] + r.slope[2][2] > S(0);
    if (!any(pushes | rubs)) return;
    block(r.second, r.on_second, r.second, r.on_second);
    if (r.first == N) return;
    block(r.first, r.on_first, r.first, r.on_first);
    if (r.second > r.first) {
      block(r.second, r.on_second, r.first, r.on_first);
    } else {
      block(r.first, r.on_first, r.second, r.on_second);
    }
  }

  void apply_jacobian(RowState& r) const {
    for (std::size_t d = 0; d < 3; ++d) {
      r.change[d] = S(0);
      for (std::size_t k = 0; k < 6; ++k) {
        r.change[d] += r.on_second[d][k] * b_[6 * r.second + k];
        if (r.first != N) r.change[d] += r.on_first[d][k] * b_[6 * r.first + k];
      }
    }
  }

  /// How far to go along the step: all the way, or to where the function's slope is a fraction of what it
  /// was.
  S step_length() const {
    S bend(0), rise(0);  // of the kinetic part
    for (std::size_t i = 0; i < bodies_.size(); ++i) {
      const Six m = momentum(i, &b_[6 * i]);
      for (std::size_t d = 0; d < 6; ++d) {
        bend += m[d] * b_[6 * i + d];
        rise += m[d] * moved_[6 * i + d];
      }
    }
    const auto slope = [&](const S& length) {
      S sum = rise + length * bend;
      for (const RowState& r : rows_) {
        const Three p = project(r, length);
        for (std::size_t d = 0; d < 3; ++d)
          sum += select(r.active, S((r.impulse[d] - p[d]) * r.change[d]), S(0));
      }
      return sum;
    };
    S low(0), high(1), at_low = slope(low), at_high = slope(high);
    const S enough = as<S>(0.1) * abs_of(at_low);
    S length(1);
    MaskOf<S> searching = at_high > enough;
    for (int i = 0; i < 20 && any(searching); ++i) {
      // Illinois' method would do; halving now and then keeps kinks from stalling it.
      const S fall = at_high - at_low;
      const S secant = low - at_low * (high - low) / select(fall > S(0), fall, S(1));
      const S middle = S(0.5) * (low + high);
      const S next = select(searching, i % 3 == 2 ? middle : secant, length);
      const S found = slope(next);
      length = next;
      const MaskOf<S> above = found > S(0);
      high = select(above, next, high);
      at_high = select(above, found, at_high);
      low = select(above, low, next);
      at_low = select(above, at_low, found);
      searching = searching & (abs_of(found) > enough);
    }
    return length;
  }

  /// Goes along the step.
  void advance(const S& length, const MaskOf<S>& where) {
    const S way = select(where, length, S(0));
    for (std::size_t i = 0; i < moved_.size(); ++i) moved_[i] += way * b_[i];
    for (RowState& r : rows_) {
      for (std::size_t d = 0; d < 3; ++d) r.fault[d] += way * r.change[d];
    }
  }

  /// Mass and inertia times a velocity.
  Six momentum(std::size_t i, const S* v) const {
    const auto& [mass, inertia] = inertia_[i];
    const Vec3<S> spin = inertia * Vec3<S>{v[3], v[4], v[5]};
    return {mass * v[0], mass * v[1], mass * v[2], spin.x, spin.y, spin.z};
  }
  struct Inertia {
    S mass;
    Mat3<S> tensor;  ///< world frame
  };

  S stiffness_, best_;  ///< rho times a point's response; the least fault so far, m/s
  std::array<std::size_t, N> place_;
  Reserved<int> bodies_;
  Reserved<std::size_t> first_;
  Reserved<Inertia> inertia_;
  Reserved<RowState> rows_;
  BlockProfile<S> matrix_;
  Reserved<S> b_;      ///< right side, then the step of the bodies' velocities
  Reserved<S> moved_;  ///< by the steps of this round
};

}  // namespace rbres::detail
