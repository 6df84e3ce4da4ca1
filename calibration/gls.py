"""Generalised least squares with errors in both variables, by effective variances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import CalibrationError
from .design import Array, Design
from .rungs import Rung

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
    rung : Rung
        The model.
    parameters : ndarray of float, shape (p,)
        Those of the rung, then for each further gain the inverse of its factor.
    luminance, slope, residual : ndarray of float, shape (n,)
        Luminance of each observation, its derivative by the DN, and luminance less reading; cd/m^2.
    jacobian : ndarray of float, shape (n, p)
        Derivatives of the luminances by the parameters.
    gain : ndarray of float, shape (p, n)
        How the parameters follow from the luminances.
    covariance, weight, left : ndarray of float, shape (n, n)
        Effective covariance C of the residuals; its inverse K; and P = K - K X (X^T K X)^-1 X^T K with the Jacobian X,
        by which all tests of further parameters follow.
    """

    design: Design
    rung: Rung
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
        weight = self.weight if self.rung.bracket is None else self.left
        return float(self.residual @ weight @ self.residual)

    @property
    def degrees_of_freedom(self) -> int:
        """Observations less parameters."""
        return self.residual.size - self.parameters.size

    def shift(self, pattern: Array) -> tuple[float, float]:
        """Fit one more parameter: how much of `pattern`, shape (n,), is in luminances less readings.

        Returns its value and standard uncertainty by the stated errors. The sum of squares falls by the square of
        their ratio (score test; for linear models exact). The uncertainty is infinite if the model holds the pattern
        already.
        """
        seen = float(pattern @ self.left @ pattern)
        if seen <= 1e-12 * float(pattern @ self.weight @ pattern):
            return 0.0, float("inf")
        return float(pattern @ self.left @ self.residual) / seen, seen**-0.5


def solve(design: Design, rung: Rung) -> Solution:
    """Fit a model.

    Minimises chi^2 = r^T C^-1 r with r = luminance - reading and the effective covariance C = C_x + S C_n S, where C_x
    holds readings and patches, C_n the signals, and S the slopes dL/dn. Setting the derivative to zero gives weighted
    normal equations with the Jacobian at the adjusted signals n' = n - C_n S C^-1 r on the left; they are solved by
    repetition. For a straight line and uncorrelated errors these are the unified equations of D. York et al., Am. J.
    Phys. 72 (2004) 367. The errors of a response that is given count in the solution's covariance, not in the weights
    of the fit: its scale would follow the signals that it starts from, and be wrong by its whole error at the others.

    Parameters
    ----------
    design : Design
        The observations.
    rung : Rung
        The model.

    Raises
    ------
    CalibrationError
        If the repetition does not settle, or the response does not rise.
    """
    x, net_covariance = design.readings, design.net_covariance()
    parameters = _start(design, rung)
    for _ in range(_MAX_ROUNDS):
        luminance, slope, jacobian = _evaluate(design, rung, parameters, design.net_dn)
        covariance = design.patch_covariance(luminance) + slope[:, None] * net_covariance * slope
        if not (np.isfinite(covariance).all() and (slope != 0).all()):
            break
        try:
            weight = np.linalg.inv(covariance)
        except np.linalg.LinAlgError:
            break
        residual = luminance - x
        adjusted = design.net_dn - net_covariance @ (slope * (weight @ residual))
        left = _evaluate(design, rung, parameters, adjusted)[2].T @ weight
        step = np.linalg.solve(left @ jacobian, left @ residual)
        parameters = parameters - step
        if np.abs(jacobian @ step / np.sqrt(np.diag(covariance))).max() <= 1e-6 or (
            np.abs(jacobian @ step).max() <= _TOLERANCE * x.max()
        ):
            return _solution(design, rung, parameters, net_covariance)
    raise CalibrationError(
        f"the {rung.kind} fit did not settle in {_MAX_ROUNDS} rounds: {_CHECK}"
        if rung.bracket is None
        else _CONTRADICTS
    )


def _solution(design: Design, rung: Rung, parameters: Array, net_covariance: Array) -> Solution:
    if not rung.rises(parameters[: rung.n_parameters]):
        raise CalibrationError(f"the {rung.kind} response does not rise with the light: {_CHECK}")
    luminance, slope, jacobian = _evaluate(design, rung, parameters, design.net_dn)
    covariance = design.patch_covariance(luminance) + slope[:, None] * net_covariance * slope
    normal = jacobian.T @ np.linalg.inv(covariance)
    by_shape = luminance * rung.errors(design.net_dn)
    covariance = covariance + by_shape.T @ by_shape
    weight = np.linalg.inv(covariance)
    columns = weight @ jacobian
    left = weight - columns @ np.linalg.solve(jacobian.T @ columns, columns.T)
    return Solution(
        design=design,
        rung=rung,
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


def _start(design: Design, rung: Rung) -> Array:
    """Return a straight line, or the given response, by the median ratio for each gain."""
    ratio = design.readings / (rung.shape(design.net_dn) * design.scale_per_s)
    n_gains = int(design.gain.max()) + 1
    slopes = [float(np.median(ratio[design.gain == g])) for g in range(n_gains)]
    return np.concatenate([rung.start(slopes[0]), np.array(slopes[1:]) / slopes[0]])


def _evaluate(design: Design, rung: Rung, parameters: Array, net_dn: Array) -> tuple[Array, Array, Array]:
    """Luminances, slopes and Jacobian at signals."""
    n = rung.n_parameters
    inverse_factor = np.concatenate([[1.0], parameters[n:]])[design.gain]
    curve = rung.curve(parameters[:n], net_dn)
    scale = design.scale_per_s * inverse_factor
    by_factor = [
        np.where(design.gain == g + 1, design.scale_per_s * curve.value, 0.0) for g in range(len(parameters) - n)
    ]
    jacobian = np.column_stack([scale[:, None] * curve.jacobian, *by_factor])
    return scale * curve.value, scale * curve.slope, jacobian
