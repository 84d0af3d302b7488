"""What could make the result wrong, or wrong elsewhere: each threat, what was done about it, what is left."""

from collections.abc import Mapping, Sequence
from typing import Any

from maglev_offline.physics.parameters import Plant
from maglev_offline.report import words
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import percent, plain, whole
from maglev_offline.report.page import Section, Table
from maglev_offline.report.study.arms import arms_of


def threats_section(evidence: Evidence) -> Section | None:
    """The threats to validity as a table; None without a study."""
    study = evidence.get("transfer")
    if study is None:
        return None
    rows = [*_of_data(evidence), *_of_plant(study), *_of_learning(study, evidence.blocks), *_of_statistics(study)]
    caption = "Threats to validity. Kind: whether the threat is to what was found here, or to its being so elsewhere."
    return Section(
        "threats",
        "Threats to validity",
        [Table(caption, ["threat", "kind", "what was done", "what is left"], rows, labels=4)],
    )


def _of_data(evidence: Evidence) -> list[list[str]]:
    logs = evidence.under("samples")
    simulated = sum(bool(log.facts.get("simulated")) for log in logs)
    found = []
    if simulated:
        found.append(
            [
                f"surrogate logs: {simulated} of {len(logs)} are simulated",
                "elsewhere",
                "Their plant has noise, quantisation, delays, gaps and two controllers; nothing of a real track.",
                "Real logs may teach better or worse; the diagnostic is there to be run on them first.",
            ]
        )
    if len(logs) < 10:
        found.append(
            [
                f"few logs: {len(logs)}",
                "elsewhere",
                "Arms leave out each log in turn where the recipe asks for attribution.",
                "All seeds learn from the same rows: the intervals are over seeds, not over logs.",
            ]
        )
    return found


def _of_plant(study: Artefact) -> list[list[str]]:
    mdp, starts = study.manifest.settings["mdp"], study.manifest.settings["evaluation"]["start_gaps_m"]
    papers = study.manifest.settings["plant"] == Plant().model_dump(mode="json")
    noise = mdp["force_noise_std_n"]
    force = f"A random force of {plain(noise)} N" if noise else "No random force"
    return [
        [
            f"one plant: a single magnet with {'the paper’s' if papers else 'the recipe’s'} parameters",
            "elsewhere",
            f"{force} in training; starts from {plain(1e3 * min(starts))} to {plain(1e3 * max(starts))} mm; the "
            "stops are part of the plant.",
            "No guideway irregularity, no coupling of magnets, no change of load within a run.",
        ],
        [
            f"one control period and integrator: {plain(mdp['control_period_ms'])} ms, {mdp['integrator']}",
            "elsewhere",
            "The recipe may name other periods, and study.toml does.",
            "Differences between periods mix time scale, horizon, seconds of experience and gradient steps.",
        ],
    ]


def _of_learning(study: Artefact, blocks: Sequence[Artefact]) -> list[list[str]]:
    training = study.manifest.settings["training"]
    own = {
        "layer norm": training["layer_norm_critic"],
        "critics of the root of the cost": bool(training["critic_root_offset"]),
        "a pull against saturation": bool(training["saturation_weight"]),
        "no batch norm": not training["batch_norm_actor"],
    }
    names = ", ".join(name for name, used in own.items() if used)
    chosen = (
        [
            f"chosen defaults, not the paper’s: {names}",
            "elsewhere",
            "They were chosen before this study, on empty buffers, for learning well.",
            "An agent that learns badly by itself may gain from rows that do not help these.",
        ]
        if names
        else [
            "the paper’s algorithms, whose open numbers are chosen defaults",
            "elsewhere",
            "Learning rates, cost weights, discount and voltage limit are in the recipe.",
            "Other choices may turn a small effect around.",
        ]
    )
    moving = [
        f"{algorithm.upper()} {arm}"
        for algorithm, found in study.facts["algorithms"].items()
        for arm in arms_of(study.facts)
        if abs(found["arms"][arm]["mean_drift"]) > _margin(found)
    ]
    return [
        chosen,
        [
            "length of training: "
            + (f"still changing at the end: {', '.join(moving)}" if moving else "no arm still changes at the end"),
            "here",
            "The area is judged over the whole axis; the drift of each arm is in the table of runs.",
            "The asymptote of an arm that still changes is a snapshot." if moving else "None seen.",
        ],
        [
            f"rounding of one machine: {', '.join(_engines(blocks)) or 'unknown engine'}",
            "here",
            "Both engines are held to the same updates by tests.",
            "The plant is unstable, so that roundings of another machine give other curves of the same law.",
        ],
    ]


def _engines(blocks: Sequence[Artefact]) -> list[str]:
    return sorted({f"{block.facts['engine']} ({block.facts['instruction_set']})" for block in blocks})


def _margin(found: Mapping[str, Any]) -> float:
    return max((effects["asymptote"]["margin"] for effects in found["effects"].values()), default=float("inf"))


def _of_statistics(study: Artefact) -> list[list[str]]:
    facts, settings = study.facts, study.manifest.settings["transfer"]
    metric = facts["primary_metric"]
    effects = [a["effects"][arm][metric] for a in facts["algorithms"].values() for arm in a["effects"]]
    blind = [e for e in effects if e["detectable"] is None or e["detectable"] > e["margin"]]
    total = sum(len(m) for a in facts["algorithms"].values() for m in a["effects"].values())
    lost = sum(a["arms"][arm]["diverged"] for a in facts["algorithms"].values() for arm in arms_of(facts))
    wrong = percent(1 - settings["confidence"])
    return [
        [
            f"{whole(total)} comparisons, each nominally wrong in {wrong} of the cases where nothing is there",
            "here",
            f"The recipe names one metric ({words.METRIC_NAMES[metric]}) as primary; p is Holm’s over all.",
            "Verdicts are those of single intervals, which cover less where seeds scatter unevenly (docs/protocol.md).",
        ],
        [
            f"{words.seeds_words(effects[0]['seeds'])}: an effect of the margin’s size cannot be seen in "
            f"{len(blind)} of {len(effects)} comparisons of the primary metric",
            "here",
            "Seeds are paired; the smallest detectable difference and the seeds needed are printed.",
            "“Inconclusive” is no evidence that nothing is there.",
        ],
        [
            f"runs that diverged: {whole(lost)}; runs that never reach the threshold are censored",
            "here",
            "None is dropped: costs stay, and times count with the whole run.",
            "A mean gives a few very bad runs much weight; interquartile means are beside it.",
        ],
    ]
