"""Tests of what the model takes for granted: glare, exposure times, drift, fall-off, scatter, darkness, gain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, sqrt

import numpy as np

from ..errors import CalibrationError
from ..vignetting import AnyVignetting, Cos4Vignetting
from .alternatives import by_place, drift_pattern, ratio, worth_of_place
from .chance import FALSE_ALARM, chance_of_chi_squared, limit
from .dark import DarkModel
from .design import Array
from .findings import FitTest
from .gls import Solution, solve
from .scatter import within_patches

#: Ratio of the highest to the lowest patch below which an intercept cannot be told from the slope.
MIN_SPAN = 2.0
#: Relative deviation of an exposure time that goes without notice: small beside the 2 % of a meter.
EXPOSURE_TOLERANCE_REL = 0.002
#: Relative deviation of a gain from its setting that goes without notice; cameras state theirs to about 0.1 dB.
GAIN_TOLERANCE_REL = 0.012
#: Relative deviation by the place of a patch that goes without notice.
PLACE_TOLERANCE_REL = 0.002
#: Significance, in standard uncertainties, of a single test.
_LIMIT = 3.0


def shift_with_scatter(solution: Solution, pattern: Array) -> tuple[float, float, float]:
    """Value, standard uncertainty and degrees of freedom of a further parameter; see `Solution.shift`.

    If what is left scatters more than stated, the uncertainty is widened by the scatter and has its degrees of freedom;
    else it is known, with infinite degrees of freedom.
    """
    value, uncertainty = solution.shift(pattern)
    freedom = solution.degrees_of_freedom - 1
    if freedom < 1 or uncertainty == inf:
        return value, uncertainty, inf
    left = solution.chi_squared - (value / uncertainty) ** 2
    if chance_of_chi_squared(left, freedom) >= FALSE_ALARM:
        return value, uncertainty, inf
    return value, uncertainty * sqrt(max(left / freedom, 1.0)), freedom


def glare(solution: Solution, responsivity_dn_s_cd_m2: float) -> FitTest:
    """Free intercept: a veil of constant luminance, or a wrong dark."""
    readings = solution.design.reading_cd_m2
    if readings.max() < MIN_SPAN * readings.min():
        return FitTest(
            "glare",
            0.0,
            0.0,
            "cd/m^2",
            False,
            "not testable: the patches have about the same luminance; add darker ones",
        )
    veil, uncertainty, freedom = shift_with_scatter(solution, np.ones_like(solution.luminance))
    if uncertainty == inf:
        return FitTest("glare", 0.0, 0.0, "cd/m^2", False, "not testable: too few patches for this response")
    significant = abs(veil) > _limit(freedom) * uncertainty and not _rather_a_wrong_dark(solution)
    text = f"a free intercept is {veil:.3g} +- {uncertainty:.2g} cd/m^2 ({veil * responsivity_dn_s_cd_m2:.4g} DN/s)"
    if not significant:
        return FitTest("glare", veil, uncertainty, "cd/m^2", False, f"{text}: no sign of glare")
    return FitTest(
        "glare",
        veil,
        uncertainty,
        "cd/m^2",
        True,
        f"{text}, {abs(veil) / uncertainty:.1f} standard uncertainties from zero: glare or a wrong dark; shade the "
        "lens, or take the dark frames again",
    )


def _rather_a_wrong_dark(solution: Solution) -> bool:
    """Whether the exposures speak for an offset of the DN rather than of the luminance."""
    of_dark, of_veil = solution.shift(solution.slope), solution.shift(np.ones_like(solution.luminance))
    return abs(of_dark[0]) / of_dark[1] > abs(of_veil[0]) / of_veil[1]


def exposure_reciprocity(solution: Solution) -> FitTest:
    """Each exposure against the others: the most deviating one."""
    name, design = "exposure reciprocity", solution.design
    if design.exposures_s.size < 2:
        return FitTest(
            name, 0.0, 0.0, "1", False, "reciprocity not testable with one exposure: take frames at several exposures"
        )
    rows = []
    for number, exposure_s in enumerate(design.exposures_s):
        pattern = np.where(design.exposure == number, solution.luminance, 0.0)
        rows.append((float(exposure_s), *shift_with_scatter(solution, pattern)))
    exposure_s, value, uncertainty, freedom = max(rows, key=lambda row: abs(row[1]) / row[2])
    if uncertainty == inf:
        return FitTest(name, 0.0, 0.0, "1", False, "reciprocity not testable: no patch is seen at two exposures")
    significant = abs(value) > max(limit(len(rows), freedom) * uncertainty, EXPOSURE_TOLERANCE_REL)
    at = f"at {exposure_s:g} s the signal is off by {value:+.2%} +- {uncertainty:.2%} from that at the others"
    meaning = (
        f"{at}: check this exposure time, the linearity, the dark frames and the light, or leave the exposure out"
        if significant
        else f"the signal goes with the exposure time; most of all {at}"
    )
    return FitTest(name, value, uncertainty, "1", significant, meaning)


def drift(solution: Solution) -> FitTest:
    """Camera over meter against the time of the readings."""
    pattern = drift_pattern(solution)
    if pattern is None:
        return FitTest("drift", 0.0, 0.0, "1/h", False, "not testable: the readings carry (nearly) the same time")
    times = solution.design.read_at
    span_h = (max(times) - min(times)).total_seconds() / 3600
    value, uncertainty, freedom = shift_with_scatter(solution, pattern)
    if uncertainty == inf:
        return FitTest("drift", 0.0, 0.0, "1/h", False, "not testable: too few patches for this response")
    rather_a_place = worth_of_place(solution) > ratio(solution.shift(pattern))
    significant = abs(value) > _limit(freedom) * uncertainty and not rather_a_place
    text = f"camera over meter changes by {value:+.2%} +- {uncertainty:.2%} an hour over {span_h:.2g} h of readings"
    meaning = f"{text}: let lamp and meter warm up, and measure again" if significant else f"{text}: no sign of a drift"
    return FitTest("drift", value, uncertainty, "1/h", significant, meaning)


def fall_off(solution: Solution, vignetting: AnyVignetting | None) -> FitTest:
    """Deviations of the patches that go with their places: r^2, x and y together.

    The unevenness within the patches does not count as an error here: a fall-off that is not taken off makes it, too.
    `FitTest.value` is the root mean square of the patches' deviations that their places explain.
    """
    name, design = "fall-off", solution.design
    try:
        even = solve(replace(design, uneven_rel=np.zeros(len(design.patches))), solution.rung)
    except CalibrationError:
        even = solution
    drop, n, deviations = by_place(even)
    if n == 0:
        return FitTest(name, 0.0, 0.0, "1", False, "not testable: too few patches, or all at one place")
    # What is left between the patches widens, as their exposures would hide it, or what is left of all if it is more.
    freedom = len(design.patches) - solution.rung.n_parameters - n
    left = even.chi_squared - drop
    mean_squares = [
        squares / count
        for squares, count in (
            (left - within_patches(even, even.covariance), freedom),
            (left, even.degrees_of_freedom - n),
        )
        if chance_of_chi_squared(squares, count) < FALSE_ALARM
    ]
    each = max([1.0, *mean_squares])
    scattered = bool(mean_squares)
    value = sqrt(float(np.mean(deviations**2)))
    uncertainty = value * sqrt(n * each / drop) if drop > 0 else 0.0
    times = drift_pattern(even)
    rather_a_drift = times is not None and ratio(even.shift(times)) >= worth_of_place(even)
    sure = _chance_of_ratio(drop / n / each, n, freedom if scattered else inf) < _chance_of(_LIMIT)
    significant = sure and value > PLACE_TOLERANCE_REL and not rather_a_drift
    text = f"deviations that go with the place of a patch are {value:.2%} (rms), {uncertainty:.2%} by chance"
    if not significant:
        return FitTest(name, value, uncertainty, "1", False, f"{text}: no sign of a fall-off that is not taken off")
    if vignetting is None:
        cause = "the lens' fall-off is not taken off: record a flat field and give --flat-field"
    elif isinstance(vignetting, Cos4Vignetting):
        cause = "the lens' fall-off is not cos^4 of its focal length: record a flat field and give --flat-field"
    else:
        cause = "the source of the flat field was less even than stated, or lens, focus or light have changed since"
    return FitTest(
        name,
        value,
        uncertainty,
        "1",
        True,
        f"{text}, they change over the image: {cause}; the uncertainty was widened by this",
    )


def scatter(solution: Solution) -> FitTest:
    """Reduced chi^2."""
    freedom = solution.degrees_of_freedom
    reduced = solution.chi_squared / max(freedom, 1)
    significant = chance_of_chi_squared(solution.chi_squared, freedom) < FALSE_ALARM
    meaning = (
        "patches and exposures scatter more than the stated errors explain: check regions, readings, glare and light"
        if significant
        else "patches and exposures scatter as the stated errors explain"
    )
    return FitTest("scatter", reduced, sqrt(2 / max(freedom, 1)), "1", significant, meaning)


def darkness(solution: Solution, dark: DarkModel, warnings: Sequence[str]) -> FitTest:
    """Offset of the light frames against the dark ones; and what the dark frames say among themselves.

    Parameters
    ----------
    solution : Solution
        The fit.
    dark : DarkModel
        The darkness.
    warnings : sequence of str
        What `fit_dark` says.
    """
    value, uncertainty, freedom = shift_with_scatter(solution, solution.slope)
    against = [w for w in warnings if "falls with the exposure" in w or "do not fit the others" in w]
    if uncertainty == inf:
        value, uncertainty, text = 0.0, 0.0, "not testable against the light frames: too few patches for this response"
    else:
        text = f"the light frames lie {value:.2g} +- {uncertainty:.2g} DN above what the dark frames say"
    if against:
        return FitTest("darkness", value, uncertainty, "DN", True, f"{text}; {against[0]}")
    significant = abs(value) > _limit(freedom) * uncertainty > 0 and _rather_a_wrong_dark(solution)
    if significant:
        text += ": a wrong dark; was the lens covered, and the black level the same? take the dark frames again"
    elif len(dark.exposures_s) == 1:
        text += "; growth with the exposure not testable: dark frames at one exposure only"
    return FitTest("darkness", value, uncertainty, "DN", significant, text)


def gain(factors: Sequence[tuple[float, float, float]], own_db: float) -> FitTest:
    """Fitted gain factors against 10^(dB / 20): the most deviating one.

    Parameters
    ----------
    factors : sequence of (float, float, float)
        Gain in dB, factor over the calibration's own gain, and relative standard uncertainty.
    own_db : float
        The calibration's own gain.
    """
    if not factors:
        return FitTest("gain", 0.0, 0.0, "1", False, "not testable: frames of one gain only")
    rows = [(db, factor / 10 ** ((db - own_db) / 20) - 1, rel) for db, factor, rel in factors]
    gain_db, value, uncertainty = max(rows, key=lambda row: abs(row[1]) / max(row[2], 1e-12))
    significant = abs(value) > max(limit(len(rows)) * uncertainty, GAIN_TOLERANCE_REL)
    text = (
        f"at {gain_db:g} dB the signal is {value:+.2%} +- {uncertainty:.2%} off 10^(dB / 20) of that at {own_db:g} dB"
    )
    meaning = f"{text}: the gain is not what it says; the fitted factor is used" if significant else text
    return FitTest("gain", value, uncertainty, "1", significant, meaning)


def _chance_of(standard_uncertainties: float) -> float:
    """Probability of a normal deviation at least this large."""
    from scipy.stats import norm

    return 2 * float(norm.sf(standard_uncertainties))


def _chance_of_ratio(ratio: float, n: int, freedom: float) -> float:
    """Probability of a mean square of n parameters at least this large, over one that is known or has a freedom."""
    from scipy.stats import chi2, f

    return float(chi2.sf(ratio * n, n) if freedom == inf else f.sf(ratio, n, freedom))


def _limit(freedom: float) -> float:
    """Three standard uncertainties, or as improbable a multiple of Student's t."""
    from scipy.stats import norm, t

    return _LIMIT if freedom == inf else float(t.isf(norm.sf(_LIMIT), freedom))
