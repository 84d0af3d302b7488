// What this processor, and the operating system on it, can do. Asked of the processor itself: the compilers' own
// `__builtin_cpu_supports` answers from a run-time library, and some of those leave the answer empty.
#pragma once
#ifdef MAGLEV_X86
#include <cpuid.h>

namespace maglev {

struct Processor {
    bool avx2 = false, avx512 = false;

    Processor() {
        unsigned a, b, c, d, low, high;
        if (!__get_cpuid(1, &a, &b, &c, &d)) return;
        const bool fma = c >> 12 & 1, saves_vectors = c >> 27 & 1;
        if (!fma || !saves_vectors || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return;
        __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
        const unsigned of_256 = 0x06, of_512 = 0xe6;  // registers that the operating system keeps for each thread
        avx2 = (low & of_256) == of_256 && (b >> 5 & 1);
        const bool f = b >> 16 & 1, dq = b >> 17 & 1, bw = b >> 30 & 1, vl = b >> 31 & 1;
        avx512 = avx2 && (low & of_512) == of_512 && f && dq && bw && vl;
    }
};

}  // namespace maglev
#endif
