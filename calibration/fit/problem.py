"""The fit as one nonlinear least-squares problem, with errors in both variables and shared errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ...core.errors import CalibrationError
from .candidates import CandidateModel, Curve
from .design import Array, Design

_TOLERANCE = 1e-12
#: Residual, in standard uncertainties, of parameters at which there is no covariance.
_IMPOSSIBLE = 1e6
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
    luminance, slope, residual : ndarray of float, shape (n,)
        Luminance of each observation, its derivative by the DN, and luminance less reading; cd/m^2.
    jacobian : ndarray of float, shape (n, p)
        Derivatives of the luminances by the parameters.
    gain : ndarray of float, shape (p, n)
        Sensitivity of the parameters to the luminances.
    covariance, weight, left : ndarray of float, shape (n, n)
        Effective covariance C of the residuals; its inverse K; and P = K - K X (X^T K X)^-1 X^T K with the Jacobian X,
        used by all tests of further parameters.
    """

    design: Design
    candidate: CandidateModel
    parameters: Array
    luminance: Array
    slope: Array
    residual: Array
    jacobian: Array
    gain: Array
    covariance: Array
    weight: Array
    left: Array

    @property
    def chi_squared(self) -> float:
        """Minimum of the sum of squares."""
        # The scale of a given response is fitted with other weights than these.
        weight = self.weight if self.candidate.bracket is None else self.left
        return float(self.residual @ weight @ self.residual)

    @property
    def degrees_of_freedom(self) -> int:
        """Observations less parameters."""
        return self.residual.size - self.parameters.size

    def shift(self, pattern: Array) -> tuple[float, float]:
        """Fit one more parameter: the amplitude of `pattern`, shape (n,), in luminances less readings.

        Returns its value and standard uncertainty by the stated errors. The sum of squares decreases by the square of
        their ratio (score test; exact for linear models). The uncertainty is infinite if the pattern is in the span of
        the model.
        """
        seen = float(pattern @ self.left @ pattern)
        if seen <= 1e-12 * float(pattern @ self.weight @ pattern):
            return 0.0, float("inf")
        return float(pattern @ self.left @ self.residual) / seen, seen**-0.5


@lru_cache(maxsize=32)
def solve(design: Design, candidate: CandidateModel) -> Solution:
    """Fit a model; the last solutions are kept, as screening, selection and tests ask for the same ones.

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
    from scipy.linalg import cholesky, solve_triangular
    from scipy.optimize import least_squares

    weighting = _weighting(design, candidate)
    start = _start(design, candidate)
    scale = np.maximum(np.abs(start), 1e-3 * np.abs(start[0]))

    def standardised(scaled: Array) -> Array:
        parameters = scaled * scale
        curve, factor = _evaluate(design, candidate, parameters)
        luminance, slope = factor * curve.value, factor * curve.slope
        covariance = weighting.covariance(luminance, slope)
        if not np.isfinite(covariance).all():
            return np.full(luminance.size, _IMPOSSIBLE)
        try:
            root = cholesky(covariance, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return np.full(luminance.size, _IMPOSSIBLE)
        residual: Array = solve_triangular(root, luminance - design.readings, lower=True, check_finite=False)
        return residual

    try:
        with np.errstate(all="ignore"):  # parameters on the way may be far out
            found = least_squares(standardised, start / scale, method="lm", xtol=_TOLERANCE, ftol=_TOLERANCE)
            solution = _solution(design, candidate, found.x * scale) if found.success else None
    except (ValueError, np.linalg.LinAlgError):
        solution = None
    most_rel = _IMPOSSIBLE if candidate.bracket is None else _CONTRADICTION_REL
    if solution is None or not _typical_rel(solution) <= most_rel:
        raise CalibrationError(
            f"the {candidate.kind} fit did not converge: {_CHECK}" if candidate.bracket is None else _CONTRADICTS
        )
    return solution


def _weighting(design: Design, candidate: CandidateModel) -> Design:
    """Errors that make the weights: of a given response without those that errors of its shape look like."""
    return design if candidate.bracket is None else replace(design, shared=())


def _typical_rel(solution: Solution) -> float:
    """Median deviation; the largest one if that is beyond all bounds."""
    relative = np.abs(solution.residual / solution.design.readings)
    return float(relative.max() if not relative.max() < _IMPOSSIBLE else np.median(relative))


def _solution(design: Design, candidate: CandidateModel, parameters: Array) -> Solution:
    if not candidate.rises(parameters[: candidate.n_parameters]):
        raise CalibrationError(f"the {candidate.kind} response does not rise with luminance: {_CHECK}")
    curve, factor = _evaluate(design, candidate, parameters)
    luminance, slope = factor * curve.value, factor * curve.slope
    by_factor = np.equal.outer(design.gain, np.arange(1, parameters.size - candidate.n_parameters + 1))
    by_gain = np.where(by_factor, (design.scale_per_s * curve.value)[:, None], 0.0)
    jacobian = np.column_stack([factor[:, None] * curve.jacobian, by_gain])
    covariance = design.covariance(luminance, slope)
    normal = jacobian.T @ np.linalg.inv(_weighting(design, candidate).covariance(luminance, slope))
    by_shape = luminance * candidate.errors(design.net_dn)
    covariance = covariance + by_shape.T @ by_shape
    weight = np.linalg.inv(covariance)
    columns = weight @ jacobian
    left = weight - columns @ np.linalg.solve(jacobian.T @ columns, columns.T)
    return Solution(
        design=design,
        candidate=candidate,
        parameters=parameters,
        luminance=luminance,
        slope=slope,
        residual=luminance - design.readings,
        jacobian=jacobian,
        gain=np.linalg.solve(normal @ jacobian, normal),
        covariance=covariance,
        weight=weight,
        left=left,
    )


def _start(design: Design, candidate: CandidateModel) -> Array:
    """Return a straight line, or the given response, by the median ratio for each gain."""
    ratio = design.readings / (candidate.shape(design.net_dn) * design.scale_per_s)
    n_gains = int(design.gain.max()) + 1
    slopes = [float(np.median(ratio[design.gain == g])) for g in range(n_gains)]
    return np.concatenate([candidate.start(slopes[0]), np.array(slopes[1:]) / slopes[0]])


def _evaluate(design: Design, candidate: CandidateModel, parameters: Array) -> tuple[Curve, Array]:
    """Curve of the candidate at the signals, and what it is multiplied with."""
    n = candidate.n_parameters
    inverse_factor = np.concatenate([[1.0], parameters[n:]])[design.gain]
    return candidate.curve(parameters[:n], design.net_dn), design.scale_per_s * inverse_factor
