#pragma once

#include <rbres/core/error.hpp>
#include <string>

/// What f() refuses; "" where it does not.
template <class F>
std::string error_of(const F& f) {
  try {
    f();
  } catch (const rbres::Error& error) {
    return error.what();
  }
  return "";
}
