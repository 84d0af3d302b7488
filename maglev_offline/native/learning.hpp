// One gradient step of DDPG or TD3 on a gathered batch: agents/ddpg.py and agents/td3.py.
//
// Rows go forward and back in groups of `rows_at_once`; only a batch norm, and the scale of the cloning term, must see
// the whole batch before the first slope.
#pragma once
#include <cmath>

#include "replay.hpp"
#include "seed.hpp"

namespace maglev::MAGLEV_ISA {

constexpr float saturated = 3.0f;  // agents/networks.py
constexpr double beta_1 = 0.9, beta_2 = 0.999, adam_eps = 1e-8;

// slow <- slow + tau (p - slow), as torch's lerp writes it
MAGLEV_INLINE V follow(V slow, V p, float rate) {
    return rate < 0.5f ? slow + rate * (p - slow) : p - (p - slow) * (1.0f - rate);
}

struct AdamStep {
    float step_size, per_root;  // learning rate / (1 - b1^t), 1 / sqrt(1 - b2^t)
    AdamStep(double learning_rate, std::int64_t updates)
        : step_size(static_cast<float>(learning_rate / (1 - ::pow(beta_1, static_cast<double>(updates))))),
          per_root(static_cast<float>(1 / ::sqrt(1 - ::pow(beta_2, static_cast<double>(updates))))) {}
};

// Move the parameters p by Adam, and their slow copy (if given) after them.
//
// Moments of units that went silent would decay into subnormal numbers, which are slow on some processors: they are
// put to 0 far below the size at which they could move anything.
static void adam(
    const AdamStep& step, std::int64_t size, const float* gradient, float* m, float* v, float* p, float* slow,
    float tau) {
    constexpr float new_1 = static_cast<float>(1 - beta_1), keep_2 = static_cast<float>(beta_2),
                    new_2 = static_cast<float>(1 - beta_2), eps = static_cast<float>(adam_eps), nothing = 1e-30f;
    for (std::int64_t at = 0; at < size; at += lanes) {
        const V g = load(gradient + at), old = load(m + at);
        V mean = old + new_1 * (g - old);
        V square = keep_2 * load(v + at) + new_2 * (g * g);
        mean = magnitude(mean) < nothing ? V{} : mean;
        square = square < nothing ? V{} : square;
        store(m + at, mean), store(v + at, square);
        const V moved = load(p + at) - step.step_size * (mean / (square_root(square) * step.per_root + eps));
        store(p + at, moved);
        if (slow) store(slow + at, follow(load(slow + at), moved, tau));
    }
}

// Values and their roots: z = sign(q) (sqrt(|q| + e) - sqrt(e)), and back.
MAGLEV_INLINE V signed_as(V size, V sign) { return (V)((I)size | ((I)sign & (I)splat(-0.0f))); }
MAGLEV_INLINE V compress(V q, float offset) {
    return signed_as(square_root(magnitude(q) + offset) - __builtin_sqrtf(offset), q);
}
MAGLEV_INLINE V expand(V z, float offset) {
    const V size = magnitude(z);
    return signed_as(size * (size + 2.0f * __builtin_sqrtf(offset)), z);
}

// y = h(c + d h^-1(max_j Zj'(s', u')))
static void set_targets(const Seed& seed, Ahead& ahead, const float* noise) {
    const Settings& s = seed.s;
    const Layout& at = seed.at;
    const Scratch& c = at.scratch;
    const int rows = seed.rows(), padded_rows = static_cast<int>(padded(rows, 16));
    float* const action = seed[c.next_action];
    const Acting slow = acting(
        seed.w, at.actor, s.batch_norm_actor, seed[at.slow_actor_at], seed[c.scale_1], seed[c.scale_2]);
    in_groups(rows, [&](int row, int n) {
        ahead.ask();
        act_forward(seed.w, at.actor, slow, n, seed[c.next] + 4 * row, seed.block(), action + row);
        ahead.ask();
    });
    const float std = static_cast<float>(s.smoothing_std), most = static_cast<float>(s.smoothing_clip);
    for (int b = 0; b < padded_rows; b += lanes) {
        V u = hyperbolic_tangent(load(action + b));
        if (s.smoothing) {
            V draw = {};
            if (b + lanes <= rows) draw = load_anywhere(noise + b);
            else
                for (int i = 0; b + i < rows; ++i) draw[i] = noise[b + i];
            u = clamp(u + clamp(draw * std, -most, most), -1.0f, 1.0f);
        }
        store(action + b, u);
    }
    for (std::int64_t j = 0; j < s.critics; ++j)
        in_groups(rows, [&](int row, int n) {
            critic_forward(
                seed.w, at.critic, s.layer_norm_critic, seed[at.slow_critic_at[j]], n, seed[c.next] + 4 * row,
                action + row, seed.block(), seed[c.value] + j * padded_rows + row);
            ahead.ask();
        });
    const float offset = static_cast<float>(s.critic_root_offset);
    for (int b = 0; b < padded_rows; b += lanes) {
        V q = load(seed[c.value] + b);
        if (s.critics == 2) q = larger(q, load(seed[c.value] + padded_rows + b));
        if (s.critic_root_offset > 0) q = expand(q, offset);
        V y = load(seed[c.cost] + b) + load(seed[c.discount] + b) * q;
        if (s.critic_root_offset > 0) y = compress(y, offset);
        store(seed[c.target] + b, y);
    }
}

// One Adam step of critic j down mean (Qj(s, u) - y)^2.
static void improve_critic(const Seed& seed, Ahead& ahead, std::int64_t j, const AdamStep& step, bool track) {
    const Settings& s = seed.s;
    const Layout& at = seed.at;
    const Scratch& c = at.scratch;
    float* const p = seed[at.critic_at[j]];
    float* const gradient = seed[c.critic_gradient];
    float* const w2t = seed[c.critic_w2t];
    float* const q = seed[c.value];
    float* const slope = seed[c.slope];
    const float* const target = seed[c.target];
    const float twice = 2.0f / static_cast<float>(s.batch);
    __builtin_memset(gradient, 0, sizeof(float) * static_cast<std::size_t>(at.critic.trainable));
    transpose(seed.w.h1, seed.w.h2, p + at.critic.w2, seed.w.s2, w2t, seed.w.s1);
    in_groups(seed.rows(), [&](int row, int n) {
        const float* const seen = seed[c.seen] + 4 * row;
        critic_forward(
            seed.w, at.critic, s.layer_norm_critic, p, n, seen, seed[c.action] + row, seed.block(), q + row);
        ahead.ask();
        for (int b = row; b < row + n; ++b) slope[b] = (q[b] - target[b]) * twice;
        critic_backward(
            seed.w, at.critic, s.layer_norm_critic, p, w2t, gradient, n, seen, slope + row, seed.block());
        ahead.ask();
    });
    adam(
        step, at.critic.trainable, gradient, seed[at.critic_m[j]], seed[at.critic_v[j]], p,
        track ? seed[at.slow_critic_at[j]] : nullptr, static_cast<float>(s.target_rate));
    ahead.ask();
}

// The policy of a batch that trains it: activations are kept, a batch norm looks at this batch.
static void policy_forward(const Seed& seed, int row, int rows) {
    const Layout& at = seed.at;
    const Net& net = at.actor;
    const Widths& w = seed.w;
    float* const p = seed[at.actor_at];
    const Pass to = seed.actor(row);
    const float* const seen = seed[at.scratch.seen] + 4 * row;
    float* const out = seed[at.scratch.argument] + row;
    if (!seed.s.batch_norm_actor) {
        act_forward(w, net, {p, nullptr, nullptr}, rows, seen, to, out);
        for (int r = 0; r < rows; ++r) to.h1[r * w.l1 + w.h1] = 1.0f;
        return;
    }
    dense<Reads::all, After::nothing>(rows, seen, 4, 3, p + net.w1, w.s1, nullptr, to.n1, w.s1);
    batch_norm_forward(
        rows, to.n1, w.s1, p + net.gain_1, p + net.shift_1, to.h1, w.l1, to.r1, p + net.mean_1, p + net.var_1);
    dense<Reads::active, After::nothing>(rows, to.h1, w.l1, w.h1, p + net.w2, w.s2, nullptr, to.n2, w.s2);
    batch_norm_forward(
        rows, to.n2, w.s2, p + net.gain_2, p + net.shift_2, to.h2, w.s2, to.r2, p + net.mean_2, p + net.var_2);
    dot_rows(rows, to.h2, w.s2, p + net.w3, w.s2, p[net.b3], out);
}

// Add the gradients that slopes d[row] of the tanh's argument leave in the actor.
static void policy_backward(const Seed& seed, int row, int rows, const float* d) {
    const Layout& at = seed.at;
    const Net& net = at.actor;
    const Widths& w = seed.w;
    const float* const p = seed[at.actor_at];
    float* const gradient = seed[at.scratch.actor_gradient];
    const Pass to = seed.actor(row);
    const float* const seen = seed[at.scratch.seen] + 4 * row;
    const bool norm = seed.s.batch_norm_actor;  // then there are no biases, and no input 1
    output_backward(w, net, p, gradient, rows, to.h2, d);
    if (norm)
        batch_norm_backward(
            rows, to.h2, w.s2, to.n2, w.s2, p + net.gain_2, to.r2, gradient + net.gain_2, gradient + net.shift_2);
    add_outer(rows, to.h1, w.l1, w.h1 + (norm ? 0 : 1), to.h2, w.s2, gradient + net.w2, w.s2);
    dense_masked(norm, rows, to.h2, w.s2, w.h2, seed[at.scratch.actor_w2t], w.s1, to.h1, w.l1);
    if (norm)
        batch_norm_backward(
            rows, to.h1, w.l1, to.n1, w.s1, p + net.gain_1, to.r1, gradient + net.gain_1, gradient + net.shift_1);
    add_outer(rows, seen, 4, norm ? 3 : 4, to.h1, w.l1, gradient + net.w1, w.s1);
}

// Slopes dQ/da at the policy's actions under the first critic, and the values, where the loss is scaled by them.
static void policy_values(const Seed& seed, int row, int rows) {
    const Layout& at = seed.at;
    const Scratch& c = at.scratch;
    const bool norm = seed.s.layer_norm_critic;
    const float* const p = seed[at.critic_at[0]];
    critic_forward(
        seed.w, at.critic, norm, p, rows, seed[c.seen] + 4 * row, seed[c.policy] + row, seed.block(),
        seed.s.cloning_weight > 0 ? seed[c.value] + row : nullptr);
    action_slope(seed.w, at.critic, norm, p, rows, seed.block(), seed[c.critic_gradient], seed[c.slope] + row);
}

// y = tanh(x); what lies in a last vector behind the rows is spoilt.
MAGLEV_INLINE void squash(const float* x, float* y, int rows) {
    for (int r = 0; r < rows; r += lanes) store_anywhere(y + r, hyperbolic_tangent(load_anywhere(x + r)));
}

// From dQ/da to slopes of the tanh's argument x: the loss is
// `scale` sum Q + `cloning` sum over prefilled (pi - u)^2 + `saturation` sum (how far |x| is beyond 3)^2.
static void loss_slopes(const Seed& seed, int row, int rows, float scale, float cloning, float saturation) {
    const Scratch& c = seed.at.scratch;
    float *const slope = seed[c.slope] + row, *const policy = seed[c.policy] + row;
    const float *const action = seed[c.action] + row, *const prefilled = seed[c.prefilled] + row;
    const float* const argument = seed[c.argument] + row;
    const float pull = 2.0f * cloning, back = 2.0f * saturation;
    for (int b = 0; b < rows; b += lanes) {
        const V pi = load_anywhere(policy + b);
        V d = scale * load_anywhere(slope + b);
        if (cloning > 0.0f) d += pull * load_anywhere(prefilled + b) * (pi - load_anywhere(action + b));
        const V x = load_anywhere(argument + b);
        store_anywhere(slope + b, d * (1.0f - pi * pi) + back * (x - clamp(x, -saturated, saturated)));
    }
}

// One Adam step of the actor down its loss; its slow copy follows.
static void improve_actor(const Seed& seed, Ahead& ahead, const AdamStep& step) {
    const Settings& s = seed.s;
    const Layout& at = seed.at;
    const Scratch& c = at.scratch;
    const int rows = seed.rows();
    const float share = 1.0f / static_cast<float>(rows), cloning = static_cast<float>(s.cloning_weight) * share,
                saturation = static_cast<float>(s.saturation_weight) * share;
    float* const p = seed[at.actor_at];
    float* const slow = seed[at.slow_actor_at];
    float* const gradient = seed[c.actor_gradient];
    const float tau = static_cast<float>(s.target_rate);
    __builtin_memset(gradient, 0, sizeof(float) * static_cast<std::size_t>(at.actor.trainable));
    transpose(seed.w.h1, seed.w.h2, p + at.actor.w2, seed.w.s2, seed[c.actor_w2t], seed.w.s1);
    const auto forward = [&](int row, int n) {
        policy_forward(seed, row, n);
        ahead.ask();
        squash(seed[c.argument] + row, seed[c.policy] + row, n);
    };
    const auto values = [&](int row, int n) {
        policy_values(seed, row, n);
        ahead.ask();
    };
    if (s.batch_norm_actor || s.cloning_weight > 0) {
        if (s.batch_norm_actor) forward(0, rows);
        else in_groups(rows, forward);
        in_groups(rows, values);
        float scale = share;
        if (s.cloning_weight > 0) {
            float size = 0.0f;
            for (int b = 0; b < rows; ++b) size += __builtin_fabsf(seed[c.value][b]);
            scale = 1.0f / size;  // share / mean |Q|
        }
        loss_slopes(seed, 0, rows, scale, cloning, saturation);
        const auto back = [&](int row, int n) { policy_backward(seed, row, n, seed[c.slope] + row); };
        if (s.batch_norm_actor) back(0, rows);
        else in_groups(rows, back);
    } else {
        in_groups(rows, [&](int row, int n) {
            forward(row, n), values(row, n);
            loss_slopes(seed, row, n, share, 0.0f, saturation);
            policy_backward(seed, row, n, seed[c.slope] + row);
        });
    }
    adam(step, at.actor.trainable, gradient, seed[at.actor_m], seed[at.actor_v], p, slow, tau);
    for (std::int64_t i = at.actor.trainable; i < at.actor.size; i += lanes)
        store(slow + i, follow(load(slow + i), load(p + i), tau));
}

// One gradient step on the batch in the scratch; `step` counts decisions from 0.
static void learn(const Seed& seed, Ahead& ahead, const float* noise, std::int64_t step) {
    const Settings& s = seed.s;
    Head& head = seed.head();
    const double done =
        static_cast<double>(step - s.exploratory_steps) / static_cast<double>(s.steps - s.exploratory_steps);
    const double factor = 1 - (1 - s.final_learning_rate_fraction) * done;
    const bool actor_too = step % s.policy_delay == 0;
    set_targets(seed, ahead, noise);
    const AdamStep critic_step(s.critic_learning_rate * factor, ++head.critic_updates);
    for (std::int64_t j = 0; j < s.critics; ++j) improve_critic(seed, ahead, j, critic_step, actor_too);
    if (actor_too) improve_actor(seed, ahead, AdamStep(s.actor_learning_rate * factor, ++head.actor_updates));
    ahead.ask_for_all();
}

}  // namespace maglev::MAGLEV_ISA
