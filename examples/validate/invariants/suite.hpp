#pragma once

#include "copies.hpp"
#include "faults.hpp"
#include "grid.hpp"
#include "lanes.hpp"
#include "resting.hpp"
#include "scale.hpp"
#include "symmetry.hpp"
#include "times.hpp"
#include "tunnelling.hpp"

namespace validate {

namespace grid_rows {

/// The rows of grid(), with what is allowed in this scalar.
inline std::vector<Finding> rows(const GridFigures& g, const std::string& scalar, double bound,
                                 double depth) {
  const auto name = [&](const char* row) { return row + scalar; };
  return {{name("energy_impact_plane"), "relative", bound, g.impact_plane},
          {name("energy_impact_pair"), "relative", bound, g.impact_pair},
          {name("energy_run_plane"), "relative", bound, g.run_plane},
          {name("energy_run_pair"), "relative", bound, g.run_pair},
          {name("momentum_run_linear"), "relative", bound, g.linear},
          {name("momentum_run_angular"), "relative", bound, g.angular},
          {name("momentum_run_discrete"), "relative", bound, g.angular_discrete},
          {name("momentum_run_edge"), "relative", bound, g.edge},
          {name("tunnelling_penetration"), "radii", depth, g.overlap},
          {name("scale_effort"), "of free", 100, g.work},
          {name("scale_impacts_in_step"), "impacts", 1000, g.impacts_in_step}};
}

}  // namespace grid_rows

/// Everything that is asked of a shape in double precision.
template <class Shape>
std::vector<Group> double_groups(const std::string& type) {
  return {
      {"grid", type, 144, 7200, 720,
       [](const Cases& cases) { return grid_rows::rows(grid<double, Shape>(cases), "", 1e-10, 1e-5); }},
      {"symmetry", type, 144, 3600, 288,
       [](const Cases& cases) {
         const auto s = symmetry<Shape>(cases);
         return std::vector<Finding>{{"permutation_bodies", "size, speed", 1e-6, s.permutation},
                                     {"permutation_planes", "size, speed", 1e-6, s.planes},
                                     {"frame_rotation", "size, speed", 1e-6, s.rotation},
                                     {"frame_translation", "size, speed", 1e-6, s.translation},
                                     {"frame_mirror", "size, speed", 1e-6, s.mirror},
                                     {"frame_boost", "size, speed", 1e-6, s.boost},
                                     {"frame_nudge", "size, speed", 1e-6, s.nudge}};
       }},
      {"tunnelling", type, 144, 7200, 432,
       [](const Cases& cases) {
         const auto t = tunnelling<Shape>(cases);
         return std::vector<Finding>{{"tunnelling_missed", "bodies", 0, t.missed},
                                     {"tunnelling_fast", "radii", 1e-6, t.overlap},
                                     {"tunnelling_plastic", "radii", 0.1, t.plastic}};
       }},
      {"faults", type, 216, 3456, 216,
       [](const Cases& cases) {
         return std::vector<Finding>{{"faults_unreported", "runs", 0, faults<Shape>(cases)}};
       }},
      {"copies", type, 72, 1440, 144,
       [](const Cases& cases) {
         return std::vector<Finding>{{"copies_differ", "runs", 0, copies<Shape>(cases)}};
       }},
      {"scale", type, 72, 1440, 144,
       [](const Cases& cases) {
         ScaleFigures s;
         sizes<Shape>(cases, s);
         return std::vector<Finding>{{"scale_size", "size, speed", 1e-6, s.size}};
       }},
      {"masses", type, 72, 1440, 72,
       [](const Cases& cases) {
         ScaleFigures s;
         masses<Shape>(cases, s);
         return std::vector<Finding>{{"scale_mass", "radii", 1e-6, s.mass},
                                     {"scale_mass_effort", "of free", 100, s.mass_work},
                                     {"scale_mass_impacts", "impacts", 1000, s.mass_impacts}};
       }},
      {"rest", type, 6, 72, 12,
       [](const Cases& cases) {
         return std::vector<Finding>{{"rest_minute", "radii", 1e-8, at_rest<Shape>(cases, 60)}};
       }},
      {"rest_hour", type, 0, 6, 1,
       [](const Cases& cases) {
         return std::vector<Finding>{{"rest_hour", "radii", 1e-8, at_rest<Shape>(cases, 3600)}};
       }},
  };
}

/// Floats, one run at a time.
template <class Shape>
std::vector<Group> float_groups(const std::string& type) {
  return {{"grid", type + ", float", 144, 7200, 288, [](const Cases& cases) {
             return grid_rows::rows(grid<float, Shape>(cases), "_float", 1e-5, 1e-3);
           }}};
}

/// As many runs at once as fill a register.
template <class Shape>
std::vector<Group> lane_groups(const std::string& type) {
  using P = Pack<double, native_lanes<double>>;
  return {{"grid", type + ", lanes", 144, 3600, 144,
           [](const Cases& cases) { return grid_rows::rows(grid<P, Shape>(cases), "_lanes", 1e-10, 1e-5); }},
          {"lanes", type + ", lanes", 72, 1440, 72, [](const Cases& cases) {
             const auto l = lanes<P, Shape>(cases);
             return std::vector<Finding>{{"lanes_alone", "size, speed", 1e-6, l.difference},
                                         {"lanes_neighbours", "lanes", 0, l.neighbours}};
           }}};
}

}  // namespace validate
