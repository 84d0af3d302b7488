// Compiled with -mavx2 -mfma.
#define LANES 8
#define MAGLEV_ISA avx2
#include "run.hpp"
