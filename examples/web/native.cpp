// The world of the page as a native program, for the page's test: prints the bodies' states after so many
// frames, as hexadecimal numbers, 13 a body and a line, and writes their motion as a glTF animation.
#include <cstdio>
#include <cstdlib>
#include <rbres/io/gltf.hpp>

#include "world.hpp"

int main(int count, char** words) {
  if (count != 10 && count != 11) {
    std::fprintf(
        stderr,
        "usage: native BODIES SPHERES BOXES CAPSULES RESTITUTION FRICTION GRAVITY SEED FRAMES [FILE.glb]\n");
    return 2;
  }
  const auto whole = [&](int i) { return std::atoi(words[i]); };
  const auto real = [&](int i) { return std::atof(words[i]); };
  try {
    web::World world({.bodies = whole(1),
                      .spheres = whole(2) != 0,
                      .boxes = whole(3) != 0,
                      .capsules = whole(4) != 0,
                      .restitution = real(5),
                      .friction = real(6),
                      .gravity = real(7),
                      .seed = whole(8)});
    std::vector<double> times{0};
    std::vector<web::State> states{world.state()};
    for (int k = 0; k < whole(9); ++k) {
      if (!world.advance(web::steps_per_frame)) return 1;
      times.push_back(world.time());
      states.push_back(world.state());
    }
    const double* y = &world.state()[0].position.x;
    for (int i = 0; i < 13 * world.bodies(); ++i) std::printf("%a%c", y[i], i % 13 == 12 ? '\n' : ' ');
    if (count == 11) {
      rbres::GltfScene scene;
      scene.add_motion("run", world.room(), times, states, {.bodies = world.bodies()});
      scene.write(words[10]);
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
