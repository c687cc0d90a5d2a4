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

/// The rows of grid(), with what is allowed in this scalar: of energy in one impact and of momentum, of
/// energy over a run, and of depth.
inline std::vector<Finding> grid_rows(const GridFigures& g, const std::string& scalar, double bound,
                                      double run_bound, double depth) {
  const auto name = [&](const char* row) { return row + scalar; };
  const std::string grid =
      "three bodies of any size, mass and inertia; e in {0, 0.5, 0.9, 1}, friction in {0, 0.3, 1}, both "
      "contact modes, first, middle and last body";
  const std::string impact = "rise of the energy in one impact, over the run's; ",
                    run =
                        "rise of the energy above its least so far, beyond the integrator's error, over the "
                        "run's; ",
                    momentum = "change over a run, beyond what a step rounds; ";
  return {
      {name("energy_impact_plane"), "relative", bound, impact + "with planes; " + grid, g.impact_plane},
      {name("energy_impact_pair"), "relative", bound, impact + "between bodies; " + grid, g.impact_pair},
      {name("energy_run_plane"), "relative", run_bound, run + "with planes; " + grid, g.run_plane},
      {name("energy_run_pair"), "relative", run_bound, run + "between bodies; " + grid, g.run_pair},
      {name("momentum_run_linear"), "relative", bound, momentum + grid, g.linear},
      {name("momentum_run_angular"), "relative", bound, momentum + "continuous; " + grid, g.angular},
      {name("momentum_run_discrete"), "relative", bound, momentum + "angular, discrete; " + grid,
       g.angular_discrete},
      {name("momentum_run_edge"), "relative", bound,
       momentum + "linear, along the edge of two planes without friction; " + grid, g.edge},
      {name("tunnelling_penetration"), "radii", depth,
       "the deepest overlap at the end of a step, over the smaller body's bounding radius, continuous; " +
           grid,
       g.overlap},
      {name("energy_run_resting"), "relative", run_bound, run + "e = 0; " + grid, g.run_resting},
      {name("tunnelling_resting"), "radii", 10 * depth, "the deepest overlap, e = 0, continuous; " + grid,
       g.overlap_resting},
      {name("scale_effort"), "of free", 100, "evaluations of the forces, over those of free motion; " + grid,
       g.work},
      {name("scale_impacts_in_step"), "impacts", 1000, "the most in one step; " + grid, g.impacts_in_step}};
}

inline std::vector<Finding> symmetry_rows(const SplitSymmetry& split) {
  const SymmetryFigures& s = split.bouncing;
  const std::string end = "difference of the ends of two runs, over the bodies' size and speed: ",
                    crowd = "; three bodies thrown at one another, freely and over a floor under gravity";
  const auto row = [&](const char* name, const char* what, const Figure& figure) {
    return Finding{name, "relative", 1e-6, end + what + crowd, figure};
  };
  return {
      row("permutation_bodies", "every order of the bodies", s.permutation),
      row("permutation_planes", "the planes in the other order", s.planes),
      row("frame_rotation", "the world turned", s.rotation),
      row("frame_translation", "the world moved", s.translation),
      row("frame_mirror", "the world in a mirror", s.mirror),
      row("frame_boost", "the world in motion", s.boost),
      row("frame_nudge", "the start moved by 1e-13", s.nudge),
      Finding{"frame_resting", "relative", 0.05,
              end +
                  "the largest of all these, e = 0 or friction 1: whether a contact rests or bounces, and "
                  "how points share friction, is decided by rounding" +
                  crowd,
              split.resting.all()}};
}

template <class Shape>
Group grid_group(const std::string& type) {
  return {"grid",
          type,
          144,
          7200,
          720,
          [](const Cases& cases) { return grid_rows(grid<double, Shape>(cases), "", 1e-10, 1e-10, 1e-3); }};
}
template <class Shape>
Group tunnelling_group(const std::string& type) {
  return {
      "tunnelling", type, 144, 7200, 432, [](const Cases& cases) {
        const std::string scenes =
            "; shots at thin targets, and thin bodies that spin in a room, up to 100 sizes and a turn of 1 "
            "rad in "
            "a step";
        const auto t = tunnelling<Shape>(cases);
        return std::vector<Finding>{
            {"tunnelling_missed", "bodies", 0, "shots that met nothing" + scenes, t.missed},
            {"tunnelling_fast", "radii", 1e-4, "the deepest overlap at the end of a step, e > 0" + scenes,
             t.overlap},
            {"tunnelling_plastic", "radii", 0.2, "the deepest overlap, e = 0" + scenes, t.plastic}};
      }};
}

