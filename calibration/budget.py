"""Uncertainty budget of a luminance by a calibrated camera, after the GUM (JCGM 100:2008)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import hypot, inf, isfinite, sqrt
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from ..core.luminance import CommonError
from ..core.result import Finding, FindingValue, info
from ..core.vignetting import Cos4Vignetting, FlatField, RadialVignetting, cropped
from .camera import (
    BLACK_LEVEL,
    DARK_OFFSET,
    FLAT_FIELD,
    FLICKER,
    INTERCEPT,
    REFOCUS,
    STABILITY,
    TEMPERATURE,
    VIGNETTING,
    common_errors,
    placed,
)
from .colour.conversion import errors_of_plane, joined
from .colour.model import AnyCalibration, ColourCalibration
from .frames.nonuniformity import vignetting_errors
from .model import Calibration, PatchResidual
from .setup import METER_SOURCES, MeterScale
from .uncertainty import effective_dof, expanded_half_width, expanded_uncertainty, variance_from_one_estimate

Array = NDArray[np.float64]
#: Distribution of an error.
Distribution: TypeAlias = Literal["normal", "rectangular"]
#: A position (x, y) in pixels, None for the optical axis.
Position: TypeAlias = tuple[float, float] | None

#: Order of the rows.
SOURCES = (
    "meter scale", "meter digits", "meter repeatability", "meter f1'", "meter drift", "patch uniformity",
    "exposure scatter", "shot and read noise", "pixel sensitivity", "dark non-uniformity", "dark and temperature",
    DARK_OFFSET, TEMPERATURE, BLACK_LEVEL, FLICKER, "linearity", VIGNETTING, FLAT_FIELD, "exposure time",
    "exposure offset", REFOCUS, STABILITY, "gain", "spectral mismatch", INTERCEPT, "drift", "fit",
)  # fmt: skip
#: Sources whose uncertainty is not evaluated by statistics.
_TYPE_B = (*METER_SOURCES, "spectral mismatch", "exposure time", REFOCUS, STABILITY, VIGNETTING, TEMPERATURE)
#: Sources that follow from one estimate, the scatter of the patches.
_OF_SCATTER = ("fit", "meter repeatability", "patch uniformity")
#: Sources that differ between the planes of a camera with colour filters.
_OF_EACH_PLANE = (
    "exposure scatter", "shot and read noise", "pixel sensitivity", "dark non-uniformity", "dark and temperature",
    BLACK_LEVEL, "gain",
)  # fmt: skip
#: Highest preferred signal, as a share of the saturation.
_BEST_SHARE = 0.8
#: Side of the square that V is averaged over at a position: about a patch of 1000 pixels.
_SIDE_PX = 32


@dataclass(frozen=True)
class BudgetRow:
    """One row of an uncertainty budget (JCGM 100:2008, table H.1).

    Parameters
    ----------
    source : str
        Source of the error, one of `SOURCES`.
    u_rel : float
        Its contribution to the relative standard uncertainty of the luminance.
    basis : Finding
        Basis of the value; also why it is 0 where unknown.
    distribution : {'normal', 'rectangular'}
        Of the error.
    common : bool
        True if common to all patches of one calibration, so that it (nearly) cancels in a contrast.
    evaluation : {'A', 'B'}
        A: from statistics of this session. B: from a data sheet, a certificate or judgement.
    included : bool
        Whether it is part of the stated intervals; `basis` says why if it is not.
    contained_in : str
        Source whose row includes it; empty for none.
    dof : float or None
        Degrees of freedom; None if the uncertainty is known.
    """

    source: str
    u_rel: float
    basis: Finding
    distribution: Distribution = "normal"
    common: bool = True
    evaluation: Literal["A", "B"] = "A"
    included: bool = True
    contained_in: str = ""
    dof: float | None = None


@dataclass(frozen=True)
class Budget:
    """Uncertainty budget of the luminance of a patch in one exposure.

    Parameters
    ----------
    luminance_cd_m2, exposure_s : float
        The luminance, and the exposure time of the frames.
    rows : tuple of BudgetRow
        One for each source, in the order of `SOURCES`.
    """

    luminance_cd_m2: float
    exposure_s: float
    rows: tuple[BudgetRow, ...]

    @cached_property
    def u_rel(self) -> float:
        """Relative standard uncertainty: root of the sum of squares of the included rows (JCGM 100:2008, 5.1.2)."""
        return float(np.linalg.norm([row.u_rel for row in self.rows if row.included]))

    @cached_property
    def dof(self) -> float:
        """Effective degrees of freedom (JCGM 100:2008, G.4.1); infinite where no row is based on few values."""
        return effective_dof([*self._normal, *((u**2, inf) for u in self._rectangular)])

    @cached_property
    def U_rel(self) -> float:  # noqa: N802 - the symbol of the GUM
        """Relative expanded uncertainty (95 %): the largest rectangular row as such, all others normal."""
        return expanded_uncertainty(self._normal, self._rectangular)

    @property
    def k(self) -> float:
        """Coverage factor, U over u."""
        return self.U_rel / self.u_rel

    @property
    def _rectangular(self) -> list[float]:
        return [row.u_rel for row in self.rows if row.included and row.distribution == "rectangular"]

    @property
    def _normal(self) -> list[tuple[float, float]]:
        """Variances of the other rows with their degrees of freedom; those of the scatter are one estimate."""
        normal = [row for row in self.rows if row.included and row.distribution == "normal"]
        parts = {row.source: (row.u_rel**2, row.dof or inf) for row in normal}
        by_scatter = [parts.pop(source) for source in tuple(parts) if source in _OF_SCATTER]
        return [variance_from_one_estimate(by_scatter), *parts.values()]


def budget(
    calibration: AnyCalibration,
    luminance_cd_m2: float,
    exposure_s: float | None = None,
    n_pixels: int = 1,
    n_frames: int = 1,
    position_px: Position = None,
) -> Budget:
    """Split the uncertainty of a luminance into its sources, one row for each.

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
        The luminance.
    exposure_s : float or None
        Exposure; None for the longest calibrated one at which no plane is above 80 % of saturation.
    n_pixels, n_frames : int
        Numbers of pixels, or groups of 2 x 2 pixels with colour filters, and of frames averaged.
    position_px : (float, float) or None
        Position (x, y) in the image, where the signal is that of V there; None for the optical axis.

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
    shares = np.array(calibration.weights) / sum(calibration.weights)
    of_plane = luminance_cd_m2 / sum(calibration.weights)
    leading = calibration.planes[int(np.argmax(np.abs(shares)))]
    positions = _in_planes(calibration, position_px)
    net_dn = [
        plane.net_dn(of_plane * _relative_at(plane, position), t)
        for plane, position in zip(calibration.planes, positions, strict=True)
    ]
    rows = not_included(leading) | _error_rows(calibration, shares, net_dn, t, positions)
    for row in _frame_rows(calibration, shares, net_dn, t, (n_pixels, n_frames)):
        u = row.u_rel
        of_errors = rows[FLAT_FIELD].u_rel if row.source == FLAT_FIELD else 0.0
        rows[row.source] = replace(row, u_rel=hypot(u, of_errors))
    if not rows[INTERCEPT].included:
        rows[INTERCEPT] = undetected_intercept(calibration, luminance_cd_m2)
    if len(calibration.planes) > 1:
        of_planes = [rows[source] for source in _OF_EACH_PLANE if rows[source].included]
        rows |= {
            row.source: replace(row, basis=row.basis.within("each plane with its share of the luminance"))
            for row in of_planes
        }
    return Budget(luminance_cd_m2, t, tuple(rows[source] for source in SOURCES))


