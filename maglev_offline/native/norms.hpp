// Batch norm (over the rows of a batch) and layer norm (over the features of a row), forward and back.
#pragma once
#include "layers.hpp"

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

// As `batch_norm_forward`, over the features of each row: `ones` [width] is 1 for a feature and 0 for padding.
static void layer_norm_forward(
    int rows, float* raw, int width, const float* ones, float share, const float* gain, const float* shift, float* out,
    int out_stride, float* rate) {
    for (int r = 0; r < rows; ++r) {
        float* const row = raw + r * width;
        Sum sum = {}, squares = {};
        each_vector(width, [&](int at, int part) { sum.part[part] += load(row + at); });
        const V mean = splat(one(sum) * share);
        each_vector(width, [&](int at, int part) {
            const V away = load(ones + at) * (load(row + at) - mean);
            store(row + at, away);
            squares.part[part] += away * away;
        });
        rate[r] = 1.0f / __builtin_sqrtf(one(squares) * share + norm_eps);
        const V per_sd = splat(rate[r]);
        each_vector(width, [&](int at, int) {
            const V normal = load(row + at) * per_sd;
            store(row + at, normal);
            store(out + r * out_stride + at, relu(normal * load(gain + at) + load(shift + at)));
        });
    }
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
    for (int r = 0; r < rows; ++r) {
        float* const slope = d + r * d_stride;
        const float* const n = normal + r * width;
        Sum sum = {}, product = {};
        each_vector(width, [&](int at, int part) {
            const V inner = load(slope + at) * load(gain + at);
            sum.part[part] += inner, product.part[part] += inner * load(n + at);
        });
        const V mean = splat(one(sum) * share), along = splat(one(product) * share), factor = splat(rate[r]);
        each_vector(width, [&](int at, int) {
            const V inner = load(slope + at) * load(gain + at);
            store(slope + at, load(ones + at) * factor * ((inner - mean) - load(n + at) * along));
        });
    }
}

}  // namespace maglev::MAGLEV_ISA
