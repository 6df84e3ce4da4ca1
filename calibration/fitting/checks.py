"""Checks of the model's assumptions: glare, exposure times, drift, vignetting, scatter, dark signal, gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, sqrt

import numpy as np

from ...core.result import Finding, FindingValue, info, warning
from ...core.vignetting import AnyVignetting, Cos4Vignetting
from ..camera import VIGNETTING
from ..fit_records import FitTest, undecided_cause
from ..readings import contradiction
from ..sensor.dark import DarkModel
from ..sensor.noise import GainSetting
from ..uncertainty import FALSE_ALARM, critical_value, expanded_half_width, p_value_of_chi_squared
from .design import Design
from .effects import FittedEffect, Kind, assess, largest_of_each_kind, possible_effects
from .problem import Solution
from .selection import ModelSelection

#: Tolerated relative deviation of a gain from its setting; cameras state it to about 0.1 dB.
GAIN_TOLERANCE_REL = 0.012
#: Kinds of effects by the name of their check, and why there may be none.
_CHECKS: dict[str, tuple[tuple[Kind, ...], str]] = {
    "glare": (("glare",), "span"),
    "dark signal": (("dark signal", "dark current"), "patches"),
    "exposure reciprocity": (("exposure offset", "exposure"), "exposures"),
    "drift": (("drift",), "time"),
    "meter step": (("step",), "time"),
    "vignetting": (("place",), "places"),
    "surroundings": (("rim",), "patches"),
}
_UNITS = {"glare": "cd/m²", "drift": "1/h", "dark signal": "DN"}


def effect_tests(
    selection: ModelSelection, vignetting: AnyVignetting | None, dark: DarkModel, findings: Sequence[Finding]
) -> tuple[FitTest, ...]:
    """One check for each kind of effect: of what was found, or of the most significant one that was not.

    Parameters
    ----------
    selection : ModelSelection
        The model.
    vignetting : vignetting or None
        What was corrected.
    dark : DarkModel
        The dark signal.
    findings : sequence of Finding
        What `fit_dark` found, among others.
    """
    solution = selection.solution
    keys = {row.effect.key for row in selection.effects}
    others = [row for row in possible_effects(solution.design) if row.key not in keys and row.kind != "patch"]
    left = [assess(solution, row) for row in largest_of_each_kind(solution, others)]
    tests = []
    for name, (kinds, untestable) in _CHECKS.items():
        significant = [row for row in selection.effects if row.effect.kind in kinds]
        tested = [row for row in left if row.effect.kind in kinds and row.amplitude.n]
        largest = min(significant or tested, key=lambda row: row.log_p, default=None)
        if largest is None:
            why = "patches" if any(row.effect.kind in kinds for row in left) else untestable
            tests.append(FitTest(name, 0.0, 0.0, "", False, info(f"not-testable-{why}", name)))
        else:
            value, uncertainty = size(largest, solution.design)
            finding = _finding(largest, solution, vignetting, is_significant=bool(significant))
            tests.append(FitTest(name, value, uncertainty, _UNITS.get(name, ""), bool(significant), finding))
    against = next((row for row in findings if row.code in ("dark-falls", "dark-contradicts")), None)
    one_exposure = "dark-agrees-at-one-exposure" if len(dark.exposures_s) < 2 else "dark-agrees"
    return tuple(_dark_test(row, against, one_exposure) if row.name == "dark signal" else row for row in tests)


def _dark_test(test: FitTest, against: Finding | None, agrees: str) -> FitTest:
    """Return the check of the dark signal with what the dark frames say among themselves."""
    if against is not None:
        return replace(test, significant=True, finding=against)
    return test if test.significant or not test.tested else replace(test, finding=replace(test.finding, code=agrees))


def possible_glare_cd_m2(test: FitTest) -> float:
    """Intercept to count with: a significant one, or of glare as much as it exceeds its standard uncertainty."""
    if test.significant:
        return test.value
    return sqrt(max(max(test.value, 0.0) ** 2 - test.standard_uncertainty**2, 0.0))


def effect_findings(selection: ModelSelection, vignetting: AnyVignetting | None) -> list[Finding]:
    """Return a warning of each significant effect, and one of others that explain the observations as well."""
    findings = []
    for fitted in selection.effects:
        rows = [fitted, *fitted.rivals]
        of_each = [_finding(row, selection.solution, vignetting, is_significant=True) for row in rows]
        findings.append(of_each[0])
        if fitted.rivals:
            pairs = zip(rows, of_each, strict=True)
            findings.append(undecided_cause(*((row.effect.name, f.code, row.effect.what_tells) for row, f in pairs)))
    return findings


def stated_vignetting_rel(design: Design) -> float:
    """Root mean square deviation between the patches by the stated uncertainty of an assumed vignetting; else 0."""
    return sqrt(sum(float(np.var(error.relative)) for error in design.shared if error.source == VIGNETTING))


def size(row: FittedEffect, design: Design) -> tuple[float, float]:
    """Return the size of an effect with its standard uncertainty: relative ones of exposures, rms of places."""
    kind = row.effect.kind
    if kind == "place":
        size = sqrt(
            float(np.mean((row.amplitude.value @ design.position_patterns[:, : row.amplitude.value.size].T) ** 2))
        )
        drop = row.amplitude.drop
        return size, size * sqrt(row.amplitude.n / drop) if drop > 0 else 0.0
    if kind == "rim":
        size_rel = float(np.abs(design.rim_rel).max())
        return row.value * size_rel, row.uncertainty * size_rel
    if kind == "dark current":
        longest_s = float(design.exposures_s.max())
        return row.value * longest_s, row.uncertainty * longest_s
    if kind == "exposure offset":
        shortest_s = float(design.exposures_s.min())
        return row.value / shortest_s, row.uncertainty / shortest_s
    # The meter shows more where the camera shows less.
    return (-row.value if kind == "step" else row.value), row.uncertainty


def _finding(row: FittedEffect, final: Solution, vignetting: AnyVignetting | None, *, is_significant: bool) -> Finding:
    """Return the finding of an effect, a warning if it is significant."""
    value, uncertainty = size(row, final.design)
    kind, expanded = row.effect.kind, expanded_half_width(0.0, uncertainty) if uncertainty < inf else inf
    relative: dict[str, FindingValue] = {"deviation_rel": value, "expanded_rel": expanded}
    values: Mapping[str, FindingValue] = relative
    if kind == "glare":
        codes = "intercept", "no-intercept"
        shown = {"intercept_cd_m2": value, "expanded_cd_m2": expanded, "z": abs(value) / uncertainty}
        values = {**shown, "intercept_dn_s": value * final.response[1]}
    elif kind == "dark signal":
        codes, values = ("dark-differs", "dark-agrees"), {"difference_dn": value, "expanded_dn": expanded}
    elif kind == "dark current":
        codes = "dark-current-differs", "dark-agrees"
        values = {"difference_dn": value, "expanded_dn": expanded, "exposure_s": float(final.design.exposures_s.max())}
    elif kind == "exposure offset":
        codes = "exposures-offset", "exposures-not-offset"
        values = {"offset_s": row.value, "expanded_s": expanded_half_width(0.0, row.uncertainty)}
    elif kind == "exposure":
        codes = "exposure-deviates", "exposures-agree"
        values = {"exposure_s": float(final.design.exposures_s[row.effect.number]), **relative}
    elif kind == "drift":
        codes, values = ("drift", "no-drift"), {"span_h": float(np.ptp(final.design.read_h)), **relative}
    elif kind == "step":
        codes, values = ("readings-step", "no-readings-step"), {"patch": row.effect.subject, **relative}
    elif kind == "rim":
        codes = "surroundings", "no-surroundings"
        values = {"patch": final.design.patches[int(np.argmax(np.abs(final.design.rim_rel)))], **relative}
    elif kind == "place":
        assumed = "vignetting-not-cos4" if isinstance(vignetting, Cos4Vignetting) else "vignetting-changed"
        codes = "vignetting-not-corrected" if vignetting is None else assumed, "no-vignetting-left"
        values = {"deviation_rel": value, "chance_rel": uncertainty}
    else:
        reading_cd_m2 = float(final.design.reading_cd_m2[row.effect.number])
        return contradiction("patch-contradicts", row.effect.subject, reading_cd_m2, reading_cd_m2 + value)
    return warning(codes[0], **values) if is_significant else info(codes[1], **values)


def scatter(solution: Solution) -> FitTest:
    """Reduced chi^2."""
    dof = solution.degrees_of_freedom
    reduced, uncertainty = solution.chi_squared / max(dof, 1), sqrt(2 / max(dof, 1))
    significant = p_value_of_chi_squared(solution.chi_squared, dof) < FALSE_ALARM
    finding = warning("scatter") if significant else info("scatter-as-stated")
    return FitTest("scatter", reduced, uncertainty, "", significant, finding)


def gain(gains: Sequence[GainSetting], own_db: float) -> FitTest:
    """Most deviating fitted gain factor relative to 10^(dB / 20) over the calibration's own gain."""
    if not gains:
        return FitTest("gain", 0.0, 0.0, "", False, info("not-testable-gains", "gain"))
    rows = [
        (gain.factor / 10 ** ((gain.gain_db - own_db) / 20) - 1, gain.factor_random_rel, gain.gain_db) for gain in gains
    ]
    value, uncertainty, gain_db = max(rows, key=lambda row: abs(row[0]) / max(row[1], 1e-12))
    significant = abs(value) > max(critical_value(len(rows)) * uncertainty, GAIN_TOLERANCE_REL)
    expanded = expanded_half_width(0.0, uncertainty)
    values = {"gain_db": gain_db, "own_db": own_db, "deviation_rel": value, "expanded_rel": expanded}
    finding = warning("gain-deviates", **values) if significant else info("gain-as-set", **values)
    return FitTest("gain", value, uncertainty, "", significant, finding)
