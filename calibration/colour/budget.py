"""Uncertainty budget of a grey patch by the combination of colour planes, after the GUM (JCGM 100:2008)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, sqrt

import numpy as np

from ..budget import budget, budget_exposure_s, in_order, require_positive, split_fit
from ..findings import BudgetRow
from .model import ColourCalibration

#: Sources independent from plane to plane, so that their squares add.
_OF_EACH_PLANE = ("shot and read noise", "uneven darkness", "dark and temperature", "gain", "linearity")
#: Sources of the fit of a plane; the scale of a linear plane is part of the weights.
_OF_A_FIT = ("fit", "meter repeatability")


def colour_budget(
    calibration: ColourCalibration,
    luminance_cd_m2: float,
    exposure_s: float | None = None,
    n_groups: int = 1,
    n_frames: int = 1,
) -> tuple[BudgetRow, ...]:
    """Split the uncertainty of the luminance of a grey patch, in the light of the calibration, into its sources.

    L = sum of w_p L_p. With equal L_p in all planes each contributes the share s_p = w_p / sum of w. Independent errors
    of the planes contribute the root of the sum of (s_p u_p)^2, common ones |sum of s_p u_p| (JCGM 100:2008, 5.1.2,
    5.2.2).

    Parameters
    ----------
    calibration : ColourCalibration
        Of the camera.
    luminance_cd_m2 : float
        The luminance, on the optical axis.
    exposure_s : float or None
        Exposure; None for the longest at which no plane is above 80 % of saturation, as `budget_exposure_s`.
    n_groups, n_frames : int
        Numbers of groups of 2 x 2 pixels and of frames that are averaged.

    Returns
    -------
    tuple of BudgetRow
        One for each source, in the order of `labcdp.calibration.budget.SOURCES`.

    Raises
    ------
    InputError
        If luminance, exposure or a number is not positive.
    """
    require_positive(luminance_cd_m2=luminance_cd_m2, n_groups=n_groups, n_frames=n_frames)
    t = colour_budget_exposure_s(calibration, luminance_cd_m2) if exposure_s is None else exposure_s
    shares = np.array(calibration.weights) / sum(calibration.weights)
    of_plane = luminance_cd_m2 / sum(calibration.weights)
    planes = [{row.source: row for row in budget(p, of_plane, t, n_groups, n_frames)} for p in calibration.planes]
    # Unknown sources are those of the plane with the largest share.
    rows = dict(planes[int(np.argmax(np.abs(shares)))])
    rows |= {source: _joined(source, planes, shares.tolist(), rows[source]) for source in _OF_EACH_PLANE}
    rows |= {row.source: row for row in _responses(calibration, planes, shares.tolist())}
    rows |= {row.source: row for row in split_fit(calibration.residuals, _weights(calibration))}
    rows |= {row.source: row for row in _of_patches(calibration, luminance_cd_m2, shares.tolist(), rows["glare"])}
    return in_order(rows.values())


def colour_budget_exposure_s(calibration: ColourCalibration, luminance_cd_m2: float) -> float:
    """Exposure at which each plane has the signal required by `budget_exposure_s`."""
    of_plane = luminance_cd_m2 / sum(calibration.weights)
    return min(budget_exposure_s(plane, of_plane) for plane in calibration.planes)


def _joined(
    source: str, planes: Sequence[Mapping[str, BudgetRow]], shares: Sequence[float], leading: BudgetRow
) -> BudgetRow:
    """Row of a source that is independent from plane to plane."""
    included = [(share, rows[source]) for share, rows in zip(shares, planes, strict=True) if rows[source].included]
    if not included:
        return leading
    first = included[0][1]
    u = hypot(*(share * row.standard_uncertainty_rel for share, row in included))
    basis = f"{first.basis}; each plane with its share of the luminance"
    return BudgetRow(source, u, first.distribution, first.common, first.evaluation, basis)


def _weights(calibration: ColourCalibration) -> BudgetRow:
    """Row of the fit of the weights, for light of the calibration's spectrum."""
    u = float(np.linalg.norm(calibration.weight_errors.sum(axis=1))) / sum(calibration.weights)
    basis = "covariance of the planes' weights for grey light, what the meter's scatter makes listed above"
    return BudgetRow("fit", u, "normal", True, "A", basis)


def _responses(
    calibration: ColourCalibration, planes: Sequence[Mapping[str, BudgetRow]], shares: Sequence[float]
) -> list[BudgetRow]:
    """Row of the fit of the planes' responses, where these are not linear."""
    bent = [
        share * hypot(*(rows[source].standard_uncertainty_rel for source in _OF_A_FIT))
        for plane, rows, share in zip(calibration.planes, planes, shares, strict=True)
        if plane.response.kind != "linear"
    ]
    if not bent:
        return []
    basis = "covariance of the responses of the planes that are not straight lines"
    return [BudgetRow("linearity", hypot(*bent), "normal", True, "A", basis)]


def _of_patches(
    calibration: ColourCalibration, luminance_cd_m2: float, shares: Sequence[float], glare: BudgetRow
) -> list[BudgetRow]:
    of_colour = "the uncertainty of the weights"
    if calibration.spectral_rel > 0:
        of_colour += f", and {calibration.spectral_rel:.2g} times the standard deviation of its red, green and blue"
    basis = f"none for a grey patch in {calibration.source_spectrum}; of a coloured one {of_colour}"
    rows = [BudgetRow("spectral mismatch", 0.0, "normal", False, "A", basis)]
    if calibration.scatter_rel > 0:
        n = len(calibration.planes[0].residuals)
        basis = f"scatter of the {n} grey patches that nothing else explains"
        dof = calibration.scatter_dof
        rows.append(BudgetRow("patch uniformity", calibration.scatter_rel, "normal", False, "A", basis, dof=dof))
    fits = [plane.responsivity for plane in calibration.planes]
    if all(fit.intercept_dn_s is not None for fit in fits):
        found = [
            (share * (fit.intercept_dn_s or 0.0) / r, share * (fit.intercept_standard_uncertainty_dn_s or 0.0) / r)
            for fit, share in zip(fits, shares, strict=True)
            for r in (fit.responsivity_dn_s_cd_m2,)
        ]
        # Glare is the same light in all planes.
        bound_cd_m2 = hypot(sum(value for value, _ in found), sqrt(sum(u**2 for _, u in found)))
        basis = (
            f"bound by the planes' free intercepts, {bound_cd_m2:.2g} cd/m²; not included, since the fits go through "
            "zero: glare depends on the scene"
        )
        rows.append(BudgetRow("glare", bound_cd_m2 / luminance_cd_m2, "normal", True, "A", basis, included=False))
    else:
        rows.append(glare)
    return rows
