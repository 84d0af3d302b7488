// The C interface: picks the instruction set and hands over.
#include "kernel.h"
#include "processor.hpp"

namespace maglev {

#define MAGLEV_DECLARE(name)                                                                                         \
    namespace name {                                                                                                 \
    void advance(                                                                                                    \
        const Settings&, const Layout&, float*, const Row*, Row*, const MaglevDraws&, std::int64_t);                 \
    void roll_out(                                                                                                   \
        const Settings&, const Layout&, float*, const double*, std::int64_t, std::int64_t, std::int64_t, double*,    \
        double*);                                                                                                    \
    }

MAGLEV_DECLARE(baseline)
#ifdef MAGLEV_X86
MAGLEV_DECLARE(avx2)
MAGLEV_DECLARE(avx512)
#endif

struct Isa {
    const char* name;
    std::int64_t lanes;
    bool (*runs)();
    decltype(&baseline::advance) advance;
    decltype(&baseline::roll_out) roll_out;
};

static const Isa isas[] = {
#ifdef MAGLEV_X86
    {"sse2", 4, [] { return true; }, baseline::advance, baseline::roll_out},
    {"avx2", 8, [] { return Processor().avx2; }, avx2::advance, avx2::roll_out},
    {"avx512", 16, [] { return Processor().avx512; }, avx512::advance, avx512::roll_out},
#else
    {"portable", 4, [] { return true; }, baseline::advance, baseline::roll_out},
#endif
};

}  // namespace maglev

using maglev::isas;

extern "C" {

const char* maglev_sources(void) { return MAGLEV_SOURCES; }

const char* maglev_compiler(void) {
#ifdef __clang__
    return "clang " __clang_version__;
#else
    return "gcc " __VERSION__;
#endif
}

int64_t maglev_isa_count(void) { return sizeof(isas) / sizeof(isas[0]); }
const char* maglev_isa_name(int64_t isa) { return isas[isa].name; }
int64_t maglev_isa_lanes(int64_t isa) { return isas[isa].lanes; }
int64_t maglev_isa_runs(int64_t isa) { return isas[isa].runs(); }

void maglev_layout(const MaglevSettings* settings, int64_t isa, MaglevLayout* layout) {
    *layout = maglev::arena_layout(*settings, isas[isa].lanes);
}

void maglev_advance(
    const MaglevSettings* settings, int64_t isa, float* arena, const float* prefilled, float* own,
    const MaglevDraws* draws, int64_t steps) {
    const MaglevLayout layout = maglev::arena_layout(*settings, isas[isa].lanes);
    isas[isa].advance(
        *settings, layout, arena, reinterpret_cast<const maglev::Row*>(prefilled), reinterpret_cast<maglev::Row*>(own),
        *draws, steps);
}

void maglev_roll_out(
    const MaglevSettings* settings, int64_t isa, float* arena, const double* starts_m, int64_t count, int64_t steps,
    int64_t stride, double* states, double* voltages) {
    const MaglevLayout layout = maglev::arena_layout(*settings, isas[isa].lanes);
    isas[isa].roll_out(*settings, layout, arena, starts_m, count, steps, stride, states, voltages);
}
}
