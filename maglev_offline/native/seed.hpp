// One seed: where the kernel finds its numbers in the arena.
#pragma once
#include "networks.hpp"

namespace maglev::MAGLEV_ISA {

// Everything one step needs to find its numbers.
struct Seed {
    const Settings& s;
    const Layout& at;
    float* base;
    Widths w;

    Seed(const Settings& settings, const Layout& layout, float* arena)
        : s(settings), at(layout), base(arena), w(settings, layout, arena) {
        if (!s.layer_norm_critic) return;
        for (int i = 0; i < w.h1; ++i) base[at.scratch.ones_1 + i] = 1.0f;
        for (int i = 0; i < w.h2; ++i) base[at.scratch.ones_2 + i] = 1.0f;
    }
    Head& head() const { return *reinterpret_cast<Head*>(base); }
    float* operator[](std::int64_t offset) const { return base + offset; }
    std::int64_t* slots() const { return reinterpret_cast<std::int64_t*>(base + at.scratch.slots); }
    int rows() const { return static_cast<int>(s.batch); }
    Pass block() const {
        const Scratch& c = at.scratch;
        return {base + c.block_h1, base + c.block_h2, base + c.block_n1, base + c.block_n2, base + c.block_r1,
                base + c.block_r2};
    }
    // The actor's activations from `row` on.
    Pass actor(int row) const {
        const Scratch& c = at.scratch;
        return {base + c.actor_h1 + row * w.l1, base + c.actor_h2 + row * w.s2, base + c.actor_n1, base + c.actor_n2,
                base + c.rate_1, base + c.rate_2};
    }
};

template <class Group>
MAGLEV_INLINE void in_groups(int rows, const Group& group) {
    constexpr int most = static_cast<int>(rows_at_once);
    for (int row = 0; row < rows; row += most) group(row, rows - row < most ? rows - row : most);
}

}  // namespace maglev::MAGLEV_ISA
