// The suspension in double precision: physics/dynamics.py and env.py, operation by operation.
#pragma once
#include "layout.hpp"

namespace maglev {

struct Magnet {
    double gap_m, velocity_m_s, current_a;
};

Magnet at_rest(const Settings& settings, double gap_m);

// The scaled deviation from the equilibrium: what the networks see.
void observe(const Settings& settings, const Magnet& magnet, float seen[3]);

// One plant step with the voltage (in all) and the force held, stops included.
Magnet plant_step(const Settings& settings, const Magnet& magnet, double voltage_v, double force_n);

struct Outcome {
    double cost;
    bool touched;
};

// Hold the action, in [-1, 1], for one control period; `force_n`: one value for each plant step, or null.
Outcome decide(const Settings& settings, Magnet& magnet, double action, const double* force_n);

}  // namespace maglev
