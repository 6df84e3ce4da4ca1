"""The tables of a twin as text: for the page and for the command line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from .digits import Z_95, decimals, exposure, fixed, percent, printable, significant, with_half_width
from .tables import Table

if TYPE_CHECKING:
    from ..calibration.emva.result import Quantity
    from ..evaluate.twin import TwinResult
    from ..evaluate.twin_pair import TwinPair
    from ..evaluate.twin_signal import PatchSignal

#: Shown decimals of a CDP at the most.
_MOST_DECIMALS = 5


#: Parameters in plain words, by their names in a chain file.
_NAMES = {
    "k_dn_per_e": "system gain K",
    "read_noise_e": "read noise",
    "black_level_dn": "black level",
    "dark_current_e_s": "dark current",
    "doubling_temperature_c": "doubling temperature",
    "prnu_rel": "PRNU",
    "dsnu_e": "DSNU",
    "column_dsnu_e": "DSNU of columns",
    "row_dsnu_e": "DSNU of rows",
    "dsnu_e_s": "DSNU of the dark current",
    "full_well_e": "full well",
}


def pair_table(result: TwinResult) -> Table:
    """Pairs of patches: CDP measured and predicted, each with its 95 % interval, and the verdict."""
    return Table(
        (
            "bright / dark patch",
            "verdict",
            "contrast ± tolerance (%)",
            "measured CDP (95 %)",
            "predicted CDP (95 %)",
            "difference ± joint 95 %",
            "exposure",
        ),
        tuple(_pair_row(pair) for pair in result.pairs),
    )


def _pair_row(pair: TwinPair) -> tuple[str, ...]:
    half_width = Z_95 * pair.joint_standard_uncertainty
    n = cdp_decimals_of(pair)
    return (
        pair_name_of(pair),
        pair.judgement,
        f"{significant(100 * pair.asked.contrast)} ± {significant(100 * pair.asked.epsilon * pair.asked.contrast, 3)}",
        _with_interval(pair.measured.cdp, pair.measured.confidence_interval, n),
        _with_interval(pair.predicted, pair.predicted_interval, n),
        f"{fixed(pair.difference, n, sign=True)} ± {fixed(half_width, n)}",
        exposure(pair.exposure_s),
    )


def pair_name_of(pair: TwinPair) -> str:
    """Return "bright / dark"."""
    return printable(f"{pair.asked.bright} / {pair.asked.dark}")


def cdp_decimals_of(pair: TwinPair) -> int:
    """Count the decimals that the joint interval supports."""
    return min(max(decimals(Z_95 * pair.joint_standard_uncertainty, 2), 2), _MOST_DECIMALS)


def _with_interval(value: float, interval: tuple[float, float], n: int) -> str:
    return f"{fixed(value, n)} ({fixed(interval[0], n)} to {fixed(interval[1], n)})"


def difference_table(result: TwinResult) -> Table:
    """Pairs that differ: what the patches' signals say about it, and how far off a parameter would have to be."""
    rows = []
    for pair in result.pairs:
        if not pair.differs:
            continue
        one, mended = pair.explanation, pair.mended
        chance = pair.difference / pair.sampling_standard_uncertainty
        n = cdp_decimals_of(pair)
        rows.append(
            (
                f"{pair_name_of(pair)}, {percent(pair.asked.contrast)}",
                fixed(pair.difference, n, sign=True),
                "nothing" if mended is None else printable(mended.name),
                "-" if mended is None else fixed(pair.measured.cdp - mended.predicted, n, sign=True),
                "none" if one is None else printable(one.name),
                "-" if one is None else fixed(one.shift_to_close, 1, sign=True),
                fixed(chance, 1, sign=True),
            )
        )
    return Table(
        (
            "bright / dark patch, contrast",
            "difference",
            "explained by the patches' signals",
            "difference left with it as they ask",
            "otherwise the likeliest parameter",
            "off by, in standard uncertainties",
            "or chance of the pixels: standard errors",
        ),
        tuple(rows),
    )


def finding_table(result: TwinResult) -> Table:
    """Parameters that the patches' signals contradict."""
    return Table(
        ("parameter", "in the twin", "by the camera", "unit", "standard uncertainties apart"),
        tuple(
            (printable(one.name), significant(one.stated), significant(one.needed), one.unit, fixed(abs(one.z), 1))
            for one in result.findings
        ),
    )


def influence_table(result: TwinResult) -> Table:
    """Parameters: how much each matters over all pairs; those of single patches are joined."""
    rows: dict[str, list[tuple[float, float, bool]]] = {}
    for pair in result.pairs:
        for i, one in enumerate(pair.influences):
            name = _joined(one.name, pair)
            rows.setdefault(name, []).append((one.share, abs(one.change), i == 0))
    table = []
    for name, found in sorted(rows.items(), key=lambda row: -sum(share for share, _, _ in row[1])):
        shares, changes, first = zip(*found, strict=True)
        table.append(
            (
                printable(name),
                f"{100 * sum(shares) / len(result.pairs):.2g}",
                str(sum(first)),
                f"{max(changes):.2g}",
                f"{float(np.median(changes)):.2g}",
            )
        )
    return Table(
        (
            "parameter",
            "mean share of the variance (%)",
            "pairs it decides",
            "largest change of a CDP by one standard uncertainty",
            "median change",
        ),
        tuple(table),
    )


def _joined(name: str, pair: TwinPair) -> str:
    for patch in (pair.asked.bright, pair.asked.dark):
        if name.endswith(f" {patch}"):
            return f"{name.removesuffix(patch)}a patch"
    return name


def mean_table(result: TwinResult) -> Table:
    """Patches: mean in DN, predicted and measured."""
    return _signal_table(result, {"mean_dn": "mean"})


def noise_table(result: TwinResult) -> Table:
    """Patches: temporal noise and fixed pattern in DN, predicted and measured."""
    return _signal_table(result, {"temporal_dn": "temporal noise", "spatial_dn": "fixed pattern"})


def _signal_table(result: TwinResult, names: Mapping[str, str]) -> Table:
    heads = [text for name in names.values() for text in (f"{name}: measured (DN)", f"{name}: predicted (DN)", "z")]
    rows = []
    for patch in result.patches:
        deviations = patch.deviations()
        cells = [printable(patch.name), significant(patch.luminance_cd_m2), exposure(patch.exposure_s)]
        for name in names:
            cells += [
                _value(patch.measured, name),
                _value(patch.predicted, name),
                fixed(deviations[name], 1, sign=True),
            ]
        rows.append(tuple(cells))
    return Table(("patch", "by the meter (cd/m²)", "exposure", *heads), tuple(rows))


def _value(signal: PatchSignal, name: str) -> str:
    value, uncertainty = getattr(signal, name)
    return with_half_width(value, Z_95 * uncertainty)


def parameter_table(result: TwinResult) -> Table:
    """Parameters of the twin with their 95 % half widths."""
    return Table(
        ("parameter", "value", "unit", "found by"),
        tuple(
            (parameter_name(name), _quantity(one), one.unit, one.note)
            for name, one in (*result.parameters.quantities.items(), *result.left.items())
        ),
    )


def parameter_name(name: str) -> str:
    """Return a parameter in plain words."""
    return _NAMES.get(name, name)


def _quantity(one: Quantity) -> str:
    if one.standard_uncertainty > 0:
        return with_half_width(one.value, Z_95 * one.standard_uncertainty)
    return significant(one.value)
