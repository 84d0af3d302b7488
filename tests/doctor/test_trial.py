import multiprocessing
import os

import numpy as np
import pytest

from maglev_offline.agents import engine
from maglev_offline.agents.native_library import availability
from maglev_offline.doctor import trial
from maglev_offline.doctor.trial import Found, Native, train_a_little, try_engines
from maglev_offline.errors import MaglevOfflineError


@pytest.mark.parametrize("choice", ["torch", "native"])
def test_either_engine_trains_a_little(choice):
    if choice == "native" and not availability()[0]:
        pytest.skip(availability()[1])
    assert train_a_little(choice)[:2] == (choice, "it was asked for")


class Learner:
    """Learns what it is told to."""

    def __init__(self, *weights):
        self.weights = iter(weights)

    def actors(self):
        return {"w1": np.array([next(self.weights)], dtype=np.float32)}

    def advance(self, steps):
        pass


@pytest.mark.parametrize(
    ("weights", "words"), [((1.0, 1.0), "it learned nothing"), ((1.0, np.nan), "what it learned is no number")]
)
def test_a_learner_that_does_not_learn_is_found_out(monkeypatch, weights, words):
    monkeypatch.setattr(engine, "make_learner", lambda *arguments, **options: Learner(*weights))
    with pytest.raises(MaglevOfflineError, match=words):
        train_a_little("torch")


NATIVE = Native(True, "avx2", "avx2", "gcc", [("avx2", True)])


@pytest.fixture
def process(monkeypatch):
    """Put a process in the place of the real one, which tells `answers` and then ends with `exitcode`, or hangs."""

    class Process:
        answers, exitcode, hangs, killed = (NATIVE,), 0, False, False

        def __init__(self, target, args, daemon):
            self.pipe = args[0]

        def start(self):
            for answer in self.answers:
                self.pipe.send(answer)
            if self.hangs:
                Process.held = os.dup(self.pipe.fileno())

        def kill(self):
            Process.killed = True
            os.close(Process.held)

        def join(self):
            pass

    class Context:
        Pipe = staticmethod(multiprocessing.Pipe)

    Context.Process = Process
    monkeypatch.setattr(multiprocessing, "get_context", lambda method: Context)
    return Process


def test_what_was_seen_before_a_crash_is_told_and_where_it_crashed(process):
    process.exitcode = -4
    found = try_engines("auto")
    assert found.native == NATIVE
    assert found.torch == "the trial failed here: the process was ended by SIGILL"
    assert found.trained == "not tried: the trial ended before"


def test_a_process_that_ends_before_its_time_is_told_of(process):
    process.answers, process.exitcode = (), 3
    assert try_engines("auto").native == "the trial failed here: the process ended with exit code 3"


def test_a_trial_that_hangs_is_ended(process):
    process.hangs = True
    assert try_engines("auto", longest_s=0.01).torch == "the trial failed here: it did not end within 0.01 s"
    assert process.killed


def test_what_a_look_raises_is_its_finding(monkeypatch):
    def broken():
        raise ImportError("No module named 'torch'")

    def silent(choice):
        raise ValueError

    monkeypatch.setattr(trial, "look_at_native", lambda: NATIVE)
    monkeypatch.setattr(trial, "look_at_torch", broken)
    monkeypatch.setattr(trial, "train_a_little", silent)
    ours, theirs = multiprocessing.Pipe(duplex=False)
    with ours, theirs:
        trial._look(theirs, "auto")
        assert Found(*(ours.recv() for _ in Found._fields)) == Found(NATIVE, "No module named 'torch'", "ValueError")
