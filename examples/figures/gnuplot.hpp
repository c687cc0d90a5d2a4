#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

#include "labels.hpp"
#include "script.hpp"

/// Figures by gnuplot. Each is four files in a folder: NAME.dat (the numbers), NAME.gp (the script), NAME.png
/// and NAME.svg. Every draw_... function writes the first two and returns whether gnuplot made the others;
/// without gnuplot they can be made later (see how_to_draw). Errors of files are rbres::Error.
namespace figures {

struct Curve {
  std::string name;
  std::vector<double> x, y;
};

struct CurveOptions {
  bool log_x = false, log_y = false;
  bool points = false;  ///< marks each point, for curves of few
};

/// Points of one colour with a label each; joined, they are one method at several settings.
struct LabelledPoints {
  std::string name;
  std::vector<std::string> labels;
  std::vector<double> x, y;
  bool joined = false;
};

struct Quartiles {
  double lower, median, upper;
};

/// One method's quartiles, one for each category of the figure.
struct QuartileSeries {
  std::string name;
  std::vector<Quartiles> quartiles;
};

/// Curves over a common axis: error over time, training curves.
inline bool draw_curves(const Figure& figure, const std::vector<Curve>& curves,
                        const CurveOptions& options = {}) {
  std::ostringstream data, settings, plot;
  if (options.log_x) settings << detail::log_axis("x");
  if (options.log_y) settings << detail::log_axis("y");
  for (std::size_t i = 0; i < curves.size(); ++i) {
    const Curve& curve = curves[i];
    detail::same_size(figure, curve.x.size(), curve.y.size());
    data << "# " << curve.name << '\n';
    for (std::size_t k = 0; k < curve.x.size(); ++k)
      data << detail::number(curve.x[k]) << ' ' << detail::number(curve.y[k]) << '\n';
    data << "\n\n";
    plot << (i > 0 ? ", " : "") << detail::quoted(figure.name + ".dat") << " index " << i << " with "
         << (options.points ? "linespoints pointtype 7 pointsize 0.6" : "lines") << " linewidth 1.8 dashtype "
         << detail::dash(i) << " linecolor '" << detail::colour(i) << "' title "
         << detail::quoted(curve.name);
  }
  return detail::draw(figure, data.str(), settings.str(), plot.str());
}

/// Predicted (y) against actual (x) values, with the diagonal and a band of +-`band` (in `unit`) around it.
/// Of more than 4000 points 4000 are drawn, evenly taken.
inline bool draw_agreement(const Figure& figure, const std::vector<double>& actual,
                           const std::vector<double>& predicted, double band, const std::string& unit) {
  detail::same_size(figure, actual.size(), predicted.size());
  double low = std::numeric_limits<double>::infinity(), high = -low;
  std::ostringstream data, settings, plot;
  const double stride = std::max(1.0, static_cast<double>(actual.size()) / 4000);
  for (double at = 0; at < static_cast<double>(actual.size()); at += stride) {
    const double x = actual[static_cast<std::size_t>(at)], y = predicted[static_cast<std::size_t>(at)];
    data << detail::number(x) << ' ' << detail::number(y) << '\n';
    if (!std::isfinite(x) || !std::isfinite(y)) continue;
    low = std::min({low, x, y});
    high = std::max({high, x, y});
  }
  if (!(low < high)) low = -1, high = 1;
  const double margin = 0.03 * (high - low);
  low -= margin, high += margin;
  settings << "set size square\nset xrange [" << low << ":" << high << "]\nset yrange [" << low << ":" << high
           << "]\nset samples 2\n";
  plot << "'+' using 1:($1-" << band << "):($1+" << band
       << ") with filledcurves fillcolor '#E69F00' fillstyle transparent solid 0.35 noborder title '+- "
       << band << ' ' << unit << "', " << detail::quoted(figure.name + ".dat")
       << " with points pointtype 7 pointsize 0.3 linecolor rgb '#A00072B2' title 'predictions', x-" << band
       << " with lines linewidth 0.7 linecolor '#E69F00' notitle, x+" << band
       << " with lines linewidth 0.7 linecolor '#E69F00' notitle, "
       << "x with lines linewidth 0.7 linecolor '#404040' title 'exact'";
  return detail::draw(figure, data.str(), settings.str(), plot.str());
}

/// Labelled points on two logarithmic axes: error against cost, one point per method. Points that are not
/// positive and finite have no place there and are left out.
inline bool draw_trade_off(const Figure& figure, const std::vector<LabelledPoints>& groups) {
  struct Range {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    void add(double x) { low = std::min(low, std::log10(x)), high = std::max(high, std::log10(x)); }
    void to_decades() {
      if (!(low <= high)) low = high = 0;
      low = std::floor(low - 0.02), high = std::ceil(high + 0.02);
    }
    double share(double x) const { return (std::log10(x) - low) / (high - low); }
  } x_range, y_range;
  const auto shown = [](const LabelledPoints& group, std::size_t k) {
    return std::isfinite(group.x[k]) && std::isfinite(group.y[k]) && group.x[k] > 0 && group.y[k] > 0;
  };
  for (const LabelledPoints& group : groups) {
    detail::same_size(figure, group.x.size(), group.y.size());
    detail::same_size(figure, group.x.size(), group.labels.size());
    for (std::size_t k = 0; k < group.x.size(); ++k)
      if (shown(group, k)) x_range.add(group.x[k]), y_range.add(group.y[k]);
  }
  x_range.to_decades(), y_range.to_decades();

  constexpr double left = 0.10, right = 0.71, bottom = 0.13, top = 0.91;  // of the canvas
  const detail::Rectangle area{left * detail::canvas_width, bottom * detail::canvas_height,
                               right * detail::canvas_width, top * detail::canvas_height};
  std::ostringstream data, settings, plot;
  std::vector<detail::Spot> spots;
  std::vector<std::string> labels, colours;
  // Labels may reach into the margin below the legend.
  const detail::Rectangle room{area.left, area.bottom, detail::canvas_width - 5, area.top};
  std::vector<detail::Rectangle> obstacles{
      {area.right, area.top - 24 * static_cast<double>(groups.size()) - 8, room.right, area.top}};
  for (std::size_t i = 0; i < groups.size(); ++i) {
    const LabelledPoints& group = groups[i];
    const std::size_t first = spots.size();
    data << "# " << group.name << '\n';
    for (std::size_t k = 0; k < group.x.size(); ++k) {
      if (!shown(group, k)) continue;
      data << detail::number(group.x[k]) << ' ' << detail::number(group.y[k]) << ' '
           << detail::quoted(group.labels[k]) << '\n';
      spots.push_back({area.left + x_range.share(group.x[k]) * (area.right - area.left),
                       area.bottom + y_range.share(group.y[k]) * (area.top - area.bottom)});
      labels.push_back(group.labels[k]);
      colours.push_back(detail::colour(i));
      obstacles.push_back(around(spots.back(), 6));
      if (!group.joined || spots.size() - first < 2) continue;
      const detail::Spot a = spots[spots.size() - 2], b = spots.back();
      const int pieces = 1 + static_cast<int>(std::hypot(b.x - a.x, b.y - a.y) / 5);
      for (int piece = 1; piece < pieces; ++piece) {
        const double t = static_cast<double>(piece) / pieces;
        obstacles.push_back(detail::around({a.x + t * (b.x - a.x), a.y + t * (b.y - a.y)}, 3));
      }
    }
    if (spots.size() == first) data << "NaN NaN ''\n";  // every group keeps its index
    data << "\n\n";
    plot << (i > 0 ? ", " : "") << detail::quoted(figure.name + ".dat") << " index " << i << " with "
         << (group.joined ? "linespoints linewidth 1" : "points") << " pointtype " << (group.joined ? 5 : 7)
         << " pointsize 1 linecolor '" << detail::colour(i) << "' title " << detail::quoted(group.name);
  }
  const auto screen = [](double x, double y) {
    return rbres::detail::text("screen ", x / detail::canvas_width, ", screen ", y / detail::canvas_height);
  };
  const auto places = detail::place_labels(spots, labels, obstacles, room);
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto& place = places[i];
    const detail::Spot near = place.nearest(spots[i]);
    // From the side that faces the point, as a viewer's font may be narrower than the estimate.
    const bool right_of = place.left > spots[i].x, left_of = place.right < spots[i].x;
    settings << "set label " << detail::quoted(labels[i]) << " noenhanced font ',9' textcolor '" << colours[i]
             << "' "
             << (right_of  ? "left"
                 : left_of ? "right"
                           : "center")
             << " at "
             << screen(right_of  ? place.left
                       : left_of ? place.right
                                 : (place.left + place.right) / 2,
                       (place.bottom + place.top) / 2)
             << '\n';
    if (std::hypot(near.x - spots[i].x, near.y - spots[i].y) > detail::leader_length)
      settings << "set arrow nohead linecolor '#a0a0a0' linewidth 0.7 from " << screen(spots[i].x, spots[i].y)
               << " to " << screen(near.x, near.y) << '\n';
  }
  settings << "set lmargin at screen " << left << "\nset rmargin at screen " << right
           << "\nset bmargin at screen " << bottom << "\nset tmargin at screen " << top << '\n'
           << "set key at screen " << right + 0.015 << ", screen " << top << " left top\n"
           << detail::log_axis("x") << detail::log_axis("y") << "set xrange [1e" << x_range.low << ":1e"
           << x_range.high << "]\nset yrange [1e" << y_range.low << ":1e" << y_range.high << "]\n";
  return detail::draw(figure, data.str(), settings.str(), plot.str());
}