def _relative_at(plane: Calibration, position_px: Position) -> float:
    """V of a plane, the mean over a square at a position (x, y) of the image; 1 on the axis, or without vignetting."""
    if plane.vignetting is None or position_px is None:
        return 1.0
    shape = plane.state.image_shape
    side = [min(_SIDE_PX, n) for n in shape]
    top, left = (
        round(min(max(at - n / 2, 0), most - n)) for at, n, most in zip(position_px[::-1], side, shape, strict=True)
    )
    part = cropped(plane.vignetting, shape, (left, top), (side[0], side[1]))
    return float(part.relative_illuminance((side[0], side[1])).mean())


def _in_planes(calibration: AnyCalibration, position_px: Position) -> list[Position]:
    """Return a position in the image in the pixels of each plane, which has half of them in each direction."""
    if position_px is None:
        return [None] * len(calibration.planes)
    height = calibration.state.image_shape[0]
    scales = [plane.state.image_shape[0] / height for plane in calibration.planes]
    return [(scale * position_px[0], scale * position_px[1]) for scale in scales]


def darkest_corner_px(calibration: AnyCalibration) -> tuple[float, float]:
    """Return the corner (x, y) of the image with the least light of a uniform scene."""
    height, width = calibration.state.image_shape
    corners = [(float(x), float(y)) for y in (0, height) for x in (0, width)]

    def light(corner: tuple[float, float]) -> float:
        return sum(map(_relative_at, calibration.planes, _in_planes(calibration, corner)))

    return min(corners, key=light)


