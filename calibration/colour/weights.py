"""Weights of the colours of a Bayer sensor in the luminance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.result import Finding, warning
from ...core.spectra import Source, SpectralTable, least_f1_prime, response_per_luminance
from ..fitting.scatter import scatter_around_mean
from ..model import Calibration
from .conversion import COLOURS, colours_of_planes

Array = NDArray[np.float64]

#: Colourfulness below which colour does not explain scatter.
_COLOURED = 0.05
#: Standard deviation of the true weights from those of least noise: cameras have 0.1 to 0.4 for red, 0.6 to 1 for
#: green, and -0.2 to 0.1 for blue.
_NOISE_WIDTH = 0.5
#: Standard deviation of the true weights from those by spectral sensitivities, which are known to a few percent.
_SPECTRAL_WIDTH = 0.1
#: Share of saturation at which noises are compared.
_EXPOSED = 0.5


@dataclass(frozen=True, eq=False)
class ColourData:
    """Patches measured by each colour, relative to the meter's reading.

    Parameters
    ----------
    relative : ndarray of float, shape (n patches, k colours)
        Luminance by one colour, over the reading.
    own_rel : ndarray of float, shape (n, k)
        Relative standard uncertainty independent from colour to colour: noise, pixels, dark signal.
    shared_rel : ndarray of float, shape (n,)
        Relative standard uncertainty common to all colours: meter, non-uniformity, scatter.
    colourfulness : ndarray of float, shape (n,)
        Standard deviation of the luminances by R, G and B over their mean; 0 in the calibration's light.
    """

    relative: Array
    own_rel: Array
    shared_rel: Array
    colourfulness: Array

    @property
    def dof(self) -> int:
        """Degrees of freedom of the scatter by colour: coloured patches less weights."""
        return max(int(np.count_nonzero(self.colourfulness >= _COLOURED)) - int(self.relative.shape[1]), 1)

    def without(self, patch: int) -> ColourData:
        """Return all patches but one."""
        rest = np.arange(len(self.relative)) != patch
        return ColourData(self.relative[rest], self.own_rel[rest], self.shared_rel[rest], self.colourfulness[rest])

    def only(self, colour: int) -> ColourData:
        """Return a single colour of all patches."""
        return replace(self, relative=self.relative[:, [colour]], own_rel=self.own_rel[:, [colour]])

    def variance(self, weights: Array, spectral: float) -> Array:
        """Variance of the combination over the reading, shape (n,)."""
        by_colour = (self.relative * self.own_rel) ** 2 @ weights**2
        return by_colour + self.shared_rel**2 + (spectral * self.colourfulness) ** 2


@dataclass(frozen=True, eq=False)
class Prior:
    """Prior of the weights.

    Parameters
    ----------
    weights : ndarray of float, shape (k,)
        They sum to 1.
    width : float
        Standard deviation of the true weights around these.
    """

    weights: Array
    width: float

    @property
    def root(self) -> Array:
        """Square root of the prior's information, shape (k, k); it is uninformative about the sum of the weights."""
        k = self.weights.size
        return (np.eye(k) - np.ones((k, k)) / k) / self.width


@dataclass(frozen=True, eq=False)
class Combination:
    """Fitted weights with their uncertainty.

    Parameters
    ----------
    weights : ndarray of float, shape (k,)
        Weights of the colours' luminances; their sum is about 1.
    covariance : ndarray of float, shape (k, k)
        Of the weights.
    spectral : float
        Relative standard deviation, per unit of colourfulness, of deviations that no weights explain, since V(lambda)
        is not a combination of the colours.
    dof : int
        Degrees of freedom of `spectral`.
    deviation, uncertainty : ndarray of float, shape (n,)
        Of the combination over the reading, minus 1, and its standard uncertainty.
    """

    weights: Array
    covariance: Array
    spectral: float
    dof: int
    deviation: Array
    uncertainty: Array

    @property
    def spectral_rel(self) -> float:
        """Standard uncertainty of another patch by its colour, per unit of colourfulness.

        That of Student's distribution with the `dof` of `spectral` (JCGM 101:2008, 6.4.9.7), 3 at least.
        """
        dof = max(self.dof, 3)
        return self.spectral * sqrt(dof / (dof - 2))

    @property
    def undetermined(self) -> float:
        """Largest standard uncertainty of a change of the weights at constant sum."""
        k = self.weights.size
        projection = np.eye(k) - np.ones((k, k)) / k
        return float(np.sqrt(max(np.linalg.eigvalsh(projection @ self.covariance @ projection)[-1], 0.0)))


