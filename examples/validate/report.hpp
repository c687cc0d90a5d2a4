#pragma once

#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

namespace validate {

/// One check: what was measured against what is promised.
struct Row {
  std::string name;
  double measured;
  double bound;
  std::string unit;
  std::string reference;  ///< what the figure is held against, and what was chosen where that is open

  bool pass() const { return measured <= bound; }  // NaN fails
};

using Rows = std::vector<Row>;

/// Keeps the largest of what it sees; NaN stays.
class Worst {
 public:
  void operator()(double error) {
    if (!(error <= value_)) value_ = error;
  }
  double value() const { return value_; }

 private:
  double value_ = 0;
};

inline void print_table(const Rows& rows, std::FILE* out) {
  std::fprintf(out, "%-28s %11s %9s  %-10s %-5s %s\n", "name", "measured", "bound", "unit", "pass",
               "reference");
  for (const Row& r : rows) {
    std::fprintf(out, "%-28s %11.3e %9.1e  %-10s %-5s %s\n", r.name.c_str(), r.measured, r.bound,
                 r.unit.c_str(), r.pass() ? "yes" : "NO", r.reference.c_str());
  }
}

inline void print_json(const Rows& rows, std::FILE* out) {
  std::fprintf(out, "[");
  const char* separator = "\n";
  for (const Row& r : rows) {
    // JSON has no NaN.
    char measured[32] = "null";
    if (std::isfinite(r.measured)) std::snprintf(measured, sizeof measured, "%.17g", r.measured);
    std::fprintf(
        out,
        "%s  {\"name\": \"%s\", \"measured\": %s, \"bound\": %.17g, \"unit\": \"%s\", \"reference\": \"%s\", "
        "\"pass\": %s}",
        separator, r.name.c_str(), measured, r.bound, r.unit.c_str(), r.reference.c_str(),
        r.pass() ? "true" : "false");
    separator = ",\n";
  }
  std::fprintf(out, "\n]\n");
}

}  // namespace validate
