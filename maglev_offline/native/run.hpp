// The training loop of one seed, and the rollout of its actor: agents/training.py and agents/evaluation.py.
#pragma once
#include "kernel.h"
#include "learning.hpp"
#include "plant.hpp"

namespace maglev::MAGLEV_ISA {

// Choose the rows of the batch at `step`, when `added` own rows are there.
static void plan(const Seed& seed, Replay& replay, std::int64_t step, std::int64_t added, const double* uniform) {
    std::int64_t* const slots = seed.slots();
    replay.mix(seed.s, step, added);
    for (int b = 0; b < seed.rows(); ++b) slots[b] = replay.slot(uniform[b], b);
}

// Copy the planned rows into the scratch; costs of up to n_step own rows are summed.
static void gather(const Seed& seed, const Replay& replay) {
    typedef float Unaligned __attribute__((vector_size(16), aligned(4), may_alias));
    const Settings& s = seed.s;
    const Scratch& c = seed.at.scratch;
    const std::int64_t* const slots = seed.slots();
    const std::int64_t newest = (seed.head().added - 1) % s.room;
    float *const seen = seed[c.seen], *const next = seed[c.next], *const actions = seed[c.action];
    float *const costs = seed[c.cost], *const discounts = seed[c.discount], *const marks = seed[c.prefilled];
    for (int b = 0; b < seed.rows(); ++b) {
        const Row* const row = replay.row(slots[b]);
        const bool logged = slots[b] < replay.of_prefill;
        const Row* last = row;
        float cost = row->cost, discount = row->discount;
        if (s.n_step > 1 && !logged) {
            std::int64_t at = slots[b] - replay.of_prefill;
            const auto goes_on = [&] { return at != newest && last->last == 0.0f && last->discount != 0.0f; };
            for (std::int64_t k = 1; k < s.n_step && goes_on(); ++k) {
                at = at + 1 == s.room ? 0 : at + 1;
                last = replay.own + at;
                cost += discount * last->cost, discount *= last->discount;
            }
        }
        Unaligned observation = *reinterpret_cast<const Unaligned*>(row->observation);  // and the action behind it
        actions[b] = observation[3];
        observation[3] = 1.0f;
        *reinterpret_cast<Unaligned*>(seen + 4 * b) = observation;
        *reinterpret_cast<Unaligned*>(next + 4 * b) = *reinterpret_cast<const Unaligned*>(last->next_observation);
        costs[b] = cost, discounts[b] = discount, marks[b] = logged ? 1.0f : 0.0f;
    }
}

// pi(s) of `rows` observations [rows, 4], at most `rows_at_once`; `action` has room for one vector more.
static void act(const Seed& seed, const Acting& policy, int rows, const float* seen, float* action) {
    act_forward(seed.w, seed.at.actor, policy, rows, seen, seed.block(), action);
    squash(action, action, rows);
}

MAGLEV_INLINE double number_or_zero(float x) { return x == x ? x : 0.0; }

static Acting acting_now(const Seed& seed) {
    const Scratch& c = seed.at.scratch;
    return acting(
        seed.w, seed.at.actor, seed.s.batch_norm_actor, seed[seed.at.actor_at], seed[c.scale_1], seed[c.scale_2]);
}

// The action of a decision: held uniform draws at first, then the policy with exploration noise.
static double choose(const Seed& seed, const float seen[3], const MaglevDraws& draws, std::int64_t within) {
    const Settings& s = seed.s;
    Head& head = seed.head();
    if (head.step < s.exploratory_steps) {
        if (head.step % s.hold == 0) head.held_action = draws.uniform_action[within];
        return head.held_action;
    }
    const float observation[4] = {seen[0], seen[1], seen[2], 1.0f};
    float policy[lanes];
    act(seed, acting_now(seed), 1, observation, policy);
    const double action = number_or_zero(policy[0]) + s.exploration_std * draws.exploration[within];
    return action < -1.0 ? -1.0 : action > 1.0 ? 1.0 : action;
}

// Make `steps` decisions, each followed by a gradient step once the exploration is over.
void advance(
    const Settings& s, const Layout& layout, float* arena, const Row* prefilled, Row* own, const MaglevDraws& draws,
    std::int64_t steps) {
    const Seed seed(s, layout, arena);
    Head& head = seed.head();
    Replay replay{};
    replay.prefilled = prefilled, replay.own = own;
    Magnet magnet{head.gap_m, head.velocity_m_s, head.current_a};
    bool planned = false;
    for (std::int64_t within = 0; within < steps; ++within) {
        if (head.age >= s.decisions) {
            magnet = at_rest(s, s.start_low_m + (s.start_high_m - s.start_low_m) * draws.start[within]);
            head.age = 0;
        }
        Row& row = own[head.added % s.room];
        observe(s, magnet, row.observation);
        const double action = choose(seed, row.observation, draws, within);
        const double* const force_n = draws.force_n ? draws.force_n + within * s.plant_steps : nullptr;
        const Outcome outcome = decide(s, magnet, action, force_n);
        const bool ended = outcome.touched && s.terminate_on_contact;
        head.age = ended ? s.decisions : head.age + 1;
        row.action = static_cast<float>(action), row.cost = static_cast<float>(outcome.cost);
        observe(s, magnet, row.next_observation);
        row.discount = ended ? 0.0f : static_cast<float>(s.discount);
        row.last = head.age >= s.decisions ? 1.0f : 0.0f;
        head.added += 1;
        head.gap_m = magnet.gap_m, head.velocity_m_s = magnet.velocity_m_s, head.current_a = magnet.current_a;
        if (head.step >= s.exploratory_steps) {
            if (!planned) plan(seed, replay, head.step, head.added, draws.batch + within * s.batch);
            gather(seed, replay);
            planned = within + 1 < steps;
            if (planned) plan(seed, replay, head.step + 1, head.added + 1, draws.batch + (within + 1) * s.batch);
            Ahead ahead(replay, seed.slots(), planned ? seed.rows() : 0);
            learn(seed, ahead, s.smoothing ? draws.smoothing + within * s.batch : nullptr, head.step);
        }
        head.step += 1;
    }
}

// Let the actor regulate from `count` starts for `steps` plant steps: states [steps + 1, 3, stride] and voltages
// [steps, stride], of which it fills `count` columns. A policy that is no number lets go, as in evaluation.py.
void roll_out(
    const Settings& s, const Layout& layout, float* arena, const double* starts_m, std::int64_t count,
    std::int64_t steps, std::int64_t stride, double* states, double* voltages) {
    const Seed seed(s, layout, arena);
    const Acting policy = acting_now(seed);
    constexpr int most = static_cast<int>(rows_at_once);
    in_groups(static_cast<int>(count), [&](int first, int n) {
        Magnet magnets[most];
        float seen[4 * most] = {}, action[most + lanes] = {};
        double voltage_v[most] = {};
        const auto record = [&](std::int64_t k, int i) {
            double* const to = states + k * 3 * stride + first + i;
            to[0] = magnets[i].gap_m, to[stride] = magnets[i].velocity_m_s, to[2 * stride] = magnets[i].current_a;
        };
        for (int i = 0; i < n; ++i) magnets[i] = at_rest(s, starts_m[first + i]), record(0, i);
        for (std::int64_t k = 0; k < steps; ++k) {
            if (k % s.plant_steps == 0) {
                for (int i = 0; i < n; ++i) observe(s, magnets[i], seen + 4 * i);
                act(seed, policy, n, seen, action);
                for (int i = 0; i < n; ++i)
                    voltage_v[i] = s.equilibrium_voltage_v + s.voltage_limit_v * number_or_zero(action[i]);
            }
            for (int i = 0; i < n; ++i) {
                voltages[k * stride + first + i] = voltage_v[i];
                magnets[i] = plant_step(s, magnets[i], voltage_v[i], 0.0);
                record(k + 1, i);
            }
        }
    });
}

}  // namespace maglev::MAGLEV_ISA