def combine(data: ColourData, prior: Prior) -> Combination:
    """Fit the weights and the scatter of the patches by colour.

    The scatter is the smallest for which chi^2 of the coloured patches is at most their degrees of freedom (R. C. Paule
    and J. Mandel, J. Res. Natl. Bur. Stand. 87 (1982) 377). Grey patches have no such scatter.
    """
    from scipy.optimize import brentq

    coloured = data.colourfulness >= _COLOURED
    dof = data.dof

    def chi_squared(combination: Combination) -> float:
        return float(np.sum((combination.deviation / combination.uncertainty)[coloured] ** 2))

    simplest = _solve(data, prior, 0.0)
    if chi_squared(simplest) <= dof:
        return simplest
    widest = _solve(data, prior, 1.0)
    if chi_squared(widest) > dof:
        return widest
    return _solve(data, prior, brentq(lambda spectral: chi_squared(_solve(data, prior, spectral)) - dof, 0.0, 1.0))


def scattered(data: ColourData, weights: Array, grey: NDArray[np.bool_]) -> tuple[ColourData, tuple[float, float]]:
    """Add the scatter of the grey patches that nothing explains; return it too, with its degrees of freedom.

    Light and readings scatter alike in all colours: what counts is the scatter of their combination, in which the noise
    of the colours averages.
    """
    scatter = scatter_around_mean((data.relative @ weights - 1)[grey], data.variance(weights, 0.0)[grey])
    return replace(data, shared_rel=np.hypot(data.shared_rel, scatter[0])), scatter


def leave_one_out(data: ColourData, prior: Prior, spectral: float) -> Array:
    """Deviation of each patch from weights that were fitted without it, shape (n,)."""
    return np.array(
        [data.relative[i] @ _solve(data.without(i), prior, spectral).weights - 1 for i in range(len(data.relative))]
    )


def _solve(data: ColourData, prior: Prior, spectral: float) -> Combination:
    """Minimise chi^2 with the variances of the combination itself: errors in both, and the prior."""
    from scipy.optimize import least_squares

    root = prior.root

    def residuals(weights: Array) -> Array:
        deviation = data.relative @ weights - 1
        standardised = deviation / np.sqrt(data.variance(weights, spectral))
        return np.concatenate([standardised, root @ (weights - prior.weights)])

    solution = least_squares(residuals, prior.weights, method="lm", xtol=1e-12, ftol=1e-12)
    weights: Array = solution.x
    uncertainty = np.sqrt(data.variance(weights, spectral))
    design = np.vstack([data.relative / uncertainty[:, None], root])
    covariance = np.linalg.pinv(design.T @ design)
    return Combination(weights, covariance, spectral, data.dof, data.relative @ weights - 1, uncertainty)


def choose_prior(
    planes: Sequence[Calibration], sensitivities: Mapping[str, SpectralTable] | None, source: Source
) -> tuple[Prior, Mapping[str, SpectralTable] | None, list[Finding]]:
    """Return the weights of least noise, or with spectral sensitivities those of the smallest f1'.

    Of uncorrelated L_p with equal mean, the weighted mean with weights inverse to the variances has the least
    variance; all of them are positive.

    Parameters
    ----------
    planes : sequence of Calibration
        Fitted planes.
    sensitivities : mapping of str to SpectralTable or None
        Of R, G and B; their scales do not matter.
    source : str or SpectralTable
        Light of the calibration.

    Returns
    -------
    Prior
        Prior weights of R, G and B with their uncertainty.
    mapping of str to SpectralTable or None
        Their sensitivities, each scaled to the light of the calibration; None if they are not known.
    list of Finding
        Findings for the user.

    Raises
    ------
    InputError
        If sensitivities are not those of R, G and B.
    """
    inverse = 1 / _relative_variance(planes)
    of_noise = Prior(inverse / inverse.sum(), _NOISE_WIDTH)
    if sensitivities is None:
        return of_noise, None, []
    if set(sensitivities) != set(COLOURS):
        raise InputError(
            f"the spectral sensitivities are those of {', '.join(sensitivities)}: a camera with colour filters needs "
            "R, G and B"
        )
    try:
        scaled = {colour: _scaled_to(source, sensitivities[colour]) for colour in COLOURS}
    except InputError as error:
        return of_noise, None, [warning("sensitivities-not-used", reason=str(error))]
    weights = least_f1_prime(scaled)
    total = sum(weights.values())
    return Prior(np.array([weights[c] / total for c in COLOURS]), _SPECTRAL_WIDTH), scaled, []


def _scaled_to(source: Source, table: SpectralTable) -> SpectralTable:
    factor = 1 / response_per_luminance(table, source)
    return SpectralTable(table.wavelength_nm, tuple(factor * value for value in table.values))


def _relative_variance(planes: Sequence[Calibration]) -> Array:
    """Relative variance of a pixel by each colour, where the most sensitive plane is at half its saturation."""
    responsivity = np.array([plane.responsivity.responsivity_dn_s_cd_m2 for plane in planes])
    brightest = planes[int(np.argmax(responsivity))]
    span_dn = brightest.state.saturation_dn - brightest.dark.offset_dn
    net_dn = _EXPOSED * span_dn * responsivity / responsivity.max()
    # Without noise all planes have equal weights.
    variance = np.array(
        [max(plane.noise.variance_dn2(n), 1e-12) / n**2 for plane, n in zip(planes, net_dn, strict=True)]
    )
    to_colour = colours_of_planes(planes)
    return variance @ to_colour**2
