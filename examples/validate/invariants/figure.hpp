#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace validate {

/// Which random cases are drawn: case i is a function of the seed and of i alone, so that any of them can be
/// drawn again by itself.
struct Cases {
  std::uint64_t seed = 8;
  long first = 0;
  long count = 0;
};

/// The worst of some cases, and which that was.
class Figure {
 public:
  void operator()(double value, long number, const std::string& where = {}) {
    if (value <= value_ || std::isnan(value_)) return;
    value_ = value;
    case_ = number;
    where_ = where;
  }
  void operator()(const Figure& other) { (*this)(other.value_, other.case_, other.where_); }

  double value() const { return value_; }  ///< NaN where a case gave NaN
  long number() const { return case_; }    ///< of the worst case, -1: none was above 0
  const std::string& where() const { return where_; }

 private:
  double value_ = 0;
  long case_ = -1;
  std::string where_;
};

/// What some cases gave, and what they may.
struct Finding {
  std::string name;  ///< of the row of rbres_validate
  std::string unit;
  double bound;
  std::string what;  ///< what is measured, and where
  Figure figure;

  bool good() const { return figure.value() <= bound; }  // NaN is not
};

/// Properties of one type of world that are found in the same runs.
struct Group {
  std::string name;
  std::string type;        ///< shape, and scalar where it is not double
  long quick, full, rows;  ///< cases of the quick tests, of all tests, and of rbres_validate's rows
  std::function<std::vector<Finding>(const Cases&)> run;
};

}  // namespace validate
