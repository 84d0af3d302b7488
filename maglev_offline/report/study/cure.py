"""The cure for negative transfer: chosen on half of the seeds, confirmed on the other half."""

from maglev_offline.report import words
from maglev_offline.report.numbers import interval, number, percent
from maglev_offline.report.page import Table
from maglev_offline.report.study.reading import Facts, arm_label, metric_label, metric_unit
from maglev_offline.report.style import algorithm_label


def seed_range(seeds: list[int]) -> str:
    """Name seeds: `0 to 9` where they follow each other, else one by one."""
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def cure_sentences(facts: Facts, confidence: float) -> list[str]:
    """One sentence for each algorithm: which arm was chosen, and what it does on the seeds that had no say."""
    candidates = facts["cure"]["candidates"]
    found = []
    for algorithm, cure in facts["cure"]["algorithms"].items():
        effect = cure["confirmed"]
        chosen, seeds = arm_label(facts, cure["chosen"]), words.seeds_words(effect["seeds"])
        who = (
            f"of {len(candidates)} candidates “{chosen}”" if len(candidates) > 1 else f"the only candidate, “{chosen}”,"
        )
        outcome = _OUTCOME[effect["verdict"]]
        span = f"{percent(confidence)} interval {interval(effect['low'], effect['high'])}"
        if effect["low"] is None:
            span = f"no interval from {seeds}"
        found.append(
            f"With {algorithm_label(algorithm)}, {who} looks best on the first half of the seeds; on the "
            f"other {seeds} its mean difference is {number(effect['difference'])} ({span}): {outcome}."
        )
    return found


_OUTCOME = {
    "positive": "confirmed, it helps",
    "negative": "not confirmed, it harms",
    "equivalent": "not confirmed, it makes no difference that matters",
    "inconclusive": "not confirmed, inconclusive",
}


def cure_table(facts: Facts, confidence: float) -> Table:
    """For each algorithm the chosen arm, its effect on the half that chose it, and on the other half."""
    rows, marks = [], []
    for algorithm, cure in facts["cure"]["algorithms"].items():
        effect = cure["confirmed"]
        rows.append(
            [
                algorithm_label(algorithm),
                arm_label(facts, cure["chosen"]),
                seed_range(cure["choosing_seeds"]),
                number(cure["differences_when_chosen"][cure["chosen"]]),
                seed_range(cure["confirming_seeds"]),
                number(effect["difference"]),
                interval(effect["low"], effect["high"]),
                words.VERDICT_WORDS[effect["verdict"]],
            ]
        )
        marks.append(effect["verdict"])
    head = ["algorithm", "chosen arm", "chosen on seeds", "difference there", "confirmed on seeds", "difference there"]
    head += [f"{percent(confidence)} interval", "verdict"]
    names = ", ".join(arm_label(facts, arm) for arm in facts["cure"]["candidates"])
    caption = (
        f"The candidate with the greatest mean difference in {metric_label(facts)} (empty minus arm, in "
        f"{metric_unit(facts)}) on the first half of the seeds, judged on the other half, which had no say in the "
        f"choice. Candidates: {names}. From transfer (manifest.json)."
    )
    return Table(caption, head, rows, labels=2, marks=marks, sources=("transfer",))
