// The world of the page as a native program, for the test that compares the two: prints the bodies' states
// after so many frames, as hexadecimal numbers, 13 a body and a line.
#include "world.hpp"

#include <cstdio>
#include <cstdlib>

int main(int count, char** words) {
  if (count != 9) {
    std::fprintf(stderr,
                 "usage: native BODIES SPHERES BOXES CAPSULES RESTITUTION FRICTION GRAVITY SEED < FRAMES\n");
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
    int frames = 0;
    if (std::scanf("%d", &frames) != 1) return 2;
    if (!world.advance(frames * web::steps_per_frame)) return 1;
    const double* y = &world.state()[0].position.x;
    for (int i = 0; i < 13 * world.bodies(); ++i) std::printf("%a%c", y[i], i % 13 == 12 ? '\n' : ' ');
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
