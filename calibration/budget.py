"""Uncertainty budget of a luminance by a calibrated camera, after the GUM (JCGM 100:2008)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, sqrt

import numpy as np

from ..core.clock import exposure_text
from ..core.errors import InputError
from ..core.luminance import CommonError
from ..core.vignetting import FlatField, RadialVignetting
from .colour.model import AnyCalibration, ColourCalibration
from .converter import FLAT_FIELD, FLICKER, INTERCEPT, REFOCUS, VIGNETTING, common_errors
from .excluded import not_included, undetected_intercept
from .findings import BudgetRow, Distribution
from .frames.nonuniformity import slow_rel
from .model import Calibration, PatchResidual
from .setup import METER_SOURCES
from .uncertainty import effective_dof, expanded_of, of_one_estimate

#: Order of the rows; a source that is not among them comes last.
SOURCES = (
    "meter scale",
    "meter digits",
    "meter repeatability",
    "meter f1'",
    "patch uniformity",
    "exposure scatter",
    "shot and read noise",
    "dark non-uniformity",
    "dark and temperature",
    "black level",
    FLICKER,
    "linearity",
    VIGNETTING,
    FLAT_FIELD,
    "exposure time",
    REFOCUS,
    "gain",
    "spectral mismatch",
    INTERCEPT,
    "drift",
    "fit",
)
#: Sources whose uncertainty is not evaluated by statistics.
_TYPE_B = (*METER_SOURCES, "spectral mismatch", "exposure time", REFOCUS, VIGNETTING)
#: Sources that follow from one estimate, the scatter of the patches.
_OF_SCATTER = ("fit", "meter repeatability", "patch uniformity")
#: Sources independent from plane to plane of a sensor with colour filters, so that their squares add.
_OF_EACH_PLANE = (
    "exposure scatter",
    "shot and read noise",
    "dark non-uniformity",
    "dark and temperature",
    "black level",
    "gain",
    "linearity",
)
#: Highest preferred signal, as a share of the saturation.
_BEST_SHARE = 0.8
_BASIS = {
    "fit": "covariance of the fit over the patches, what the meter's scatter makes listed above",
    "dark and temperature": "covariance of the dark signal fitted to the dark frames",
    REFOCUS: "lens: standard uncertainty after focus and aperture are set anew, as the configuration states it",
    "exposure time": "jitter of the exposure time, as the configuration states it",
    VIGNETTING: "cos⁴ in the corners of the image, as the configuration states it: here by the places of the patches",
    "gain": "scatter of the gains around each other",
    "linearity": "residual of the bracket that gives the response, and what its exposures leave open",
    INTERCEPT: "free intercept of the fit: glare, or if negative an offset of unknown cause",
}


@dataclass(frozen=True)
class CombinedUncertainty:
    """Combined uncertainty of the rows of a budget.

    Parameters
    ----------
    standard_uncertainty_rel : float
        Root of the sum of squares of the included rows (JCGM 100:2008, 5.1.2).
    effective_degrees_of_freedom : float
        After Welch and Satterthwaite (JCGM 100:2008, G.4.1); infinite where no row is based on few values.
    expanded_95_rel : float
        Expanded uncertainty U (95 %): the largest rectangular row as such, all others normal.
    """

    standard_uncertainty_rel: float
    effective_degrees_of_freedom: float
    expanded_95_rel: float

    @property
    def coverage_factor(self) -> float:
        """k, U over u."""
        return self.expanded_95_rel / self.standard_uncertainty_rel


def budget(
    calibration: AnyCalibration,
    luminance_cd_m2: float,
    exposure_s: float | None = None,
    n_pixels: int = 1,
    n_frames: int = 1,
) -> tuple[BudgetRow, ...]:
    """Split the uncertainty of a luminance into its sources, one row for each, in the order of `SOURCES`.

    The rows are the errors that `common_errors` states and the noise of the pixels, from which the intervals of patches
    and maps are computed; sources unknown to both are listed as not included, with the reason. With colour filters it
    is that of a grey patch in the light of the calibration: L = sum of w_p L_p with equal L_p, so that each plane has
    the share s_p = w_p / sum of w. Independent errors of the planes contribute the root of the sum of (s_p u_p)^2,
    common ones |sum of s_p u_p| (JCGM 100:2008, 5.1.2, 5.2.2).

    Parameters
    ----------
    calibration : Calibration or ColourCalibration
        Of the camera.
    luminance_cd_m2 : float
        The luminance, on the optical axis.
    exposure_s : float or None
        Exposure; None for the longest calibrated one at which no plane is above 80 % of saturation.
    n_pixels, n_frames : int
        Numbers of pixels, or groups of 2 x 2 pixels with colour filters, and of frames averaged.

    Raises
    ------
    InputError
        If luminance, exposure or a number is not positive.
    """
    t = budget_exposure_s(calibration, luminance_cd_m2) if exposure_s is None else exposure_s
    given = {"luminance_cd_m2": luminance_cd_m2, "exposure_s": t, "n_pixels": n_pixels, "n_frames": n_frames}
    for name, value in given.items():
        if not (isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}: give a positive number")
    of_plane = luminance_cd_m2 / sum(calibration.weights)
    planes = [_of_plane(plane, of_plane, t, n_pixels, n_frames) for plane in calibration.planes]
    rows = planes[0] if isinstance(calibration, Calibration) else _of_planes(calibration, planes, of_plane)
    if not rows[INTERCEPT].included:
        rows[INTERCEPT] = undetected_intercept(calibration, luminance_cd_m2)
    own = calibration.responsivity if isinstance(calibration, Calibration) else calibration
    if own.scatter_rel > 0:
        basis = f"scatter of the {len(calibration.planes[0].residuals)} patches that nothing else explains"
        scatter = BudgetRow("patch uniformity", own.scatter_rel, "normal", False, "A", basis, dof=own.scatter_dof)
        rows[scatter.source] = scatter
    order = {source: place for place, source in enumerate(SOURCES)}
    return tuple(sorted(rows.values(), key=lambda row: order.get(row.source, len(order))))


def combined(rows: Sequence[BudgetRow]) -> CombinedUncertainty:
    """Combine the included rows of a budget, as the interval of a patch."""
    included = [row for row in rows if row.included]
    of_scatter: list[tuple[float, float]] = []
    others: list[tuple[float, float]] = []
    rectangular: list[float] = []
    for row in included:
        square = row.standard_uncertainty_rel**2, row.dof or inf
        if row.distribution == "rectangular":
            rectangular.append(row.standard_uncertainty_rel)
        else:
            (of_scatter if row.source in _OF_SCATTER else others).append(square)
    normal = [of_one_estimate(of_scatter), *others]
    dof = effective_dof([*normal, *((u**2, inf) for u in rectangular)])
    u = float(np.linalg.norm([row.standard_uncertainty_rel for row in included]))
    return CombinedUncertainty(u, dof, expanded_of(normal, rectangular))


def budget_exposure_s(calibration: AnyCalibration, luminance_cd_m2: float) -> float:
    """Longest calibrated exposure at which no plane is above 80 % of saturation, else the shortest."""
    of_plane = luminance_cd_m2 / sum(calibration.weights)
    longest = []
    for plane in calibration.planes:
        most_dn = _BEST_SHARE * plane.state.saturation_dn
        fitting = [t for t in plane.exposures_s if plane.net_dn(of_plane, t) + plane.dark.mean_dn(t) <= most_dn]
        longest.append(max(fitting, default=plane.exposures_s[0]))
    return min(longest)


def _of_plane(
    plane: Calibration, luminance_cd_m2: float, exposure_s: float, n_pixels: int, n_frames: int
) -> dict[str, BudgetRow]:
    """Rows of a monochrome sensor, or of one plane."""
    net_dn = plane.net_dn(luminance_cd_m2, exposure_s)
    rows = not_included(plane)
    errors: dict[str, list[CommonError]] = {}
    for error in common_errors(plane, np.array([net_dn]), exposure_s):
        errors.setdefault(error.source, []).append(error)
    for source, group in errors.items():
        u = float(np.linalg.norm([np.ravel(error.relative)[0] for error in group]))
        kind: Distribution = "rectangular" if all(error.rectangular for error in group) else "normal"
        basis = _BASIS.get(source) or plane.meter_scale.basis(source)
        dof = None if group[0].dof == inf else group[0].dof
        rows[source] = BudgetRow(source, u, kind, True, "B" if source in _TYPE_B else "A", basis, dof=dof)
    if isinstance(plane.vignetting, FlatField | RadialVignetting):
        rows[FLAT_FIELD] = _flat_field(plane.vignetting, rows[FLAT_FIELD].standard_uncertainty_rel, n_pixels)
    rows |= _split(plane.residuals, rows["fit"])
    stretch = float(plane.response.slope(net_dn)) / float(plane.response.linearise(net_dn))
    noise_dn2 = plane.noise.variance_dn2(net_dn, plane.dark.noise_variance_dn2(exposure_s)) / (n_pixels * n_frames)
    pixels = "one pixel" if n_pixels == 1 else f"{n_pixels} pixels"
    over = f"{pixels} of {'one frame' if n_frames == 1 else f'{n_frames} frames'}"
    uneven_dn = plane.dark.nonuniformity_dn
    uneven = "slow change of the dark signal across the sensor" + ("" if uneven_dn > 0 else ": not significant")
    own = {
        "exposure scatter": (plane.responsivity.scatter_dn, "scatter of exposures in DN that nothing else explains"),
        "shot and read noise": (
            sqrt(noise_dn2),
            f"photon transfer over the patches, for {over} at {exposure_text(exposure_s)}",
        ),
        "dark non-uniformity": (uneven_dn, uneven),
        "black level": (plane.dark.drift_dn / sqrt(n_frames), f"drift from frame to frame, for {n_frames} of them"),
        FLICKER: (
            plane.noise.flicker_rel / stretch / sqrt(n_frames),
            f"light from frame to frame, for {n_frames} of them",
        ),
    }
    dofs = {FLICKER: plane.noise.flicker_dof or None}
    return rows | {
        source: BudgetRow(source, stretch * u_dn, "normal", False, "A", basis, dof=dofs.get(source))
        for source, (u_dn, basis) in own.items()
    }


def _flat_field(vignetting: FlatField | RadialVignetting, of_fit_rel: float, n_pixels: int) -> BudgetRow:
    """Row of what a flat field leaves at any place: slow errors, noise of its pixels, and their effect on the fit."""
    of_pixels = vignetting.random_rel / sqrt(n_pixels) if isinstance(vignetting, FlatField) else 0.0
    u, basis = hypot(of_fit_rel, vignetting.slow_rel, of_pixels), "non-uniformity of the uniform source, and noise"
    return BudgetRow(FLAT_FIELD, u, "normal", False, "B", basis)


def _of_planes(
    calibration: ColourCalibration, planes: Sequence[dict[str, BudgetRow]], luminance_cd_m2: float
) -> dict[str, BudgetRow]:
    """Rows of a grey patch by the combination of planes; what is not known is that of the largest share."""
    total = sum(calibration.weights)
    shares = [weight / total for weight in calibration.weights]
    leading = planes[int(np.argmax(np.abs(shares)))]
    rows = {source: _joined(row, planes, shares) for source, row in leading.items()}
    # Glare and an offset of unknown cause may have unlike signs in the planes, whose weights have, too.
    intercept = sum(s * plane.responsivity.glare_cd_m2 for s, plane in zip(shares, calibration.planes, strict=True))
    rows[INTERCEPT] = replace(rows[INTERCEPT], standard_uncertainty_rel=abs(intercept) / luminance_cd_m2)
    # The source of a flat field is that of all planes; noise and fit are those of each.
    own = [
        sqrt(max(one[FLAT_FIELD].standard_uncertainty_rel ** 2 - slow_rel(plane.vignetting) ** 2, 0.0))
        for one, plane in zip(planes, calibration.planes, strict=True)
    ]
    u = hypot(calibration.field_rel, *(s * one for s, one in zip(shares, own, strict=True)))
    rows[FLAT_FIELD] = replace(rows[FLAT_FIELD], standard_uncertainty_rel=u)
    basis = "covariance of the planes' weights for grey light, what the meter's scatter makes listed above"
    u = float(np.linalg.norm(calibration.weight_errors.sum(axis=1))) / total
    rows |= _split(calibration.residuals, BudgetRow("fit", u, "normal", True, "A", basis))
    # The scale of a linear plane is part of the weights.
    bent = [
        share * hypot(*(own[source].standard_uncertainty_rel for source in ("fit", "meter repeatability")))
        for plane, own, share in zip(calibration.planes, planes, shares, strict=True)
        if plane.response.kind != "linear"
    ]
    if bent:
        basis = "covariance of the responses of the planes that are not straight lines"
        rows["linearity"] = BudgetRow("linearity", hypot(*bent), "normal", True, "A", basis)
    of_colour = "the uncertainty of the weights"
    if calibration.spectral_rel > 0:
        of_colour += f", and {calibration.spectral_rel:.2g} times the standard deviation of its red, green and blue"
    basis = f"none for a grey patch in {calibration.source_spectrum}; of a coloured one {of_colour}"
    return rows | {"spectral mismatch": BudgetRow("spectral mismatch", 0.0, "normal", False, "A", basis)}


def _joined(leading: BudgetRow, planes: Sequence[Mapping[str, BudgetRow]], shares: Sequence[float]) -> BudgetRow:
    source = leading.source
    own = [
        (s, rows[source]) for s, rows in zip(shares, planes, strict=True) if source in rows and rows[source].included
    ]
    if not own:
        return leading
    first, parts = own[0][1], [share * row.standard_uncertainty_rel for share, row in own]
    if source not in _OF_EACH_PLANE:
        return replace(first, standard_uncertainty_rel=abs(sum(parts)))
    basis = f"{first.basis}; each plane with its share of the luminance"
    return replace(first, standard_uncertainty_rel=hypot(*parts), basis=basis, dof=None)


def _split(rows: Sequence[PatchResidual], fit: BudgetRow) -> dict[str, BudgetRow]:
    """Separate the meter's random part from the fit: its share of the variance of a weighted mean over patches."""
    meter = np.array([row.reading_random_cd_m2 / row.reading_cd_m2 for row in rows])
    scatter = [abs(row.residual_rel / row.standardised_residual) if row.standardised_residual else 0.0 for row in rows]
    total = np.maximum(scatter, meter)
    weight = 1 / np.maximum(total, 1e-12) ** 2
    share = min(float(np.sum((weight * meter) ** 2) / np.sum((weight * total) ** 2)), 1.0)
    number = f"{sum(row.n_readings for row in rows)} readings of {len(rows)} patches"
    of_meter = f"{number}, last digit included; its share of the fit"
    u, source = fit.standard_uncertainty_rel, "meter repeatability"
    return {
        source: replace(fit, source=source, standard_uncertainty_rel=u * sqrt(share), basis=of_meter),
        "fit": replace(fit, standard_uncertainty_rel=u * sqrt(1 - share)),
    }
