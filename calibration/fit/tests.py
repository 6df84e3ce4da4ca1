"""Checks of the model's assumptions: glare, exposure times, drift, vignetting, scatter, dark signal, gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, sqrt

import numpy as np

from ...core.errors import CalibrationError
from ...core.result import Finding, FindingValue, info, warning
from ...core.vignetting import AnyVignetting, Cos4Vignetting
from ..converter import VIGNETTING
from ..findings import FitTest
from ..sensor.dark import DarkModel
from ..sensor.noise import GainSetting
from ..uncertainty import FALSE_ALARM, critical_value, p_value_of_chi_squared
from .design import Design, SharedError
from .problem import Shift, Solution, solve
from .scatter import shift_with_scatter, within_patches
from .selection import by_place, drift_pattern, exposure_patterns, strongest_step, worth_of_place, worth_of_step

#: Ratio of the highest to the lowest patch below which intercept and slope cannot be distinguished.
MIN_SPAN = 2.0
#: Tolerated relative deviation of a gain from its setting; cameras state it to about 0.1 dB.
GAIN_TOLERANCE_REL = 0.012
#: Tolerated relative deviation by the position of a patch.
PLACE_TOLERANCE_REL = 0.002
#: Significance, in standard uncertainties, of a single test.
_LIMIT = 3.0


def glare(solution: Solution, responsivity_dn_s_cd_m2: float) -> FitTest:
    """Free intercept: glare of constant luminance, or a wrong dark signal."""
    readings = solution.design.reading_cd_m2
    narrow = readings.max() < MIN_SPAN * readings.min()
    veil = Shift() if narrow else shift_with_scatter(solution, np.ones_like(solution.luminance))
    significant = veil.z > _critical_value(veil.dof) and not _rather_a_wrong_dark(solution)
    intercept = {"intercept_cd_m2": veil.value, "expanded_cd_m2": veil.expanded}
    values = {**intercept, "intercept_dn_s": veil.value * responsivity_dn_s_cd_m2, "z": veil.z}
    codes = "intercept" if veil.value > 0 else "intercept-negative", "no-intercept"
    return _test("glare", veil, "cd/m²", significant, codes, values, "span" if narrow else "patches")


def possible_glare_cd_m2(test: FitTest) -> float:
    """Intercept to count with: what was found, or of glare as much as it exceeds its standard uncertainty."""
    if test.significant:
        return test.value
    return sqrt(max(max(test.value, 0.0) ** 2 - test.standard_uncertainty**2, 0.0))


def _rather_a_wrong_dark(solution: Solution) -> bool:
    """Whether the exposures support an offset of the DN rather than of the luminance."""
    return solution.shift(solution.slope).z > solution.shift(np.ones_like(solution.luminance)).z


def exposure_reciprocity(solution: Solution, found: Sequence[Finding]) -> FitTest:
    """Most deviating exposure time relative to the others; significant if that, or their offset, was `found`."""
    rows = [(t, shift_with_scatter(solution, pattern)) for t, pattern in exposure_patterns(solution)]
    exposure_s, shift = max(rows, key=lambda row: row[1].z, default=(0.0, Shift()))
    values, codes = {"exposure_s": exposure_s, **_relative(shift)}, ("exposure-deviates", "exposures-agree")
    test = _test("exposure reciprocity", shift, "", False, codes, values, "exposures")
    return replace(test, significant=True, finding=found[0]) if found else test


def drift(solution: Solution) -> FitTest:
    """Drift of camera over meter with the time of the readings."""
    pattern = drift_pattern(solution)
    shift = shift_with_scatter(solution, pattern)
    other = max(worth_of_place(solution), worth_of_step(solution))
    significant = shift.z > _critical_value(shift.dof) and solution.shift(pattern).z >= other
    values = {"span_h": float(np.ptp(solution.design.read_h)), **_relative(shift)}
    untestable = "patches" if pattern.any() else "time"
    return _test("drift", shift, "1/h", significant, ("drift", "no-drift"), values, untestable)


def step(solution: Solution, *others: FitTest) -> tuple[FitTest, list[SharedError]]:
    """Largest change of the readings at once; with the errors of the observations by it, if significant.

    Of `others`, drift and vignetting, the significant ones explain it unless it is the better explanation. Nobody knows
    whether it was the meter or the light: either side may be right, or anything in between.
    """
    (pattern, first, n), name = strongest_step(solution), "meter step"
    shift = shift_with_scatter(solution, pattern)
    rivals = {one.name for one in others if one.significant}
    other = max(
        worth_of_place(solution) if "vignetting" in rivals else 0.0,
        solution.shift(drift_pattern(solution)).z if "drift" in rivals else 0.0,
    )
    significant = shift.z > critical_value(n, shift.dof) and worth_of_step(solution) > other
    opposite = shift._replace(value=-shift.value)
    values = {"patch": solution.design.patches[first], **_relative(opposite)}
    errors = []
    if significant:
        errors = [shift.value * pattern / solution.luminance, np.full_like(pattern, abs(shift.value) / 2 / sqrt(3))]
    test = _test(name, opposite, "", significant, ("readings-step", "no-readings-step"), values)
    return test, [SharedError(name, one) for one in errors]


def vignetting_left(solution: Solution, vignetting: AnyVignetting | None) -> FitTest:
    """Deviations by position of the patches: r^2, x and y together.

    Non-uniformity within the patches is not counted as an error here, as uncorrected vignetting causes it too.
    `FitTest.value` is the root mean square of the deviations explained by position.
    """
    name, design = "vignetting", solution.design
    try:
        # cos^4 itself is tested, whatever its stated uncertainty.
        tested = replace(design.without_shared(VIGNETTING), nonuniformity_rel=np.zeros(len(design.patches)))
        even = solve(tested, solution.candidate)
    except CalibrationError:
        even = solution
    drop, n, deviations = by_place(even)
    if n == 0:
        return _test(name, Shift(), "", False, ("", ""), {}, "places")
    # Widened by the residual scatter between the patches, or that of all observations if larger.
    dof = len(design.patches) - solution.candidate.n_parameters - n
    left = even.chi_squared - drop
    mean_squares = [
        squares / count
        for squares, count in ((left - within_patches(even, even.covariance), dof), (left, even.degrees_of_freedom - n))
        if p_value_of_chi_squared(squares, count) < FALSE_ALARM
    ]
    each = max([1.0, *mean_squares])
    scattered = bool(mean_squares)
    value = sqrt(float(np.mean(deviations**2)))
    uncertainty = value * sqrt(n * each / drop) if drop > 0 else 0.0
    times = drift_pattern(even)
    rather_a_drift = times.any() and even.shift(times).z >= worth_of_place(even)
    sure = _p_value_of_ratio(drop / n / each, n, dof if scattered else inf) < p_value_of_chi_squared(_LIMIT**2, 1)
    significant = bool(sure and value > PLACE_TOLERANCE_REL and not rather_a_drift)
    values = {"deviation_rel": value, "chance_rel": uncertainty}
    assumed = "vignetting-not-cos4" if isinstance(vignetting, Cos4Vignetting) else "vignetting-changed"
    cause = "vignetting-not-corrected" if vignetting is None else assumed
    return _test(name, Shift(value, uncertainty), "", significant, (cause, "no-vignetting-left"), values)


def stated_vignetting_rel(design: Design) -> float:
    """Root mean square deviation between the patches by the stated uncertainty of an assumed vignetting; else 0."""
    return sqrt(sum(float(np.var(one.relative)) for one in design.shared if one.source == VIGNETTING))


def scatter(solution: Solution) -> FitTest:
    """Reduced chi^2."""
    dof = solution.degrees_of_freedom
    reduced = Shift(solution.chi_squared / max(dof, 1), sqrt(2 / max(dof, 1)))
    significant = p_value_of_chi_squared(solution.chi_squared, dof) < FALSE_ALARM
    return _test("scatter", reduced, "", significant, ("scatter", "scatter-as-stated"), {})


def dark_signal(solution: Solution, dark: DarkModel, findings: Sequence[Finding]) -> FitTest:
    """Offset of the light frames relative to the dark frames, and consistency of the dark frames.

    Parameters
    ----------
    solution : Solution
        The fit.
    dark : DarkModel
        The dark signal.
    findings : sequence of Finding
        What `fit_dark` found, among others.
    """
    shift = shift_with_scatter(solution, solution.slope)
    against = next((one for one in findings if one.code in ("dark-falls", "dark-contradicts")), None)
    significant = shift.z > _critical_value(shift.dof) and _rather_a_wrong_dark(solution)
    values = {"difference_dn": shift.value, "expanded_dn": shift.expanded}
    agrees = "dark-agrees" if len(dark.exposures_s) > 1 else "dark-agrees-at-one-exposure"
    test = _test("dark signal", shift, "DN", significant, ("dark-differs", agrees), values)
    return test if against is None else replace(test, significant=True, finding=against)


def gain(gains: Sequence[GainSetting], own_db: float) -> FitTest:
    """Most deviating fitted gain factor relative to 10^(dB / 20) over the calibration's own gain."""
    rows = [
        (one.gain_db, Shift(one.factor / 10 ** ((one.gain_db - own_db) / 20) - 1, one.factor_random_rel))
        for one in gains
    ]
    largest = max(rows, key=lambda row: abs(row[1].value) / max(row[1].uncertainty, 1e-12), default=(own_db, Shift()))
    gain_db, shift = largest
    limit = max(critical_value(len(rows)) * shift.uncertainty, GAIN_TOLERANCE_REL)
    values = {"gain_db": gain_db, "own_db": own_db, **_relative(shift)}
    return _test("gain", shift, "", abs(shift.value) > limit, ("gain-deviates", "gain-as-set"), values, "gains")


def _test(
    name: str,
    found: Shift,
    unit: str,
    significant: bool,
    codes: tuple[str, str],
    values: Mapping[str, FindingValue],
    untestable: str = "patches",
) -> FitTest:
    """Return a test with the finding of one code if significant, else of the other; or why it was not possible."""
    if not found.known:
        return FitTest(name, 0.0, 0.0, unit, False, info(f"not-testable-{untestable}", name))
    finding = warning(codes[0], **values) if significant else info(codes[1], **values)
    return FitTest(name, float(found.value), float(found.uncertainty), unit, significant, finding)


def _relative(found: Shift) -> dict[str, FindingValue]:
    return {"deviation_rel": float(found.value), "expanded_rel": found.expanded}


def _p_value_of_ratio(ratio: float, n: int, dof: float) -> float:
    """Probability of a mean square of n parameters at least this large, over one that is known or has a dof."""
    from scipy.stats import f

    return p_value_of_chi_squared(ratio * n, n) if dof == inf else float(f.sf(ratio, n, dof))


def _critical_value(dof: float) -> float:
    """Three standard uncertainties, or as improbable a multiple of Student's t."""
    from scipy.stats import norm, t

    return _LIMIT if dof == inf else float(t.isf(norm.sf(_LIMIT), dof))
