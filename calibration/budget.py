"""Uncertainty budget of a luminance by a calibrated camera, after the GUM (JCGM 100:2008)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt

import numpy as np

from ..core.errors import InputError
from ..core.luminance import CommonError
from .budget_gaps import rows_not_included
from .converter import REFOCUS, common_errors
from .findings import BudgetRow
from .meter import MeterScale
from .model import Calibration, PatchResidual
from .uncertainty import effective_dof, expanded_of, of_one_estimate

#: Order of the rows; a source that is not among them comes last.
SOURCES = (
    "meter scale",
    "meter digits",
    "meter repeatability",
    "meter f1'",
    "patch uniformity",
    "shot and read noise",
    "uneven darkness",
    "dark and temperature",
    "linearity",
    "flat field",
    "exposure time",
    "focus and aperture",
    "gain",
    "spectral mismatch",
    "glare",
    "drift",
    "fit",
)
#: Preferred signal range, as shares of the saturation, for choosing the exposure.
_BEST_SHARE = 0.8


@dataclass(frozen=True)
class CombinedUncertainty:
    """Combined uncertainty of the rows of a budget.

    Parameters
    ----------
    standard_uncertainty_rel : float
        Root of the sum of squares of the rows that are included (JCGM 100:2008, 5.1.2).
    effective_degrees_of_freedom : float
        By the formula of Welch and Satterthwaite (JCGM 100:2008, G.4.1); infinite where no row is based on few values.
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
    calibration: Calibration,
    luminance_cd_m2: float,
    exposure_s: float | None = None,
    n_pixels: int = 1,
    n_frames: int = 1,
) -> tuple[BudgetRow, ...]:
    """Split the uncertainty of a luminance into its sources.

    The rows are the errors that `common_errors` states and the noise of the pixels, from which the intervals of patches
    and maps are computed; sources unknown to both are listed as not included, with the reason.

    Parameters
    ----------
    calibration : Calibration
        Of the camera.
    luminance_cd_m2 : float
        The luminance, on the optical axis.
    exposure_s : float or None
        Exposure; None for the longest calibrated one at which the luminance is below 80 % of saturation.
    n_pixels, n_frames : int
        Numbers of pixels and frames averaged; 1 and 1 for a pixel of a frame.

    Returns
    -------
    tuple of BudgetRow
        One for each source, in the order of `SOURCES`.

    Raises
    ------
    InputError
        If luminance, exposure or a number is not positive.
    """
    require_positive(luminance_cd_m2=luminance_cd_m2, n_pixels=n_pixels, n_frames=n_frames)
    t = budget_exposure_s(calibration, luminance_cd_m2) if exposure_s is None else exposure_s
    if not (isfinite(t) and t > 0):
        raise InputError(f"exposure_s is {exposure_s}: give a positive number of seconds")
    net_dn = calibration.net_dn(luminance_cd_m2, t)
    rows = {row.source: row for row in rows_not_included(calibration, luminance_cd_m2)}
    known = (
        *_of_common_errors(calibration, net_dn, t),
        *_of_patches(calibration),
        *_of_pixels(calibration, net_dn, n_pixels, n_frames, t),
    )
    rows |= {row.source: row for row in known}
    rows |= {row.source: row for row in split_fit(calibration.residuals, rows["fit"])}
    return in_order(rows.values())


def in_order(rows: Iterable[BudgetRow]) -> tuple[BudgetRow, ...]:
    """Sort rows as `SOURCES` are."""
    order = {source: place for place, source in enumerate(SOURCES)}
    return tuple(sorted(rows, key=lambda row: order.get(row.source, len(order))))


def combined(rows: Sequence[BudgetRow]) -> CombinedUncertainty:
    """Combine the included rows of a budget."""
    included = [row for row in rows if row.included]
    parts = [(row.standard_uncertainty_rel**2, row.dof or inf, row.distribution) for row in included]
    u = sqrt(sum(square for square, _, _ in parts))
    normal = [*_of_the_fit(included), *((s, d) for s, d, kind in parts if kind == "normal" and d == inf)]
    rectangular = [sqrt(square) for square, _, distribution in parts if distribution == "rectangular"]
    dof = effective_dof([*normal, *((square**2, inf) for square in rectangular)])
    return CombinedUncertainty(u, dof, expanded_of(normal, rectangular))


def _of_the_fit(rows: Sequence[BudgetRow]) -> list[tuple[float, float]]:
    """Variance with few degrees of freedom: scatter of the patches, in the fit too."""
    return [of_one_estimate((row.standard_uncertainty_rel**2, row.dof) for row in rows if row.dof)]


def require_positive(**values: float) -> None:
    """Refuse values that are not positive, by name."""
    for name, value in values.items():
        if not (isfinite(value) and value > 0):
            raise InputError(f"{name} is {value}: give a positive number")


def budget_exposure_s(calibration: Calibration, luminance_cd_m2: float) -> float:
    """Longest calibrated exposure at which a luminance is below 80 % of saturation, else the shortest."""
    fitting = [
        t
        for t in calibration.exposures_s
        if calibration.net_dn(luminance_cd_m2, t) + calibration.dark.mean_dn(t)
        <= _BEST_SHARE * calibration.state.saturation_dn
    ]
    return max(fitting, default=calibration.exposures_s[0])


