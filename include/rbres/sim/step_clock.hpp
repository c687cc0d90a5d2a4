#pragma once

#include <rbres/contact/contact_pair.hpp>
#include <rbres/sim/resting_points.hpp>

namespace rbres::RBRES_ABI::detail {

/// A part of a step, if no impact ends it earlier.
template <class S>
struct StepPart {
  S seconds;
  MaskOf<S> running;    ///< lanes that take part
  ClosingRate<S> pull;  ///< of its resting contacts
};

/// How much of a step is left, and how long its parts may be.
template <class S>
class StepClock {
 public:
  /// A step of h seconds.
  StepClock(const S& h, bool in_crowd)
      : in_crowd_(in_crowd), h_(h), shortest_(as<S>(1.0 / 512) * h), left_(h), known_(h), longest_(h) {}

  /// s.
  const S& left() const { return left_; }
  /// The next part. No rest is left that is a rounding error: forces over such a part would be, too.
  StepPart<S> next() const {
    const S seconds = select(ends_before(left_, longest_), left_, longest_);
    const MaskOf<S> running = (left_ > S(0)) & !lost_;
    // Resting contacts close a tenth of their gap in a step, and more where its parts must be short. Bodies
    // of a heap that are wedged between walls overlap both: they would push for ever.
    return {seconds, running,
            ClosingRate<S>{as<S>(0.1) / h_, select(longest_ < h_, S(as<S>(0.5) / longest_), S(0)),
                           in_crowd_ ? as<S>(1.1 * heap_sinking) : S(0)}};
  }
  /// Whether a part ends where that before it would have without an impact.
  bool goes_on(const StepPart<S>& part) const { return all(part.seconds == known_); }
  /// Whether it is the last, if no impact ends it.
  bool ends_with(const StepPart<S>& part) const { return !any(part.seconds < left_); }
  /// However dense the impacts, time goes on.
  S least(const StepPart<S>& part) const { return minimum(part.seconds, S(as<S>(1e-9) * h_)); }

  /// What an impact has made spin (rad/s) may turn too far in a part for the interpolation that finds the
  /// next: then parts are shorter, and this is true.
  bool shorten_for(const S& spin, const StepPart<S>& part) {
    const S turn = spin * part.seconds;
    const MaskOf<S> far = turn > as<S>(1.25), helps = part.seconds > shortest_ * turn,
                    whirls = part.running & far & helps;
    if (!any(whirls)) return false;
    longest_ = select(whirls, S(part.seconds / maximum(turn, S(1))), longest_);
    return true;
  }
  /// Forces that are constant over a part, and the interpolation that finds impacts, are off by the third and
  /// fourth power of its duration: where bodies end too `deep`, parts are shorter, and this is true.
  bool shorten_where(const MaskOf<S>& deep, const StepPart<S>& part) {
    const MaskOf<S> divides = !ends_before(part.seconds, shortest_), where = part.running & divides & deep;
    if (!any(where)) return false;
    longest_ = select(where, maximum(S(as<S>(0.5) * part.seconds), shortest_), longest_);
    return true;
  }

  /// A part has ended after so many seconds.
  void pass(const StepPart<S>& part, const S& seconds) {
    left_ = select(part.running, S(left_ - seconds), left_);
    known_ = left_;
    // In a crowd it is one body of many whose parts must be short, and most often not for long.
    if (in_crowd_) longest_ = minimum(h_, S(as<S>(1.5) * longest_));
  }
  /// The step ends here in these lanes.
  void stop(const MaskOf<S>& lanes) { left_ = select(lanes, S(0), left_); }
  /// The step ends in these lanes with time left: bodies go too far in one, or impacts have no end.
  void give_up(const MaskOf<S>& lanes) { lost_ = lost_ | lanes; }

 private:
  /// Whether a rest of the step is not longer than a part may be.
  static MaskOf<S> ends_before(const S& rest, const S& longest) { return rest < as<S>(1.25) * longest; }

  bool in_crowd_;
  S h_, shortest_;
  S left_;
  S known_;    ///< how far those on course are known to go
  S longest_;  ///< part that can be computed at once
  MaskOf<S> lost_{false};
};

}  // namespace rbres::RBRES_ABI::detail
