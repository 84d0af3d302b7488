"""Where every run is: the rows that it started with and the blocks that hold it, each with its hash."""

from maglev_offline.report.evidence import Artefact, Evidence
from maglev_offline.report.numbers import whole
from maglev_offline.report.page import Block, Section, Table
from maglev_offline.report.style import algorithm_label

HASH_DIGITS = 16


def runs_section(evidence: Evidence) -> Section | None:
    """A row for each block of seeds, with engine and hash, and the artefact of its rows; None without a study."""
    study = evidence.get("transfer")
    if study is None:
        return None
    rows = [_row(evidence, block) for block in evidence.blocks]
    caption = (
        f"The runs that the study was made from: {whole(study.manifest.counts['runs'])} in {len(rows)} blocks. "
        f"Hash: the first {HASH_DIGITS} digits of the SHA-256 of the block’s manifest, which holds those of its "
        "files; the manifest of transfer holds the hash of every block."
    )
    head = ["algorithm", "arm", "seeds", "block", "hash", "rows it started with", "hash of the rows", "engine"]
    table = Table(caption, head, rows, labels=8, sources=("transfer",), folded=len(rows) > 20)
    blocks: list[Block] = [table]
    return Section("runs", "The runs, to be audited", blocks)


def _row(evidence: Evidence, block: Artefact) -> list[str]:
    algorithm, _, arm = block.folder.parent.name.partition("-")
    seeds = block.facts["seeds"]
    name = next(iter(block.manifest.inputs), "")
    rows = evidence.get(name) if name else None
    return [
        algorithm_label(algorithm),
        arm,
        f"{seeds[0]} to {seeds[-1]}",
        block.name,
        block.hash[:HASH_DIGITS],
        name or "none",
        rows.hash[:HASH_DIGITS] if rows is not None else "–",
        f"{block.facts['engine']}, {block.facts['instruction_set']}",
    ]
