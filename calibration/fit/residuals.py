"""The residual tables: fitted patches, and patches held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import sqrt

import numpy as np

from ...core.errors import CalibrationError
from ...core.finding import Finding, warning
from ...core.reading import Reading
from ..convert.patch import PatchLuminance
from ..frames.observations import PatchObservation
from ..model import PatchResidual
from ..readings import PatchReading, combine_readings
from .problem import Solution
from .selection import leave_one_out, patch_weights


def fitted_rows(
    solution: Solution, readings: Mapping[str, PatchReading], groups: Mapping[str, Sequence[PatchObservation]]
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
    supported = len(design.patches) > solution.candidate.n_parameters
    for number, name in enumerate(design.patches):
        own = np.flatnonzero(design.patch == number)
        weight, reading = patch_weights(solution, number), readings[name]
        luminance = float(weight @ solution.luminance[own])
        deviation = luminance - reading.luminance_cd_m2
        stated = sqrt(float(weight @ solution.covariance[np.ix_(own, own)] @ weight))
        rows.append(
            PatchResidual.of(
                reading,
                luminance,
                tuple(float(t) for t in np.unique(design.exposures_s[design.exposure[own]])),
                residual_rel=deviation / reading.luminance_cd_m2,
                standardised_residual=deviation / stated,
                centre_px=groups[name][0].centre_px,
                leave_one_out_rel=float(left_out[number]) if supported else None,
            )
        )
    return tuple(rows)


def held_out_rows(
    measure: Callable[[str], PatchLuminance],
    centres_px: Mapping[str, tuple[float, float]],
    readings: Mapping[str, Sequence[Reading]],
) -> tuple[tuple[PatchResidual, ...], list[Finding]]:
    """One row for each held-out patch, and findings on unusable ones.

    Parameters
    ----------
    measure : callable
        Returns the luminance of a held-out patch by the calibration; may raise CalibrationError.
    centres_px : dict of str to (float, float)
        Middle (x, y) of the held-out patches.
    readings : mapping of str to sequence of Reading
        The meter's readings.
    """
    rows: list[PatchResidual] = []
    findings: list[Finding] = []
    for name, centre_px in centres_px.items():
        reading, of_readings = combine_readings(name, readings[name])
        findings += of_readings
        try:
            seen = measure(name)
        except CalibrationError as error:
            findings.append(warning("held-out-not-usable", name, reason=str(error)))
            continue
        if reading.luminance_cd_m2 == 0:
            findings.append(warning("held-out-reads-zero", name))
            continue
        findings += seen.findings
        deviation = seen.luminance_cd_m2 - reading.luminance_cd_m2
        # The meter's scale error is common to camera and reading.
        stated = sqrt(reading.random_cd_m2**2 + (seen.random_rel**2 + seen.fit_rel**2) * seen.luminance_cd_m2**2)
        rows.append(
            PatchResidual.of(
                reading,
                seen.luminance_cd_m2,
                seen.exposures_s,
                residual_rel=deviation / reading.luminance_cd_m2,
                standardised_residual=deviation / stated,
                centre_px=centre_px,
                leave_one_out_rel=deviation / reading.luminance_cd_m2,
            )
        )
    return tuple(rows), findings
