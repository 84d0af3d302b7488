// Actor and critics of one seed: agents/networks.py, rows of a batch at a time.
#pragma once
#include "layers.hpp"
#include "layout.hpp"
#include "norms.hpp"

namespace maglev::MAGLEV_ISA {

// Widths as the loops want them.
struct Widths {
    int h1, h2, s1, s2, l1;  // hidden features, their padded strides, stride of h1 with action and 1 behind it
    const float *ones_1, *ones_2;  // 1 for a feature, 0 for padding; below, the share of a feature in a mean
    float share_1, share_2;
    Widths(const Settings& s, const Layout& at, const float* base)
        : h1(static_cast<int>(s.hidden_1)), h2(static_cast<int>(s.hidden_2)),
          s1(static_cast<int>(at.critic.stride_1)), s2(static_cast<int>(at.critic.stride_2)),
          l1(static_cast<int>(at.scratch.stride_h1)),
          ones_1(base + at.scratch.ones_1), ones_2(base + at.scratch.ones_2),
          share_1(1.0f / static_cast<float>(h1)), share_2(1.0f / static_cast<float>(h2)) {}
};

// Where one pass through some rows keeps its activations (h), normalised inputs (n) and 1/sd (r). On the way back
// slopes take the place of the activations that they belong to: half the memory to go through.
struct Pass {
    float *h1, *h2, *n1, *n2, *r1, *r2;
};

// q[row] = Q(seen, action); without `q`, only the activations.
static void critic_forward(
    const Widths& w, const Net& net, bool norm, const float* p, int rows, const float* seen, const float* action,
    const Pass& to, float* q) {
    if (norm) {
        dense<Reads::all, After::nothing>(rows, seen, 4, 3, p + net.w1, w.s1, p + net.b1, to.n1, w.s1);
        layer_norm_forward(rows, to.n1, w.s1, w.ones_1, w.share_1, p + net.gain_1, p + net.shift_1, to.h1, w.l1, to.r1);
    } else {
        dense<Reads::all, After::relu>(rows, seen, 4, 3, p + net.w1, w.s1, p + net.b1, to.h1, w.l1);
    }
    for (int r = 0; r < rows; ++r) to.h1[r * w.l1 + w.h1] = action[r], to.h1[r * w.l1 + w.h1 + 1] = 1.0f;
    if (norm) {
        dense<Reads::active, After::nothing>(rows, to.h1, w.l1, w.h1 + 1, p + net.w2, w.s2, p + net.b2, to.n2, w.s2);
        layer_norm_forward(rows, to.n2, w.s2, w.ones_2, w.share_2, p + net.gain_2, p + net.shift_2, to.h2, w.s2, to.r2);
    } else {
        dense<Reads::active, After::relu>(rows, to.h1, w.l1, w.h1 + 1, p + net.w2, w.s2, p + net.b2, to.h2, w.s2);
    }
    if (q) dot_rows(rows, to.h2, w.s2, p + net.w3, w.s2, p[net.b3], q);
}

template <int N>
MAGLEV_CALL void output_panel(int rows, float* h2, int stride, const float* d, const float* weight, float* gradient) {
    V w[N], sum[N];
    MAGLEV_UNROLL
    for (int n = 0; n < N; ++n) w[n] = load(weight + n * lanes), sum[n] = load(gradient + n * lanes);
#pragma GCC unroll 2
    for (int r = 0; r < rows; ++r) {
        const V slope = splat(d[r]);
        MAGLEV_UNROLL
        for (int n = 0; n < N; ++n) {
            float* const place = h2 + r * stride + n * lanes;
            const V h = load(place);
            sum[n] += slope * h;
            store(place, h > 0.0f ? slope * w[n] : V{});
        }
    }
    MAGLEV_UNROLL
    for (int n = 0; n < N; ++n) store(gradient + n * lanes, sum[n]);
}

// h2 becomes d w3 where it is active; adds the gradients of the last layer.
static void output_backward(
    const Widths& w, const Net& net, const float* p, float* gradient, int rows, float* h2, const float* d) {
    float bias = 0.0f;
    for (int r = 0; r < rows; ++r) bias += d[r];
    gradient[net.b3] += bias;
    in_panels(w.s2, [&](auto panel, int at) {
        output_panel<decltype(panel)::vectors>(rows, h2 + at, w.s2, d, p + net.w3 + at, gradient + net.w3 + at);
    });
}

// Add the gradients that the slopes d[row] of the values leave in the parameters, after `critic_forward`.
static void critic_backward(
    const Widths& w, const Net& net, bool norm, const float* p, const float* w2t, float* gradient, int rows,
    const float* seen, const float* d, const Pass& at) {
    output_backward(w, net, p, gradient, rows, at.h2, d);
    if (norm)
        layer_norm_backward(
            rows, at.h2, w.s2, at.n2, w.s2, w.ones_2, w.share_2, p + net.gain_2, at.r2,
            gradient + net.gain_2, gradient + net.shift_2);
    add_outer(rows, at.h1, w.l1, w.h1 + 2, at.h2, w.s2, gradient + net.w2, w.s2);
    dense_masked(norm, rows, at.h2, w.s2, w.h2, w2t, w.s1, at.h1, w.l1);
    if (norm)
        layer_norm_backward(
            rows, at.h1, w.l1, at.n1, w.s1, w.ones_1, w.share_1, p + net.gain_1, at.r1,
            gradient + net.gain_1, gradient + net.shift_1);
    add_outer(rows, seen, 4, 4, at.h1, w.l1, gradient + net.w1, w.s1);
}

// slope[row] = dQ/da, after `critic_forward`; `unused`: room for gradients of gain and shift, which nobody wants here.
static void action_slope(
    const Widths& w, const Net& net, bool norm, const float* p, int rows, const Pass& at, float* unused, float* slope) {
    const float* const of_action = p + net.w2 + w.h1 * w.s2;
    for (int r = 0; r < rows; ++r)
        for (int n = 0; n < w.s2; n += lanes) {
            const V active = load(at.h2 + r * w.s2 + n) > 0.0f ? load(p + net.w3 + n) : V{};
            store(at.h2 + r * w.s2 + n, active);
        }
    if (norm)
        layer_norm_backward(
            rows, at.h2, w.s2, at.n2, w.s2, w.ones_2, w.share_2, p + net.gain_2, at.r2, unused + net.gain_2,
            unused + net.shift_2);
    dot_rows(rows, at.h2, w.s2, of_action, w.s2, 0.0f, slope);
}

// A policy as it acts: parameters, and the scales of its frozen batch norm.
struct Acting {
    const float* p;
    const float *scale_1, *scale_2;  // null without batch norm
};

static Acting acting(const Widths& w, const Net& net, bool norm, const float* p, float* scale_1, float* scale_2) {
    if (!norm) return {p, nullptr, nullptr};
    frozen_scale(w.s1, p + net.gain_1, p + net.var_1, scale_1);
    frozen_scale(w.s2, p + net.gain_2, p + net.var_2, scale_2);
    return {p, scale_1, scale_2};
}

// out[row] = the argument of the policy's tanh
static void act_forward(
    const Widths& w, const Net& net, const Acting& policy, int rows, const float* seen, const Pass& to, float* out) {
    const float* const p = policy.p;
    if (policy.scale_1) {
        const Frozen one = {p + net.mean_1, policy.scale_1, p + net.shift_1};
        const Frozen two = {p + net.mean_2, policy.scale_2, p + net.shift_2};
        dense<Reads::all, After::normalised_relu>(rows, seen, 4, 3, p + net.w1, w.s1, nullptr, to.h1, w.l1, one);
        dense<Reads::active, After::normalised_relu>(
            rows, to.h1, w.l1, w.h1, p + net.w2, w.s2, nullptr, to.h2, w.s2, two);
    } else {
        dense<Reads::all, After::relu>(rows, seen, 4, 3, p + net.w1, w.s1, p + net.b1, to.h1, w.l1);
        dense<Reads::active, After::relu>(rows, to.h1, w.l1, w.h1, p + net.w2, w.s2, p + net.b2, to.h2, w.s2);
    }
    dot_rows(rows, to.h2, w.s2, p + net.w3, w.s2, p[net.b3], out);
}

}  // namespace maglev::MAGLEV_ISA
