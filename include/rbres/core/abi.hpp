#pragma once

// RBRES_ABI is the inline namespace that all of rbres stands in, named after the instructions that the
// compiler may use, and whether it may use exceptions. Inline functions and templates compiled for two
// instruction sets differ. With one name for both, the linker would keep either of them, perhaps the one that
// the processor cannot run. So each has its own name, and files compiled with different -march, or some with
// -fno-exceptions, may stand in one program. What hands rbres's types from one such file to another does not
// link.
//
// To declare ahead what is rbres's, include this header and open the namespace as rbres does:
//   namespace rbres::RBRES_ABI { template <class S> struct Vec3; }

// Each of these extensions of x86 includes those below it. On other processors the extension for vectors
// stands alone.
#if defined(__AVX512F__)
#define RBRES_ABI_VECTORS avx512_
#elif defined(__AVX2__)
#define RBRES_ABI_VECTORS avx2_
#elif defined(__AVX__)
#define RBRES_ABI_VECTORS avx_
#elif defined(__SSE4_2__)
#define RBRES_ABI_VECTORS sse42_
#elif defined(__SSE4_1__)
#define RBRES_ABI_VECTORS sse41_
#elif defined(__SSSE3__)
#define RBRES_ABI_VECTORS ssse3_
#elif defined(__SSE3__)
#define RBRES_ABI_VECTORS sse3_
#elif defined(__SSE2__)
#define RBRES_ABI_VECTORS sse2_
#elif defined(__ARM_FEATURE_SVE2)
#define RBRES_ABI_VECTORS sve2_
#elif defined(__ARM_FEATURE_SVE)
#define RBRES_ABI_VECTORS sve_
#elif defined(__ARM_NEON)
#define RBRES_ABI_VECTORS neon_
#elif defined(__wasm_simd128__)
#define RBRES_ABI_VECTORS simd128_
#else
#define RBRES_ABI_VECTORS scalar_
#endif

// A letter for each of x86's other extensions: long names would fill the compiler's messages.
#if defined(__POPCNT__)
#define RBRES_ABI_POPCNT p
#else
#define RBRES_ABI_POPCNT
#endif
#if defined(__LZCNT__)
#define RBRES_ABI_LZCNT l
#else
#define RBRES_ABI_LZCNT
#endif
#if defined(__BMI__)
#define RBRES_ABI_BMI b
#else
#define RBRES_ABI_BMI
#endif
#if defined(__BMI2__)
#define RBRES_ABI_BMI2 c
#else
#define RBRES_ABI_BMI2
#endif
#if defined(__MOVBE__)
#define RBRES_ABI_MOVBE m
#else
#define RBRES_ABI_MOVBE
#endif
#if defined(__F16C__)
#define RBRES_ABI_F16C h
#else
#define RBRES_ABI_F16C
#endif
#if defined(__FMA__)
#define RBRES_ABI_FMA f
#else
#define RBRES_ABI_FMA
#endif
#if defined(__AVX512CD__)
#define RBRES_ABI_AVX512CD C
#else
#define RBRES_ABI_AVX512CD
#endif
#if defined(__AVX512DQ__)
#define RBRES_ABI_AVX512DQ D
#else
#define RBRES_ABI_AVX512DQ
#endif
#if defined(__AVX512BW__)
#define RBRES_ABI_AVX512BW B
#else
#define RBRES_ABI_AVX512BW
#endif
#if defined(__AVX512VL__)
#define RBRES_ABI_AVX512VL V
#else
#define RBRES_ABI_AVX512VL
#endif
#if defined(__AVX512IFMA__)
#define RBRES_ABI_AVX512IFMA I
#else
#define RBRES_ABI_AVX512IFMA
#endif
#if defined(__AVX512VBMI__)
#define RBRES_ABI_AVX512VBMI X
#else
#define RBRES_ABI_AVX512VBMI
#endif
#if defined(__AVX512VBMI2__)
#define RBRES_ABI_AVX512VBMI2 Y
#else
#define RBRES_ABI_AVX512VBMI2
#endif
#if defined(__AVX512VNNI__)
#define RBRES_ABI_AVX512VNNI N
#else
#define RBRES_ABI_AVX512VNNI
#endif
#if defined(__AVX512BF16__)
#define RBRES_ABI_AVX512BF16 G
#else
#define RBRES_ABI_AVX512BF16
#endif
#if defined(__AVX512FP16__)
#define RBRES_ABI_AVX512FP16 H
#else
#define RBRES_ABI_AVX512FP16
#endif
#if defined(__AVX512VPOPCNTDQ__)
#define RBRES_ABI_AVX512VPOPCNTDQ P
#else
#define RBRES_ABI_AVX512VPOPCNTDQ
#endif
#if defined(__AVX512BITALG__)
#define RBRES_ABI_AVX512BITALG T
#else
#define RBRES_ABI_AVX512BITALG
#endif
#if defined(__AVXVNNI__)
#define RBRES_ABI_AVXVNNI n
#else
#define RBRES_ABI_AVXVNNI
#endif

// Without exceptions a refused input ends in error_handler (error.hpp).
#if defined(__cpp_exceptions)
#define RBRES_HAS_EXCEPTIONS 1
#define RBRES_ABI_EXCEPTIONS
#else
#define RBRES_HAS_EXCEPTIONS 0
#define RBRES_ABI_EXCEPTIONS _noexceptions
#endif

#define RBRES_ABI_PASTE_8(a, b, c, d, e, f, g, h) a##b##c##d##e##f##g##h
#define RBRES_ABI_JOIN_8(a, b, c, d, e, f, g, h) RBRES_ABI_PASTE_8(a, b, c, d, e, f, g, h)
#define RBRES_ABI_1                                                                                     \
  RBRES_ABI_JOIN_8(RBRES_ABI_VECTORS, RBRES_ABI_POPCNT, RBRES_ABI_LZCNT, RBRES_ABI_BMI, RBRES_ABI_BMI2, \
                   RBRES_ABI_MOVBE, RBRES_ABI_F16C, RBRES_ABI_FMA)
#define RBRES_ABI_2                                                                         \
  RBRES_ABI_JOIN_8(RBRES_ABI_1, RBRES_ABI_AVX512CD, RBRES_ABI_AVX512DQ, RBRES_ABI_AVX512BW, \
                   RBRES_ABI_AVX512VL, RBRES_ABI_AVX512IFMA, RBRES_ABI_AVX512VBMI, RBRES_ABI_AVX512VBMI2)
#define RBRES_ABI                                                                                        \
  inline RBRES_ABI_JOIN_8(RBRES_ABI_2, RBRES_ABI_AVX512VNNI, RBRES_ABI_AVX512BF16, RBRES_ABI_AVX512FP16, \
                          RBRES_ABI_AVX512VPOPCNTDQ, RBRES_ABI_AVX512BITALG, RBRES_ABI_AVXVNNI,          \
                          RBRES_ABI_EXCEPTIONS)
