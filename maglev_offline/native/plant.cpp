// Compiled without contraction of products and sums: the environment agrees with numpy's to the last bit.
#include "plant.hpp"

namespace maglev {

static double clip(double x, double low, double high) {
    const double above = x < low ? low : x;
    return above > high ? high : above;
}

static Magnet derivative(const Settings& s, const Magnet& at, double voltage_v, double force_n) {
    const double reach = at.gap_m + s.pole_offset_m;
    const double slope_over_reach = s.inductance_slope_h_m / reach;
    const double ratio = at.current_a / reach;
    const double acceleration =
        s.gravity_m_s2 - s.inductance_slope_h_m / (2 * s.mass_kg) * ratio * ratio + force_n / s.mass_kg;
    const double current_rate =
        (voltage_v - s.resistance_ohm * at.current_a + slope_over_reach * ratio * at.velocity_m_s) /
        (s.inductance_offset_h + slope_over_reach);
    return {at.velocity_m_s, acceleration, current_rate};
}

static Magnet moved(const Magnet& from, const Magnet& rate, double dt_s) {
    return {
        from.gap_m + dt_s * rate.gap_m, from.velocity_m_s + dt_s * rate.velocity_m_s,
        from.current_a + dt_s * rate.current_a};
}

static double mean_slope(double a, double b, double c, double d) { return (a + 2 * b + 2 * c + d) / 6; }

static Magnet stopped(const Settings& s, const Magnet& at) {
    const bool into_stop =
        (at.gap_m <= s.gap_min_m && at.velocity_m_s < 0) || (at.gap_m >= s.gap_max_m && at.velocity_m_s > 0);
    return {
        clip(at.gap_m, s.gap_min_m, s.gap_max_m), at.velocity_m_s * (into_stop ? 0.0 : 1.0),
        at.current_a < 0 ? 0.0 : at.current_a};
}

Magnet plant_step(const Settings& s, const Magnet& from, double voltage_v, double force_n) {
    const double dt = s.plant_step_s;
    const Magnet k1 = derivative(s, from, voltage_v, force_n);
    if (!s.rk4) return stopped(s, moved(from, k1, dt));
    const Magnet k2 = derivative(s, moved(from, k1, dt / 2), voltage_v, force_n);
    const Magnet k3 = derivative(s, moved(from, k2, dt / 2), voltage_v, force_n);
    const Magnet k4 = derivative(s, moved(from, k3, dt), voltage_v, force_n);
    const Magnet mean = {
        mean_slope(k1.gap_m, k2.gap_m, k3.gap_m, k4.gap_m),
        mean_slope(k1.velocity_m_s, k2.velocity_m_s, k3.velocity_m_s, k4.velocity_m_s),
        mean_slope(k1.current_a, k2.current_a, k3.current_a, k4.current_a)};
    return stopped(s, moved(from, mean, dt));
}

Magnet at_rest(const Settings& s, double gap_m) { return {gap_m, 0.0, s.equilibrium_current_a}; }

void observe(const Settings& s, const Magnet& at, float seen[3]) {
    seen[0] = static_cast<float>((at.gap_m - s.set_point_m) / s.gap_scale_m);
    seen[1] = static_cast<float>(at.velocity_m_s / s.velocity_scale_m_s);
    seen[2] = static_cast<float>((at.current_a - s.equilibrium_current_a) / s.current_scale_a);
}

static double stage_cost(const Settings& s, const Magnet& at, double v) {
    const double gap = at.gap_m - s.set_point_m;
    return s.cost_gap_per_m2 * (gap * gap) + s.cost_velocity_s2_per_m2 * (at.velocity_m_s * at.velocity_m_s) +
           s.cost_voltage_per_v2 * (v * v);
}

Outcome decide(const Settings& s, Magnet& magnet, double action, const double* force_n) {
    const double tolerance_m = 1e-6;
    const double v = s.voltage_limit_v * clip(action, -1.0, 1.0);
    const double voltage_v = s.equilibrium_voltage_v + v;
    Outcome outcome{0.0, false};
    for (std::int64_t k = 0; k < s.plant_steps; ++k) {
        outcome.cost += stage_cost(s, magnet, v);
        magnet = plant_step(s, magnet, voltage_v, force_n ? force_n[k] : 0.0);
        outcome.touched |=
            magnet.gap_m <= s.gap_min_m + tolerance_m || magnet.gap_m >= s.gap_max_m - tolerance_m;
    }
    outcome.cost += s.contact_penalty * (outcome.touched ? 1.0 : 0.0);
    return outcome;
}

}  // namespace maglev