def budget_exposure_s(calibration: AnyCalibration, luminance_cd_m2: float) -> float:
    """Longest calibrated exposure at which no plane is above 80 % of saturation, else the shortest."""
    of_plane = luminance_cd_m2 / sum(calibration.weights)
    longest = []
    for plane in calibration.planes:
        most_dn = _BEST_SHARE * plane.state.saturation_dn
        fitting = [t for t in plane.exposures_s if plane.net_dn(of_plane, t) + plane.dark.mean_dn(t) <= most_dn]
        longest.append(max(fitting, default=plane.exposures_s[0]))
    return min(longest)


def _error_rows(
    calibration: AnyCalibration,
    shares: Array,
    net_dn: Sequence[float],
    exposure_s: float,
    positions: Sequence[Position],
) -> dict[str, BudgetRow]:
    """Rows of common errors: those of planes joined as in the luminance of a patch."""
    of_planes = [
        common_errors(plane, np.array([net]), exposure_s, temperature_c=plane.dark.temperature_c)
        for plane, net in zip(calibration.planes, net_dn, strict=True)
    ]
    of_planes = [
        placed(plane, errors, list(vignetting_errors(plane.vignetting, plane.state.image_shape, [position])))
        if position is not None
        else errors
        for plane, errors, position in zip(calibration.planes, of_planes, positions, strict=True)
    ]
    errors, rows, case = [*of_planes[0]], dict[str, BudgetRow](), ""
    if isinstance(calibration, ColourCalibration):
        case = "of planes"
        of_weights = calibration.weight_errors.sum(axis=1) / sum(calibration.weights)
        kept = [
            [replace(e, source="linearity") if e.source == "fit" else e for e in errors_of_plane(plane, plane_errors)]
            for plane, plane_errors in zip(calibration.planes, of_planes, strict=True)
        ]
        errors = [*(CommonError("fit", error) for error in of_weights), *joined(kept, shares.tolist())]
        rows["spectral mismatch"] = _colour_row(calibration)
    for source in dict.fromkeys(error.source for error in errors):
        group = [error for error in errors if error.source == source]
        variance, dof = variance_from_one_estimate(
            (float(np.sum(np.square(error.relative))), error.dof) for error in group
        )
        kind: Distribution = "rectangular" if all(error.rectangular for error in group) else "normal"
        of = basis(source, case if source == "fit" else "")
        if source == "linearity":
            of = basis(source, case or ("" if calibration.planes[0].response.kind == "table" else "next"))
        if source == TEMPERATURE:
            within_k = calibration.planes[0].dark.unknown_within_k
            of = basis(source, within_k=within_k) if variance else basis(source, "none")
        if source in METER_SOURCES:
            of = _meter_basis(calibration.meter_scale, source)
        evaluation: Literal["A", "B"] = "B" if source in _TYPE_B else "A"
        rows[source] = BudgetRow(source, sqrt(variance), of, kind, True, evaluation, dof=None if dof == inf else dof)
    own_scale = calibration.responsivity if isinstance(calibration, Calibration) else calibration
    if own_scale.scatter_rel > 0:
        source, of = "patch uniformity", basis("patch uniformity", n_patches=len(calibration.planes[0].residuals))
        rows[source] = BudgetRow(source, own_scale.scatter_rel, of, common=False, dof=own_scale.scatter_dof)
    return rows | _split(calibration.residuals, rows["fit"])


