"""Prior weights of the colours: those of least noise, or of the smallest f1'."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from ...core.finding import Finding, warning
from ...core.spectral.mismatch import Source, least_f1_prime, response_per_luminance
from ...core.spectral.table import SpectralTable
from ..model import Calibration
from .combination import Array, Prior
from .planes import COLOURS, colours_of_planes

#: Standard deviation of the true weights from those of least noise: cameras have 0.1 to 0.4 for red, 0.6 to 1 for
#: green, and -0.2 to 0.1 for blue.
_NOISE_WIDTH = 0.5
#: Standard deviation of the true weights from those by spectral sensitivities, which are known to a few percent.
_SPECTRAL_WIDTH = 0.1
#: Share of saturation at which noises are compared.
_EXPOSED = 0.5


@dataclass(frozen=True, eq=False)
class ColourPrior:
    """Prior of the weights and related quantities.

    Parameters
    ----------
    prior : Prior
        Prior weights of R, G and B with their uncertainty.
    sensitivities : mapping of str to SpectralTable or None
        Standard deviations of the luminances by R, G and B, each scaled to the light of the calibration.
    findings : tuple of Finding
        Findings for the user.
    """

    prior: Prior
    sensitivities: Mapping[str, SpectralTable] | None
    findings: tuple[Finding, ...]


def choose_prior(
    planes: Sequence[Calibration], sensitivities: Mapping[str, SpectralTable] | None, source: Source
) -> ColourPrior:
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

    Raises
    ------
    InputError
        If sensitivities are not those of R, G and B.
    """
    inverse = 1 / _relative_variance(planes)
    of_noise = Prior(inverse / inverse.sum(), _NOISE_WIDTH)
    if sensitivities is None:
        return ColourPrior(of_noise, None, ())
    if set(sensitivities) != set(COLOURS):
        raise InputError(
            f"the spectral sensitivities are those of {', '.join(sensitivities)}: a camera with colour filters needs "
            "R, G and B"
        )
    try:
        scale = {colour: 1 / response_per_luminance(sensitivities[colour], source) for colour in COLOURS}
    except InputError as error:
        return ColourPrior(of_noise, None, (warning("sensitivities-not-used", reason=str(error)),))
    right = {colour: _scaled(sensitivities[colour], scale[colour]) for colour in COLOURS}
    weights = least_f1_prime(right)
    total = sum(weights.values())
    return ColourPrior(Prior(np.array([weights[c] / total for c in COLOURS]), _SPECTRAL_WIDTH), right, ())


def _scaled(table: SpectralTable, factor: float) -> SpectralTable:
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
    result: Array = variance @ to_colour**2
    return result
