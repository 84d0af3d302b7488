// Vectors of LANES floats in the compilers' own notation (g++ and clang++): one source for every instruction set.
//
// A translation unit defines LANES and MAGLEV_ISA, the namespace that keeps its code apart from that of the other
// instruction sets. Nothing here may call a library template: the linker would keep one copy of it for all of them.
#pragma once
#include <cstdint>

#define MAGLEV_INLINE static inline __attribute__((always_inline))
#define MAGLEV_CALL static __attribute__((noinline))  // g++ keeps a loop's sums in registers where it is on its own
#define MAGLEV_UNROLL _Pragma("GCC unroll 16")

#if defined(__clang__) || __GNUC__ >= 12
#define MAGLEV_PICK(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define MAGLEV_PICK(a, b, ...) __builtin_shuffle(a, b, I4{__VA_ARGS__})
#endif

namespace maglev::MAGLEV_ISA {

constexpr int lanes = LANES;
constexpr int parts = 16 / LANES;
typedef float V __attribute__((vector_size(4 * LANES), aligned(4 * LANES), may_alias));
typedef std::int32_t I __attribute__((vector_size(4 * LANES), aligned(4 * LANES), may_alias));
typedef std::int32_t I4 __attribute__((vector_size(16), aligned(16)));
typedef float V4 __attribute__((vector_size(16), aligned(16), may_alias));

MAGLEV_INLINE V load(const float* p) { return *reinterpret_cast<const V*>(p); }
MAGLEV_INLINE void store(float* p, V x) { *reinterpret_cast<V*>(p) = x; }
typedef float U __attribute__((vector_size(4 * LANES), aligned(4), may_alias));
MAGLEV_INLINE V load_anywhere(const float* p) { return *reinterpret_cast<const U*>(p); }
MAGLEV_INLINE void store_anywhere(float* p, V x) { *reinterpret_cast<U*>(p) = x; }
MAGLEV_INLINE V splat(float x) { return x - V{}; }  // x - 0 is x, -0 included, so this is a broadcast and no more

// NaN goes through all of these: a run that diverged stays a run that diverged.
MAGLEV_INLINE V relu(V x) {
#if LANES == 8
    return __builtin_ia32_maxps256(V{}, x);
#else
    return V{} > x ? V{} : x;
#endif
}
MAGLEV_INLINE V clamp(V x, float low, float high) {
    const V lowest = splat(low), highest = splat(high);
    const V above = lowest > x ? lowest : x;
    return highest < above ? highest : above;
}
MAGLEV_INLINE V larger(V a, V b) { return ((a > b) | (a != a)) ? a : b; }
MAGLEV_INLINE V magnitude(V x) { return (V)((I)x & 0x7fffffff); }

// Bit i is set where lane i is 0.
MAGLEV_INLINE std::uint32_t zeros(I x) {
#if LANES == 8
    return static_cast<unsigned>(__builtin_ia32_movmskps256((V)(x == 0)));
#elif LANES == 4 && defined(__SSE2__)
    return static_cast<unsigned>(__builtin_ia32_movmskps((V)(x == 0)));
#else
    std::uint32_t bits = 0;
    for (int i = 0; i < lanes; ++i) bits |= (x[i] == 0 ? 1u : 0u) << i;
    return bits;
#endif
}

MAGLEV_INLINE V square_root(V x) {
    V r;
    for (int i = 0; i < lanes; ++i) r[i] = __builtin_sqrtf(x[i]);
    return r;
}

// e^x for |x| <= 40: x = n ln 2 + f, and e^f by its series to f^7 (|f| <= 0.35: the rest is below 1e-8).
MAGLEV_INLINE V exponential(V x) {
    const V round = splat(12582912.0f);  // 1.5 * 2^23: adding it rounds to a whole number
    const V shifted = x * 1.44269504f + round;
    const V n = shifted - round;
    const V f = (x - n * 0.693359375f) - n * -2.12194440e-4f;  // ln 2 in two parts, the first exact in few bits
    V series = splat(1.0f / 5040);
    series = series * f + 1.0f / 720;
    series = series * f + 1.0f / 120;
    series = series * f + 1.0f / 24;
    series = series * f + 1.0f / 6;
    series = series * f + 0.5f;
    series = series * f + 1.0f;
    series = series * f + 1.0f;
    return (V)((I)series + (((I)shifted - (I)round) << 23));
}

// 1 - 2 / (e^2|x| + 1) with the sign of x; an odd polynomial where that would cancel. Off by 2 units of the last bit.
MAGLEV_INLINE V hyperbolic_tangent(V x) {
    const V size = magnitude(x);
    const V capped = size > 10.0f ? splat(10.0f) : size;
    const V far = 1.0f - 2.0f / (exponential(capped + capped) + 1.0f);
    const V signed_far = (V)((I)far | ((I)x & (I)splat(-0.0f)));
    const V s = x * x;
    V near = splat(-0.0056669763f);
    near = near * s + 0.020606175f;
    near = near * s - 0.053730007f;
    near = near * s + 0.13331331f;
    near = near * s - 0.33333278f;
    near = near * s * x + x;
    return size < 0.625f ? near : (x != x ? x : signed_far);
}

}  // namespace maglev::MAGLEV_ISA
