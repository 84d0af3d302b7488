"""The sections of a study: every arm seed by seed, how runs lie, and why. None where the study has no such facts."""

from collections.abc import Mapping
from functools import partial

from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import listing, number
from maglev_offline.report.page import Block, Paragraph, Plot, Section
from maglev_offline.report.study import attribution, cure, differences, foretelling, profiles
from maglev_offline.report.study.reading import Facts, arm_label, metric_label, primary_effects, runs_of
from maglev_offline.report.style import algorithm_label

SOURCE = ("transfer",)

LEAST_ARMS = 2
"""Of fewer arms with a target error there is nothing to hold against each other."""


def differences_section(evidence: Evidence) -> Section | None:
    """What every arm did to every seed, with the effects of all arms as one table."""
    study = _study(evidence)
    if study is None:
        return None
    facts, confidence = study.facts, _confidence(study)
    figure = partial(differences.differences_figure, facts, runs_of(study))
    caption = differences.differences_caption(facts, confidence)
    label = "Paired differences of every seed and arm. " + " ".join(_verdict_sentences(facts))
    section = Section("differences", "All arms, seed by seed")
    section.blocks += [Paragraph(text) for text in _verdict_sentences(facts)]
    section.blocks.append(Plot("differences", figure, caption, label, SOURCE))
    section.blocks.append(differences.differences_table(facts, confidence))
    if facts.get("against", {}).get("comparisons"):
        section.blocks.append(differences.against_table(facts, confidence))
    return section


def profiles_section(evidence: Evidence) -> Section | None:
    """How the runs of each arm lie, and when they reached the threshold."""
    study = _study(evidence)
    if study is None:
        return None
    facts, confidence = study.facts, _confidence(study)
    steps = int(study.manifest.settings["training"]["steps"])
    figure = partial(profiles.profiles_figure, facts, runs_of(study), steps, confidence)
    label = "Performance profiles of the cost at the end, and shares of runs that reached the threshold over the steps."
    section = Section("profiles", "How the runs lie: final cost, and time to the threshold")
    section.blocks.append(Paragraph(" ".join(_reached_sentences(facts))))
    section.blocks.append(Plot("profiles", figure, profiles.profiles_caption(facts, confidence), label, SOURCE))
    return section


def why_section(evidence: Evidence) -> Section | None:
    """Which part of the rows harms, whether the outcome was foretold, and whether a cure was confirmed."""
    study = _study(evidence)
    if study is None:
        return None
    facts, confidence = study.facts, _confidence(study)
    section = Section("why", "Why: which rows matter, what was foretold, what cures")
    if facts.get("attribution", {}).get("parts"):
        section.blocks += _attribution(facts, confidence)
    section.blocks += _foretelling(study, confidence)
    if facts.get("cure", {}).get("algorithms"):
        section.blocks.append(Paragraph(" ".join(cure.cure_sentences(facts, confidence))))
        section.blocks.append(cure.cure_table(facts, confidence))
    return section if section.blocks else None


def _study(evidence: Evidence) -> Artefact | None:
    """The study, if it holds an effect."""
    study = evidence.get("transfer")
    if study is None or not any(primary_effects(study.facts, name) for name in study.facts["algorithms"]):
        return None
    return study


def _confidence(study: Artefact) -> float:
    return float(study.manifest.settings["transfer"]["confidence"])


_SAID = {
    "positive": "{} beat{} the empty buffer",
    "negative": "{} do{} worse than the empty buffer",
    "equivalent": "{} make{} no difference that matters",
    "inconclusive": "{} stay{} open",
}


def _verdict_sentences(facts: Facts) -> list[str]:
    """For each algorithm, which arms help, harm, do nothing or stay open, and how many verdicts survive Holm."""
    found = []
    for algorithm in facts["algorithms"]:
        effects = primary_effects(facts, algorithm)
        clauses = []
        for verdict, said in _SAID.items():
            arms = [arm for arm, effect in effects.items() if effect["verdict"] == verdict]
            if arms:
                ending = ("es" if said.startswith("{} do") else "s") if len(arms) == 1 else ""
                clauses.append(said.format(listing([f"“{arm_label(facts, arm)}”" for arm in arms]), ending))
        name, said = algorithm_label(algorithm), "; ".join(clauses)
        found.append(f"{name}, judged by {metric_label(facts)}: {said}.{_holm(facts, effects)}")
    return found


def _holm(facts: Facts, effects: Mapping[str, Facts]) -> str:
    """Which of the differences hold after the correction for their number."""
    decided = {arm: effect for arm, effect in effects.items() if effect["verdict"] in ("positive", "negative")}
    kept = [f"“{arm_label(facts, arm)}”" for arm, effect in decided.items() if effect["holds_after_holm"]]
    if not decided:
        return ""
    if not kept:
        return (
            f" After Holm’s correction {'none of these differences holds' if len(decided) > 1 else 'it does not hold'}."
        )
    if len(kept) == len(decided):
        return " Holm’s correction changes none of it."
    return f" After Holm’s correction only {listing(kept)} still differ{'s' * (len(kept) == 1)}."


def _reached_sentences(facts: Facts) -> list[str]:
    """How many runs of the arms that the figure tells apart reach the threshold."""
    found = [f"The threshold is a cost of {number(facts['threshold_cost'])}."]
    for algorithm in facts["algorithms"]:
        counts = [
            f"{reached} of {runs} ({label})" for label, reached, runs in profiles.reached_counts(facts, algorithm)
        ]
        found.append(f"With {algorithm_label(algorithm)}, the runs that reach it are {listing(counts)}.")
    return found


def _attribution(facts: Facts, confidence: float) -> list[Block]:
    text = " ".join(attribution.attribution_sentences(facts))
    return [
        Paragraph(text),
        Plot(
            "attribution",
            partial(attribution.attribution_figure, facts),
            attribution.attribution_caption(facts, confidence),
            f"Differences without each part of the rows. {text}",
            SOURCE,
        ),
        attribution.attribution_table(facts, confidence),
    ]


def _foretelling(study: Artefact, confidence: float) -> list[Block]:
    """The outcome against the diagnostic, where enough arms have both."""
    facts = study.facts
    told = facts.get("foretelling", {}).get("algorithms", {})
    if max((found[foretelling.NUMBER]["arms"] for found in told.values()), default=0) < LEAST_ARMS:
        return []
    text = " ".join(foretelling.foretelling_sentences(facts, confidence))
    return [
        Paragraph(text),
        Plot(
            "foretelling",
            partial(foretelling.foretelling_figure, facts, runs_of(study)),
            foretelling.foretelling_caption(facts, confidence),
            f"Target error of each arm’s rows against what it did. {text}",
            SOURCE,
        ),
        foretelling.calibration_table(facts),
    ]
