#pragma once

#include <algorithm>
#include <rbres/contact/contact_rows.hpp>
#include <rbres/core/reserved.hpp>
#include <span>

namespace rbres::RBRES_ABI::detail {

/// The forces of resting contacts in the part before: where the next solution starts, so that a stack at
/// rest takes a sweep or two.
template <class System>
class ContactMemory {
  using S = typename System::Scalar;
  using Row = typename ContactRows<System>::Row;
  using Pair = ContactPair<System>;

 public:
  ContactMemory(const System& system, std::size_t most_rows)
      : bodies_(system.size()), planes_(static_cast<int>(system.planes().size())) {
    last_.reserve(most_rows);
    next_.reserve(most_rows);
    laid_by_.reserve(most_rows);
    if constexpr (!has_groups<System>) return;
    step_.reserve(most_rows);
    groups_.reserve(most_rows);
  }

  /// Starts a step that is done group by group: what a group knows is where it was at the end of the last
  /// step, and then what it has found itself.
  void start_groups() {
    step_.swap(last_);
    groups_.clear();
  }
  void start_group() {
    last_.clear();
    fresh_ = true;
  }
  void end_group() {
    fresh_ = false;
    for (const Entry& entry : last_) {
      if (groups_.size() < groups_.capacity()) groups_.push_back(entry);
    }
  }
  void end_groups() {
    last_.swap(groups_);
    sort(last_);
  }
  /// As before start_groups(), whether or not a group has started.
  void undo_groups() {
    fresh_ = false;
    last_.swap(step_);
  }

  /// Forgets all, except in the lanes where `same` holds.
  void forget_unless(const MaskOf<S>& same) {
    for (auto* entries : {&last_, &laid_by_}) {
      for (Entry& entry : *entries) {
        for (S& force : entry.force) force = select(same, force, S(0));
      }
    }
  }
  /// Keeps the forces on the bodies that sleeps(i) apart, until they wake.
  template <class Sleeps>
  void lay_by(const Sleeps& sleeps) {
    const auto asleep = [&](const Entry& entry) {
      const auto [first, second] = pair_of(entry.key);
      return sleeps(second) || (first >= 0 && sleeps(first));
    };
    // Those of the last part are newer.
    remove_where(laid_by_, [&](const Entry& entry) {
      return !asleep(entry) || std::binary_search(last_.begin(), last_.end(), entry, by_key);
    });
    for (const Entry& entry : last_) {
      if (asleep(entry) && laid_by_.size() < laid_by_.capacity()) laid_by_.push_back(entry);
    }
    sort(laid_by_);
  }
  /// The force at a row's point, N along its normal and tangents; zero where none is known.
  std::array<S, 3> force(const Row& row) {
    const Entry* entry = find(key(row));
    return entry ? entry->force : std::array<S, 3>{S(0), S(0), S(0)};
  }

