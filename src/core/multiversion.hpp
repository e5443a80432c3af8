#pragma once

/// Compiles a function twice, for any CPU and for those with AVX2; which one runs is decided when the program
/// is loaded. Loops over arrays in it become twice as wide, and their results stay the same to the last bit:
/// without fused multiply-add, both round after each operation.
///
/// The loader decides before sanitizers are ready, so that they get the plain version.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__) && \
    !defined(__SANITIZE_ADDRESS__)
#define LCR_MULTIVERSION __attribute__((target_clones("avx2", "default")))
#else
#define LCR_MULTIVERSION
#endif
