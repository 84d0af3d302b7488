"""The sentences of the report, built from the verdict alone."""

from collections.abc import Mapping, Sequence
from typing import Any

from maglev_offline.report.numbers import NO_BREAK, interval, listing, number, percent, whole
from maglev_offline.report.style import algorithm_label

METRIC_WORDS = {
    "area": "the mean cost over the whole training",
    "jumpstart": "the cost right after the first gradient steps",
    "asymptote": "the cost at the end of training",
    "time_to_threshold": "the steps needed to reach the threshold",
}
"""What each metric measures; all of them are better when smaller."""

DIRECTION = "Differences are empty buffer minus the other, of costs and steps: a negative one means harm."

METRIC_NAMES = {name: name.replace("_", " ") for name in METRIC_WORDS}

VERDICT_WORDS = {
    "positive": "positive transfer",
    "negative": "negative transfer",
    "equivalent": "equivalent",
    "inconclusive": "inconclusive",
}

CONTROL_WORDS = VERDICT_WORDS | {"positive": "better", "negative": "worse"}
"""The same of arms whose rows are no logs': what they do is no transfer from logs."""

REASONS = {
    "not_decodable": "The payload could not be read.",
    "no_time": "The message has no time stamp.",
    "not_finite": "A value is missing, or is no finite number.",
    "out_of_range": "A value lies outside the range that the recipe declares valid.",
    "repeated_message": "The same time and the same values as the message before it.",
    "not_explained_by_plant": "Plant and law cannot explain the samples between which the row lies.",
    "time_conflict": "The same time as an earlier message, but other values; the earlier one was kept.",
    "too_short": "The stretch around it holds a single message, or no instant of the grid.",
    "no_partner": "The point's other topics are silent at its time, so that no state can be formed.",
    "unmapped_topic": "No signal is taken from its topic.",
    "contact": "The magnet stays in contact with a mechanical stop, where the plant is another one.",
    "lone_sample": "The sample is alone in its segment and can be part of no transition.",
    "voltage_outside_limit": "The logged voltage is larger than the agent's limit, so that it is no action of its.",
    "shorter_than_a_decision": "The two samples are closer than a control period: no decision lies between them.",
    "inconsistent_with_simulator": "The recipe keeps a share of the rows, and the simulator explains others better.",
    "excluded_by_rule": "The recipe excludes rows like it.",
    "not_in_include_rule": "The recipe includes certain rows only, and it is none of them.",
    "not_selected_by_balance": "Balance takes as many rows as the recipe asks for, and took others.",
    "held_out_for_validation": "The row belongs to a log that is held out for validation.",
    "samples_not_drawn": "There are more samples than the recipe takes into memory, and others were drawn.",
    "over_prefill_rows": "The recipe asks for fewer rows.",
}
"""What each reason code means."""


def reason(code: str) -> str:
    """Explain a reason code in a plain sentence."""
    return REASONS.get(code, f"{code.replace('_', ' ').capitalize()}.")


def arm_words(arm: str, rows: int | None) -> str:
    """Name what an arm started from, for the middle of a sentence."""
    if arm == "prefill":
        return f"{whole(rows)} logged rows in the buffer" if rows is not None else "logged rows in the buffer"
    return f"the arm “{arm}”"


def logged_arms(verdict: Mapping[str, Any]) -> list[str]:
    """The arms that start with rows of logs: `prefill` alone where there is one, since the question is about it."""
    if "prefill" in verdict["arms"]:
        return ["prefill"]
    return [arm for arm in verdict["arms"] if verdict["rows"].get(arm, {}).get("rows_from") == "log"]


def verdict_words(verdict: Mapping[str, Any], arm: str, outcome: str) -> str:
    """An outcome in words: transfer where the arm's rows are of logs, better or worse where they are not."""
    logged = verdict["rows"].get(arm, {}).get("rows_from") == "log"
    return (VERDICT_WORDS if logged else CONTROL_WORDS)[outcome]


