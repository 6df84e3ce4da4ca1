"""Rows of a budget for what the stated intervals do not hold, each with the reason."""

from __future__ import annotations

from math import hypot

from ..vignetting import Cos4Vignetting, FlatField
from .findings import BudgetRow
from .model import Calibration


def rows_not_included(calibration: Calibration, luminance_cd_m2: float) -> list[BudgetRow]:
    """List every source that common errors and noise may not know; those they do know replace these rows.

    Parameters
    ----------
    calibration : Calibration
        Of the camera.
    luminance_cd_m2 : float
        The luminance.
    """
    glare = _glare(calibration, luminance_cd_m2)
    known = (
        _unknown("meter digits", "contained in meter repeatability: a calibration keeps the two together"),
        _unknown("meter f1'", f"not stated for the {calibration.meter_scale.meter.model}"),
        _unknown("patch uniformity", _uniformity(calibration)),
        _unknown("dark and temperature", "not known"),
        _unknown("linearity", _linearity(calibration)),
        _flat_field(calibration),
        _unknown("exposure time", "taken as exact"),
        _unknown("gain", "one gain only: part of the responsivity"),
        _unknown("spectral mismatch", f"none for {calibration.source_spectrum}, unknown for any other light"),
        glare,
        _drift(calibration),
        _unknown("fit", "not known"),
    )
    return list(known)


def _unknown(source: str, basis: str) -> BudgetRow:
    return BudgetRow(source, 0.0, "normal", True, "B", basis, included=False)


def _uniformity(calibration: Calibration) -> str:
    """Say why there is no further scatter of the patches."""
    if any(test.name == "scatter" and test.significant for test in calibration.tests):
        return "contained in fit: the patches scatter more than stated, by what their exposures disagree"
    return "contained in fit: the stated errors explain the scatter of the patches"


def _linearity(calibration: Calibration) -> str:
    if calibration.response.kind == "linear":
        return "taken as linear; the ladder of models found nothing better"
    return "contained in fit: the response is fitted together with the responsivity"


def _flat_field(calibration: Calibration) -> BudgetRow:
    vignetting = calibration.vignetting
    if vignetting is None:
        return _unknown("flat field", "no fall-off is taken off; unknown away from the axis")
    if isinstance(vignetting, Cos4Vignetting):
        return _unknown("flat field", "cos⁴ by focal length and pixel pitch, not measured; unknown away from the axis")
    own_rel = vignetting.random_rel if isinstance(vignetting, FlatField) else 0.0
    basis = "noise and unevenness of the uniform source; in patches and maps, 0 on the axis, which this is for"
    u = hypot(vignetting.slow_rel, own_rel)
    return BudgetRow("flat field", u, "normal", False, "A", basis, included=False)


def _glare(calibration: Calibration, luminance_cd_m2: float) -> BudgetRow:
    fit = calibration.responsivity
    if fit.intercept_dn_s is None or fit.intercept_standard_uncertainty_dn_s is None:
        return _unknown("glare", "not tested: all patches have about the same luminance")
    r = fit.responsivity_dn_s_cd_m2
    # What the test of the intercept could have overlooked: one standard uncertainty, and a part of it that is there.
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
        return _unknown("drift", "not tested: read a patch before and after the frames, and verify now and then")
    return _unknown("drift", f"during the calibration: {test.meaning}; since then only a verification tells")
