// What a run is made of, and where its numbers lie.
//
// All state of one seed is one flat block ("arena") that the caller owns: a head of whole numbers and doubles, then
// floats. Layers are stored as the gradient step reads them, rows of features padded to whole vectors:
//
//     head      step, added, age, Adam counts | gap, velocity, current, held action           32 words of 8 bytes
//     nets      actor, slow actor, critics, slow critics      each: w1 | b1 | w2 | b2 | w3 | b3 | gains and shifts
//     moments   Adam's m and v of the actor and of the critics, in the shape of a net
//     scratch   gradients, the batch, activations: nothing here outlives a step
//
// A bias is the weight of an input that is 1, so that it needs no code of its own: b1 is the row behind w1, b2 the
// row behind w2 (whose last row, in a critic, belongs to the action). Padding is 0 and stays 0: its gradients are 0.
// One seed's nets, moments and scratch are about 200 kB for 40/40/100: they stay in the cache of the core that runs it.
#pragma once
#include <cstddef>
#include <cstdint>

namespace maglev {

// Every field takes 8 bytes: native_library.py mirrors the structs without rules of padding.
struct Settings {
    // networks
    std::int64_t critics, hidden_1, hidden_2, batch_norm_actor, layer_norm_critic;
    // learning
    std::int64_t batch, smoothing, policy_delay, n_step, exploratory_steps, steps, hold;
    double actor_learning_rate, critic_learning_rate, final_learning_rate_fraction, target_rate;
    double exploration_std, smoothing_std, smoothing_clip, cloning_weight, saturation_weight, critic_root_offset;
    // replay: `room` slots for own rows behind `prefilled` rows; mixing_share < 0 and prefill_decay_steps 0: not given
    std::int64_t prefilled, room, prefill_decay_steps;
    double mixing_share;
    // plant
    double mass_kg, resistance_ohm, gravity_m_s2, inductance_slope_h_m, inductance_offset_h, pole_offset_m;
    double gap_min_m, gap_max_m, set_point_m, equilibrium_current_a, equilibrium_voltage_v;
    // process
    std::int64_t plant_steps, decisions, rk4, terminate_on_contact;
    double plant_step_s, voltage_limit_v, cost_gap_per_m2, cost_velocity_s2_per_m2, cost_voltage_per_v2, discount;
    double gap_scale_m, velocity_scale_m_s, current_scale_a, start_low_m, start_high_m, contact_penalty;
};

constexpr std::int64_t row_width = 10;  // observation 3, action, cost, next observation 3, discount, last

struct Row {
    float observation[3], action, cost, next_observation[3], discount, last;
};
static_assert(sizeof(Row) == row_width * sizeof(float), "rows are shared with numpy");

// The head of an arena.
struct Head {
    std::int64_t step, added, age, critic_updates, actor_updates, reserved[11];
    double gap_m, velocity_m_s, current_a, held_action, reserved_reals[12];
};
static_assert(sizeof(Head) == 256, "the head is 32 words");

// Offsets in floats from the start of a net; `norm_*` of a net without normalisation have no width.
struct Net {
    std::int64_t inputs_2;              // rows of w2 before the bias: hidden_1, and the action in a critic
    std::int64_t stride_1, stride_2;    // padded hidden widths
    std::int64_t w1, b1, w2, b2, w3, b3, gain_1, shift_1, gain_2, shift_2;
    std::int64_t trainable;             // floats that a gradient moves
    std::int64_t mean_1, var_1, mean_2, var_2;
    std::int64_t size;
};

constexpr std::int64_t padded(std::int64_t n, std::int64_t to) { return (n + to - 1) / to * to; }

// Hands out stretches of floats, each starting at a whole cache line.
struct Taker {
    std::int64_t at = 0;
    std::int64_t operator()(std::int64_t floats) {
        const std::int64_t place = at;
        at += padded(floats, 16);
        return place;
    }
};

// Rows of a batch that are taken forward and back at once, so that a large batch does not leave the nearest caches.
constexpr std::int64_t rows_at_once = 100;

// Everything that does not outlive a step; offsets in floats from the start of an arena.
struct Scratch {
    std::int64_t stride_h1;                                            // of first-layer activations, with action and 1
    std::int64_t slots;                                                // of the next batch, 8 bytes each
    std::int64_t seen, next, action, cost, discount, prefilled;        // the batch
    std::int64_t next_action, target, argument, policy, value, slope;  // one number for each row of it
    std::int64_t block_h1, block_h2, block_n1, block_n2, block_r1, block_r2;
    std::int64_t actor_h1, actor_h2, actor_n1, actor_n2;               // the whole batch: a batch norm looks at it
    std::int64_t scale_1, scale_2, rate_1, rate_2;                     // of the batch norm
    std::int64_t ones_1, ones_2;                                       // 1 for a feature, 0 for padding
    std::int64_t critic_gradient, actor_gradient, critic_w2t, actor_w2t;
};

// Offsets in floats from the start of an arena, all at whole cache lines.
struct Layout {
    Net actor, critic;
    std::int64_t actor_at, slow_actor_at, critic_at[2], slow_critic_at[2];
    std::int64_t actor_m, actor_v, critic_m[2], critic_v[2];
    std::int64_t state_size;  // all before the scratch
    std::int64_t size;
    Scratch scratch;
};
static_assert(sizeof(Scratch) <= 64 * 8, "native_library.py leaves so much room for it");

inline Net net_layout(std::int64_t h1, std::int64_t h2, bool action, bool norm, bool statistics, std::int64_t lanes) {
    Net net{};
    net.inputs_2 = h1 + (action ? 1 : 0);
    net.stride_1 = padded(h1, lanes);
    net.stride_2 = padded(h2, lanes);
    std::int64_t at = 0;
    const auto take = [&at](std::int64_t n) {
        const std::int64_t place = at;
        at += n;
        return place;
    };
    net.w1 = take(3 * net.stride_1);
    net.b1 = take(net.stride_1);
    net.w2 = take(net.inputs_2 * net.stride_2);
    net.b2 = take(net.stride_2);
    net.w3 = take(net.stride_2);
    net.b3 = take(lanes);
    net.gain_1 = take(norm ? net.stride_1 : 0);
    net.shift_1 = take(norm ? net.stride_1 : 0);
    net.gain_2 = take(norm ? net.stride_2 : 0);
    net.shift_2 = take(norm ? net.stride_2 : 0);
    net.trainable = at;
    net.mean_1 = take(statistics ? net.stride_1 : 0);
    net.var_1 = take(statistics ? net.stride_1 : 0);
    net.mean_2 = take(statistics ? net.stride_2 : 0);
    net.var_2 = take(statistics ? net.stride_2 : 0);
    net.size = at;
    return net;
}

inline Layout arena_layout(const Settings& s, std::int64_t lanes) {
    Layout to{};
    to.actor = net_layout(s.hidden_1, s.hidden_2, false, s.batch_norm_actor, s.batch_norm_actor, lanes);
    to.critic = net_layout(s.hidden_1, s.hidden_2, true, s.layer_norm_critic, false, lanes);
    Taker take;
    take(sizeof(Head) / sizeof(float));
    to.actor_at = take(to.actor.size);
    to.slow_actor_at = take(to.actor.size);
    to.actor_m = take(to.actor.trainable);
    to.actor_v = take(to.actor.trainable);
    for (std::int64_t j = 0; j < s.critics; ++j) {
        to.critic_at[j] = take(to.critic.size);
        to.slow_critic_at[j] = take(to.critic.size);
        to.critic_m[j] = take(to.critic.trainable);
        to.critic_v[j] = take(to.critic.trainable);
    }
    to.state_size = take.at;

    const std::int64_t rows = padded(s.batch, 16) + 16, s1 = to.critic.stride_1, s2 = to.critic.stride_2;
    const std::int64_t norm_rows = s.batch_norm_actor ? rows : 0, layer_rows = s.layer_norm_critic ? rows_at_once : 0;
    Scratch& c = to.scratch;
    c.stride_h1 = padded(s.hidden_1 + 2, lanes);
    c.slots = take(2 * rows);
    c.seen = take(4 * rows), c.next = take(4 * rows);
    c.action = take(rows), c.cost = take(rows), c.discount = take(rows), c.prefilled = take(rows);
    c.next_action = take(rows), c.target = take(rows), c.argument = take(rows), c.policy = take(rows);
    c.value = take(2 * rows), c.slope = take(rows);
    c.block_h1 = take(rows_at_once * c.stride_h1), c.block_h2 = take(rows_at_once * s2);
    c.block_n1 = take(layer_rows * s1), c.block_n2 = take(layer_rows * s2);
    c.block_r1 = take(rows_at_once), c.block_r2 = take(rows_at_once);
    c.actor_h1 = take(rows * c.stride_h1), c.actor_h2 = take(rows * s2);
    c.actor_n1 = take(norm_rows * s1), c.actor_n2 = take(norm_rows * s2);
    c.scale_1 = take(s1), c.scale_2 = take(s2), c.rate_1 = take(s1), c.rate_2 = take(s2);
    c.ones_1 = take(s1), c.ones_2 = take(s2);
    c.critic_gradient = take(to.critic.trainable), c.actor_gradient = take(to.actor.trainable);
    c.critic_w2t = take(s2 * s1), c.actor_w2t = take(s2 * s1);
    to.size = take.at;
    return to;
}

}  // namespace maglev