/// Medians (strokes) within quartiles (boxes), side by side in each category, on a logarithmic axis.
inline bool draw_quartiles(const Figure& figure, const std::vector<std::string>& categories,
                           const std::vector<QuartileSeries>& series) {
  std::ostringstream data, settings, plot;
  settings << detail::log_axis("y")
           << "unset grid\nset grid ytics linecolor '#d8d8d8' linetype 1 linewidth 0.5\n"
           << "set xrange [-0.5:" << static_cast<double>(categories.size()) - 0.5
           << "]\nset xtics noenhanced (";
  for (std::size_t c = 0; c < categories.size(); ++c)
    settings << (c > 0 ? ", " : "") << detail::quoted(categories[c]) << ' ' << c;
  settings << ")\n";
  const double width = 0.8 / static_cast<double>(std::max<std::size_t>(1, series.size()));
  for (std::size_t i = 0; i < series.size(); ++i) {
    detail::same_size(figure, categories.size(), series[i].quartiles.size());
    data << "# " << series[i].name << '\n';
    for (std::size_t c = 0; c < categories.size(); ++c) {
      const Quartiles& q = series[i].quartiles[c];
      data << static_cast<double>(c) - 0.4 + width * (static_cast<double>(i) + 0.5) << ' '
           << detail::number(q.lower) << ' ' << detail::number(q.median) << ' ' << detail::number(q.upper)
           << '\n';
    }
    data << "\n\n";
    const std::string source =
        detail::quoted(figure.name + ".dat") + rbres::detail::text(" index ", i, " using ");
    const std::string colour = " linecolor '" + detail::colour(i) + "' ";
    const double half = 0.42 * width;
    plot << (i > 0 ? ", " : "") << source << "1:3:($1-" << half << "):($1+" << half
         << "):2:4 with boxxyerrorbars fillstyle transparent solid 0.4 linewidth 0.7" << colour << "title "
         << detail::quoted(series[i].name) << ", " << source << "($1-" << half << "):3:(" << 2 * half
         << "):(0) with vectors nohead linewidth 2.5" << colour << "notitle";
  }
  return detail::draw(figure, data.str(), settings.str(), plot.str());
}

}  // namespace figures
