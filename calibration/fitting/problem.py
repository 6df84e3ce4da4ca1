"""The fit as one nonlinear least-squares problem, with errors in both variables and common errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from ...core.dn import Response
from ...core.errors import CalibrationError
from .candidates import CandidateModel
from .design import Array, Design

_TOLERANCE = 1e-12
#: Residual, in standard uncertainties, of parameters at which there is no covariance.
_IMPOSSIBLE = 1e6
#: Least eigenvalue of the correlations of parameters that the observations determine.
_DETERMINED = 1e-12
#: Typical deviation of the patches above which a given response is not that of this camera.
_CONTRADICTION_REL = 0.2
_CHECK = (
    "check that readings and frames belong to the same patches; of a camera with a tone curve (gamma) find the "
    "response by a bracket (labcdp calibrate --response debevec)"
)
_CONTRADICTS = (
    "the response of the bracket contradicts the patches: check that readings and frames belong to the same patches, "
    "that scene and light stood still, or calibrate without it"
)


@dataclass(frozen=True, eq=False)
class Solution:
    """A model fitted to a design: L = c(n) scale / factor of the gain.

    Parameters
    ----------
    design : Design
        The observations.
    candidate : CandidateModel
        The model.
    parameters : ndarray of float, shape (p,)
        Those of the candidate, then for each further gain the inverse of its factor.
    luminance, slope : ndarray of float, shape (n,)
        Luminance of each observation, and its derivative by the DN; cd/m^2.
    jacobian : ndarray of float, shape (n, p)
        Derivatives of the luminances by the parameters.
    gain : ndarray of float, shape (p, n)
        Sensitivity of the parameters to the luminances.
    covariance : ndarray of float, shape (n, n)
        Effective covariance C of the residuals.
    """

    design: Design
    candidate: CandidateModel
    parameters: Array
    luminance: Array
    slope: Array
    jacobian: Array
    gain: Array
    covariance: Array

    @property
    def residual(self) -> Array:
        """Luminance less reading, shape (n,)."""
        return self.luminance - self.design.readings

    @property
    def level(self) -> Array:
        """Luminances that relative errors refer to, shape (n,); see `Design.level`."""
        return self.design.level(self.luminance)

    @cached_property
    def weight(self) -> Array:
        """K, the inverse of C, shape (n, n)."""
        return np.linalg.inv(self.covariance)

    @cached_property
    def left(self) -> Array:
        """P = K - K X (X^T K X)^-1 X^T K with the Jacobian X, shape (n, n): what the parameters leave."""
        # Parameters of very different sizes: their columns are scaled.
        jacobian = self.jacobian / np.sqrt(np.einsum("ni,nm,mi->i", self.jacobian, self.weight, self.jacobian))
        columns = self.weight @ jacobian
        left: Array = self.weight - columns @ np.linalg.solve(jacobian.T @ columns, columns.T)
        return left

    @property
    def response(self) -> tuple[Response, float]:
        """Return h and R."""
        return self.candidate.response(self.parameters[: self.candidate.n_parameters])

    @property
    def parameter_covariance(self) -> Array:
        """Covariance of the parameters, dark signal included, shape (p, p)."""
        covariance: Array = self.gain @ self.covariance @ self.gain.T
        return covariance

    @property
    def chi_squared(self) -> float:
        """Minimum of the sum of squares."""
        # The scale of a given response is fitted with other weights than these.
        weight = self.weight if self.candidate.bracket is None else self.left
        return float(self.residual @ weight @ self.residual)

    @property
    def degrees_of_freedom(self) -> int:
        """Observations less parameters, effects that were found among them."""
        return self.luminance.size - self.parameters.size - self.design.n_effects


@lru_cache(maxsize=32)
def solve(design: Design, candidate: CandidateModel) -> Solution:
    """Fit a model; the last solutions are kept, as selection and checks ask for the same ones.

    Unknown are the parameters, the true luminance of each patch and each shared error, with normal priors of their
    stated widths. All but the parameters enter linearly and are eliminated: what remains is chi^2 = r^T C^-1 r with
    r = luminance - reading and the effective covariance C of `Design.covariance`, at the slopes of the parameters. It
    is minimised by `scipy.optimize.least_squares`. For a straight line and independent errors these are the equations
    of D. York et al., Am. J. Phys. 72 (2004) 367. Errors of a given response are included in the solution's covariance
    but not in the weights of the fit, which would otherwise favour signals near its reference point.

    Parameters
    ----------
    design : Design
        The observations.
    candidate : CandidateModel
        The model.

    Raises
    ------
    CalibrationError
        If there is no minimum, or the response is not increasing.
    """
    # LAPACK itself: what checks and converts around it takes longer than matrices this small.
    from scipy.linalg.lapack import dpotrf, dtrtrs
    from scipy.optimize import least_squares

    weighting = _weighting(design, candidate)
    start = _start(design, candidate)
    scale = np.maximum(np.abs(start), 1e-3 * np.abs(start[0]))

    def standardised(scaled: Array) -> Array:
        luminance, slope = _luminances(design, candidate, scaled * scale)
        root, failed = dpotrf(weighting.covariance(luminance, slope), lower=True)
        if failed or not np.isfinite(root).all():
            return np.full(luminance.size, _IMPOSSIBLE)
        residual: Array = dtrtrs(root, luminance - design.readings, lower=True)[0]
        return residual

    try:
        with np.errstate(all="ignore"):  # parameters on the way may be far out
            minimum = least_squares(standardised, start / scale, method="lm", xtol=_TOLERANCE, ftol=_TOLERANCE)
            solution = solution_at(design, candidate, minimum.x * scale) if minimum.success else None
    except (ValueError, np.linalg.LinAlgError):
        solution = None
    most_rel = _IMPOSSIBLE if candidate.bracket is None else _CONTRADICTION_REL
    if solution is None or not _typical_rel(solution) <= most_rel:
        raise CalibrationError(
            f"the {candidate.kind} fit did not converge: {_CHECK}" if candidate.bracket is None else _CONTRADICTS
        )
    return solution


def solutions(design: Design, candidates: Iterable[CandidateModel]) -> Iterator[Solution]:
    """Yield the fits of those models that have one with an increasing response."""
    for candidate in candidates:
        with suppress(CalibrationError):
            yield solve(design, candidate)


def _weighting(design: Design, candidate: CandidateModel) -> Design:
    """Errors that make the weights: of a given response without those that errors of its shape look like.

    An effect that was found is no such error: without it, the fit would follow it.
    """
    if candidate.bracket is None:
        return design
    return replace(design, shared=tuple(error for error in design.shared if error.is_parameter))


def _typical_rel(solution: Solution) -> float:
    """Median deviation; the largest one if that is beyond all bounds."""
    relative = np.abs(solution.residual / solution.design.readings)
    return float(relative.max() if not relative.max() < _IMPOSSIBLE else np.median(relative))


def solution_at(design: Design, candidate: CandidateModel, parameters: Array) -> Solution:
    """Return a model with given parameters; raises CalibrationError if they are none of a response that rises."""
    if not candidate.rises(parameters[: candidate.n_parameters]):
        # With the shape of a bracket only the scale is free: no positive one is a contradiction.
        text = f"the {candidate.kind} response does not rise with luminance: {_CHECK}"
        raise CalibrationError(text if candidate.bracket is None else _CONTRADICTS)
    luminance, slope = _luminances(design, candidate, parameters)
    jacobian = _jacobian(design, candidate, parameters)
    normal = jacobian.T @ np.linalg.inv(_weighting(design, candidate).covariance(luminance, slope))
    by_shape = luminance * candidate.errors(design.net_dn)
    covariance = design.covariance(luminance, slope) + by_shape.T @ by_shape
    information = normal @ jacobian
    scale = np.sqrt(np.abs(np.diag(information)))
    if not (scale > 0).all() or np.linalg.eigvalsh(information / np.outer(scale, scale))[0] < _DETERMINED:
        raise CalibrationError(f"the patches do not determine a {candidate.kind} response: {_CHECK}")
    gain = np.linalg.solve(information, normal)
    return Solution(design, candidate, parameters, luminance, slope, jacobian, gain, covariance)


def _start(design: Design, candidate: CandidateModel) -> Array:
    """Return a straight line, or the given response, by the median ratio for each gain, or beside what was found."""
    shape, gain = candidate.shape(design.net_dn) * design.signals.scale_per_s, design.signals.gain_index
    of_gains = np.equal.outer(gain, np.arange(int(gain.max()) + 1))
    slopes = np.array([np.median((design.readings / shape)[of_gain]) for of_gain in of_gains.T])
    with_effects = replace(design, shared=tuple(error for error in design.shared if error.is_parameter))
    if with_effects.shared:
        effects = with_effects.patterns(design.readings, design.signals.scale_per_s)
        columns = np.column_stack([of_gains, (effects / shape).T])
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        if np.isfinite(size).all():
            beside = np.linalg.lstsq(columns / size, design.readings / shape, rcond=None)[0] / size
            slopes = beside[: slopes.size] if (beside[: slopes.size] > 0).all() else slopes
    return np.concatenate([candidate.start(float(slopes[0])), slopes[1:] / slopes[0]])


def _luminances(design: Design, candidate: CandidateModel, parameters: Array) -> tuple[Array, Array]:
    """Luminances of the observations, and their derivatives by the DN."""
    value, slope = candidate.curve(parameters[: candidate.n_parameters], design.net_dn)
    factor = _factors(design, candidate, parameters)
    return factor * value, factor * slope


def _factors(design: Design, candidate: CandidateModel, parameters: Array) -> Array:
    """Factors of the observations by exposure, place and gain."""
    by_gain = np.concatenate([[1.0], parameters[candidate.n_parameters :]])
    factors: Array = design.signals.scale_per_s * by_gain[design.signals.gain_index]
    return factors


def _jacobian(design: Design, candidate: CandidateModel, parameters: Array) -> Array:
    """Return derivatives of the luminances by all parameters, shape (n, p)."""
    n, gain = candidate.n_parameters, design.signals.gain_index
    value, _ = candidate.curve(parameters[:n], design.net_dn)
    by_curve = _factors(design, candidate, parameters)[:, None] * candidate.jacobian(parameters[:n], design.net_dn)
    this_gain = np.equal.outer(gain, np.arange(1, parameters.size - n + 1))
    return np.column_stack([by_curve, np.where(this_gain, (design.signals.scale_per_s * value)[:, None], 0.0)])
