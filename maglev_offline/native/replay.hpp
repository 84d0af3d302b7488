// The rows that a seed learns from, and how a batch of them is chosen: replay/sampling.py.
#pragma once
#include <cmath>

#include "layout.hpp"
#include "vectors.hpp"

namespace maglev::MAGLEV_ISA {

// The replay of one seed: prefilled rows first, then a ring of its own.
struct Replay {
    const Row* prefilled;
    Row* own;
    std::int64_t first;  // places of the batch that are prefilled rows, with a mixing share
    double share;        // probability of a prefilled row, with a decaying prefill
    enum class How { plain, places, weighted } how;
    std::int64_t of_prefill, of_own;

    // The mixture of the batch at `step`, with `added` own rows: replay/sampling.py.
    void mix(const Settings& s, std::int64_t step, std::int64_t added) {
        of_prefill = s.prefilled;
        of_own = added < s.room ? added : s.room;
        how = How::plain;
        if (!of_prefill || !of_own) return;
        double weight = 1.0;
        if (s.prefill_decay_steps) {
            weight = 1.0 - static_cast<double>(step) / static_cast<double>(s.prefill_decay_steps);
            weight = weight > 0.0 ? weight : 0.0;
        }
        if (s.mixing_share >= 0) {
            how = How::places;
            first = static_cast<std::int64_t>(::nearbyint(static_cast<double>(s.batch) * s.mixing_share * weight));
        } else if (weight != 1.0) {
            how = How::weighted;
            const double weighed = weight * static_cast<double>(of_prefill);
            share = weighed / (weighed + static_cast<double>(of_own));
        }
    }

    std::int64_t slot(double u, std::int64_t place) const {
        const double p = static_cast<double>(of_prefill), n = static_cast<double>(of_own);
        if (how == How::plain) return static_cast<std::int64_t>(u * static_cast<double>(of_prefill + of_own));
        if (how == How::places)
            return place < first ? static_cast<std::int64_t>(u * p) : of_prefill + static_cast<std::int64_t>(u * n);
        if (u < share) {
            const double at = u / share * p;
            return static_cast<std::int64_t>(at < p - 1 ? at : p - 1);
        }
        const double at = (u - share) / (1 - share) * n;
        return of_prefill + static_cast<std::int64_t>(at < n - 1 ? at : n - 1);
    }

    const Row* row(std::int64_t slot) const { return slot < of_prefill ? prefilled + slot : own + (slot - of_prefill); }
};

// The rows of the next batch, asked for while this one is learned from: a long replay lies outside of the caches. They
// are known a whole gradient step before they are needed, but must not be asked for at once: a processor has room for
// about twenty lines that are under way, and forgets what it is asked for beyond.
class Ahead {
  public:
    Ahead(const Replay& replay, const std::int64_t* slots, int rows) : replay_(replay), slots_(slots), left_(rows) {}

    // Ask for ten rows more.
    void ask() {
        for (int i = 0; i < 10 && left_ > 0; ++i, ++slots_, --left_) {
            const Row* const row = replay_.row(*slots_);
            __builtin_prefetch(row);
            __builtin_prefetch(reinterpret_cast<const char*>(row + 1) - 1);
        }
    }
    void ask_for_all() {
        while (left_ > 0) ask();
    }

  private:
    const Replay& replay_;
    const std::int64_t* slots_;
    int left_;
};

}  // namespace maglev::MAGLEV_ISA
