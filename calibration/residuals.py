"""The residual tables: fitted patches, and patches held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import sqrt

import numpy as np

from ..errors import CalibrationError
from ..reading import Reading
from .gls import Solution
from .ladder import leave_one_out, patch_weights
from .model import PatchResidual
from .observations import PatchObservation
from .patch import PatchLuminance
from .readings import PatchReading, combine_readings


def fitted_rows(
    solution: Solution,
    readings: Mapping[str, PatchReading],
    groups: Mapping[str, Sequence[PatchObservation]],
) -> tuple[PatchResidual, ...]:
    """One row for each patch of the fit.

    Parameters
    ----------
    solution : Solution
        The fit.
    readings : mapping of str to PatchReading
        Of its patches.
    groups : mapping of str to sequence of PatchObservation
        Their observations.
    """
    design, rows = solution.design, []
    left_out = leave_one_out(solution).relative
    supported = len(design.patches) > solution.rung.n_parameters
    for number, name in enumerate(design.patches):
        own = np.flatnonzero(design.patch == number)
        weight, reading = patch_weights(solution, number), readings[name]
        luminance = float(weight @ solution.luminance[own])
        deviation = luminance - reading.luminance_cd_m2
        stated = sqrt(float(weight @ solution.covariance[np.ix_(own, own)] @ weight))
        rows.append(
            PatchResidual(
                patch=name,
                reading_cd_m2=reading.luminance_cd_m2,
                reading_random_cd_m2=reading.random_cd_m2,
                n_readings=reading.n_readings,
                luminance_cd_m2=luminance,
                residual_rel=deviation / reading.luminance_cd_m2,
                standardised_residual=deviation / stated,
                exposures_s=tuple(float(t) for t in np.unique(design.exposures_s[design.exposure[own]])),
                centre_px=groups[name][0].centre_px,
                leave_one_out_rel=float(left_out[number]) if supported else None,
            )
        )
    return tuple(rows)


def held_out_rows(
    measure: Callable[[str], PatchLuminance],
    centres_px: Mapping[str, tuple[float, float]],
    readings: Mapping[str, Sequence[Reading]],
) -> tuple[tuple[PatchResidual, ...], list[str]]:
    """One row for each held-out patch, and warnings about those that cannot be used.

    Parameters
    ----------
    measure : callable
        Returns the luminance of a patch by a calibration that was not shown it; may raise CalibrationError.
    centres_px : dict of str to (float, float)
        Middle (x, y) of the held-out patches.
    readings : mapping of str to sequence of Reading
        The meter's readings.
    """
    rows, warnings = [], []
    for name, centre_px in centres_px.items():
        reading, reading_warnings = combine_readings(name, readings[name])
        warnings += reading_warnings
        try:
            seen = measure(name)
        except CalibrationError as error:
            warnings.append(f"held-out patch {name!r} tells nothing: {error}")
            continue
        if reading.luminance_cd_m2 == 0:
            warnings.append(f"held-out patch {name!r} reads 0 cd/m^2, below the meter's range: it tells nothing")
            continue
        warnings += seen.warnings
        deviation = seen.luminance_cd_m2 - reading.luminance_cd_m2
        # Of the camera's common errors the meter's scale is that of the reading too.
        stated = sqrt(reading.random_cd_m2**2 + (seen.random_rel**2 + seen.fit_rel**2) * seen.luminance_cd_m2**2)
        rows.append(
            PatchResidual(
                patch=name,
                reading_cd_m2=reading.luminance_cd_m2,
                reading_random_cd_m2=reading.random_cd_m2,
                n_readings=reading.n_readings,
                luminance_cd_m2=seen.luminance_cd_m2,
                residual_rel=deviation / reading.luminance_cd_m2,
                standardised_residual=deviation / stated,
                exposures_s=seen.exposures_s,
                centre_px=centre_px,
                leave_one_out_rel=deviation / reading.luminance_cd_m2,
            )
        )
    return tuple(rows), warnings
