// Compiled for AVX-512 F, VL, DQ and BW.
#define LANES 16
#define MAGLEV_ISA avx512
#include "run.hpp"
