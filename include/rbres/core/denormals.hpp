#pragma once

#include <rbres/core/abi.hpp>

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace rbres::RBRES_ABI::detail {

/// While it lives, numbers of this thread that are too small for full precision (below 1.2e-38 in float) are
/// zero: weights that nothing but the L2 term moves, and their moments, fade into that range, where each
/// operation takes a hundred times as long. On processors other than x86 it does nothing.
class FlushDenormals {
 public:
#if defined(__SSE2__)
  FlushDenormals() noexcept : before_(_mm_getcsr()) { _mm_setcsr(before_ | results | operands); }
  ~FlushDenormals() { _mm_setcsr(before_); }
#else
  FlushDenormals() noexcept {}
#endif
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

#if defined(__SSE2__)
 private:
  static constexpr unsigned results = 0x8000, operands = 0x0040;  // of the control register MXCSR
  unsigned before_;
#endif
};

}  // namespace rbres::RBRES_ABI::detail
