// Bodies thrown into a tray: what the scenes of a trajectory set begin with.
#pragma once

#include <cmath>
#include <cstdint>
#include <rbres/core/philox.hpp>
#include <rbres/learn/trajectory.hpp>
#include <string>
#include <vector>

namespace rbres::contacts_program {

struct ThrowOptions {
  std::string folder;
  bool boxes = false, rbres = false;
  int bodies = 6, train = 900, test = 100, frames = 150;
  std::uint64_t seed = 7;
};

inline constexpr double frame_time = 0.01, step = 0.0005;  // s
inline constexpr int steps_per_frame = 20;

inline double within(Random& random, double least, double most) {
  return least + (most - least) * random.uniform();
}

/// Half the tray's width, m: as much room for each body, however many there are.
inline double half_width(int bodies) { return 0.5 * std::sqrt(bodies / 6.0); }

inline std::vector<Plane<double>> tray(double w) {
  return {{{0, 0, 1}, 0, {}},
          {{1, 0, 0}, -w, {}},
          {{-1, 0, 0}, -w, {}},
          {{0, 1, 0}, -w, {}},
          {{0, -1, 0}, -w, {}}};
}

/// Bodies and where they start: apart from one another and from the tray.
struct Start {
  std::vector<Body<double>> bodies;
  std::vector<RigidState<double>> states;
};

inline Start thrown(const ThrowOptions& options, Random& random) {
  Start start;
  const double w = half_width(options.bodies);
  for (int i = 0; i < options.bodies; ++i) {
    const bool box = options.boxes && random.uniform() < 0.5;
    const AnyShape<double> shape =
        box ? AnyShape<double>(Box<double>(within(random, 0.04, 0.08), within(random, 0.04, 0.08),
                                           within(random, 0.04, 0.08)))
            : AnyShape<double>(Sphere<double>(within(random, 0.05, 0.1)));
    const auto body = Body<double>::of_density(shape, 1000 * within(random, 0.15, 0.25));
    const double room = w - std::max(0.12, body.bounding_radius() + 0.01);
    RigidState<double> y;
    bool apart = false;
    for (int tries = 0; !apart; ++tries) {
      if (tries == 100'000)
        detail::refuse("bodies", "fewer, so that they fit above the tray", options.bodies);
      y.position = {within(random, -room, room), within(random, -room, room),
                    within(random, std::max(0.12, body.bounding_radius() + 0.01), 0.9)};
      apart = true;
      for (int j = 0; j < i && apart; ++j) {
        const auto k = static_cast<std::size_t>(j);
        apart = norm(y.position - start.states[k].position) >
                body.bounding_radius() + start.bodies[k].bounding_radius() + 0.01;
      }
    }
    if (box) {
      y.orientation =
          normalized(Quat<double>{random.normal(), random.normal(), random.normal(), random.normal()});
    }
    for (double* v : {&y.velocity.x, &y.velocity.y, &y.velocity.z}) *v = within(random, -1.5, 1.5);
    for (double* v : {&y.angular_velocity.x, &y.angular_velocity.y, &y.angular_velocity.z})
      *v = within(random, -8, 8);
    start.bodies.push_back(body);
    start.states.push_back(y);
  }
  return start;
}

}  // namespace rbres::contacts_program
