"""The card in words and tables, from the facts of the card alone."""

from collections.abc import Mapping
from typing import Any

from maglev_offline.curate.recovery.words import recovery_words
from maglev_offline.curate.words import residual_lines, verdict_words
from maglev_offline.ingest.findings import SEVERITIES
from maglev_offline.report.coverage_table import coverage_table
from maglev_offline.report.numbers import NOTHING, listing, whole
from maglev_offline.report.page import Block, Paragraph, Points, Section, Table, Verbatim
from maglev_offline.report.sections_recipe import toml_text
from maglev_offline.report.words import reason, simulated_sentence

Facts = Mapping[str, Any]

MOST_LOGS = 100
"""So many logs have a row of their own in a table of the page; `card.json` has all."""


def head_of(card: Facts) -> Section:
    """What the dataset is, in a sentence, and what to know before anything else."""
    counts, sources = card["ledger"][2], card["sources"]
    lead = (
        f"{whole(counts['used'])} state-action transitions of {whole(len(sources))} "
        f"log{'s' * (len(sources) != 1)} of a maglev suspension; {verdict_words(card)}."
    )
    head = Section("head", "", [Paragraph(lead, "lead")])
    if card["description"]:
        head.blocks.append(Paragraph(card["description"]))
    simulated = simulated_sentence(sum(source["simulated"] for source in sources), len(sources))
    if simulated:
        head.blocks.append(Paragraph(simulated, "note"))
    head.blocks += [Paragraph(f"To be doubted: {doubt}", "warning") for doubt in card["doubts"]]
    return head


def sections_of(card: Facts) -> list[Section]:
    """All sections below the head, in order; `selection` is where the page puts the scatter."""
    return [
        Section("use", "Intended use", _use(card["intended_use"])),
        Section("selection", "States and actions, and rules to select them"),
        Section("sources", "Sources", _sources(card)),
        Section("signals", "Signals", _signals(card)),
        Section("checks", "What the checks found", _checks(card)),
        Section("ledger", "What was left out", _ledger(card)),
        Section("coverage", "Construction and balance", _coverage(card)),
        Section("truth", "Do the rows teach the truth?", _truth(card)),
        Section("splits", "Splits", _splits(card)),
        Section("recipe", "Recipe, versions and hashes", _recipe(card)),
    ]


def _use(use: Facts) -> list[Block]:
    return [Paragraph("For:"), Points(use["for"]), Paragraph("Not for:"), Points(use["not_for"])]


def _more(sources: list[Facts]) -> list[Block]:
    hidden = len(sources) - MOST_LOGS
    return [Paragraph(f"{whole(hidden)} more logs are in card.json.", "note")] if hidden > 0 else []


def _sources(card: Facts) -> list[Block]:
    sources = card["sources"]
    rows = [
        [
            one["file"],
            "simulated" if one["simulated"] else "not marked",
            _time(one["first"]),
            _time(one["last"]),
            ", ".join(one["points"][:6]) + (", …" if len(one["points"]) > 6 else ""),
            whole(one["counts"].get("rows")),
            whole(one["transitions"]),
        ]
        for one in sources[:MOST_LOGS]
    ]
    head = ["file", "origin", "first sample (UTC)", "last sample (UTC)", "points", "samples", "curated rows"]
    caption = "The logs. Simulated: the log says so itself; not marked: it does not say."
    hashes = [[one["file"], one["sha256"] or NOTHING] for one in sources[:MOST_LOGS]]
    return [
        Table(caption, head, rows, labels=5),
        Table("Their bytes.", ["file", "SHA-256"], hashes, labels=2),
        *_more(sources),
    ]


def _time(instant: str | None) -> str:
    return NOTHING if instant is None else instant[:19].replace("T", " ")


def _signals(card: Facts) -> list[Block]:
    """One table for each mapping, with the logs that it is of."""
    groups: dict[str, list[Facts]] = {}
    for one in card["sources"]:
        groups.setdefault(repr((one["signals"], one["signals_detected"], one["velocity"])), []).append(one)
    return [_mapping(alike, whole_card=len(groups) == 1) for alike in groups.values()]


def _mapping(alike: list[Facts], *, whole_card: bool) -> Table:
    one = alike[0]
    found = {name: part for name, part in one["signals"].items() if isinstance(part, Mapping) and "field" in part}
    found |= one["signals"].get("context", {})
    rows = [
        [name, part["field"], part.get("topic") or one["signals"].get("topic", ""), part["unit"], _remarks(part)]
        for name, part in found.items()
    ]
    named = [log["file"] for log in alike[:3]] + ([f"{len(alike) - 3} more"] if len(alike) > 3 else [])
    logs = "all logs" if whole_card else listing(named)
    how = "found by names and units" if one["signals_detected"] else "as the recipe says"
    velocity = {"logged": "logged", "central_difference": "taken from the gap"}.get(one["velocity"], one["velocity"])
    set_point = "logged" if one["set_point"] == "logged" else "the plant’s"
    caption = (
        f"What was read as what, of {logs}: {how}; times by {one['signals'].get('clock', 'the log')}; the velocity is "
        f"{velocity}, the set-point {set_point}."
    )
    return Table(caption, ["signal", "field", "topics", "unit", "remarks"], rows, labels=5)


