import pytest
from pydantic import ValidationError

from maglev_offline.agents.settings import TrainingSettings


def test_what_is_not_given_treats_the_prefill_like_any_row():
    settings = TrainingSettings()
    assert (settings.engine, settings.n_step, settings.mixing_share, settings.prefill_decay_steps) == (
        "auto", 1, None, None,
    )  # fmt: skip
    assert settings.cloning_weight == 0


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mixing_share": 1.2}, "less than or equal to 1"),
        ({"mixing_share": -0.1}, "greater than or equal to 0"),
        ({"n_step": 0}, "greater than or equal to 1"),
        ({"prefill_decay_steps": 0}, "greater than or equal to 1"),
        ({"cloning_weight": -1}, "greater than or equal to 0"),
        ({"critic_root_offset": -0.1}, "greater than or equal to 0"),
        ({"saturation_weight": -0.1}, "greater than or equal to 0"),
        ({"checkpoint_every": 0}, "greater than or equal to 1"),
        ({"engine": "jax"}, "'auto', 'torch' or 'native'"),
        ({"n_step": 5, "buffer_capacity": 5}, "n_step = 5 rows do not fit into buffer_capacity = 5 slots"),
        ({"mixing_share": 0, "cloning_weight": 2.5}, "cloning_weight = 2.5 needs prefilled rows in the batch"),
    ],
)
def test_what_cannot_be_is_refused_in_words(given, words):
    with pytest.raises(ValidationError, match=words):
        TrainingSettings(**given)
