"""Budget rows for what the stated intervals do not include, each with the reason."""

from __future__ import annotations

from math import hypot

from ..core.vignetting import Cos4Vignetting, FlatField
from .converter import REFOCUS
from .findings import BudgetRow
from .meter import MeterScale
from .model import Calibration
from .uncertainty import expanded_half_width


def rows_not_included(calibration: Calibration, luminance_cd_m2: float) -> list[BudgetRow]:
    """List all sources that common errors and noise may not cover; those covered replace these rows.

    Parameters
    ----------
    calibration : Calibration
        Of the camera.
    luminance_cd_m2 : float
        The luminance.
    """
    glare = _glare(calibration, luminance_cd_m2)
    known = (
        _unknown("meter digits", "a calibration keeps the two together", "meter repeatability"),
        _unknown("meter f1'", _mismatch(calibration.meter_scale)),
        _unknown("patch uniformity", _uniformity(calibration), "fit"),
        _unknown("dark and temperature", "not known"),
        _linearity(calibration),
        _flat_field(calibration),
        _unknown("exposure time", "taken as exact"),
        _unknown(REFOCUS, "locked, as the configuration states it"),
        _unknown("gain", "one gain only: part of the responsivity"),
        _unknown("spectral mismatch", f"none for {calibration.source_spectrum}, unknown for any other light"),
        glare,
        _drift(calibration),
        _unknown("fit", "not known"),
    )
    return list(known)


def _unknown(source: str, basis: str, contained_in: str = "") -> BudgetRow:
    text = f"contained in {contained_in}: {basis}" if contained_in else basis
    return BudgetRow(source, 0.0, "normal", True, "B", text, included=False, contained_in=contained_in)


def _mismatch(scale: MeterScale) -> str:
    """Return the reason for no mismatch of the meter."""
    if scale.f1_prime is None:
        return f"not stated for the {scale.meter.model}"
    return f"none: the light is that of the meter's calibration, {scale.illuminant}"


def _uniformity(calibration: Calibration) -> str:
    """Return the reason for no further scatter of the patches."""
    if any(test.name == "scatter" and test.significant for test in calibration.tests):
        return "the patches scatter more than stated, by what their exposures disagree"
    return "the stated errors explain the scatter of the patches"


def _linearity(calibration: Calibration) -> BudgetRow:
    if calibration.response.kind == "linear":
        return _unknown("linearity", "taken as linear; no candidate model was better")
    return _unknown("linearity", "the response is fitted together with the responsivity", "fit")


def _flat_field(calibration: Calibration) -> BudgetRow:
    vignetting = calibration.vignetting
    if vignetting is None:
        return _unknown("flat field", "vignetting is not corrected; unknown away from the axis")
    if isinstance(vignetting, Cos4Vignetting):
        return _unknown("flat field", "cos⁴ by focal length and pixel pitch, not measured; unknown away from the axis")
    own_rel = vignetting.random_rel if isinstance(vignetting, FlatField) else 0.0
    basis = "noise and non-uniformity of the uniform source; in patches and maps, 0 on the axis, which this is for"
    u = hypot(vignetting.slow_rel, own_rel)
    return BudgetRow("flat field", u, "normal", False, "A", basis, included=False)


def _glare(calibration: Calibration, luminance_cd_m2: float) -> BudgetRow:
    fit = calibration.responsivity
    if fit.intercept_dn_s is None or fit.intercept_standard_uncertainty_dn_s is None:
        return _unknown("glare", "not tested: all patches have about the same luminance")
    r = fit.responsivity_dn_s_cd_m2
    # Possible undetected intercept: its standard uncertainty, combined with the fitted value.
    bound_cd_m2 = hypot(fit.intercept_dn_s, fit.intercept_standard_uncertainty_dn_s) / r
    return BudgetRow(
        "glare",
        bound_cd_m2 / luminance_cd_m2,
        "normal",
        True,
        "A",
        f"bound by the free intercept, {bound_cd_m2:.2g} cd/m²; not included, since the fit goes through zero: glare "
        "depends on the scene",
        included=False,
    )


def _drift(calibration: Calibration) -> BudgetRow:
    test = next((t for t in calibration.tests if t.name == "drift" and t.standard_uncertainty > 0), None)
    if test is None:
        return _unknown("drift", "not tested: read a patch before and after the frames, and verify regularly")
    found = f"{100 * test.value:+.2g} % ± {100 * expanded_half_width(0.0, test.standard_uncertainty):.2g} % (95 %)"
    return _unknown("drift", f"{found} an hour during the calibration; a verification shows the drift since then")
