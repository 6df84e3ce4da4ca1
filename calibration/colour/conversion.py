"""Luminance of patches by the combination of the planes of a Bayer sensor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from math import hypot, inf, sqrt
from typing import Any, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ...core.errors import CalibrationError, InputError
from ...core.luminance import CommonError
from ...core.result import unique
from ..camera import FLICKER, INTERCEPT, REFOCUS, STABILITY, TEMPERATURE, VIGNETTING
from ..convert.patch import PatchLuminance, outside_range, patch_luminance
from ..frames.observations import PatchObservation
from ..model import Calibration, PatchResidual
from ..setup import METER_SOURCES
from ..uncertainty import effective_dof

#: Common errors of all planes of a frame, which add with their signs.
_OF_ALL_PLANES = (*METER_SOURCES, "exposure time", FLICKER, REFOCUS, STABILITY, VIGNETTING, INTERCEPT, TEMPERATURE)
_T = TypeVar("_T")
#: Observations by the name of the plane, None for a monochrome sensor.
ByPlane: TypeAlias = Mapping[str | None, Sequence[_T]]
#: The colours, each of one or two planes.
COLOURS = ("R", "G", "B")
#: Harmonics of the hue: mismatch errors of simulated cameras are nearly independent from 45 degrees of hue on.
_HARMONICS = 4
#: R, G and B at equal angles, scaled so that the magnitude is the standard deviation of the three.
_AXES = np.sqrt(2) / 3 * np.exp(2j * np.pi * np.arange(3) / 3)


@dataclass(frozen=True)
class CalibratedColourCamera:
    """DN to cd/m^2 for a camera with colour filters: L = sum of w_p L_p over the planes p.

    L_p is the luminance by the plane's own calibration, so with its rate S_p = h_p(DN - d_p) / (t V) and responsivity
    R_p it is L = sum of (w_p / R_p) S_p at each group of 2 x 2 pixels.

    Parameters
    ----------
    planes : tuple of Calibration
        In the order R, Gr, Gb, B; fitted to the patches of one spectrum.
    weights : tuple of float
        w, one per plane, equal for both greens; their sum is about 1.
    weight_covariance : tuple of tuple of float
        Covariance of the weights, without the meter's scale.
    spectral_rel : float
        Relative standard uncertainty of a luminance by its colour, per unit of colourfulness, that no weights explain;
        see `mismatch_errors`.
    scatter_rel : float
        Unexplained relative standard deviation between patches, common to all planes.
    range_cd_m2 : (float, float)
        Lowest and highest luminance of the patches.
    scatter_dof : float or None
        Degrees of freedom of `scatter_rel`; None if it is known.

    Raises
    ------
    InputError
        If the numbers of planes, weights and covariances differ, or the range is not ascending.
    """

    planes: tuple[Calibration, ...]
    weights: tuple[float, ...]
    weight_covariance: tuple[tuple[float, ...], ...]
    spectral_rel: float
    scatter_rel: float
    range_cd_m2: tuple[float, float]
    scatter_dof: float | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        n = len(self.planes)
        if n == 0 or len(self.weights) != n or np.shape(self.weight_covariance) != (n, n):
            raise InputError(
                f"a colour calibration of {n} planes has {len(self.weights)} weights and a covariance of shape "
                f"{np.shape(self.weight_covariance)}: give one weight a plane"
            )
        low, high = self.range_cd_m2
        if not 0 < low <= high < float("inf"):
            raise InputError(f"range_cd_m2 is {low:g} to {high:g}: give two positive luminances, the lower first")

    def at_their_temperature(self) -> Self:
        """Return it for frames of the session of its dark frames, at whose temperature they were taken."""
        return replace(self, planes=tuple(plane.at_their_temperature() for plane in self.planes))

    def for_use(self, recorded: Iterable[datetime | None], temperatures_c: Iterable[float | None] = ()) -> Self:
        """Return it for what was recorded at these times and temperatures, as a plane."""
        times, known = [*recorded], [*temperatures_c]
        return replace(self, planes=tuple(plane.for_use(times, known) for plane in self.planes))

    def changed_by(self, relative: float) -> Self:
        """Return it with a responsivity that has changed, as a plane."""
        return replace(self, planes=tuple(plane.changed_by(relative) for plane in self.planes))

    @property
    def field_rel(self) -> float:
        """Relative standard uncertainty of slow residuals of the flat field, common to all planes."""
        return max(plane.field_rel for plane in self.planes)

    @property
    def fit_part(self) -> tuple[float, float]:
        """Relative variance of a grey luminance by weights and scatter of the patches, and its degrees of freedom."""
        of_weights = float(np.sum(np.square(self.weight_errors.sum(axis=1))))
        parts = (of_weights, inf), (self.scatter_rel**2, self.scatter_dof or inf)
        return sum(variance for variance, _ in parts), effective_dof(parts)

    @property
    def weight_errors(self) -> NDArray[np.float64]:
        """Independent errors of the weights for one standard uncertainty, one a row, shape (n, planes)."""
        values, vectors = np.linalg.eigh(np.array(self.weight_covariance))
        kept = values > 1e-12 * max(values.max(), 1e-30)
        rows: NDArray[np.float64] = (vectors[:, kept] * np.sqrt(values[kept])).T
        return rows

    @property
    def grey_patches(self) -> set[str]:
        """Names of the patches of one spectrum, which the planes were fitted to and for which they agree."""
        return set.intersection(*({row.patch for row in plane.residuals} for plane in self.planes))

    @cached_property
    def grey(self) -> tuple[NDArray[np.float64], float]:
        """Luminances by the planes of a grey patch of 1 cd/m^2, shape (planes,), and their standard uncertainty.

        They are 1 but for errors of their fits. Patches are weighted by the noise of their pixels, and the uncertainty
        is that of their scatter between the planes, in which their readings cancel.
        """
        names = self.grey_patches
        rows = [[row for row in plane.residuals if row.patch in names] for plane in self.planes]
        noise = [
            [_noise_rel2(plane, row) for row in plane_rows] for plane, plane_rows in zip(self.planes, rows, strict=True)
        ]
        weight = 1 / np.mean(noise, axis=0)
        weight /= weight.sum()
        relative = np.array([[row.luminance_cd_m2 / row.reading_cd_m2 for row in plane_rows] for plane_rows in rows])
        grey: NDArray[np.float64] = relative @ weight
        scatter = relative - grey[:, None]
        scatter -= scatter.mean(axis=0)
        k, n = scatter.shape
        return grey, float(np.sqrt(np.sum((scatter * weight) ** 2) / max((k - 1) * (1 - 1 / n), 1)))

    def common_errors(
        self, by_plane: NDArray[np.floating[Any]], of_planes: Sequence[Sequence[CommonError]], shares: Sequence[Any]
    ) -> tuple[CommonError, ...]:
        """Return the common errors of luminances: of the weights, of the planes, and of the colour.

        Parameters
        ----------
        by_plane : ndarray of float, shape (..., planes)
            Luminances by the planes without their noise, which is no colour of the light: weights do not act on it.
        of_planes, shares : sequence
            Errors of each plane, and its shares of the luminances.
        """
        level = np.maximum(np.abs(by_plane @ np.array(self.weights, by_plane.dtype)), 1e-30)
        of_weights = [CommonError("fit", by_plane @ row / level) for row in self.weight_errors]
        kept = [errors_of_plane(plane, errors) for plane, errors in zip(self.planes, of_planes, strict=True)]
        of_colour = mismatch_errors(by_plane @ colours_of_planes(self.planes), self.spectral_rel)
        return (*of_weights, *joined(kept, shares), *of_colour)


def luminance_of_planes(
    calibration: Calibration | CalibratedColourCamera, observations: ByPlane[PatchObservation]
) -> PatchLuminance:
    """Luminance of one patch from its observations by plane."""
    if isinstance(calibration, Calibration):
        return patch_luminance(calibration, observations.get(None, ()))
    return colour_patch_luminance(calibration, observations)


def colour_patch_luminance(camera: CalibratedColourCamera, observations: ByPlane[PatchObservation]) -> PatchLuminance:
    """Luminance of one patch by the combination of planes.

    Parameters
    ----------
    camera : CalibratedColourCamera
        Of the same camera and settings.
    observations : mapping of str to sequence of PatchObservation
        Of one patch, by the name of the plane.

    Raises
    ------
    CalibrationError
        As `patch_luminance`, naming the plane; if a plane is missing, or the combined luminance is not positive.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from labcdp import Session
    >>> from labcdp.calibration import colour_patch_luminance, observe_patches
    >>> from labcdp.calibration.colour.conversion import CalibratedColourCamera
    >>> from labcdp.session import example_session
    >>> session, names = Session.open(example_session()), ("R", "Gr", "Gb", "B")
    >>> mono = session.calibrate().calibration  # as if each colour had been like it
    >>> planes = tuple(replace(mono, state=replace(mono.state, plane=name)) for name in names)
    >>> camera = CalibratedColourCamera(planes, (0.25,) * 4, ((0.0,) * 4,) * 4, 0.0, 0.0, (0.01, 1e5))
    >>> light, patch = session.frames("light"), session.configuration.target.patches[-1].region()
    >>> frames = [session.load(r) for r in light if r.exposure_s == light[0].exposure_s]
    >>> (seen,) = observe_patches(frames, [patch], mono.vignetting)
    >>> by_plane = {name: [replace(seen, state=replace(seen.state, plane=name))] for name in names}
    >>> colour_patch_luminance(camera, by_plane).luminance_cd_m2 > 0
    True
    """
    seen = [_plane_luminance(plane, observations) for plane in camera.planes]
    patch, by_plane = seen[0].patch, np.array([patch_of_plane.luminance_cd_m2 for patch_of_plane in seen])
    luminance = float(np.array(camera.weights) @ by_plane)
    if luminance <= 0:
        raise CalibrationError(
            f"patch {patch!r} has {luminance:.3g} cd/m² by the combination of planes: its light is not of the kind the "
            "weights are for; calibrate with a patch of this colour"
        )
    shares = np.array(camera.weights) * by_plane / luminance
    pairs = list(zip(camera.planes, seen, strict=True))
    independent = [own_rel(plane, patch_of_plane) for plane, patch_of_plane in pairs]
    random_rel = hypot(float(np.linalg.norm(shares * independent)), camera.scatter_rel, camera.field_rel)
    grey, grey_rel = camera.grey
    colour = _colour(by_plane / grey, np.abs(by_plane) * np.hypot(independent, grey_rel)) * grey
    # The range of a single plane does not matter.
    findings = [
        finding if finding.code == "temperature-not-stated" else finding.within(f"plane {plane.state.plane}")
        for plane, patch_of_plane in pairs
        for finding in patch_of_plane.findings
        if finding.code not in ("luminance-outside-range", "signal-outside-range")
    ]
    return PatchLuminance(
        patch=patch,
        luminance_cd_m2=luminance,
        random_rel=random_rel,
        scatter_rel=camera.scatter_rel,
        scatter_dof=camera.scatter_dof or inf,
        common=camera.common_errors(colour, [patch_of_plane.common for patch_of_plane in seen], shares.tolist()),
        exposures_s=tuple(sorted({t for patch_of_plane in seen for t in patch_of_plane.exposures_s})),
        findings=(*unique(findings), *outside_range(patch, luminance, random_rel, camera.range_cd_m2)),
    )


def _colour(by_plane: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.float64]:
    """Luminances by the planes without their noise, which is no colour of the light: wrong weights do not act on it.

    The variance of their deviations from a common luminance is reduced by what noise alone makes of it.
    """
    noise = np.maximum(noise, 1e-12 * np.abs(by_plane))
    common = np.average(by_plane, weights=1 / noise**2)
    chi_squared = float(np.sum(((by_plane - common) / noise) ** 2))
    left = max(1 - (by_plane.size - 1) / chi_squared, 0.0) if chi_squared > 0 else 0.0
    return common + sqrt(left) * (by_plane - common)


def _noise_rel2(plane: Calibration, row: PatchResidual) -> float:
    """Relative variance of a pixel of a patch at the longest exposure that was used."""
    exposure_s = row.exposures_s[-1]
    net_dn = plane.net_dn(row.luminance_cd_m2, exposure_s)
    return plane.noise.variance_dn2(net_dn, plane.dark.noise_variance_dn2(exposure_s)) / net_dn**2


def _plane_luminance(plane: Calibration, observations: ByPlane[PatchObservation]) -> PatchLuminance:
    name = plane.state.plane
    if name not in observations:
        raise CalibrationError(f"there are no observations of plane {name}: observe all planes of the frames")
    try:
        return patch_luminance(plane, observations[name])
    except CalibrationError as error:
        raise CalibrationError(f"plane {name}: {error}") from error


def own_rel(plane: Calibration, seen: PatchLuminance) -> float:
    """Relative standard uncertainty of a patch that is independent from plane to plane."""
    # Non-uniformity of the flat field source is common to all planes.
    shared_rel = hypot(plane.responsivity.scatter_rel, plane.field_rel)
    return sqrt(max(seen.random_rel**2 - shared_rel**2, 0.0))


def errors_of_plane(plane: Calibration, common: Sequence[CommonError]) -> list[CommonError]:
    """Errors of a plane other than its scale, which is part of the weights."""
    return [e for e in common if e.source != "fit" or plane.response.kind != "linear"]


def joined(planes: Sequence[Sequence[CommonError]], shares: Sequence[Any]) -> list[CommonError]:
    """Errors of the planes times their shares of the luminance; common ones are summed."""
    sums: dict[str, CommonError] = {}
    independent: list[CommonError] = []
    for errors, share in zip(planes, shares, strict=True):
        for error in errors:
            part = replace(error, relative=share * error.relative)
            if not error.source.startswith(_OF_ALL_PLANES):
                independent.append(part)
            elif error.source in sums:
                sums[error.source] = replace(part, relative=sums[error.source].relative + part.relative)
            else:
                sums[error.source] = part
    # The meter's errors are the same for all planes, and so for their sum.
    sums |= {error.source: error for error in planes[0] if error.source in METER_SOURCES}
    return [*sums.values(), *independent]


def colours_of_planes(planes: Sequence[Calibration]) -> NDArray[np.float64]:
    """Matrix that averages planes to colours, shape (planes, 3); its transpose distributes a colour's weight."""
    names = [f"{plane.state.plane}"[0] for plane in planes]
    return np.array([[float(name == colour) / max(names.count(colour), 1) for colour in COLOURS] for name in names])


