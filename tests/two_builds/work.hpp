#pragma once

struct Results {
  double network = 0;  ///< norm of a network's outputs
  double norm = 0;     ///< of (2, 3, 6), by lanes
  double sum = 0;      ///< of the numbers below 4, by threads
};

/// The same source, compiled for x86-64 and for x86-64-v3.
namespace plain {
Results work();
void refuse();
}  // namespace plain
namespace wide {
Results work();
void refuse();
}  // namespace wide
