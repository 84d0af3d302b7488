"""A byte of an artefact that is flipped, or a file that is cut: whoever reads it notices, and its stage mends it."""

import shutil

import pytest

READERS = {
    "samples": ("ingest", "curate"),
    "shared_content": ("ingest", None),
    "transitions": ("curate", "prefill"),
    "prefill": ("prefill", None),
    "exports": ("prefill", None),
    "control": ("control", None),
    "control_page": ("control", None),
    "training": ("train", "export"),
    "transfer": ("transfer", None),
    "card": ("card", None),
    "report": ("report", None),
}
"""By kind of artefact: the stage that makes it, and one that reads it and nothing newer."""


def damaged(content, how):
    if how == "cut":
        return content[: len(content) // 2]
    at = len(content) // 2
    return content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]


def after(harness, stage):
    names = list(harness.STAGES)
    return names[names.index(stage) + 1]


def try_files(harness, nursery, road, folder, kind, hows):
    """Damage each file of the first artefact of a kind in turn."""
    maker, reader = READERS[kind]
    start = road.before(after(harness, maker))
    (first, *_) = sorted(p for p in (start / "workspace" / kind).rglob("manifest.json") if "/." not in str(p))
    good = harness.digest(start)
    for path in sorted(p for p in first.parent.rglob("*") if p.is_file()):
        for how in hows:
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(start, folder)
            broken = folder / path.relative_to(start)
            broken.write_bytes(damaged(broken.read_bytes(), how))
            if reader is not None:
                told = nursery.run(folder, *harness.STAGES[reader])
                assert told.code == 2, (path.name, how, told)
                assert "not what was written" in told.err or "cannot be read" in told.err, told.err
                assert "Traceback" not in told.err
            again = nursery.run(folder, *harness.STAGES[maker])
            assert again.code == 0, again.err
            assert harness.digest(folder) == good, (path.name, how)


def test_a_flipped_byte_is_noticed_and_mended(harness, nursery, road, tmp_path):
    try_files(harness, nursery, road, tmp_path / "w", "prefill", ["flip"])


@pytest.mark.faults
@pytest.mark.parametrize("kind", sorted(READERS))
def test_every_file_of_every_kind(harness, nursery, road, tmp_path, kind):
    try_files(harness, nursery, road, tmp_path / "w", kind, ["flip", "cut"])
