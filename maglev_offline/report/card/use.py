"""What the rows may be used for, and what not, as the verdict on them says."""

from collections.abc import Mapping
from typing import Any

_FOR = {
    "fit": "To fill the replay buffer of an agent on this plant, as one arm beside an empty buffer.",
    "doubtful": "To find out, beside an empty buffer, whether such rows help an agent on this plant.",
    "harmful": "To study negative transfer on this plant, and its cures, beside an empty buffer.",
}
_NOT_FOR = {
    "fit": "To take help for granted: the verdict is about what rows say, not about what they cover.",
    "doubtful": "To fill a replay buffer without an empty one beside it: whether the rows teach the truth is open.",
    "harmful": "To fill a replay buffer in the hope of learning sooner: the rows teach what the simulator contradicts.",
}


def intended_use(facts: Mapping[str, Any], process: Mapping[str, Any], simulated: int, logs: int) -> dict[str, Any]:
    """JSON-able: `verdict`, `simulated` (all, some or none of the logs), and the sentences `for` and `not_for`.

    `facts`: those of the transitions; `process`: their `plant` and `mdp` tables.
    """
    verdict = facts["diagnostic"]["verdict"]
    plant, mdp = process["plant"], process["mdp"]
    world = (
        f"{plant['mass_kg']:g} kg at {1e3 * plant['set_point_m']:g} mm, decisions every "
        f"{mdp['control_period_ms']:g} ms, voltages within {mdp['voltage_limit_v']:g} V of the equilibrium's"
    )
    not_for = [
        _NOT_FOR[verdict],
        f"For another plant or decision process than this one ({world}): cost and discount of each row are its own.",
        "As trajectories: balance has taken single rows of them. candidates.parquet holds all that are usable.",
        "As evidence that a controller is safe on a vehicle.",
    ]
    if simulated:
        which = "All logs are" if simulated == logs else f"{simulated} of {logs} logs are"
        not_for.append(f"For any statement on a real vehicle. {which} surrogates: simulated, and no recording.")
    not_for += [f"Before this doubt is settled: {doubt}" for doubt in facts.get("doubts", [])]
    return {
        "verdict": verdict,
        "simulated": "none" if not simulated else "all" if simulated == logs else "some",
        "for": [_FOR[verdict], "To look for the regions of state and action that are worth including or excluding."],
        "not_for": not_for,
    }
