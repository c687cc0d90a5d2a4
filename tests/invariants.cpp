#include <doctest/doctest.h>

#include <cstdlib>
#include <string_view>

#include "../examples/validate/invariants/groups.hpp"

using namespace validate;

namespace {

/// The cases of a group: the quick ones, one in six of them (RBRES_CASES=few, for slow builds), all
/// (RBRES_CASES=full), or those of a failure that is repeated (RBRES_FIRST_CASE=17 RBRES_CASES=1).
Cases chosen(const Group& group) {
  const char *count = std::getenv("RBRES_CASES"), *first = std::getenv("RBRES_FIRST_CASE");
  Cases cases{.count = group.quick};
  const std::string_view which = count != nullptr ? count : "";
  if (which == "few") {
    cases.count = (group.quick + 5) / 6;
  } else if (which == "full") {
    cases.count = group.full;
  } else if (!which.empty()) {
    cases.count = std::atol(count);
  }
  if (first != nullptr) cases.first = std::atol(first);
  return cases;
}

void check(const Group& group, const Cases& cases) {
  if (cases.count == 0) return;
  for (const Finding& finding : group.run(cases)) {
    CAPTURE(group.type);
    CAPTURE(group.name);
    CAPTURE(finding.name);
    CAPTURE(finding.what);
    CAPTURE(finding.figure.where());
    INFO("again: RBRES_FIRST_CASE=", finding.figure.number(), " RBRES_CASES=1, seed ", cases.seed);
    CHECK(finding.figure.value() <= finding.bound);
  }
}
void check(const std::vector<Group>& groups) {
  for (const Group& group : groups) check(group, chosen(group));
}
/// Cases of the group of this name.
void repeat(const std::vector<Group>& groups, std::string_view name, std::initializer_list<long> cases) {
  for (const Group& group : groups) {
    if (group.name != name) continue;
    for (const long first : cases) check(group, {.first = first, .count = 1});
  }
}

}  // namespace

TEST_CASE("worlds of spheres keep what nature keeps") { check(sphere_groups()); }
TEST_CASE("worlds of boxes keep what nature keeps") { check(box_groups()); }
TEST_CASE("worlds of capsules keep what nature keeps") { check(capsule_groups()); }
TEST_CASE("worlds of any shapes keep what nature keeps") { check(any_shape_groups()); }
TEST_CASE("worlds of convex hulls keep what nature keeps") { check(hull_groups()); }
TEST_CASE("worlds of compounds keep what nature keeps") { check(compound_groups()); }

TEST_CASE("worlds that were once over their bounds keep within them") {
  repeat(capsule_groups(), "symmetry", {754});  // forces hung on those of the step before
  repeat(capsule_groups(), "lanes", {172, 342});
  repeat(any_shape_groups(), "symmetry", {2694});
  repeat(any_shape_groups(), "lanes", {514, 768});
  repeat(compound_groups(), "tunnelling", {3308});  // an impact makes a needle spin 20 turns in a step
}
