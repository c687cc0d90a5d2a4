#pragma once

#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstddef>
#include <filesystem>
#include <iterator>
#include <sstream>
#include <string>

#include <rbres/core/error.hpp>
#include <rbres/io/atomic_file.hpp>

namespace figures {

/// Where a figure goes and what stands around it. Labels carry their units: "position error [m]".
struct Figure {
  std::filesystem::path folder;
  std::string name;  ///< of the files, without an ending
  std::string title, x_label, y_label;
};

/// What to tell the user when a figure was not drawn.
inline std::string how_to_draw(const std::filesystem::path& folder) {
  return "The figures were left out, as gnuplot was not found or failed. Draw them with:\n  cd " +
         folder.string() + " && gnuplot *.gp\n";
}

namespace detail {

/// Every figure's size, in the unit that labels are placed in (pixels of the SVG).
inline constexpr int canvas_width = 900, canvas_height = 540;

/// Told apart with any colour vision: Okabe and Ito (2008), without the yellow, which white paper swallows.
inline std::string colour(std::size_t i) {
  constexpr const char* palette[] = {"#0072B2", "#D55E00", "#009E73", "#CC79A7",
                                     "#E69F00", "#56B4E9", "#000000"};
  return palette[i % std::size(palette)];
}

/// A second round through the colours is dashed.
inline std::size_t dash(std::size_t i) { return 1 + i / 7; }

inline std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? "''" : std::string(1, c);
  return result + "'";
}

/// Numbers that are not finite are gaps.
inline std::string number(double x) { return std::isfinite(x) ? rbres::detail::text(x) : "NaN"; }

inline void same_size(const Figure& figure, std::size_t x, std::size_t y) {
  if (x != y)
    rbres::detail::refuse("figure " + figure.name, rbres::detail::text(x, " values of y, one per x"), y);
}

/// What all figures share.
inline std::string preamble(const Figure& figure) {
  std::ostringstream out;
  out << "reset\n"
      << "set title " << quoted(figure.title) << " noenhanced font ',13'\n"
      << "set xlabel " << quoted(figure.x_label) << " noenhanced\n"
      << "set ylabel " << quoted(figure.y_label) << " noenhanced\n"
      << "set border 3 linecolor '#404040'\nset tics nomirror out\n"
      << "set grid linecolor '#d8d8d8' linetype 1 linewidth 0.5\n"
      << "set key outside right top vertical Left reverse noenhanced samplen 2 spacing 1.3 width 1\n";
  return out.str();
}

inline std::string log_axis(const char* axis) {
  return rbres::detail::text("set logscale ", axis, "\nset format ", axis, " '10^{%L}'\n");
}

inline void write_file(const std::filesystem::path& path, const std::string& content) {
  rbres::AtomicFile file(path);
  file.write(content.data(), content.size());
  file.commit();
}

/// Writes the files and runs gnuplot on the script, in its folder.
inline bool draw(const Figure& figure, const std::string& data, const std::string& settings,
                 const std::string& plot) {
  const std::string size = rbres::detail::text(canvas_width, ",", canvas_height);
  std::ostringstream script;
  script << preamble(figure) << settings  //
         << "set terminal pngcairo enhanced font 'DejaVu Sans,11' fontscale 1.5 linewidth 1.5 pointscale 1.5 "
            "size "
         << 1.5 * canvas_width << "," << 1.5 * canvas_height << "\nset output "
         << quoted(figure.name + ".png") << "\nplot " << plot
         << "\nset terminal svg enhanced font 'DejaVu Sans,11' fontscale 1.3 background '#ffffff' size "
         << canvas_width << "," << canvas_height << "\nset output " << quoted(figure.name + ".svg")
         << "\nreplot\nunset output\n";
  // In a locale that is not UTF-8 gnuplot warns of other characters, and draws others.
  for (const char c : data + script.str())
    if (static_cast<unsigned char>(c) > 127)
      rbres::detail::refuse("figure " + figure.name, "names and labels in ASCII", "other characters");
  std::filesystem::create_directories(figure.folder);
  write_file(figure.folder / (figure.name + ".dat"), data);
  const std::string script_name = figure.name + ".gp";
  write_file(figure.folder / script_name, script.str());

  const pid_t child = ::fork();
  if (child == 0) {
    if (::chdir(figure.folder.c_str()) == 0)
      ::execlp("gnuplot", "gnuplot", script_name.c_str(), static_cast<char*>(nullptr));
    ::_exit(127);
  }
  int status = -1;
  return child > 0 && ::waitpid(child, &status, 0) == child && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

}  // namespace detail

}  // namespace figures
