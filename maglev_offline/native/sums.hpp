// Sums over the features of a row, in one order for every instruction set, and the transposes that they are made with.
#pragma once
#include "vectors.hpp"

namespace maglev::MAGLEV_ISA {

// A sum over features in 16 partial sums, whatever the vector: then 16 -> 8 -> 4, and 4 -> 1 as (0 + 1) + (2 + 3).
struct Sum {
    V part[parts];
};

MAGLEV_INLINE V4 four(const Sum& sum) {
    V4 r;
    if constexpr (lanes == 4) {
        const V a = sum.part[0] + sum.part[2 % parts], b = sum.part[1 % parts] + sum.part[3 % parts];
        for (int i = 0; i < 4; ++i) r[i] = a[i] + b[i];
    } else {
        typedef float V8 __attribute__((vector_size(32), aligned(32), may_alias));
        V8 eight;
        if constexpr (lanes == 8) {
            const V both = sum.part[0] + sum.part[1 % parts];
            eight = *reinterpret_cast<const V8*>(&both);
        } else {
            const V8* half = reinterpret_cast<const V8*>(&sum.part[0]);
            eight = half[0] + half[lanes / 16];
        }
        const V4* half = reinterpret_cast<const V4*>(&eight);
        r = half[0] + half[1];
    }
    return r;
}

MAGLEV_INLINE float one(const Sum& sum) {
    const V4 s = four(sum);
    return (s[0] + s[1]) + (s[2] + s[3]);
}

MAGLEV_INLINE void transpose_4(V4& a, V4& b, V4& c, V4& d) {
    const V4 ab = MAGLEV_PICK(a, b, 0, 4, 1, 5), cd = MAGLEV_PICK(c, d, 0, 4, 1, 5);
    const V4 AB = MAGLEV_PICK(a, b, 2, 6, 3, 7), CD = MAGLEV_PICK(c, d, 2, 6, 3, 7);
    a = MAGLEV_PICK(ab, cd, 0, 1, 4, 5), b = MAGLEV_PICK(ab, cd, 2, 3, 6, 7);
    c = MAGLEV_PICK(AB, CD, 0, 1, 4, 5), d = MAGLEV_PICK(AB, CD, 2, 3, 6, 7);
}

// Products of R rows with w, as four sums each.
template <int R>
MAGLEV_INLINE void dot_tile(const float* in, int stride, const float* w, int vectors, V4* to) {
    Sum sum[R] = {};
    int n = 0;
    for (; n + parts <= vectors; n += parts)
        MAGLEV_UNROLL
        for (int part = 0; part < parts; ++part) {
            const V weight = load(w + (n + part) * lanes);
            MAGLEV_UNROLL
            for (int r = 0; r < R; ++r) sum[r].part[part] += load(in + r * stride + (n + part) * lanes) * weight;
        }
    MAGLEV_UNROLL
    for (int part = 0; part < parts - 1; ++part) {
        if (n + part >= vectors) break;
        const V weight = load(w + (n + part) * lanes);
        MAGLEV_UNROLL
        for (int r = 0; r < R; ++r) sum[r].part[part] += load(in + r * stride + (n + part) * lanes) * weight;
    }
    MAGLEV_UNROLL
    for (int r = 0; r < R; ++r) to[r] = four(sum[r]);
}

// out[row] = in[row, :] . w + bias
static void dot_rows(int rows, const float* in, int stride, const float* w, int width, float bias, float* out) {
    const int vectors = width / lanes;
    int row = 0;
    for (; row + 4 <= rows; row += 4) {
        V4 s[4];
        dot_tile<4>(in + row * stride, stride, w, vectors, s);
        transpose_4(s[0], s[1], s[2], s[3]);
        const V4 total = ((s[0] + s[1]) + (s[2] + s[3])) + bias;
        __builtin_memcpy(out + row, &total, sizeof total);
    }
    for (; row < rows; ++row) {
        V4 s;
        dot_tile<1>(in + row * stride, stride, w, vectors, &s);
        out[row] = ((s[0] + s[1]) + (s[2] + s[3])) + bias;
    }
}

// to[j, k] = from[k, j] for k < rows, j < columns
static void transpose(int rows, int columns, const float* from, int from_stride, float* to, int to_stride) {
    int k = 0;
    for (; k + 4 <= rows; k += 4) {
        int j = 0;
        for (; j + 4 <= columns; j += 4) {
            V4 block[4];
            for (int i = 0; i < 4; ++i) block[i] = *reinterpret_cast<const V4*>(from + (k + i) * from_stride + j);
            transpose_4(block[0], block[1], block[2], block[3]);
            for (int i = 0; i < 4; ++i) *reinterpret_cast<V4*>(to + (j + i) * to_stride + k) = block[i];
        }
        for (; j < columns; ++j)
            for (int i = 0; i < 4; ++i) to[j * to_stride + k + i] = from[(k + i) * from_stride + j];
    }
    for (; k < rows; ++k)
        for (int j = 0; j < columns; ++j) to[j * to_stride + k] = from[k * from_stride + j];
}

}  // namespace maglev::MAGLEV_ISA
