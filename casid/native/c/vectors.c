/* The type V of W lanes, and functions of it: of the vector library of glibc where there is one, else lane by lane. */
#include <math.h>
#include <string.h>
#if defined(__AVX512F__)
#define W 8
#elif defined(__AVX__)
#define W 4
#else
#define W 2
#endif
typedef double V __attribute__((vector_size(8 * W)));
#if defined(CASID_MVEC) && defined(__GLIBC__) && (defined(__AVX512F__) || defined(__AVX2__))
#if defined(__AVX512F__)
#define MVEC1(f) _ZGVeN8v_##f
#define MVEC2(f) _ZGVeN8vv_##f
#else
#define MVEC1(f) _ZGVdN4v_##f
#define MVEC2(f) _ZGVdN4vv_##f
#endif
#define VECTOR1(f) V MVEC1(f)(V); static inline V v_##f(V a) { return MVEC1(f)(a); }
#define VECTOR2(f) V MVEC2(f)(V, V); static inline V v_##f(V a, V b) { return MVEC2(f)(a, b); }
#if __GLIBC_PREREQ(2, 35)
#define LATER1 VECTOR1
#define LATER2 VECTOR2
#endif
#else
#define VECTOR1 LANES1
#endif
#define LANES1(f) static inline V v_##f(V a) { V r; for (int i = 0; i < W; i++) r[i] = f(a[i]); return r; }
#define LANES2(f) static inline V v_##f(V a, V b) { V r; for (int i = 0; i < W; i++) r[i] = f(a[i], b[i]); return r; }
#ifndef LATER1
#define LATER1 LANES1
#define LATER2 LANES2
#endif
