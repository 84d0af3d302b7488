"""The published result beside this one, with what is not the same in the two."""

from collections.abc import Mapping
from typing import Any

from maglev_offline.report import words
from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import interval, number, plain, whole
from maglev_offline.report.page import Paragraph, Section, Table
from maglev_offline.report.style import algorithm_label

PUBLISHED = {
    "ddpg": ("learns faster with 10,000 logged rows", "positive"),
    "td3": ("becomes worse with them: negative transfer", "negative"),
}
"""What the paper reports of each algorithm, and the verdict that this would be."""

ASKED = ("area", "jumpstart", "asymptote")
"""The metrics of costs in which a reader may see the paper's words."""


def paper_section(evidence: Evidence) -> Section | None:
    """Zhao et al.'s result and settings beside the study's; None where the study has no arm `prefill` to compare."""
    study = evidence.get("transfer")
    if study is None or "prefill" not in study.facts["arms"]:
        return None
    section = Section("paper", "The published result beside this one")
    section.blocks += [
        _results(study.facts),
        _settings(evidence, study),
        Paragraph(
            "The paper gives no number for transfer, no number of seeds and no interval, so that its words are all "
            "that can be held against ours."
        ),
    ]
    return section


def _results(facts: Mapping[str, Any]) -> Table:
    rows = []
    for algorithm, found in facts["algorithms"].items():
        says, verdict = PUBLISHED[algorithm]
        for metric in (facts["primary_metric"], *(m for m in ASKED if m != facts["primary_metric"])):
            effect = found["effects"]["prefill"][metric]
            rows.append(
                [
                    algorithm_label(algorithm),
                    says,
                    words.METRIC_NAMES[metric],
                    f"{number(effect['difference'])} ({interval(effect['low'], effect['high'])})",
                    words.VERDICT_WORDS[effect["verdict"]],
                    _agreement(effect["verdict"], verdict),
                ]
            )
    head = ["algorithm", "the paper: it", "metric here", "difference here", "verdict here", "the same?"]
    caption = (
        "What 10,000 logged rows do, by the paper and here (empty minus prefilled; a negative difference is harm)."
    )
    return Table(caption, head, rows, labels=6, sources=("transfer",))


def _agreement(here: str, there: str) -> str:
    if here == there:
        return "yes"
    return "not shown" if here == "inconclusive" else "no"


def _settings(evidence: Evidence, study: Artefact) -> Table:
    made = study.manifest.settings
    mdp, training, evaluation = made["mdp"], made["training"], made["evaluation"]
    rows_used = study.facts["rows"]["prefill"]["rows"]
    logs = evidence.under("samples")
    simulated = sum(bool(log.facts.get("simulated")) for log in logs)
    start = " to ".join(plain(1e3 * end) for end in dict.fromkeys(mdp["start_gap_m"]))
    pairs = [
        ("logs", "one train’s, not published", f"{len(logs)}, {simulated} of them simulated"),
        ("rows in the buffer", "10,000", whole(rows_used)),
        ("construction of a row", "logged sample to the next, 100 ms", study.facts["rows"]["prefill"]["construction"]),
        ("decision every", "1 ms", f"{plain(mdp['control_period_ms'])} ms"),
        ("training", "1,000 episodes of 500 steps", f"{whole(training['steps'])} steps"),
        ("gap at the start of an episode", "15 mm", f"{start} mm"),
        ("seeds", "not given", whole(training["seeds"])),
        ("hidden layers", "40 neurons", ", ".join(str(n) for n in training["hidden"])),
        ("batch norm in the actor", "yes", _yes(training["batch_norm_actor"])),
        ("layer norm in the critics", "no", _yes(training["layer_norm_critic"])),
        ("critics learn", "the cost-to-go", "the cost-to-go" if not training["critic_root_offset"] else "its root"),
        ("exploration, of the voltage limit", "0.1", plain(training["exploration_std"])),
        ("discount", "not given", number(mdp["discount"])),
        ("cost weights, voltage limit, learning rates", "not given", "see the recipe"),
        ("judged on", "not given", f"{len(evaluation['start_gaps_m'])} fixed starts, without exploration"),
    ]
    head = ["setting", "the paper", "here"]
    return Table(
        "The settings of both, and what the paper leaves open.", head, [list(p) for p in pairs], labels=3,
        sources=("transfer",),
    )  # fmt: skip


def _yes(value: bool) -> str:
    return "yes" if value else "no"