def _of_common_errors(calibration: Calibration, net_dn: float, exposure_s: float) -> list[BudgetRow]:
    errors: dict[str, list[CommonError]] = {}
    for error in common_errors(calibration, np.array([net_dn]), exposure_s, calibration.state.gain_db):
        errors.setdefault(error.source, []).append(error)
    rows = []
    for source, group in errors.items():
        u = sqrt(sum(float(np.ravel(error.relative)[0]) ** 2 for error in group))
        rectangular = all(error.rectangular for error in group)
        rows.append(
            BudgetRow(
                source=source,
                standard_uncertainty_rel=u,
                distribution="rectangular" if rectangular else "normal",
                common=True,
                evaluation="B"
                if source in ("meter scale", "meter f1'", "spectral mismatch", "exposure time", REFOCUS)
                else "A",
                basis=_BASIS.get(source)
                or _of_meter(source, calibration.meter_scale)
                or "as the calibration states it",
                dof=None if group[0].dof == inf else group[0].dof,
            )
        )
    return rows


_BASIS = {
    "fit": "covariance of the fit over the patches, what the meter's scatter makes listed above",
    "dark and temperature": "covariance of the dark signal fitted to the dark frames",
    REFOCUS: "lens: standard uncertainty after focus and aperture are set anew, as the configuration states it",
    "exposure time": "steps of the exposure time that cameras apply",
    "gain": "scatter of the gains around each other",
    "linearity": "residual of the bracket that gives the response, and what its exposures leave open",
    "drift": "readings before and after the frames",
    "flat field": "noise and repeatability of the flat field",
    "glare": "free intercept of the fit",
    "spectral mismatch": "mismatch of camera and light of the patches",
}


def _of_meter(source: str, scale: MeterScale) -> str:
    """Return the basis of the rows of the meter; empty for another source."""
    certificate = scale.certificate
    if source == "meter f1'":
        limits = f"f1' of {100 * (scale.f1_prime or 0):g} % as limits"
        return f"{limits}: {scale.light} light, read by a meter calibrated in illuminant {scale.illuminant}"
    if source != "meter scale":
        return ""
    if certificate is None:
        limits = f"± {100 * scale.limits_rel:g} % (limits)"
        return f"{limits} by the data sheet of the {scale.meter.model}; shared by all its readings"
    of = f"certificate {certificate.number} of {certificate.laboratory}, {certificate.date}"
    dof = "" if certificate.degrees_of_freedom is None else f", {certificate.degrees_of_freedom:g} degrees of freedom"
    u = f"U = {100 * certificate.expanded_uncertainty_rel:g} % with k = {certificate.coverage_factor:g}{dof}"
    return f"{u} by {of}; shared by all its readings"


def split_fit(rows: Sequence[PatchResidual], fit: BudgetRow) -> list[BudgetRow]:
    """Separate the meter's random part from the fit: its share of the variance of a weighted mean over patches."""
    meter = np.array([row.reading_random_cd_m2 / row.reading_cd_m2 for row in rows])
    total = np.array(
        [_total_rel(row.residual_rel, row.standardised_residual, u) for row, u in zip(rows, meter, strict=True)]
    )
    weight = 1 / np.maximum(total, 1e-12) ** 2
    share = min(float(np.sum((weight * meter) ** 2) / np.sum((weight * total) ** 2)), 1.0)
    u = fit.standard_uncertainty_rel
    return [
        BudgetRow(
            "meter repeatability",
            u * sqrt(share),
            "normal",
            True,
            "A",
            f"{sum(row.n_readings for row in rows)} readings of {len(rows)} patches, last digit included; its share of "
            "the fit",
            dof=fit.dof,
        ),
        replace(fit, standard_uncertainty_rel=u * sqrt(1 - share)),
    ]


def _total_rel(residual_rel: float, standardised: float, least: float) -> float:
    return max(abs(residual_rel / standardised), least) if standardised else least


def _of_patches(calibration: Calibration) -> list[BudgetRow]:
    scatter_rel = calibration.responsivity.scatter_rel
    if scatter_rel == 0:
        return []
    n = len(calibration.residuals)
    basis = f"scatter of the {n} patches that nothing else explains"
    dof = calibration.responsivity.scatter_dof
    return [BudgetRow("patch uniformity", scatter_rel, "normal", False, "A", basis, dof=dof)]


def _of_pixels(
    calibration: Calibration, net_dn: float, n_pixels: int, n_frames: int, exposure_s: float
) -> list[BudgetRow]:
    response = calibration.response
    stretch = float(response.slope(net_dn)) / float(response.linearise(net_dn))
    noise_dn2 = calibration.noise.variance_dn2(net_dn, calibration.dark.noise_variance_dn2(exposure_s))
    noise_rel = stretch * sqrt(noise_dn2 / (n_pixels * n_frames))
    pixels = "one pixel" if n_pixels == 1 else f"{n_pixels} pixels"
    over = f"{pixels} of {'one frame' if n_frames == 1 else f'{n_frames} frames'}"
    basis = f"photon transfer over the patches, for {over} at {exposure_s:g} s"
    uneven_dn = calibration.dark.nonuniformity_dn
    uneven = "slow change of the dark signal across the sensor" + ("" if uneven_dn > 0 else ": not significant")
    return [
        BudgetRow("shot and read noise", noise_rel, "normal", False, "A", basis),
        BudgetRow("uneven darkness", stretch * uneven_dn, "normal", False, "A", uneven),
    ]
