"""How the planes of a camera with colour filters have changed, each and against each other, by grey patches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import hypot, sqrt
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from .colour import ColourCalibration
from .colour_planes import COLOURS, colours_of_planes
from .comparison import Readings, chance_of, drift_of, generalised_means, named_errors, with_shared_errors
from .observations import PatchObservation
from .patch import PatchLuminance, patch_luminance
from .uncertainty import expanded_half_width
from .verification import ColourBalance, Drift

Array = NDArray[np.float64]

_NAMES: tuple[Literal["red", "green", "blue"], ...] = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class PlaneDrifts:
    """Changes of the planes' responsivities since the calibration.

    Parameters
    ----------
    relative : ndarray of float, shape (n planes,)
        The changes.
    covariance : ndarray of float, shape (n, n)
        Of these; the meter's errors, which all planes share, among them.
    drifts : tuple of Drift
        The same as intervals.
    """

    relative: Array
    covariance: Array
    drifts: tuple[Drift, ...]


def grey_patches(calibration: ColourCalibration) -> set[str]:
    """Names of the patches that the planes were fitted to: those of one spectrum, where all planes see the same."""
    return set.intersection(*({row.patch for row in plane.residuals} for plane in calibration.planes))


def plane_drifts(
    calibration: ColourCalibration,
    groups: Mapping[str, Mapping[str, Sequence[PatchObservation]]],
    readings: Readings,
    uneven_rel: Sequence[float],
) -> PlaneDrifts | None:
    """Compare each plane alone with the meter, by the calibration's grey patches.

    Parameters
    ----------
    calibration : ColourCalibration
        To verify.
    groups : mapping
        New observations by patch, then by plane.
    readings : Readings
        Of these patches, in their order.
    uneven_rel : sequence of float
        Unevenness of each of these patches itself.

    Returns
    -------
    PlaneDrifts or None
        None if no grey patch of the calibration is among the patches.
    """
    known, n = grey_patches(calibration), len(calibration.planes)
    difference: list[float] = []
    own: list[float] = []
    common: list[dict[tuple[str, ...], float]] = []
    for (name, group), reading, random_rel, uneven in zip(
        groups.items(), readings.joined, readings.random_rel, uneven_rel, strict=True
    ):
        if name not in known:
            continue
        try:
            seen = [patch_luminance(plane, group[f"{plane.state.plane}"]) for plane in calibration.planes]
        except CalibrationError:
            # With the new darkness the patch is no brighter than the dark: it tells nothing of the light.
            continue
        for plane, one in zip(calibration.planes, seen, strict=True):
            difference.append(one.luminance_cd_m2 / reading.luminance_cd_m2 - 1)
            own.append(one.random_rel)
            of_patch = {("patch", name): hypot(random_rel, uneven)}
            common.append(of_patch | _by_plane(f"{plane.state.plane}", one))
    if not difference:
        return None
    design = np.tile(np.eye(n), (len(difference) // n, 1))
    covariance = with_shared_errors(np.array(own), common, readings.scales)
    mean, of_mean = generalised_means(np.array(difference), covariance, design)
    variances = np.diag(of_mean)
    return PlaneDrifts(
        mean,
        of_mean,
        tuple(
            drift_of(plane, float(relative), float(variance), readings)
            for plane, relative, variance in zip(calibration.planes, mean, variances, strict=True)
        ),
    )


def balance_of(calibration: ColourCalibration, drifts: PlaneDrifts) -> ColourBalance:
    """Tell whether the colours have changed alike: chi^2 of their differences, and the colour that deviates most."""
    average = colours_of_planes(calibration.planes)
    change, covariance = drifts.relative @ average, average.T @ drifts.covariance @ average
    between = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    apart = between @ change
    chi_squared = float(apart @ np.linalg.solve(between @ covariance @ between.T, apart))
    contrasts = [_against_the_others(colour) for colour in range(len(COLOURS))]
    z = [abs(c @ change) / sqrt(c @ covariance @ c) for c in contrasts]
    odd = int(np.argmax(z))
    # Green is the reference for the others, since it has most of the light.
    to = contrasts[1] if odd == 1 else np.eye(3)[odd] - np.eye(3)[1]
    others = 1 + float((np.eye(3)[odd] - to) @ change)
    weights = np.array(calibration.weights)
    of_grey = weights @ drifts.relative / weights.sum()
    return ColourBalance(
        odd=_NAMES[odd],
        against="red and blue" if odd == 1 else "green",
        change_rel=float(to @ change) / others,
        half_width_95_rel=expanded_half_width(0.0, sqrt(to @ covariance @ to)) / others,
        chance=chance_of(chi_squared, 2),
        effect_rel=float(np.abs(weights) @ np.abs(drifts.relative - of_grey)),
    )


def _by_plane(plane: str, seen: PatchLuminance) -> dict[tuple[str, ...], float]:
    """Shared errors of a patch; all but those of the exposure time are the plane's own."""
    return {
        name if name[0].startswith("exposure time") else (plane, *name): relative
        for name, relative in named_errors(seen.common).items()
    }


def _against_the_others(colour: int) -> Array:
    contrast = np.full(len(COLOURS), -1 / (len(COLOURS) - 1))
    contrast[colour] = 1.0
    return contrast
