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
    n, undecided = len(result.pairs), len(result.pairs) - result.decided
    agree = "agrees" if result.agreeing == 1 else "agree"
    counts = [f"{result.agreeing} {agree} with the measurement within the joint 95 % interval"]
    if result.differing:
        counts.append(f"{result.differing} {'differs' if result.differing == 1 else 'differ'}")
    if undecided:
        counts.append(f"{undecided} {'is' if undecided == 1 else 'are'} undecided")
    text = (
        f"The twin predicts the contrast detection probability (CDP) of {n} {'pair' if n == 1 else 'pairs'} of "
        f"patches; {', '.join(counts)}."
    )
    return [text, *_undecided(result), *_judged(result), _mattering(result)]


def _undecided(result: TwinResult) -> list[str]:
    if result.decided == len(result.pairs):
        return []
    return [
        "Of an undecided pair nearly any CDP would agree, as what the parameters, the readings and the pixels leave "
        "open is too much: it counts neither way."
    ]


def _judged(result: TwinResult) -> list[str]:
    """Tell whether the twin describes the camera: by the CDPs and by the patches' signals, in one verdict."""
    n, differing = result.decided, result.differing
    chance = sum(comb(n, k) * _EXPECTED**k * (1 - _EXPECTED) ** (n - k) for k in range(differing, n + 1))
    # A wrong reading is no fault of the twin.
    by_readings = bool(result.findings) and all(one.mending.patch is not None for one in result.findings)
    contradicted = "what the meter read" if by_readings else "the twin"
    verdict = "the twin does not describe this camera in full"
    if by_readings:
        verdict = "the twin can be judged when these readings were taken again"
    if differing and chance < _CHANCE:
        text = (
            f"By chance about {max(round(_EXPECTED * n), 1)} would differ: {verdict}. Pairs with a patch in common "
            "often differ together, so look which patches the differing ones share."
        )
        if not result.findings:
            text += " Mean, noise and fixed pattern of the patches contradict no parameter of the twin."
        return [text, *_contradicted(result)]
    if result.findings:
        pairs = "No more pairs differ than by chance" if differing else "No pair differs"
        return [
            f"{pairs}, but the signals of the patches contradict {contradicted}: {verdict}.",
            *_contradicted(result),
        ]
    if n == 0:
        return [
            "No pair tells whether the twin describes this camera, and with uncertainties as wide as these the signals "
            "of the patches contradict nothing."
        ]
    few = f", as far as the {n} decided {'pair tells' if n == 1 else 'pairs tell'}" if n < len(result.pairs) else ""
    if differing:
        return [
            "That is what chance leaves of 95 % intervals, and the signals of the patches contradict no parameter: the "
            f"twin describes this camera{few}."
        ]
    return [f"The twin describes this camera within what its parameters, the readings and the pixels leave open{few}."]


def _contradicted(result: TwinResult) -> list[str]:
    """Tell what the patches' signals contradict, which single CDPs cannot tell apart."""
    if not result.findings:
        return []
    one = result.findings[0]
    sentence = (
        f"By the signals of the patches, the {printable(one.name)} is off: {significant(one.stated)} {one.unit} in the "
        f"twin, {significant(one.needed)} {one.unit} by the camera ({abs(one.z):.1f} standard uncertainties)"
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
