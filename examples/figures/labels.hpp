#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <vector>

namespace figures::detail {

struct Spot {
  double x, y;
};

struct Rectangle {
  double left, bottom, right, top;

  bool meets(const Rectangle& other) const {
    return left < other.right && other.left < right && bottom < other.top && other.bottom < top;
  }
  bool contains(const Spot& spot) const {
    return left < spot.x && spot.x < right && bottom < spot.y && spot.y < top;
  }
  Spot nearest(const Spot& spot) const {
    return {std::clamp(spot.x, left, right), std::clamp(spot.y, bottom, top)};
  }
  bool contains(const Rectangle& other) const {
    return left <= other.left && other.right <= right && bottom <= other.bottom && other.top <= top;
  }
};

/// A square of this half width around a spot.
inline Rectangle around(const Spot& spot, double half) {
  return {spot.x - half, spot.y - half, spot.x + half, spot.y + half};
}

inline constexpr double label_height = 13, label_character = 6.6;  // at 9 points

/// A label farther from its spot is tied to it with a line.
inline constexpr double leader_length = 14;

inline double label_width(const std::string& text) {
  return label_character * static_cast<double>(text.size());
}

/// Whether a label may stand there: it covers no obstacle, and the line from its spot, where it needs one,
/// crosses none but those at the spot itself.
inline bool is_free(const Rectangle& place, const Spot& spot, const std::vector<Rectangle>& obstacles) {
  const Spot end = place.nearest(spot);
  const double length = std::hypot(end.x - spot.x, end.y - spot.y);
  return std::none_of(obstacles.begin(), obstacles.end(), [&](const Rectangle& obstacle) {
    if (place.meets(obstacle)) return true;
    if (length <= leader_length || obstacle.contains(spot)) return false;
    for (double t = 0; t < 1; t += 3 / length)
      if (obstacle.contains(Spot{spot.x + t * (end.x - spot.x), spot.y + t * (end.y - spot.y)})) return true;
    return false;
  });
}

/// Finds each label the nearest place around its spot, inside `area`, that is_free() of the obstacles and the
/// labels before it. One that has none stands on the right of its spot.
inline std::vector<Rectangle> place_labels(const std::vector<Spot>& spots,
                                           const std::vector<std::string>& labels,
                                           std::vector<Rectangle> obstacles, const Rectangle& area) {
  constexpr int directions = 16;
  std::vector<Rectangle> places;
  for (std::size_t i = 0; i < spots.size(); ++i) {
    const double width = label_width(labels[i]);
    const auto place = [&](double distance, int direction) {
      const double angle = 2 * std::numbers::pi * direction / directions;
      // The middle moves on an ellipse around the spot that clears the label's own size.
      const double x = spots[i].x + (distance + width / 2) * std::cos(angle);
      const double y = spots[i].y + (distance + label_height / 2) * std::sin(angle);
      return Rectangle{x - width / 2, y - label_height / 2, x + width / 2, y + label_height / 2};
    };
    Rectangle best = place(8, 0);
    [&] {
      for (double distance = 8; distance < 150; distance += 6) {
        for (const int direction : {0, 1, 15, 2, 14, 4, 12, 3, 13, 8, 7, 9, 6, 10, 5, 11}) {
          const Rectangle candidate = place(distance, direction);
          if (area.contains(candidate) && is_free(candidate, spots[i], obstacles)) {
            best = candidate;
            return;
          }
        }
      }
    }();
    places.push_back(best);
    obstacles.push_back(best);
  }
  return places;
}

}  // namespace figures::detail
