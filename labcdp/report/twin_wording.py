"""What a report on a twin says in sentences."""

from __future__ import annotations

from collections import Counter
from math import comb
from typing import TYPE_CHECKING

from .digits import printable, significant

if TYPE_CHECKING:
    from ..evaluate.twin import TwinResult

#: Chance below which so many differing pairs are more than chance.
_CHANCE = 0.01
#: Share of differing pairs that 95 % intervals leave.
_EXPECTED = 0.05


def twin_results(result: TwinResult) -> list[str]:
    """Tell whether camera and twin agree, and what matters."""
    n, differing = len(result.pairs), len(result.pairs) - result.agreeing
    text = (
        f"The twin predicts the contrast detection probability (CDP) of {n} {'pair' if n == 1 else 'pairs'} of "
        f"patches; {result.agreeing} {'agrees' if result.agreeing == 1 else 'agree'} with the measurement within the "
        f"joint 95 % interval{f', {differing} ' + ('differs' if differing == 1 else 'differ') if differing else ''}."
    )
    return [text, _judged(n, differing), *_explained(result), _mattering(result)]


def _judged(n: int, differing: int) -> str:
    chance = sum(comb(n, k) * _EXPECTED**k * (1 - _EXPECTED) ** (n - k) for k in range(differing, n + 1))
    if differing and chance < _CHANCE:
        return (
            f"By chance about {max(round(_EXPECTED * n), 1)} would: the twin does not describe this camera in full. "
            "Pairs with a patch in common often differ together, so look which patches the differing ones share."
        )
    if differing:
        return "That is what chance leaves of 95 % intervals: the twin describes this camera."
    return "The twin describes this camera within what its parameters, the readings and the pixels leave open."


def _explained(result: TwinResult) -> list[str]:
    """Tell what the patches' signals contradict, which single CDPs cannot tell apart."""
    if not result.findings:
        if result.agreeing == len(result.pairs):
            return []
        return ["Mean, noise and fixed pattern of the patches contradict no parameter of the twin."]
    one = result.findings[0]
    sentence = (
        f"By the signals of the patches, the {printable(one.name)} is off: {significant(one.stated)} {one.unit} in the "
        f"twin, {significant(one.needed)} {one.unit} by the camera ({abs(one.z):.0f} standard uncertainties)"
    )
    others = [printable(other.name) for other in result.findings[1:]]
    explained = sum(pair.mended is not None for pair in result.pairs)
    closing = f" This explains {explained} of the pairs that differ, in whole or in part." if explained else ""
    return [f"{sentence}{'; also ' + ', '.join(others) if others else ''}.{closing}"]


def _mattering(result: TwinResult) -> str:
    names = Counter(pair.influences[0].name for pair in result.pairs)
    name, times = names.most_common(1)[0]
    return (
        f"What limits the comparison most often is the {printable(name)}: it is the largest part of the uncertainty of "
        f"{times} of {len(result.pairs)} pairs."
    )


def twin_warnings(result: TwinResult) -> list[str]:
    """Tell what to mind of the comparison: what was left out, and what the calibration warns of."""
    return [printable(note) for note in (*(f"left out: {text}" for text in result.left_out), *result.warnings)]


def twin_notes(result: TwinResult) -> list[str]:
    """Tell what the twin cannot hold, or had to assume."""
    return [printable(note) for note in result.parameters.notes]


def simulated(result: TwinResult) -> str:
    """Tell that the bench was simulated; empty on a real one."""
    camera = result.calibration.state.camera
    if not camera.simulated:
        return ""
    return (
        f"Simulated: camera {printable(camera.model)} and target. The numbers show how the comparison works; they are "
        "of no real bench."
    )
