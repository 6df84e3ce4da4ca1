"""Rows of a budget that its intervals do not hold, with the reasons."""

from __future__ import annotations

from math import hypot, sqrt

from ..core.vignetting import Cos4Vignetting
from .colour.model import AnyCalibration
from .converter import FLAT_FIELD, INTERCEPT, REFOCUS, VIGNETTING
from .findings import BudgetRow, basis
from .model import Calibration
from .uncertainty import expanded_half_width


def not_included(plane: Calibration) -> dict[str, BudgetRow]:
    """List sources that common errors and noise may not cover, with the reason; those covered replace these rows."""
    scale, tests, curved = plane.meter_scale, {test.name: test for test in plane.tests}, plane.response.kind != "linear"
    found, vignetting = tests.get("drift"), plane.vignetting
    more_scatter = "scatter" in tests and tests["scatter"].significant
    assumed = "exact" if isinstance(vignetting, Cos4Vignetting) else "measured"
    drift = basis("drift", "not tested")
    if found is not None and found.standard_uncertainty > 0:
        drift = basis("drift", value_rel=found.value, expanded_rel=expanded_half_width(0.0, found.standard_uncertainty))
    f1_prime = "not stated" if scale.f1_prime is None else "none"
    why = {
        "meter digits": (basis("meter digits"), "meter repeatability"),
        "meter f1'": (basis("meter f1'", f1_prime, model=scale.meter.model, illuminant=scale.illuminant), ""),
        "patch uniformity": (basis("patch uniformity", "by exposures" if more_scatter else "as stated"), "fit"),
        "linearity": (basis("linearity", "fitted"), "fit") if curved else (basis("linearity", "straight"), ""),
        VIGNETTING: (basis(VIGNETTING, "not corrected" if vignetting is None else assumed), ""),
        FLAT_FIELD: (basis(FLAT_FIELD, "none"), ""),
        REFOCUS: (basis(REFOCUS, "locked"), ""),
        "gain": (basis("gain", "one"), ""),
        "spectral mismatch": (basis("spectral mismatch", light=plane.source_spectrum), ""),
        INTERCEPT: (basis(INTERCEPT, "not tested"), ""),
        "drift": (drift, ""),
    }
    return {
        source: BudgetRow(source, 0.0, of, evaluation="B", included=False, contained_in=inside)
        for source, (of, inside) in why.items()
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
    of = basis(INTERCEPT, "not found", bound_cd_m2=bound_cd_m2)
    return BudgetRow(INTERCEPT, bound_cd_m2 / luminance_cd_m2, of, included=False)
