// Batch norm (over the rows of a batch) and layer norm (over the features of a row), forward and back.
#pragma once
#include "sums.hpp"

namespace maglev::MAGLEV_ISA {

constexpr float norm_eps = 1e-5f;
constexpr float batch_norm_momentum = 0.1f;

// Two sums over the rows, to which `term(row, sum, sum)` adds, each in four interleaved chains.
template <class Term>
MAGLEV_INLINE void sum_rows(int rows, const Term& term, V& first, V& second) {
    V a[4] = {}, b[4] = {};
    int row = 0;
    for (; row + 4 <= rows; row += 4)
        MAGLEV_UNROLL
        for (int i = 0; i < 4; ++i) term(row + i, a[i], b[i]);
    for (; row < rows; ++row) term(row, a[0], b[0]);
    first = (a[0] + a[1]) + (a[2] + a[3]), second = (b[0] + b[1]) + (b[2] + b[3]);
}

// scale = gain / sqrt(var + eps): what a frozen batch norm multiplies by.
static void frozen_scale(int width, const float* gain, const float* var, float* scale) {
    for (int at = 0; at < width; at += lanes)
        store(scale + at, load(gain + at) * (1.0f / square_root(load(var + at) + norm_eps)));
}

// Normalise `raw` [rows, width] in place over the rows, put relu(gain raw + shift) into `out`, keep 1/sd in `rate` and
// move the running statistics.
static void batch_norm_forward(
    int rows, float* raw, int width, const float* gain, const float* shift, float* out, int out_stride, float* rate,
    float* running_mean, float* running_var) {
    const float share = 1.0f / static_cast<float>(rows);
    const float unbiased = static_cast<float>(rows) / static_cast<float>(rows > 1 ? rows - 1 : 1);
    for (int at = 0; at < width; at += lanes) {
        V total, squares, unused;
        sum_rows(rows, [&](int r, V& a, V&) { a += load(raw + r * width + at); }, total, unused);
        const V mean = total * share;
        const auto square = [&](int r, V& a, V&) {
            const V away = load(raw + r * width + at) - mean;
            a += away * away;
        };
        sum_rows(rows, square, squares, unused);
        const V var = squares * share;
        const V per_sd = 1.0f / square_root(var + norm_eps);
        store(rate + at, per_sd);
        const V old_mean = load(running_mean + at), old_var = load(running_var + at);
        store(running_mean + at, old_mean + batch_norm_momentum * (mean - old_mean));
        store(running_var + at, old_var + batch_norm_momentum * (var * unbiased - old_var));
        const V g = load(gain + at), s = load(shift + at);
        for (int r = 0; r < rows; ++r) {
            const V normal = (load(raw + r * width + at) - mean) * per_sd;
            store(raw + r * width + at, normal);
            store(out + r * out_stride + at, relu(normal * g + s));
        }
    }
}

// Turn slopes of relu's argument, in place, into slopes of what came into the norm; add those of gain and shift.
static void batch_norm_backward(
    int rows, float* d, int d_stride, const float* normal, int width, const float* gain, const float* rate,
    float* gain_gradient, float* shift_gradient) {
    const float share = 1.0f / static_cast<float>(rows);
    for (int at = 0; at < width; at += lanes) {
        V sum, product;
        const auto term = [&](int r, V& a, V& b) {
            const V slope = load(d + r * d_stride + at);
            a += slope, b += slope * load(normal + r * width + at);
        };
        sum_rows(rows, term, sum, product);
        store(gain_gradient + at, product), store(shift_gradient + at, sum);
        const V factor = load(gain + at) * load(rate + at), mean = sum * share, along = product * share;
        for (int r = 0; r < rows; ++r) {
            float* const place = d + r * d_stride + at;
            store(place, factor * ((load(place) - mean) - load(normal + r * width + at) * along));
        }
    }
}

// Call `term(at, part)` for every vector of a row, where `part` goes round the partial sums.
template <class Term>
MAGLEV_INLINE void each_vector(int width, const Term& term) {
    int at = 0;
    for (; at + 16 <= width; at += 16)
        MAGLEV_UNROLL
        for (int part = 0; part < parts; ++part) term(at + part * lanes, part);
    MAGLEV_UNROLL
    for (int part = 0; part < parts - 1; ++part)
        if (at + part * lanes < width) term(at + part * lanes, part);
}

// One number for each of R rows.
template <int R> struct Numbers {
    float of[R];
};

template <int R>
MAGLEV_INLINE Numbers<R> totals(const Sum (&sums)[R]) {
    Numbers<R> r;
    MAGLEV_UNROLL
    for (int i = 0; i < R; ++i) r.of[i] = one(sums[i]);
    return r;
}

// R rows of `layer_norm_forward` side by side: the sums of one wait for nothing of the others.
template <int R>
MAGLEV_INLINE void layer_norm_rows(
    float* raw, int width, const float* ones, float share, const float* gain, const float* shift, float* out,
    int out_stride, float* rate) {
    Sum sum[R] = {}, squares[R] = {};
    each_vector(width, [&](int at, int part) {
        MAGLEV_UNROLL
        for (int i = 0; i < R; ++i) sum[i].part[part] += load(raw + i * width + at);
    });
    const Numbers<R> total = totals(sum);
    V mean[R], per_sd[R];
    MAGLEV_UNROLL
    for (int i = 0; i < R; ++i) mean[i] = splat(total.of[i] * share);
    each_vector(width, [&](int at, int part) {
        const V feature = load(ones + at);
        MAGLEV_UNROLL
        for (int i = 0; i < R; ++i) {
            const V away = feature * (load(raw + i * width + at) - mean[i]);
            store(raw + i * width + at, away);
            squares[i].part[part] += away * away;
        }
    });
    const Numbers<R> power = totals(squares);
    MAGLEV_UNROLL
    for (int i = 0; i < R; ++i) {
        rate[i] = 1.0f / __builtin_sqrtf(power.of[i] * share + norm_eps);
        per_sd[i] = splat(rate[i]);
    }
    each_vector(width, [&](int at, int) {
        const V g = load(gain + at), s = load(shift + at);
        MAGLEV_UNROLL
        for (int i = 0; i < R; ++i) {
            const V normal = load(raw + i * width + at) * per_sd[i];
            store(raw + i * width + at, normal);
            store(out + i * out_stride + at, relu(normal * g + s));
        }
    });
}

// As `batch_norm_forward`, over the features of each row: `ones` [width] is 1 for a feature and 0 for padding.
static void layer_norm_forward(
    int rows, float* raw, int width, const float* ones, float share, const float* gain, const float* shift, float* out,
    int out_stride, float* rate) {
    int r = 0;
    for (; r + 4 <= rows; r += 4)
        layer_norm_rows<4>(
            raw + r * width, width, ones, share, gain, shift, out + r * out_stride, out_stride, rate + r);
    for (; r < rows; ++r)
        layer_norm_rows<1>(
            raw + r * width, width, ones, share, gain, shift, out + r * out_stride, out_stride, rate + r);
}

// R rows of the slopes of `layer_norm_backward`.
template <int R>
MAGLEV_INLINE void layer_norm_slopes(
    float* d, int d_stride, const float* normal, int width, const float* ones, float share, const float* gain,
    const float* rate) {
    Sum sum[R] = {}, product[R] = {};
    each_vector(width, [&](int at, int part) {
        const V g = load(gain + at);
        MAGLEV_UNROLL
        for (int i = 0; i < R; ++i) {
            const V inner = load(d + i * d_stride + at) * g;
            sum[i].part[part] += inner, product[i].part[part] += inner * load(normal + i * width + at);
        }
    });
    const Numbers<R> total = totals(sum), along_total = totals(product);
    V mean[R], along[R], factor[R];
    MAGLEV_UNROLL
    for (int i = 0; i < R; ++i)
        mean[i] = splat(total.of[i] * share), along[i] = splat(along_total.of[i] * share), factor[i] = splat(rate[i]);
    each_vector(width, [&](int at, int) {
        const V g = load(gain + at), feature = load(ones + at);
        MAGLEV_UNROLL
        for (int i = 0; i < R; ++i) {
            float* const slope = d + i * d_stride + at;
            const V inner = load(slope) * g;
            store(slope, feature * factor[i] * ((inner - mean[i]) - load(normal + i * width + at) * along[i]));
        }
    });
}

// As `batch_norm_backward`, over the features of each row.
static void layer_norm_backward(
    int rows, float* d, int d_stride, const float* normal, int width, const float* ones, float share,
    const float* gain, const float* rate, float* gain_gradient, float* shift_gradient) {
    for (int at = 0; at < width; at += lanes) {
        V of_gain, of_shift;
        const auto term = [&](int r, V& a, V& b) {
            const V slope = load(d + r * d_stride + at);
            a += slope, b += slope * load(normal + r * width + at);
        };
        sum_rows(rows, term, of_shift, of_gain);
        store(gain_gradient + at, load(gain_gradient + at) + of_gain);
        store(shift_gradient + at, load(shift_gradient + at) + of_shift);
    }
    int r = 0;
    for (; r + 4 <= rows; r += 4)
        layer_norm_slopes<4>(d + r * d_stride, d_stride, normal + r * width, width, ones, share, gain, rate + r);
    for (; r < rows; ++r)
        layer_norm_slopes<1>(d + r * d_stride, d_stride, normal + r * width, width, ones, share, gain, rate + r);
}

}  // namespace maglev::MAGLEV_ISA