def _remarks(part: Facts) -> str:
    said = [f"offset {part['offset']:g}"] if part.get("offset") else []
    said += ["sign reversed"] if part.get("sign") == -1 else []
    said += [f"valid {part['valid'][0]:g} to {part['valid'][1]:g}"] if part.get("valid") else []
    return ", ".join(said)


def _checks(card: Facts) -> list[Block]:
    logs: dict[tuple[str, str], list[Facts]] = {}
    for one in card["sources"]:
        for found in one["findings"]:
            logs.setdefault((found["severity"], found["code"]), []).append(found)
    order = sorted(logs, key=lambda key: (-SEVERITIES.index(key[0]), key[1]))
    rows = []
    for severity, code in order:
        alike = logs[severity, code]
        worst = max(alike, key=lambda found: found["places"])
        places = sum(found["places"] for found in alike)
        rows.append([code, severity, worst["what"], whole(len(alike)), whole(places)])
    caption = "The worst case of each code in words, how many logs have it, and how many places there are."
    table = Table(caption, ["code", "severity", "what", "logs", "places"], rows, labels=3)
    return [table if rows else Paragraph("Nothing."), Paragraph(_shared_words(card["shared_content"]))]


def _shared_words(shared: list[Facts] | None) -> str:
    if shared is None:
        return "Whether logs share content was not looked at."
    if not shared:
        return "No two logs hold the same recording, or a part of one in another."
    return "Logs share content: " + " ".join(found["what"] for found in shared)


def _ledger(card: Facts) -> list[Block]:
    rows = [
        [code, f"{entry['stage']}, {entry['unit']}", reason(code), whole(n)]
        for entry in card["ledger"]
        for code, n in sorted(entry["left_out"].items())
    ]
    blocks: list[Block] = [Points([_sum(entry) for entry in card["ledger"]])]
    blocks += [
        Paragraph(f"The counts of {entry['stage']} ({entry['unit']}) do not add up.", "warning")
        for entry in card["ledger"]
        if not entry["balances"]
    ]
    caption = "What was not used at each stage, and why."
    return [*blocks, Table(caption, ["reason code", "stage", "meaning", "count"], rows, labels=3)] if rows else blocks


def _sum(entry: Facts) -> str:
    lost = sum(entry["left_out"].values())
    return (
        f"{entry['stage']}: {whole(entry['in'])} {entry['unit']} = {whole(entry['used'])} used + {whole(lost)} left out"
    )


def _coverage(card: Facts) -> list[Block]:
    tables = card["recipe"]["tables"]
    curate = tables["curate"]
    filtered = curate.get("consistent_fraction")
    text = (
        f"Construction {card['construction']}"
        + (f", of which the share of {filtered:g} that agrees best with the simulator" if filtered else "")
        + f"; balance {card['balance']}, for {whole(curate['target_rows'])} rows, seed {curate['seed']}."
    )
    return [Paragraph(text), coverage_table({**card["coverage"], "balance": card["balance"]})]


def _truth(card: Facts) -> list[Block]:
    found = card["diagnostic"]
    judged = (
        f"Of {whole(found['rows'])} rows for training, against the simulator of the recipe’s plant, with intervals at "
        f"{found['confidence']:.0%} over {whole(found['units'])} {found['resampled']}."
    )
    lines = [verdict_words(card), recovery_words(card["recovery"]), *residual_lines(card)]
    return [Points([f"{line[0].upper()}{line[1:]}." for line in lines]), Paragraph(judged)]


def _splits(card: Facts) -> list[Block]:
    rows = [
        [one["file"], one["split"] or "none of its rows is usable", whole(one["candidates"]), whole(one["transitions"])]
        for one in card["sources"][:MOST_LOGS]
    ]
    for name, part in card["splits"].items():
        rows.append([f"all for {name}", name, whole(part["candidates"]), whole(part["transitions"])])
    caption = "Whole logs are held out for validation, never rows; curated rows are for training only."
    return [Table(caption, ["log", "split", "usable rows", "curated rows"], rows, labels=2), *_more(card["sources"])]


def _recipe(card: Facts) -> list[Block]:
    differ = card["recipe"]["differ_between_logs"]
    blocks: list[Block] = []
    if differ:
        blocks.append(Paragraph(f"The logs were ingested with different tables {listing(differ)}.", "warning"))
    artefacts = [
        [name, one["hash"][:16], one["fingerprint"][:16]] for name, one in list(card["artefacts"].items())[-MOST_LOGS:]
    ]
    versions = [[package, ", ".join(found)] for package, found in card["versions"].items()]
    caption = (
        "The artefacts: the first 16 digits of hash (of the manifest, which holds that of each file) and fingerprint."
    )
    return [
        *blocks,
        Table(caption, ["artefact", "hash", "fingerprint"], artefacts, labels=3),
        Table("Versions that they were made with.", ["package", "version"], versions, labels=2),
        Verbatim(
            f"The tables of the recipe “{card['name']}” that made them, defaults filled in.",
            toml_text(card["recipe"]["tables"]),
        ),
    ]