def headline(verdict: Mapping[str, Any]) -> str:
    """Say in a line or two what prefill does, and which algorithms have not learned their task anyway."""
    groups: dict[str, list[str]] = {}
    primary, logged = verdict["primary_metric"], logged_arms(verdict)
    if not logged:
        return "No arm of this study starts with rows of logs, so that it says nothing of prefill with logged data."
    for algorithm, found in verdict["algorithms"].items():
        # A primary metric that says nothing (see `_telling`) has established nothing.
        # Arms whose rows are no logs' are controls: what they do is not what prefill does.
        telling = [_telling(found, arm) for arm in logged if arm in found["effects"]]
        words = [effects[primary]["verdict"] if primary in effects else "inconclusive" for effects in telling]
        groups.setdefault(_outcome(words), []).append(algorithm_label(algorithm))
    parts = [outcome.format(listing(names)) for outcome, names in groups.items()]
    named = "" if logged == ["prefill"] else f" ({listing([f'“{arm}”' for arm in logged])})"
    text = f"Judged by {METRIC_WORDS[primary]}, prefill with logged data{named} {listing(parts)}." if parts else ""
    failing = [algorithm_label(name) for name, found in verdict["algorithms"].items() if not has_learned(found)]
    if failing:
        if len(failing) == len(verdict["algorithms"]) == 2:
            subject = "Neither has"
        else:
            subject = f"{listing(failing)} {'has' if len(failing) == 1 else 'have'} not"
        text += f" {subject} yet learned to regulate: to settle and stay within 0.5 mm in most runs."
    return text.strip()


def _telling(found: Mapping[str, Any], arm: str) -> dict[str, Mapping[str, Any]]:
    """The effects that say something: where no run of either arm reaches the threshold, the time to it does not."""
    silent = all(found["arms"][name]["share_reached"] == 0 for name in ("empty", arm) if name in found["arms"])
    return {m: effect for m, effect in found["effects"][arm].items() if not (silent and m == "time_to_threshold")}


def _outcome(verdicts: Sequence[str]) -> str:
    helps, harms = "positive" in verdicts, "negative" in verdicts
    if helps and harms:
        return "helps {} in one arm and harms it in another"
    if harms:
        return "harms {}"
    if helps:
        return "helps {}"
    if verdicts and all(word == "equivalent" for word in verdicts):
        return "makes no difference that matters to {}"
    return "has no effect on {} that so many seeds could establish"


def answers(verdict: Mapping[str, Any], rows: Mapping[str, int], confidence: float, arms: Sequence[str]) -> list[str]:
    """One sentence for each algorithm and arm of `arms`: every metric with its difference, interval and verdict.

    `rows`: how many rows each algorithm's buffer starts with, where that is known.
    """
    sentences = []
    for algorithm, found in verdict["algorithms"].items():
        for arm in (arm for arm in arms if arm in found["effects"]):
            effects = _telling(found, arm)
            clauses: list[str] = []
            for word in ("negative", "positive", "equivalent", "inconclusive"):
                chosen = {m: effects[m] for m in METRIC_WORDS if m in effects and effects[m]["verdict"] == word}
                if chosen:
                    clauses.append(_clause(word, chosen, None if clauses else confidence))
            if len(effects) < len(found["effects"][arm]):
                clauses.append("no run of either arm reaches the threshold")
            start = arm_words(arm, rows.get(algorithm))
            sentences.append(f"With {algorithm_label(algorithm)}, {start} {'; '.join(clauses)}.")
    return sentences