def _frame_rows(
    calibration: AnyCalibration, shares: Array, net: Sequence[float], exposure_s: float, averaged: tuple[int, int]
) -> Iterator[BudgetRow]:
    """Rows of what is not common to all luminances: noise, dark pattern, black level, light and flat field."""
    planes, (n_pixels, n_frames) = calibration.planes, averaged
    stretch = shares * [float(p.response.slope(n) / p.response.linearise(n)) for p, n in zip(planes, net, strict=True)]
    noise = [
        sqrt(p.noise.variance_dn2(n, p.dark.noise_variance_dn2(exposure_s)) / n_pixels) / sqrt(n_frames)
        for p, n in zip(planes, net, strict=True)
    ]
    uneven = [p.dark.nonuniformity_dn for p in planes]
    black_level = stretch * [p.dark.drift_dn for p in planes] / sqrt(n_frames)
    values: dict[str, FindingValue] = {"n_pixels": n_pixels, "n_frames": n_frames}

    def row(source: str, us: Sequence[float] | Array, dof: int = 0, case: str = "") -> BudgetRow:
        of = basis(source, case, **values)
        return BudgetRow(source, float(np.linalg.norm(us)), of, common=False, dof=dof or None)

    yield row("exposure scatter", stretch * [p.responsivity.scatter_dn for p in planes])
    yield row("shot and read noise", stretch * noise)
    yield row("dark non-uniformity", stretch * uneven, case="" if any(uneven) else "not significant")
    yield row(BLACK_LEVEL, black_level, planes[0].dark.drift_dof)
    # The light is that of all planes.
    flicker = float(shares @ [p.noise.flicker_at(exposure_s)[0] for p in planes]) / sqrt(n_frames)
    yield row(FLICKER, [flicker], planes[0].noise.flicker_at(exposure_s)[1])
    of_flat_field = "flat field" if isinstance(planes[0].vignetting, FlatField) else ""
    yield row("pixel sensitivity", shares * [p.pixel_rel() for p in planes] / sqrt(n_pixels), case=of_flat_field)
    if isinstance(planes[0].vignetting, FlatField | RadialVignetting):
        # The source of a flat field is that of all planes.
        yield replace(row(FLAT_FIELD, [max(p.field_rel for p in planes)]), evaluation="B")


def _colour_row(calibration: ColourCalibration) -> BudgetRow:
    case = "with scatter" if calibration.spectral_rel > 0 else ""
    light, scatter_rel = calibration.source_spectrum, calibration.spectral_rel
    of = basis("spectral mismatch of planes", case, light=light, scatter_rel=scatter_rel)
    return BudgetRow("spectral mismatch", 0.0, of, common=False)


def basis(source: str, case: str = "", /, **values: FindingValue) -> Finding:
    """Return what the uncertainty of a source is based on, in one of several cases."""
    words = f"budget {source} {case}".replace("'", "").split()
    return info("-".join(words), **values)


