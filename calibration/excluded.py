"""Rows of a budget that its intervals do not hold, with the reasons."""

from __future__ import annotations

from math import hypot, sqrt

from ..core.vignetting import Cos4Vignetting
from .colour.model import AnyCalibration
from .converter import FLAT_FIELD, INTERCEPT, REFOCUS, VIGNETTING
from .findings import BudgetRow
from .model import Calibration
from .uncertainty import expanded_half_width


def not_included(plane: Calibration) -> dict[str, BudgetRow]:
    """List sources that common errors and noise may not cover, with the reason; those covered replace these rows."""
    scale, tests = plane.meter_scale, {test.name: test for test in plane.tests}
    mismatch = f"none: the light is that of the meter's calibration, {scale.illuminant}"
    linearity = ("the response is fitted together with the responsivity", "fit")
    if plane.response.kind == "linear":
        linearity = ("taken as linear; no candidate model was better", "")
    uniformity = "the stated errors explain the scatter of the patches"
    if "scatter" in tests and tests["scatter"].significant:
        uniformity = "the patches scatter more than stated, by what their exposures disagree"
    drift = "not tested: read a patch before and after the frames, and verify regularly"
    if (u := tests["drift"].standard_uncertainty if "drift" in tests else 0.0) > 0:
        found = f"{100 * tests['drift'].value:+.2g} % ± {100 * expanded_half_width(0.0, u):.2g} % (95 %)"
        drift = f"{found} an hour during the calibration; a verification shows the drift since then"
    assumed = "none: measured by a flat field"
    if plane.vignetting is None:
        assumed = "not corrected; unknown away from the axis"
    elif isinstance(plane.vignetting, Cos4Vignetting):
        assumed = "cos⁴ by focal length and pixel pitch, stated to be exact"
    why = {
        "meter digits": ("a calibration keeps the two together", "meter repeatability"),
        "meter f1'": (f"not stated for the {scale.meter.model}" if scale.f1_prime is None else mismatch, ""),
        "patch uniformity": (uniformity, "fit"),
        "linearity": linearity,
        VIGNETTING: (assumed, ""),
        FLAT_FIELD: ("none: no flat field is used", ""),
        REFOCUS: ("locked, as the configuration states it", ""),
        "gain": ("one gain only: part of the responsivity", ""),
        "spectral mismatch": (f"none for {plane.source_spectrum}, unknown for any other light", ""),
        INTERCEPT: ("not tested: all patches have about the same luminance", ""),
        "drift": (drift, ""),
    }
    texts = {source: f"contained in {inside}: {text}" if inside else text for source, (text, inside) in why.items()}
    return {
        source: BudgetRow(source, 0.0, "normal", True, "B", texts[source], included=False, contained_in=inside)
        for source, (_, inside) in why.items()
    }


def undetected_intercept(calibration: AnyCalibration, luminance_cd_m2: float) -> BudgetRow:
    """Possible undetected intercept: its standard uncertainty, combined with the fitted value."""
    value = u2 = 0.0
    for plane, weight in zip(calibration.planes, calibration.weights, strict=True):
        fit, share = plane.responsivity, weight / sum(calibration.weights)
        if fit.intercept_dn_s is None or fit.intercept_standard_uncertainty_dn_s is None:
            return not_included(calibration.planes[0])[INTERCEPT]
        # Glare is the same light in all planes.
        value += share * fit.intercept_dn_s / fit.responsivity_dn_s_cd_m2
        u2 += (share * fit.intercept_standard_uncertainty_dn_s / fit.responsivity_dn_s_cd_m2) ** 2
    bound_cd_m2 = hypot(value, sqrt(u2))
    why = "not included, since the fit goes through zero: glare depends on the scene"
    basis = f"bound by the free intercept, {bound_cd_m2:.2g} cd/m²; {why}"
    return BudgetRow(INTERCEPT, bound_cd_m2 / luminance_cd_m2, "normal", True, "A", basis, included=False)
