"""What another version made is told in a sentence with what to do, not as a failure of the tool."""

import json

import pandas as pd
import pytest

from maglev_offline.errors import ArtefactError
from maglev_offline.report.evidence import gather
from maglev_offline.report.stage import head_section
from maglev_offline.report.versions import COLUMNS, STAGE_OF, as_told
from maglev_offline.workspace import Manifest, Workspace


@pytest.fixture(scope="module")
def read(made):
    """The manifests of a finished workspace by the names of their artefacts, as the pages read them."""
    return gather(Workspace(made)).artefacts


def without(manifest, *path):
    """The manifest of a version that did not know the fact at `path`."""
    facts = json.loads(json.dumps(manifest.facts))
    table = facts
    for part in path[:-1]:
        table = table[part]
    del table[path[-1]]
    return Manifest(**(vars(manifest) | {"facts": facts}))


def test_every_column_that_is_asked_for_is_written_today(read):
    looked_at = {(name.partition("/")[0], file) for name, a in read.items() for file in a.manifest.files}
    assert {(kind, f"{table}.parquet") for kind, table in COLUMNS} <= looked_at


def test_a_fact_that_a_verdict_lacks_is_named_with_the_stage_that_makes_it(made, read, recipe):
    study = read["transfer"]
    older = as_told(without(study.manifest, "algorithms", "ddpg", "arms", "empty", "seeds"), "transfer", study.folder)
    assert older.facts["algorithms"]["ddpg"]["arms"]["empty"].get("seeds") is None
    evidence = gather(Workspace(made))
    evidence.artefacts["transfer"] = type(study)("transfer", study.folder, older, study.hash)
    with pytest.raises(
        ArtefactError, match=r"another version.* no 'seeds'.*Remove that folder.*maglev-offline transfer`"
    ):
        head_section(evidence, recipe.plain())


def test_a_table_without_a_column_is_told_of_before_anything_is_drawn(tmp_path):
    manifest = Manifest("transitions", "mark", {}, files={"diagnostic_rows.parquet": ""})
    rows = pd.DataFrame({"gap_cell": [0], "velocity_cell": [0], "advantage": [0.0], "taught_advantage": [0.0]})
    rows.to_parquet(tmp_path / "diagnostic_rows.parquet")
    with pytest.raises(ArtefactError, match=r"no column weight in diagnostic_rows\.parquet.*maglev-offline curate`"):
        as_told(manifest, "transitions", tmp_path)
    rows.assign(weight=1.0).to_parquet(tmp_path / "diagnostic_rows.parquet")
    assert as_told(manifest, "transitions", tmp_path).facts == {}


def test_what_is_to_be_run_again_is_a_command_for_every_kind_of_artefact():
    from typer.main import get_command

    from maglev_offline.cli import app

    commands = set(get_command(app).commands)
    kinds = {"samples", "shared_content", "transitions", "prefill", "exports", "identify", "control", "control_page",
             "training", "transfer", "card", "report"}  # fmt: skip
    assert {STAGE_OF.get(kind, kind) for kind in kinds | set(STAGE_OF)} <= commands