  void start() {
    next_.clear();
    kept_ = 0;
  }
  /// Keeps a row's impulse as a force (times `rate`, 1/s) for the next part, in the lanes `open`; the others
  /// keep what they have.
  void keep(const Row& row, const S& rate, const MaskOf<S>& open) {
    if (next_.size() == next_.capacity()) return;
    const auto old = all(open) ? std::array<S, 3>{} : force(row);
    Entry entry{key(row), {}};
    for (std::size_t d = 0; d < 3; ++d) entry.force[d] = select(open, S(rate * row.impulse()[d]), old[d]);
    next_.push_back(entry);
  }
  /// Keeps what is known of a pair's forces: of pairs in the order in which they are found, and before those
  /// of rows.
  void keep(const Pair& pair) {
    const auto all = known();
    const long first = key(pair.who, pair.place(0)), last = key(pair.who, pair.place(Pair::points));
    for (auto at = at_or_after(all, first); at != all.end() && at->key < last; ++at) {
      if (next_.size() < next_.capacity()) next_.push_back(*at);
    }
    kept_ = next_.size();
  }
  void finish(const MaskOf<S>& open) {
    if (kept_ > 0) {
      const auto rows = next_.begin() + static_cast<std::ptrdiff_t>(kept_);
      std::sort(rows, next_.end(), by_key);
      last_.resize(next_.size());
      std::merge(next_.begin(), rows, rows, next_.end(), last_.begin(), by_key);
      fresh_ = false;
      return;
    }
    sort(next_);
    if (!all(open)) {  // what other lanes still hold on to
      const std::size_t fresh = next_.size();
      for (const Entry& old : last_) {
        const auto end = next_.begin() + static_cast<std::ptrdiff_t>(fresh);
        if (std::binary_search(next_.begin(), end, old, by_key) || next_.size() == next_.capacity()) continue;
        Entry entry{old.key, {}};
        for (std::size_t d = 0; d < 3; ++d) entry.force[d] = select(open, S(0), old.force[d]);
        next_.push_back(entry);
      }
      sort(next_);
    }
    last_.swap(next_);
    fresh_ = false;
  }

 private:
  struct Entry {
    long key;
    std::array<S, 3> force;
  };
  static bool by_key(const Entry& a, const Entry& b) { return a.key < b.key; }
  /// Those of a single island are in order.
  template <class Entries>
  static void sort(Entries& entries) {
    if (!std::is_sorted(entries.begin(), entries.end(), by_key))
      std::sort(entries.begin(), entries.end(), by_key);
  }
  /// In the order in which pairs are found.
  long key(const Candidate& who, std::size_t place) const {
    const int first = who.first < 0 ? -1 - who.first - planes_ : who.first;
    return (static_cast<long>(first) * bodies_ + who.second) * static_cast<long>(Pair::places) +
           static_cast<long>(place);
  }
  /// The pair of a key; those of planes are negative.
  Candidate pair_of(long key) const {
    const auto floor = [](long a, long b) { return a >= 0 ? a / b : -((b - 1 - a) / b); };
    const long pair = floor(key, static_cast<long>(Pair::places)), first = floor(pair, bodies_);
    return {static_cast<int>(first < 0 ? -1 - (first + planes_) : first),
            static_cast<int>(pair - first * bodies_)};
  }
  long key(const Row& row) const { return key(row.who, row.point); }
  static auto at_or_after(std::span<const Entry> entries, long key) {
    return std::lower_bound(entries.begin(), entries.end(), key,
                            [](const Entry& entry, long k) { return entry.key < k; });
  }
  std::span<const Entry> known() const {
    return fresh_ ? std::span<const Entry>(step_) : std::span<const Entry>(last_);
  }
  const Entry* find(long key) {
    const auto last = known();
    if (next_found_ < last.size() && last[next_found_].key == key) return &last[next_found_++];
    for (const std::span<const Entry> all : {last, std::span<const Entry>(laid_by_)}) {
      const auto at = at_or_after(all, key);
      if (at == all.end() || at->key != key) continue;
      if (all.data() == last.data()) next_found_ = static_cast<std::size_t>(at - all.begin()) + 1;
      return &*at;
    }
    return nullptr;
  }

  int bodies_, planes_;
  std::size_t kept_ = 0;        ///< of `next_`
  std::size_t next_found_ = 0;  ///< what is asked for next is most often behind what was found last
  Reserved<Entry, row_room<System>> last_, next_;
  static constexpr std::size_t group_room = has_groups<System> ? row_room<System> : 0;
  Reserved<Entry, group_room> step_;           ///< of all groups: where the step began
  Reserved<Entry, group_room> groups_;         ///< the same: where those done end it
  Reserved<Entry, row_room<System>> laid_by_;  ///< of bodies that sleep
  bool fresh_ = false;                         ///< whether a group has found nothing yet
};

}  // namespace rbres::RBRES_ABI::detail
