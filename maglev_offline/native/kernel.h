/* The C interface of the kernel: the caller owns all memory, and no call keeps any of it.
 *
 * Calls for different arenas may run at the same time. Every call takes the number of an instruction set, one of those
 * that `maglev_isa_runs` allows; arenas of one set are laid out by `maglev_layout` of that set. */
#pragma once
#include <stdint.h>

#ifdef __cplusplus
#include "layout.hpp"
typedef maglev::Settings MaglevSettings;
typedef maglev::Layout MaglevLayout;
extern "C" {
#endif

/* Random numbers of one seed for `steps` decisions, as agents/draws.py draws them. */
typedef struct {
    const double* start;           /* [steps] in [0, 1) */
    const double* exploration;     /* [steps] standard normal */
    const double* uniform_action;  /* [steps] in [-1, 1) */
    const double* batch;           /* [steps, batch] in [0, 1) */
    const float* smoothing;        /* [steps, batch] standard normal */
    const double* force_n;         /* [steps, plant steps], newton, or null */
} MaglevDraws;

#pragma GCC visibility push(default)

const char* maglev_sources(void);  /* a hash of the sources it was built from */
const char* maglev_compiler(void);

/* Instruction sets from 0 up, the later the faster. */
int64_t maglev_isa_count(void);
const char* maglev_isa_name(int64_t isa);
int64_t maglev_isa_lanes(int64_t isa);
int64_t maglev_isa_runs(int64_t isa);

void maglev_layout(const MaglevSettings* settings, int64_t isa, MaglevLayout* layout);

/* Make `steps` decisions of one seed. `arena`: its floats, at a multiple of 64 bytes; `prefilled` and `own`: rows. */
void maglev_advance(
    const MaglevSettings* settings, int64_t isa, float* arena, const float* prefilled, float* own,
    const MaglevDraws* draws, int64_t steps);

/* Roll the actor out from `count` starts; see run.hpp for the shapes. */
void maglev_roll_out(
    const MaglevSettings* settings, int64_t isa, float* arena, const double* starts_m, int64_t count, int64_t steps,
    int64_t stride, double* states, double* voltages);

#pragma GCC visibility pop

#ifdef __cplusplus
}
#endif
