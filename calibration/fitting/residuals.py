"""The residual tables: fitted patches, and patches held out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import hypot, inf, sqrt

import numpy as np

from ...core.errors import CalibrationError
from ...core.result import Finding, warning
from ..camera import VIGNETTING
from ..convert.patch import PatchLuminance
from ..fit_records import FitError
from ..frames.observations import Groups
from ..model import PatchResidual
from ..readings import PatchReading, combine_readings
from ..setup import MeterScale, Readings
from .candidates import CandidateModel
from .design import Array
from .problem import Solution, solutions
from .scatter import fit_dof
from .selection import leave_one_out, weights_by_patch

#: Signals at which the error of a non-linear response is stored; linear interpolation is accurate to 0.1 % of it.
_N_NODES = 96


def fitted_rows(solution: Solution, groups: Groups, moved: Array | float) -> tuple[PatchResidual, ...]:
    """One row for each patch of the fit, with the luminance by the fit.

    Parameters
    ----------
    solution : Solution
        The fit.
    groups : mapping of str to sequence of PatchObservation
        Observations of its patches.
    moved : ndarray of float, shape (n,), or float
        Part of its luminances that is no deviation of the patches, as that of the vignetting, cd/m^2.
    """
    design, rows = solution.design, []
    luminance = solution.luminance - moved
    supported = len(design.patches) > solution.candidate.n_parameters
    by_patch = zip(design.patch_readings, weights_by_patch(solution), leave_one_out(solution)[0], strict=True)
    for reading, (of_patch, weight), left_out_rel in by_patch:
        variance = float(weight @ solution.covariance[np.ix_(of_patch, of_patch)] @ weight)
        stated = sqrt(variance) / reading.luminance_cd_m2
        exposures_s = tuple(np.unique(design.exposures_s[design.exposure[of_patch]]).tolist())
        seen = float(weight @ luminance[of_patch]), exposures_s
        without = float(left_out_rel) if supported else None
        rows.append(PatchResidual.compared(reading, seen, stated, groups[reading.patch][0].centre_px, without))
    return tuple(rows)


def held_out_rows(
    measure: Callable[[str], PatchLuminance], centres_px: Mapping[str, tuple[float, float]], readings: Readings
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
        ratio = seen.luminance_cd_m2 / reading.luminance_cd_m2
        # The meter's scale error is common to camera and reading.
        of_meter = reading.random_cd_m2 / reading.luminance_cd_m2
        stated = hypot(of_meter, ratio * seen.random_rel, ratio * seen.fit_rel)
        of_camera = seen.luminance_cd_m2, seen.exposures_s
        rows.append(PatchResidual.compared(reading, of_camera, stated, centre_px, ratio - 1))
    return tuple(rows), findings


def measured_rows(
    rows: Sequence[PatchResidual],
    measure: Callable[[str], PatchLuminance],
    readings: Mapping[str, PatchReading],
    meter: MeterScale,
) -> tuple[PatchResidual, ...]:
    """Return rows with the luminances of the patches by the finished calibration, as a report of the session has them.

    Parameters
    ----------
    rows : sequence of PatchResidual
        Fitted and held-out patches.
    measure : callable
        Returns the luminance of a patch by the calibration; a patch for which it raises CalibrationError, as colours
        may cancel, keeps that of the fit.
    readings : mapping of str to PatchReading
        All patches by the meter, from `combine_patches`.
    meter : MeterScale
        The meter.
    """
    measured = list(rows)
    for n, row in enumerate(rows):
        with suppress(CalibrationError):
            measured[n] = row.measured(measure(row.patch), readings[row.patch], meter)
    return tuple(measured)


def fit_errors(solution: Solution, of_vignetting: float = 1.0) -> tuple[FitError, ...]:
    """Split the errors of parameters and dark signal into independent ones.

    An error of the dark signal, or of the vignetting, also changes the parameters: it is kept as one error with both
    effects. The rest of the
    parameters' covariance is split into the eigenvectors of the response (``fit``; the gain factors follow by
    regression) and those of the gain factors given the response (``gain``). An error of a given response
    (``linearity``) is reduced by the compensation of the fitted scale.

    Parameters
    ----------
    solution : Solution
        The fit.
    of_vignetting : float
        Standard deviation that the fit leaves of the error of an assumed vignetting, over that of its prior.
    """
    twice = [error for error in solution.design.shared if error.dark or error.pattern is not None]
    # What an error adds to the readings that the parameters are fitted to.
    left = [of_vignetting if error.source == VIGNETTING else 1.0 for error in twice]
    by_twice = [
        (solution.slope * error.dn - solution.level * error.relative) / part
        for error, part in zip(twice, left, strict=True)
    ]
    by_shape = list(solution.luminance * solution.candidate.errors(solution.design.net_dn))
    rest = solution.covariance - sum(np.outer(column, column) for column in (*by_twice, *by_shape))
    covariance = solution.gain @ rest @ solution.gain.T
    n = solution.candidate.n_parameters
    response, between, factors = covariance[:n, :n], covariance[n:, :n], covariance[n:, n:]
    dof, regression = fit_dof(solution), between @ np.linalg.pinv(response)
    errors = [_error(solution, "fit", np.concatenate([step, regression @ step]), dof) for step in independent(response)]
    for step in independent(factors - regression @ between.T):
        errors.append(_error(solution, "gain", np.concatenate([np.zeros(n), step]), dof))
    for error, column in zip(twice, by_twice, strict=True):
        moved = _error(solution, error.source, solution.gain @ column)
        errors.append(replace(moved, dark=error.dark, dark_gain_db=error.gain_db, pattern=error.pattern))
    for row, column in zip(solution.candidate.errors(_nodes(solution.candidate)), by_shape, strict=True):
        moved = _error(solution, "linearity", -solution.gain @ column)
        errors.append(replace(moved, relative=tuple((row + np.array(moved.relative)).tolist())))
    return tuple(errors)


def next_response_error(solution: Solution, candidates: Sequence[CandidateModel]) -> tuple[FitError, ...]:
    """Return the error of a fitted response by what the next candidate would change, as glare that is not significant.

    It counts with the part that exceeds what chance gives: the root of the difference of the squares. None for the
    response of a bracket, whose errors are known.

    Parameters
    ----------
    solution : Solution
        The fit.
    candidates : sequence of CandidateModel
        Candidates of the response, simplest first.
    """
    candidate = solution.candidate
    larger = [other for other in candidates if other.n_parameters > candidate.n_parameters]
    more = larger if candidate.bracket is None else []
    other = next(solutions(solution.design, more), None)
    if other is None:
        return ()
    drop, extra = solution.chi_squared - other.chi_squared, other.candidate.n_parameters - candidate.n_parameters
    if drop <= extra:
        return ()

    def change(net_dn: Array) -> Array:
        before, after = (
            fitted.candidate.curve(fitted.parameters[: fitted.candidate.n_parameters], net_dn)[0]
            for fitted in (solution, other)
        )
        return after / before - 1

    nodes = np.geomspace(float(solution.design.net_dn.min()), candidate.knots_dn[-1], _N_NODES)
    # The responsivity is where it is.
    relative = (change(nodes) - change(solution.design.net_dn).mean()) * sqrt(1 - extra / drop)
    return (FitError("linearity", tuple(nodes.tolist()), tuple(relative.tolist())),)


def independent(covariance: Array) -> Array:
    """Independent errors for one standard uncertainty, one a row: eigenvectors of a covariance."""
    values, vectors = np.linalg.eigh(covariance)
    errors: Array = (np.sqrt(np.maximum(values, 0.0)) * vectors).T
    return errors


def _nodes(candidate: CandidateModel) -> Array:
    top = candidate.knots_dn[-1]
    if candidate.kind == "linear":
        return np.array([top])
    if candidate.kind == "table":
        return np.geomspace(candidate.knots_dn[0], top, _N_NODES)
    return top * np.arange(1, _N_NODES + 1) / _N_NODES


def finite(dof: float) -> float | None:
    """Return degrees of freedom as a file holds them, None for infinite ones."""
    return dof if dof < inf else None


def _error(solution: Solution, source: str, step: Array, dof: float = inf) -> FitError:
    """Return the change of the luminances by a step of all parameters."""
    n, nodes = solution.candidate.n_parameters, _nodes(solution.candidate)
    value, _ = solution.candidate.curve(solution.parameters[:n], nodes)
    relative = solution.candidate.jacobian(solution.parameters[:n], nodes) @ step[:n] / value
    of_gains = step[n:] / solution.parameters[n:]
    return FitError(source, tuple(nodes.tolist()), tuple(relative.tolist()), tuple(of_gains.tolist()), dof=finite(dof))