def colourfulness(by_colour: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
    """Return standard deviation over mean of the luminances by R, G and B, along the last axis."""
    return np.abs(_chromaticity(by_colour))


def mismatch_errors(by_colour: NDArray[np.floating[Any]], spectral_rel: float) -> tuple[CommonError, ...]:
    """Return the errors of luminances by their colour, in patches and maps alike.

    Each harmonic of the hue, times the colourfulness, is an independent error. Together they have the standard
    uncertainty `spectral_rel` times the colourfulness. Between two luminances of one chromaticity they cancel; between
    unlike ones the correlation falls from 0.2 at 30 degrees of hue to about 0. Noise of grey pixels, which have any
    hue, averages out.

    Parameters
    ----------
    by_colour : ndarray of float, shape (..., 3)
        Luminances by R, G and B alone, equal for light of the calibration's spectrum.
    spectral_rel : float
        Relative standard uncertainty per unit of colourfulness.
    """
    if spectral_rel == 0:
        return ()
    chromaticity = _chromaticity(by_colour)
    size = np.abs(chromaticity)
    direction = chromaticity / np.maximum(size, 1e-30)
    patterns = [spectral_rel / np.sqrt(_HARMONICS) * size * direction**m for m in range(1, _HARMONICS + 1)]
    return tuple(
        CommonError("spectral mismatch", part if part.ndim else float(part))
        for pattern in patterns
        for part in (pattern.real, pattern.imag)
    )


def _chromaticity(by_colour: NDArray[np.floating[Any]]) -> NDArray[np.complex128]:
    """Hue and colourfulness as angle and magnitude; 0 for grey."""
    result: NDArray[np.complex128] = by_colour @ _AXES / np.maximum(np.abs(by_colour.mean(axis=-1)), 1e-30)
    return result
