#include "adaptive_faults.hpp"
#include "closed_sphere.hpp"
#include "groups.hpp"
#include "suite.hpp"

namespace validate {

std::vector<Group> sphere_groups() {
  auto groups = shape_groups<Sphere<double>>("sphere");
  groups.push_back(
      {"closed forms", "sphere", 1, 1, 1, [](const Cases&) {
         return std::vector<Finding>{
             {"incline_ball", "relative", 1e-9,
              "way, speed and spin after 2 s: rolls with 5/7 g sin a, or slides with g (sin a - mu cos a)",
              ball_on_incline()},
             {"bounce_end", "relative", 1e-4,
              "time of the last bounce, v (1 + e) / (g (1 - e)); e = 0.1, 0.5, 0.8, rest_speed 1e-4 m/s",
              end_of_bouncing()},
             {"faults_adaptive", "runs", 0, "faults with DormandPrince54 that are not reported",
              adaptive_faults()}};
       }});
  groups.push_back({"times", "sphere", 200, 20000, 1000, [](const Cases& cases) {
                      using P = Pack<double, native_lanes<double>>;
                      const std::string what =
                          "times told and places then, over the duration; any step, duration and sample rate";
                      return std::vector<Finding>{
                          {"times_simulate", "relative", 1e-12, what, times<double>(cases)},
                          {"times_batch", "relative", 1e-12, what + ", simulate_batch", times<P>(cases)}};
                    }});
  return groups;
}

}  // namespace validate
