"""A policy as one C header: C99 and C++, math.h and nothing else, numbers that read back exactly."""

import numpy as np

from maglev_offline.policies.policy import Policy, Weights, metadata, voltage_range


def as_c_header(policy: Policy) -> str:
    """The header: `double maglev_policy_voltage(double gap_m, double velocity_m_s, double current_a)`.

    Weights are float and written with nine digits, which give every float back; arithmetic is double, so that two
    compilers differ in the last digits of a double at most.
    """
    mdp, point = policy.mdp, policy.plant.equilibrium()
    low, high = voltage_range(policy)
    first, second, last = policy.layers
    widths = first.bias.size, second.bias.size
    return f"""\
/*
 * The coil voltage of a magnetic suspension by a trained policy. Made by maglev-offline; do not edit.
 *
 * Call it once a control period and hold the voltage in between. Compile it without -ffast-math.
 *
{_comment(policy)}
 */
#ifndef MAGLEV_POLICY_H
#define MAGLEV_POLICY_H

#include <math.h>

/* Time for which a voltage is held, s. */
#define MAGLEV_POLICY_CONTROL_PERIOD_S {mdp.control_period_ms / 1e3!r}

/* Air gap in m, its velocity in m/s and the coil current in A, to the total coil voltage in V. */
static inline double maglev_policy_voltage(double gap_m, double velocity_m_s, double current_a)
{{
    static const float w1[3][{widths[0]}] = {_matrix(first.weight)};
    static const float b1[{widths[0]}] = {_row(first.bias)};
    static const float w2[{widths[0]}][{widths[1]}] = {_matrix(second.weight)};
    static const float b2[{widths[1]}] = {_row(second.bias)};
    static const float w3[{widths[1]}] = {_row(last.weight[:, 0])};
    static const float b3 = {_float(last.bias[0])};

    double state[3], hidden1[{widths[0]}], hidden2[{widths[1]}], sum, voltage_v;
    int i, j;

    if (!isfinite(gap_m) || !isfinite(velocity_m_s) || !isfinite(current_a))
        return {point.voltage_v!r};

    state[0] = (gap_m - {point.gap_m!r}) / {mdp.gap_scale_m!r};
    state[1] = velocity_m_s / {mdp.velocity_scale_m_s!r};
    state[2] = (current_a - {point.current_a!r}) / {mdp.current_scale_a!r};

    for (j = 0; j < {widths[0]}; ++j) {{
        sum = (double)b1[j];
        for (i = 0; i < 3; ++i)
            sum += state[i] * (double)w1[i][j];
        hidden1[j] = sum > 0.0 ? sum : 0.0;
    }}
    for (j = 0; j < {widths[1]}; ++j) {{
        sum = (double)b2[j];
        for (i = 0; i < {widths[0]}; ++i)
            sum += hidden1[i] * (double)w2[i][j];
        hidden2[j] = sum > 0.0 ? sum : 0.0;
    }}
    sum = (double)b3;
    for (i = 0; i < {widths[1]}; ++i)
        sum += hidden2[i] * (double)w3[i];

    voltage_v = {point.voltage_v!r} + {mdp.voltage_limit_v!r} * tanh(sum);
    if (voltage_v < {low!r})
        return {low!r};
    if (voltage_v > {high!r})
        return {high!r};
    return voltage_v;
}}

#endif /* MAGLEV_POLICY_H */
"""


def _comment(policy: Policy) -> str:
    """The metadata; nothing in it may end the comment or open another one."""
    lines = (f" * {name}: {value}" for name, value in metadata(policy).items())
    return "\n".join(line.replace("*/", "* /").replace("/*", "/ *") for line in lines)


def _float(value: np.float32) -> str:
    text = f"{float(value):.9g}"
    return f"{text}f" if any(mark in text for mark in ".e") else f"{text}.0f"


def _row(values: Weights) -> str:
    cells = [_float(value) for value in values]
    lines = [", ".join(cells[at : at + 6]) for at in range(0, len(cells), 6)]
    return "{\n        " + ",\n        ".join(lines) + "}"


def _matrix(values: Weights) -> str:
    return "{\n        " + ",\n        ".join(_row(row) for row in values) + "}"
