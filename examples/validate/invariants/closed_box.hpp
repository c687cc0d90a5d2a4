#pragma once

#include "closed_forms.hpp"

namespace validate {

struct BlockFigures {
  Figure slides;  ///< relative error of the way
  Figure sticks;  ///< way over that of a free slide
};

/// A block on an incline slides with g (sin a - mu cos a), and stays where friction is as steep as the slope
/// or steeper: at the friction angle, too.
inline BlockFigures block_on_incline() {
  BlockFigures worst;
  const double g = 9.81, time = 2;
  for (const double angle : {0.1, 0.3, 0.5}) {
    const Incline slope{angle};
    const double steep = std::tan(angle), free = g * std::sin(angle) * time * time / 2;
    for (const double share : {0.0, 0.5, 0.9, 0.999, 1.0, 1.000001, 1.001, 1.1, 2.0}) {
      const Material<double> material{0, share * steep};
      OnPlane<Box<double>> block(Body{Box{0.2, 0.1, 0.1}, 1.0, material}, slope.plane(material));
      block.body().position = 0.1 * slope.normal;
      block.body().orientation = slope.turn;
      block.run({.step = 1e-3, .duration = time});
      const double way = dot(block.body().position, slope.down);
      const auto where = rbres::detail::text("slope ", angle, ", friction ", share, " of it");
      if (share < 1) {
        worst.slides(std::abs(way / free - (1 - share)), 0, where);
      } else {
        worst.sticks(std::abs(way) / free, 0, where);
      }
    }
  }
  return worst;
}

}  // namespace validate
