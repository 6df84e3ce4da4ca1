"""Generalised least squares with errors in both variables, by effective variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.errors import CalibrationError
from .candidates import CandidateModel
from .design import Array, Design

_MAX_ROUNDS = 200
_TOLERANCE = 1e-10
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


def solve(design: Design, candidate: CandidateModel) -> Solution:
    """Fit a model.

    Minimises chi^2 = r^T C^-1 r with r = luminance - reading and the effective covariance C = C_x + S C_n S, where C_x
    is that of readings and patches, C_n that of the signals, and S the slopes dL/dn. Setting the derivative to zero
    gives weighted normal equations with the Jacobian at the adjusted signals n' = n - C_n S C^-1 r on the left; they
    are solved iteratively. For a straight line and uncorrelated errors these are the unified equations of D. York et
    al., Am. J. Phys. 72 (2004) 367. Errors of a given response are included in the solution's covariance but not in the
    weights of the fit, which would otherwise favour signals near its reference point.

    Parameters
    ----------
    design : Design
        The observations.
    candidate : CandidateModel
        The model.

    Raises
    ------
    CalibrationError
        If the iteration does not converge, or the response is not increasing.
    """
    x, net_covariance = design.readings, design.net_covariance()
    parameters = _start(design, candidate)
    for _ in range(_MAX_ROUNDS):
        luminance, slope, jacobian = _evaluate(design, candidate, parameters, design.net_dn)
        covariance = design.patch_covariance(luminance) + slope[:, None] * net_covariance * slope
        if not (np.isfinite(covariance).all() and (slope != 0).all()):
            break
        try:
            weight = np.linalg.inv(covariance)
        except np.linalg.LinAlgError:
            break
        residual = luminance - x
        adjusted = design.net_dn - net_covariance @ (slope * (weight @ residual))
        left = _evaluate(design, candidate, parameters, adjusted)[2].T @ weight
        step = np.linalg.solve(left @ jacobian, left @ residual)
        parameters = parameters - step
        if np.abs(jacobian @ step / np.sqrt(np.diag(covariance))).max() <= 1e-6 or (
            np.abs(jacobian @ step).max() <= _TOLERANCE * x.max()
        ):
            return _solution(design, candidate, parameters, net_covariance)
    raise CalibrationError(
        f"the {candidate.kind} fit did not converge in {_MAX_ROUNDS} rounds: {_CHECK}"
        if candidate.bracket is None
        else _CONTRADICTS
    )


def _solution(design: Design, candidate: CandidateModel, parameters: Array, net_covariance: Array) -> Solution:
    if not candidate.rises(parameters[: candidate.n_parameters]):
        raise CalibrationError(f"the {candidate.kind} response does not rise with luminance: {_CHECK}")
    luminance, slope, jacobian = _evaluate(design, candidate, parameters, design.net_dn)
    covariance = design.patch_covariance(luminance) + slope[:, None] * net_covariance * slope
    normal = jacobian.T @ np.linalg.inv(covariance)
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


def _evaluate(
    design: Design, candidate: CandidateModel, parameters: Array, net_dn: Array
) -> tuple[Array, Array, Array]:
    """Luminances, slopes and Jacobian at signals."""
    n = candidate.n_parameters
    inverse_factor = np.concatenate([[1.0], parameters[n:]])[design.gain]
    curve = candidate.curve(parameters[:n], net_dn)
    scale = design.scale_per_s * inverse_factor
    by_factor = [
        np.where(design.gain == g + 1, design.scale_per_s * curve.value, 0.0) for g in range(len(parameters) - n)
    ]
    jacobian = np.column_stack([scale[:, None] * curve.jacobian, *by_factor])
    return scale * curve.value, scale * curve.slope, jacobian
