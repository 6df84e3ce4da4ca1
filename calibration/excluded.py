"""Rows of a budget that its intervals do not hold, with the reasons."""

from __future__ import annotations

from math import hypot

from ..core.vignetting import Cos4Vignetting, FlatField
from .converter import FLAT_FIELD, GLARE, REFOCUS, VIGNETTING
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
    why = {
        "meter digits": ("a calibration keeps the two together", "meter repeatability"),
        "meter f1'": (f"not stated for the {scale.meter.model}" if scale.f1_prime is None else mismatch, ""),
        "patch uniformity": (uniformity, "fit"),
        "linearity": linearity,
        REFOCUS: ("locked, as the configuration states it", ""),
        "gain": ("one gain only: part of the responsivity", ""),
        "spectral mismatch": (f"none for {plane.source_spectrum}, unknown for any other light", ""),
        GLARE: ("not tested: all patches have about the same luminance", ""),
        "drift": (drift, ""),
    }
    texts = {source: f"contained in {inside}: {text}" if inside else text for source, (text, inside) in why.items()}
    rows = {
        source: BudgetRow(source, 0.0, "normal", True, "B", texts[source], included=False, contained_in=inside)
        for source, (_, inside) in why.items()
    }
    return rows | _of_vignetting(plane)


def _of_vignetting(plane: Calibration) -> dict[str, BudgetRow]:
    """Rows of what is assumed of the vignetting, and of what a flat field leaves; one of them says nothing."""
    v, u = plane.vignetting, 0.0
    if v is None or isinstance(v, Cos4Vignetting):
        assumed, measured = "cos⁴ by focal length and pixel pitch, stated to be exact", "none: no flat field is used"
        if v is None:
            assumed = "not corrected; unknown away from the axis"
    else:
        u = hypot(v.slow_rel, v.random_rel if isinstance(v, FlatField) else 0.0)
        assumed = "none: measured by a flat field"
        measured = "noise and non-uniformity of the uniform source; in patches and maps, and 0 on the axis"
    return {
        VIGNETTING: BudgetRow(VIGNETTING, 0.0, "normal", True, "B", assumed, included=False),
        FLAT_FIELD: BudgetRow(FLAT_FIELD, u, "normal", False, "A", measured, included=False),
    }
