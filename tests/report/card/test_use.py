"""What a card says the rows are for: it depends on the verdict, and never hides that logs are simulated."""

import pytest

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.report.card.use import intended_use

PROCESS = {"plant": Plant().model_dump(), "mdp": Mdp().model_dump()}


def use(verdict, simulated=0, doubts=()):
    return intended_use({"diagnostic": {"verdict": verdict}, "doubts": doubts}, PROCESS, simulated, 3)


@pytest.mark.parametrize(
    ("verdict", "good", "bad"),
    [
        ("fit", "To fill the replay buffer", "To take help for granted"),
        ("doubtful", "To find out", "without an empty one beside it"),
        ("harmful", "To study negative transfer", "in the hope of learning sooner"),
    ],
)
def test_each_verdict_has_its_use_and_its_misuse(verdict, good, bad):
    found = use(verdict)
    assert found["verdict"] == verdict
    assert good in found["for"][0]
    assert bad in found["not_for"][0]
    assert any("For another plant" in text and "8 mm, decisions every" in text for text in found["not_for"])


@pytest.mark.parametrize(("simulated", "called", "words"), [(3, "all", "All logs are"), (1, "some", "1 of 3 logs are")])
def test_simulated_logs_say_nothing_of_a_vehicle(simulated, called, words):
    found = use("fit", simulated)
    assert found["simulated"] == called
    assert any(f"{words} surrogates" in text for text in found["not_for"])


def test_recorded_logs_are_not_called_simulated_and_doubts_are_told():
    found = use("fit", doubts=["the gap does not fit."])
    assert found["simulated"] == "none"
    assert not any("surrogates" in text for text in found["not_for"])
    assert found["not_for"][-1] == "Before this doubt is settled: the gap does not fit."
