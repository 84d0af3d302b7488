// What layers are made of: small dense products and their gradients on rows of features, vectors along the features.
//
// Every output is a sum in the order of the inputs, whatever the tile it is computed in: a row's numbers do not depend
// on the rows beside it, and AVX2 and AVX-512 agree in every bit.
#pragma once
#include "layout.hpp"
#include "vectors.hpp"

namespace maglev::MAGLEV_ISA {

// A tile is R rows by N vectors of sums that stay in registers: 16 of them up to AVX2, 32 with AVX-512. At least eight
// keep two multiplying units busy, and the rows divide `rows_at_once`.
template <int N> constexpr int tile_rows = lanes == 16 ? (N > 3 ? 4 : 5) : (N > 3 ? 2 : 4);

// The vectors of a row are worked off in panels of at most five, none of them much narrower than it must be.
constexpr int panel_of(int left) { return left <= 5 ? left : left == 6 ? 3 : left == 7 ? 4 : 5; }

template <int N> struct Panel {
    static constexpr int vectors = N;
};

// Call `work(Panel, at)` for the panels of a row of `width` floats, `at` being where each begins.
template <class Work>
MAGLEV_INLINE void in_panels(int width, const Work& work) {
    for (int at = 0; at < width;) {
        const int vectors = panel_of((width - at) / lanes);
        switch (vectors) {
            case 1: work(Panel<1>{}, at); break;
            case 2: work(Panel<2>{}, at); break;
            case 3: work(Panel<3>{}, at); break;
            case 4: work(Panel<4>{}, at); break;
            case 5: work(Panel<5>{}, at); break;
        }
        at += vectors * lanes;
    }
}

enum class After { nothing, relu, normalised_relu, masked };

// Which inputs of a tile are read: all, or those that one of its rows has. About half of what comes out of a relu is 0,
// and a product of 0 and a number changes no sum; weights that are no numbers are found out by other means
// (agents/divergence.py). Of more rows than two there is seldom an input that none has.
enum class Reads { all, active };
template <Reads reads, int N> constexpr bool skips = reads == Reads::active && tile_rows<N> == 2;

// Bit k: whether input k of some rows is anything but 0 in one of them. Inputs from 64 on are always read.
typedef std::uint64_t Bits;
constexpr int bits = 64;

template <int R>
MAGLEV_INLINE Bits active_inputs(const float* in, int stride, int inputs) {
    Bits zero = 0;
#pragma GCC unroll 16
    for (int at = 0; at < bits; at += lanes) {
        if (at >= inputs) break;
        I any = {};
        MAGLEV_UNROLL
        for (int r = 0; r < R; ++r) any |= (I)load(in + r * stride + at);
        zero |= static_cast<Bits>(zeros(any)) << at;
    }
    return inputs < bits ? ~zero & ((Bits{1} << inputs) - 1) : ~zero;
}

// The active inputs of each pair of rows, and of the last row where it has none to go with.
MAGLEV_CALL void find_active(int rows, const float* in, int stride, int inputs, Bits* active) {
    for (; rows > 1; rows -= 2, in += 2 * stride) *active++ = active_inputs<2>(in, stride, inputs);
    if (rows) *active = active_inputs<1>(in, stride, inputs);
}

// A frozen batch norm, for `normalised_relu`.
struct Frozen {
    const float *mean, *scale, *shift;
    Frozen from(int at) const { return mean ? Frozen{mean + at, scale + at, shift + at} : *this; }
};

template <bool skipping, After after, int R, int N>
MAGLEV_INLINE void dense_tile(
    const float* in, int in_stride, int inputs, Bits active, const float* w, int w_stride, const float* bias,
    float* out, int out_stride, const Frozen& norm) {
    V sum[R][N];
    MAGLEV_UNROLL
    for (int n = 0; n < N; ++n) {
        const V start = bias ? load(bias + n * lanes) : V{};
        MAGLEV_UNROLL
        for (int r = 0; r < R; ++r) sum[r][n] = start;
    }
    const float* row[R];
    MAGLEV_UNROLL
    for (int r = 0; r < R; ++r) row[r] = in + r * in_stride;
    const std::ptrdiff_t stride = w_stride;
    const auto add_input = [&](std::ptrdiff_t k) __attribute__((always_inline)) {
        const float* const from = w + k * stride;
        V weight[N];
        MAGLEV_UNROLL
        for (int n = 0; n < N; ++n) weight[n] = load(from + n * lanes);
        MAGLEV_UNROLL
        for (int r = 0; r < R; ++r) {
            const V x = splat(row[r][k]);
            MAGLEV_UNROLL
            for (int n = 0; n < N; ++n) sum[r][n] += x * weight[n];
        }
    };
    std::ptrdiff_t k = 0;
    if constexpr (skipping) {
        for (; active; active &= active - 1) add_input(__builtin_ctzll(active));
        k = bits;
    }
#pragma GCC unroll 4
    for (; k < inputs; ++k) add_input(k);
    MAGLEV_UNROLL
    for (int r = 0; r < R; ++r) {
        MAGLEV_UNROLL
        for (int n = 0; n < N; ++n) {
            V y = sum[r][n];
            const int at = n * lanes;
            if (after == After::relu) y = relu(y);
            if (after == After::normalised_relu)
                y = relu((y - load(norm.mean + at)) * load(norm.scale + at) + load(norm.shift + at));
            float* const to = out + r * out_stride + at;
            if (after == After::masked) y = load(to) > 0.0f ? y : V{};
            store(to, y);
        }
    }
}

// `active`: of each tile, where tiles skip.
template <Reads reads, After after, int N>
MAGLEV_CALL void dense_panel(
    int rows, const float* in, int in_stride, int inputs, const Bits* active, const float* w, int w_stride,
    const float* bias, float* out, int out_stride, Frozen norm) {
    constexpr int R = tile_rows<N>;
    constexpr bool skipping = skips<reads, N>;
    const auto next = [&] { return skipping ? *active++ : 0; };
    for (; rows >= R; rows -= R, in += R * in_stride, out += R * out_stride)
        dense_tile<skipping, after, R, N>(in, in_stride, inputs, next(), w, w_stride, bias, out, out_stride, norm);
    for (; rows > 0; --rows, in += in_stride, out += out_stride)
        dense_tile<skipping, after, 1, N>(in, in_stride, inputs, next(), w, w_stride, bias, out, out_stride, norm);
}

// out[row, :] = after(in[row, :inputs] w + bias) for `width` columns, a multiple of the lanes.
template <Reads reads, After after>
static void dense(
    int rows, const float* in, int in_stride, int inputs, const float* w, int width, const float* bias, float* out,
    int out_stride, Frozen norm = {nullptr, nullptr, nullptr}) {
    constexpr int most = static_cast<int>(rows_at_once);
    for (; rows > 0; rows -= most, in += most * in_stride, out += most * out_stride) {
        const int count = rows < most ? rows : most;
        Bits active[(most + 1) / 2];
        bool found = false;
        in_panels(width, [&](auto panel, int at) {
            constexpr int N = decltype(panel)::vectors;
            if (skips<reads, N> && !found) find_active(count, in, in_stride, inputs, active), found = true;
            dense_panel<reads, after, N>(
                count, in, in_stride, inputs, active, w + at, width, bias ? bias + at : nullptr, out + at, out_stride,
                norm.from(at));
        });
    }
}

// out[row, :] = in[row, :inputs] w where out was active, and 0 elsewhere: slopes take the place of activations. Slopes
// that came through a norm are nowhere 0.
static void dense_masked(
    bool normed, int rows, const float* in, int in_stride, int inputs, const float* w, int width, float* out,
    int out_stride) {
    const auto call = normed ? dense<Reads::all, After::masked> : dense<Reads::active, After::masked>;
    call(rows, in, in_stride, inputs, w, width, nullptr, out, out_stride, {nullptr, nullptr, nullptr});
}

template <int K, int N>
MAGLEV_INLINE void outer_tile(
    int rows, const float* in, int in_stride, const float* d, int d_stride, float* gradient, int stride) {
    V sum[K][N];
    MAGLEV_UNROLL
    for (int k = 0; k < K; ++k)
        MAGLEV_UNROLL
        for (int n = 0; n < N; ++n) sum[k][n] = load(gradient + k * stride + n * lanes);
#pragma GCC unroll 2
    for (int row = 0; row < rows; ++row) {
        V slope[N];
        MAGLEV_UNROLL
        for (int n = 0; n < N; ++n) slope[n] = load(d + row * d_stride + n * lanes);
        MAGLEV_UNROLL
        for (int k = 0; k < K; ++k) {
            const V x = splat(in[row * in_stride + k]);
            MAGLEV_UNROLL
            for (int n = 0; n < N; ++n) sum[k][n] += x * slope[n];
        }
    }
    MAGLEV_UNROLL
    for (int k = 0; k < K; ++k)
        MAGLEV_UNROLL
        for (int n = 0; n < N; ++n) store(gradient + k * stride + n * lanes, sum[k][n]);
}

template <int N>
MAGLEV_CALL void outer_panel(
    int rows, const float* in, int in_stride, int inputs, const float* d, int d_stride, float* gradient, int stride) {
    constexpr int K = tile_rows<N>;
    int k = 0;
    for (; k + K <= inputs; k += K)
        outer_tile<K, N>(rows, in + k, in_stride, d, d_stride, gradient + k * stride, stride);
    for (; k < inputs; ++k) outer_tile<1, N>(rows, in + k, in_stride, d, d_stride, gradient + k * stride, stride);
}

// gradient[k, :] += sum over the rows of in[row, k] d[row, :], for `width` columns.
static void add_outer(
    int rows, const float* in, int in_stride, int inputs, const float* d, int d_stride, float* gradient, int width) {
    in_panels(width, [&](auto panel, int at) {
        outer_panel<decltype(panel)::vectors>(rows, in, in_stride, inputs, d + at, d_stride, gradient + at, width);
    });
}

}  // namespace maglev::MAGLEV_ISA
