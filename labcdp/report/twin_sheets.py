"""A twin as a spreadsheet."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .digits import Z_95, decimals
from .facts import Fact
from .twin_tables import cdp_decimals_of, parameter_name
from .twin_wording import simulated, twin_notes, twin_results, twin_warnings
from .workbook import Cell, Number, Sheet

if TYPE_CHECKING:
    from ..evaluate.twin import TwinResult
    from ..evaluate.twin_pair import TwinPair


def twin_sheets(result: TwinResult, provenance: Sequence[Fact]) -> list[Sheet]:
    """Sheets of summary, pairs, influences, patches, parameters and provenance."""
    return [
        _summary(result),
        Sheet("Pairs", _PAIR_HEADER, [_pair(pair) for pair in result.pairs]),
        _influences(result),
        _patches(result),
        _parameters(result),
        Sheet("Provenance", ("What", "Value"), [(fact.name, fact.value) for fact in provenance]),
    ]


def _summary(result: TwinResult) -> Sheet:
    rows: list[tuple[Cell, ...]] = [
        ("Session", result.observed.configuration.name),
        ("Camera", str(result.calibration.state.camera)),
        ("Simulated", simulated(result) or "nothing"),
        ("Pairs compared", Number(len(result.pairs), 0)),
        ("Pairs that agree", Number(result.agreeing, 0)),
        ("Pairs that differ", Number(result.differing, 0)),
        ("Undecided pairs", Number(len(result.pairs) - result.decided, 0)),
        *(("Result", sentence) for sentence in twin_results(result)),
        *(("Mind", warning) for warning in twin_warnings(result)),
        *(("The twin", note) for note in twin_notes(result)),
    ]
    return Sheet("Summary", ("Quantity", "Value"), rows)


_PAIR_HEADER = (
    "bright patch",
    "dark patch",
    "contrast in %",
    "tolerance in %",
    "contrast by the meter in %",
    "exposure in ms",
    "measured CDP",
    "lower end of its 95 % interval",
    "upper end",
    "predicted CDP",
    "lower end of its 95 % interval",
    "upper end",
    "measured less predicted",
    "joint 95 % half width",
    "judgement",
    "verdict",
)


def _pair(pair: TwinPair) -> tuple[Cell, ...]:
    n = cdp_decimals_of(pair)
    cdp = (pair.measured.cdp, *pair.measured.confidence_interval, pair.predicted, *pair.predicted_interval)
    return (
        pair.asked.bright,
        pair.asked.dark,
        Number(100 * pair.asked.contrast, 2),
        Number(100 * pair.asked.epsilon, 1),
        Number(100 * pair.asked.meter_contrast, 2),
        Number(1e3 * pair.exposure_s, decimals(1e3 * pair.exposure_s, 4)),
        *(Number(value, n) for value in cdp),
        Number(pair.difference, n),
        Number(Z_95 * pair.joint_standard_uncertainty, n),
        pair.judgement,
        pair.verdict,
    )


def _influences(result: TwinResult) -> Sheet:
    header = (
        "bright patch",
        "dark patch",
        "contrast in %",
        "parameter",
        "change of the CDP by one standard uncertainty",
        "standard uncertainty of the CDP by it",
        "share of the variance in %",
        "shift that closes the difference, in standard uncertainties",
    )
    rows = []
    for pair in result.pairs:
        for one in pair.influences:
            rows.append(
                (
                    pair.asked.bright,
                    pair.asked.dark,
                    Number(100 * pair.asked.contrast, 2),
                    one.name,
                    Number(one.change, decimals(one.change, 2)),
                    Number(one.standard_uncertainty, decimals(one.standard_uncertainty, 2)),
                    Number(100 * one.share, 1),
                    Number(one.shift_to_close, 1),
                )
            )
    return Sheet("Influences", header, rows)


def _patches(result: TwinResult) -> Sheet:
    heads = ["patch", "by the meter in cd/m²", "exposure in ms"]
    for name in ("mean", "temporal noise", "fixed pattern"):
        heads += [f"{name} measured in DN", "standard uncertainty", f"{name} predicted in DN", "standard uncertainty"]
        heads += ["deviation in joint standard uncertainties"]
    rows = []
    for patch in result.patches:
        cells: list[Cell] = [
            patch.name,
            Number(patch.luminance_cd_m2, decimals(patch.luminance_cd_m2, 4)),
            Number(1e3 * patch.exposure_s, decimals(1e3 * patch.exposure_s, 4)),
        ]
        for name, deviation in patch.deviations().items():
            for value, uncertainty in (getattr(patch.measured, name), getattr(patch.predicted, name)):
                n = decimals(uncertainty, 2)
                cells += [Number(value, n), Number(uncertainty, n)]
            cells.append(Number(deviation, 2))
        rows.append(tuple(cells))
    return Sheet("Patches", tuple(heads), rows)


def _parameters(result: TwinResult) -> Sheet:
    rows = [
        (
            parameter_name(name),
            Number(
                one.value, decimals(one.standard_uncertainty or one.value, 2 if one.standard_uncertainty > 0 else 5)
            ),
            Number(one.standard_uncertainty, decimals(one.standard_uncertainty, 2)),
            one.unit,
            one.note,
        )
        for name, one in (*result.parameters.quantities.items(), *result.left.items())
    ]
    return Sheet("Parameters", ("parameter", "value", "standard uncertainty", "unit", "found by"), rows)