def _clause(verdict: str, effects: Mapping[str, Mapping[str, Any]], confidence: float | None) -> str:
    """All metrics of one verdict; the first effect names the confidence and the seeds, where `confidence` is given."""
    whats = []
    for place, (metric, effect) in enumerate(effects.items()):
        inside = effect_words(metric, effect, confidence if place == 0 else None)
        if verdict in ("negative", "positive"):
            whats.append(f"{METRIC_WORDS[metric]} ({METRIC_NAMES[metric]}: {inside})")
        else:
            whats.append(f"the {METRIC_NAMES[metric]} ({inside})")
    return {
        "negative": "raised {}: negative",
        "positive": "lowered {}: positive",
        "equivalent": "made no difference that matters to {}: equivalent",
        "inconclusive": "left open which way {} would go: inconclusive",
    }[verdict].format(listing(whats))


def effect_words(metric: str, effect: Mapping[str, Any], confidence: float | None) -> str:
    """One effect: `33.3 to 41.8, difference −8.5, 95 % interval −14 to −2, 8 seeds`; without confidence, shorter."""
    unit = " steps" if metric == "time_to_threshold" else ""
    means = f"{number(effect['baseline_mean'])} to {number(effect['arm_mean'])}{unit}"
    difference = f"{means}, difference {number(effect['difference'])}"
    if effect["low"] is None or effect["high"] is None:
        return f"{difference}, no interval from {seeds_words(effect['seeds'])}"
    span = interval(effect["low"], effect["high"])
    if confidence is None:
        return f"{difference}, {span}"
    return f"{difference}, {percent(confidence)} interval {span}, {seeds_words(effect['seeds'])}"


def seeds_words(seeds: int) -> str:
    """Count seeds: `1 seed`, `8 seeds`."""
    return f"{seeds} seed" if seeds == 1 else f"{seeds} seeds"


def has_learned(found: Mapping[str, Any]) -> bool:
    """Whether in some arm of an algorithm most runs end within 0.5 mm from every start, and most of them settle."""
    return any(arm["share_within_half_mm"] > 0.5 and arm["share_settled"] > 0.5 for arm in found["arms"].values())


def learned_sentence(verdict: Mapping[str, Any], arms: Sequence[str]) -> str:
    """Say for each algorithm how many runs of `arms` end up holding the gap and settling, and where that is not so."""
    parts = []
    for algorithm, found in verdict["algorithms"].items():
        counts = []
        for arm in (arm for arm in arms if arm in found["arms"]):
            facts = found["arms"][arm]
            n = facts["seeds"]
            within, settled = round(facts["share_within_half_mm"] * n), round(facts["share_settled"] * n)
            start = {"empty": "an empty buffer", "prefill": "a prefilled one"}.get(arm, f"the arm “{arm}”")
            counts.append(f"{within} of {n} with {start} ({settled} settle{'s' * (settled == 1)})")
        parts.append(f"{algorithm_label(algorithm)} {listing(counts)}")
    return (
        f"Last policies whose gap error stays within 0.5 mm over the last 20 % of the episode from every start: "
        f"{'; '.join(parts)}. A run settles if it stays within 2 % of its first deviation from the reference start."
    ).replace("2 %", f"2{NO_BREAK}%")


def classical_sentence(settling_s: Mapping[str, float | None]) -> str:
    """Set LQR and LQI beside the agents, how often each acts, and how fast they settle from the reference start."""
    known = {"lqr_held": "the LQR that decides as often as they do", "lqi": "the LQI at every plant step"}
    parts = [
        f"{label} settles in {number(settling_s[name], 2)} s from the reference start"
        if settling_s[name] is not None
        else f"{label} does not settle"
        for name, label in known.items()
        if name in settling_s
    ]
    return f"For comparison, {listing(parts)}." if parts else ""


def simulated_sentence(simulated: int, logs: int) -> str:
    """Say plainly where logs are simulated."""
    if not simulated:
        return ""
    if simulated == logs:
        which = {1: "The log is", 2: "Both logs are"}.get(logs, f"All {logs} logs are")
        return f"{which} simulated: surrogate data of this package, no recording of any real vehicle."
    verb = "is" if simulated == 1 else "are"
    return f"{simulated} of {logs} logs {verb} simulated: surrogate data of this package, no recording of a vehicle."