/// Everything that is asked of a shape in double precision.
template <class Shape>
std::vector<Group> double_groups(const std::string& type) {
  return {
      grid_group<Shape>(type),
      {"symmetry", type, 144, 3600, 288,
       [](const Cases& cases) { return symmetry_rows(symmetry<Shape>(cases)); }},
      tunnelling_group<Shape>(type),
      {"faults", type, 216, 3456, 216,
       [](const Cases& cases) {
         return std::vector<Finding>{{"faults_unreported", "runs", 0,
                                      "runs whose forces go wrong (NaN, infinite, 1e200, unstable) in "
                                      "flight, landing, resting, sliding, "
                                      "stacked or colliding, and that do not end with the last good state",
                                      faults<Shape>(cases)}};
       }},
      {"copies", type, 72, 1440, 144,
       [](const Cases& cases) {
         const auto c = copies<Shape>(cases);
         return std::vector<Finding>{
             {"copies_differ", "runs", 0, "runs that a copied stepper takes to other bits", c.copied},
             {"copies_restored_differ", "runs", 0,
              "runs that a stepper set back to a copy takes to other bits", c.restored}};
       }},
      {"sizes", type, 72, 1440, 144,
       [](const Cases& cases) {
         return std::vector<Finding>{
             {"scale_size", "relative", 1e-6,
              "end of a fall of bodies of 0.1 mm to 10 km, in their own units, against the "
              "same at a metre",
              sizes<Shape>(cases)}};
       }},
      {"masses", type, 72, 1440, 72,
       [](const Cases& cases) {
         const std::string pile =
             "; a body at rest on another, masses 1 to 1e6, the heavy one above or below";
         const auto m = masses<Shape>(cases);
         return std::vector<Finding>{
             {"scale_mass", "radii", 1e-6, "motion in 0.2 s" + pile, m.moved},
             {"scale_mass_effort", "of free", 100,
              "evaluations of the forces, over those of free motion" + pile, m.work},
             {"scale_mass_impacts", "impacts", 1000, "the most in one step" + pile, m.impacts}};
       }},
      {"rest", type, 6, 72, 12,
       [](const Cases& cases) {
         return std::vector<Finding>{{"rest_minute", "radii", 1e-8,
                                      "motion in a minute of bodies that lie on a floor and on one another",
                                      at_rest<Shape>(cases, 60)}};
       }},
      {"rest_hour", type, 0, 12, 1,
       [](const Cases& cases) {
         return std::vector<Finding>{
             {"rest_hour", "radii", 1e-8, "the same in an hour", at_rest<Shape>(cases, 3600)}};
       }},
  };
}

/// Floats, one run at a time.
template <class Shape>
std::vector<Group> float_groups(const std::string& type) {
  return {{"grid", type + ", float", 144, 7200, 288, [](const Cases& cases) {
             return grid_rows(grid<float, Shape>(cases), "_float", 1e-5, 1e-5, 1e-3);
           }}};
}

/// As many runs at once as fill a register.
template <class Shape>
std::vector<Group> lane_groups(const std::string& type) {
  using P = Pack<double, native_lanes<double>>;
  return {{"grid", type + ", lanes", 144, 3600, 144,
           [](const Cases& cases) {
             auto rows = grid_rows(grid<P, Shape>(cases), "_lanes", 1e-10, 1e-10, 1e-3);
             rows.erase(rows.begin(), rows.begin() + 2);  // nobody hears of the impacts of lanes
             return rows;
           }},
          {"lanes", type + ", lanes", 72, 1440, 72, [](const Cases& cases) {
             const auto l = lanes<P, Shape>(cases);
             return std::vector<Finding>{
                 {"lanes_alone", "relative", 1e-6, "difference of a lane's end from that of a run of its own",
                  l.difference},
                 {"lanes_resting", "relative", 0.05,
                  "that, and what a fault in another lane makes, e = 0: see frame_resting", l.resting},
                 {"lanes_neighbours", "relative", 1e-6, "difference that a fault in another lane makes",
                  l.neighbours},
                 {"lanes_unreported", "lanes", 0, "lanes whose fault is not theirs, or is not reported",
                  l.unreported}};
           }}};
}

/// All that is asked of a shape, in every scalar.
template <class Shape>
std::vector<Group> shape_groups(const std::string& type) {
  auto groups = double_groups<Shape>(type);
  for (const auto& more : {float_groups<Shape>(type), lane_groups<Shape>(type)}) {
    groups.insert(groups.end(), more.begin(), more.end());
  }
  return groups;
}

}  // namespace validate
