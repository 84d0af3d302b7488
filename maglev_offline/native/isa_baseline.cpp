// What every processor of the architecture can do: SSE2 on x86-64.
#define LANES 4
#define MAGLEV_ISA baseline
#include "run.hpp"
