"""The verdict of the recovery as people read it. Imports no pandas: an unchanged run needs none."""

from collections.abc import Mapping
from typing import Any, Literal

RecoveryVerdict = Literal["trustworthy", "limited", "not_identifiable"]

_MEANINGS = {
    "trustworthy": "trustworthy",
    "limited": "of limited use",
    "not_identifiable": "not identifiable from these samples",
}


def recovery_words(found: Mapping[str, Any]) -> str:
    """Say in one sentence what the facts `recovery` of a transitions manifest tell."""
    signals = ", ".join(f"{name} {kind}" for name, kind in found["signals"].items())
    laws = ", ".join(f"{law} in {n} log{'s' * (n != 1)}" for law, n in found["laws"].items()) or "none tried"
    least = "" if found["phase_of"] == "law" else "at least "
    turns = ", ".join(f"{phase:.2f} rad ({law})" for law, phase in found["phase_rad_by_law"].items())
    text = (
        f"states between samples are {_MEANINGS[found['verdict']]} ({signals}; law: {laws}; the loop turns by "
        f"{least}{turns or '0 rad'} from sample to sample, the plant explains {found['explained_share']:.0%}"
    )
    std, known = found["expected_std"], found["known_share"]
    if std is None:
        return text + ")"
    return text + (
        f"; expected error {std['gap'] * 1e3:.3f} mm, {std['velocity'] * 1e3:.2f} mm/s, {std['current']:.3f} A, of the "
        f"variance known: gap {known['gap']:.1%}, velocity {known['velocity']:.1%}, current {known['current']:.1%})"
    )
