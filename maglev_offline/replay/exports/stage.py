"""Makes the artefact `exports/<algorithm>-<form>` from a prefill."""

from importlib.metadata import version
from pathlib import Path
from typing import Literal

from maglev_offline.mdp import Mdp
from maglev_offline.physics.parameters import Plant
from maglev_offline.replay.exports import d3rlpy, minari, npz, sb3, torchrl
from maglev_offline.replay.exports.rows import Form, as_rows
from maglev_offline.replay.prefill import load_prefill
from maglev_offline.workspace import Manifest, Workspace, fingerprint, input_hash

Name = Literal["npz", "sb3", "d3rlpy", "minari", "torchrl"]

FORMS: dict[Name, Form] = {
    "npz": npz.FORM,
    "sb3": sb3.FORM,
    "d3rlpy": d3rlpy.FORM,
    "minari": minari.FORM,
    "torchrl": torchrl.FORM,
}

LAYOUT = 1
"""Version of what is written, so that an export of an older one is made again."""


def make_export(workspace: Workspace, algorithm: str, name: Name, plant: Plant, mdp: Mdp) -> tuple[Path, bool]:
    """Write the prefill of `algorithm` in a form; return the folder and whether it is new.

    Raises
    ------
    ArtefactError: there is no prefill, or it is damaged.
    InputError: the rows cannot be used, or say what the form cannot hold.
    """
    source, form = workspace.path("prefill", algorithm), FORMS[name]
    columns = load_prefill(source)
    inputs = {f"prefill/{algorithm}": input_hash(source)}
    home = workspace.path("exports", f"{algorithm}-{name}")
    mark = fingerprint("export", inputs, mdp, form=name, layout=LAYOUT)
    if workspace.is_current(home, mark):
        return home, False

    construction = str(Manifest.read(workspace.path("transitions")).facts.get("construction", "unknown"))
    rows = as_rows(columns, construction, plant, mdp)
    manifest = Manifest(f"exports/{algorithm}-{name}", mark, inputs)
    manifest.settings = {"mdp": mdp.model_dump(mode="json")}
    manifest.counts = {"rows": len(rows.reward)}
    manifest.facts = {
        "format": name,
        "algorithm": algorithm,
        "written_for": form.library,
        "columns": dict(form.columns),
        "terminated": int(rows.terminated.sum()),
        **rows.facts,
    }
    with workspace.commit(home, manifest) as draft:
        form.write(rows, draft)
        manifest.versions |= {package: version(package) for package in form.packages}
    return home, True