def _meter_basis(scale: MeterScale, source: str) -> Finding:
    """Return what the uncertainty of a source in `METER_SOURCES` is based on."""
    certificate = scale.certificate
    if source == "meter f1'":
        return basis(source, f1_prime=scale.f1_prime, light=scale.light, illuminant=scale.illuminant)
    if source == "meter drift" and certificate is not None:
        per_year = {"per_year_rel": certificate.drift_rel_per_year, "date": f"{certificate.date}"}
        return basis(source, drift_rel=scale.drift_rel, **per_year)
    if certificate is None:
        return basis(source, limits_rel=scale.limits_rel, model=scale.meter.model)
    dof = certificate.degrees_of_freedom
    return basis(
        source,
        f"certificate{'' if dof is None else ' dof'}",
        expanded_rel=certificate.expanded_uncertainty_rel,
        coverage_factor=certificate.coverage_factor,
        dof=dof,
        number=certificate.number,
        laboratory=certificate.laboratory,
        date=f"{certificate.date}",
    )


def _split(rows: Sequence[PatchResidual], fit: BudgetRow) -> dict[str, BudgetRow]:
    """Separate the meter's random part from the fit: its share of the variance of a weighted mean over patches."""
    meter = np.array([row.reading_random_cd_m2 / row.reading_cd_m2 for row in rows])
    total = np.maximum([row.stated_rel for row in rows], meter)
    weight = 1 / np.maximum(total, 1e-12) ** 2
    share = min(float(np.sum((weight * meter) ** 2) / np.sum((weight * total) ** 2)), 1.0)
    u, source = fit.u_rel, "meter repeatability"
    of_meter = basis(source, n_readings=sum(row.n_readings for row in rows), n_patches=len(rows))
    return {
        source: replace(fit, source=source, u_rel=u * sqrt(share), basis=of_meter),
        "fit": replace(fit, u_rel=u * sqrt(1 - share)),
    }


def not_included(plane: Calibration) -> dict[str, BudgetRow]:
    """List sources that common errors and noise may not cover, with the reason; those covered replace these rows."""
    scale, tests, curved = plane.meter_scale, {test.name: test for test in plane.tests}, plane.response.kind != "linear"
    drift_test, vignetting = tests.get("drift"), plane.vignetting
    more_scatter = "scatter" in tests and tests["scatter"].significant
    assumed = "exact" if isinstance(vignetting, Cos4Vignetting) else "measured"
    drift = basis("drift", "not tested")
    if drift_test is not None and drift_test.standard_uncertainty > 0:
        drift = basis(
            "drift", value_rel=drift_test.value, expanded_rel=expanded_half_width(0.0, drift_test.standard_uncertainty)
        )
    f1_prime = "not stated" if scale.f1_prime is None else "none"
    why = {
        "meter digits": (basis("meter digits"), "meter repeatability"),
        "meter f1'": (basis("meter f1'", f1_prime, model=scale.meter.model, illuminant=scale.illuminant), ""),
        "meter drift": (_no_drift(scale), ""),
        "patch uniformity": (basis("patch uniformity", "by exposures" if more_scatter else "as stated"), "fit"),
        "linearity": (basis("linearity", "fitted"), "fit") if curved else (basis("linearity", "straight"), ""),
        VIGNETTING: (basis(VIGNETTING, "not corrected" if vignetting is None else assumed), ""),
        FLAT_FIELD: (basis(FLAT_FIELD, "none"), ""),
        DARK_OFFSET: (basis(DARK_OFFSET, "none"), ""),
        "exposure offset": (basis("exposure offset", "none"), ""),
        REFOCUS: (basis(REFOCUS, "locked"), ""),
        STABILITY: (basis(STABILITY, "same day", stability_rel=plane.lens.stability_rel), ""),
        "gain": (basis("gain", "one"), ""),
        "spectral mismatch": (basis("spectral mismatch", light=plane.source_spectrum), ""),
        INTERCEPT: (basis(INTERCEPT, "not tested"), ""),
        "drift": (drift, ""),
    }
    return {
        source: BudgetRow(source, 0.0, of, evaluation="B", included=False, contained_in=inside)
        for source, (of, inside) in why.items()
    }


def _no_drift(scale: MeterScale) -> Finding:
    """Say why the drift of the meter does not count."""
    if scale.certificate is None:
        return basis("meter drift", "no certificate")
    return (
        _meter_basis(scale, "meter drift")
        if scale.certificate.drift_rel_per_year
        else basis("meter drift", "not stated")
    )


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
