"""How well a spectral sensitivity imitates V(lambda): f1', and mismatch factors between light sources."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError
from ..finding import Finding, FindingValue, info, warning
from .photometry import THESIS_SPECTRUM, WAVELENGTH_RANGE_NM, spectral_weights
from .table import SpectralTable

#: A light source: by the name of its spectrum, as `labcdp.core.spectral.photometry` knows it, or measured.
Source = str | SpectralTable

#: Illuminants of a table of mismatch factors: incandescent, daylight, LED, and a fluorescent lamp of each group.
COMMON_ILLUMINANTS = (
    "A", "D50", "D65", "E", "LED-B1", "LED-B2", "LED-B3", "LED-B4", "LED-B5", "LED-BH1", "LED-RGB1", "LED-V1",
    "LED-V2", "FL2", "FL7", "FL11", "HP1", "HP4",
)  # fmt: skip

#: Relative change of a luminance below which another light does no harm worth a number.
_NEGLIGIBLE = 0.001


def f1_prime(sensitivity: SpectralTable) -> float:
    """General V(lambda) mismatch index f1' of a sensitivity, as a fraction.

    f1' = integral |s*(lambda) - V(lambda)| / integral V(lambda), 380 to 780 nm, with s* = s times integral(S_A V) /
    integral(S_A s), S_A the CIE illuminant A (ISO/CIE 19476:2014, CIE S 023, section 5.2.2).

    Parameters
    ----------
    sensitivity : SpectralTable
        Relative sensitivity to radiant power.
    """
    nm, illuminant_a, visibility = spectral_weights("A")
    s = sensitivity.at(nm)
    matched = s * (illuminant_a @ visibility) / _seen(float(illuminant_a @ s), "A")
    return float(np.abs(matched - visibility).sum() / visibility.sum())


def mismatch_factor(sensitivity: SpectralTable, test: Source, calibration: Source) -> float:
    """Spectral mismatch correction factor F: the true luminance over the indicated one.

    F = integral(S_t V) integral(S_c s) / (integral(S_t s) integral(S_c V)) (ISO/CIE 19476:2014, CIE S 023, section
    5.2.3, there for calibration in illuminant A). Multiply a luminance that was measured in the light S_t, with a
    calibration in the light S_c, by F.

    Parameters
    ----------
    sensitivity : SpectralTable
        Relative sensitivity to radiant power.
    test, calibration : str or SpectralTable
        The light that is measured, and the light of the calibration.

    Raises
    ------
    InputError
        If a source is not known, or the sensitivity sees none of its light.
    """
    return response_per_luminance(sensitivity, calibration) / response_per_luminance(sensitivity, test)


def response_per_luminance(sensitivity: SpectralTable, source: Source) -> float:
    """Response of a sensitivity to a light over that of V(lambda), integral(S s) / integral(S V).

    Raises
    ------
    InputError
        If the source is not known, or the sensitivity sees none of its light.
    """
    nm, power, visibility = _nodes(source)
    luminance = _seen(float(power @ visibility), _name(source))
    return _seen(float(power @ sensitivity.at(nm)), _name(source)) / luminance


def least_f1_prime(sensitivities: Mapping[str, SpectralTable]) -> dict[str, float]:
    """Weights of the sum of sensitivities with the smallest f1'.

    With each sensitivity scaled to the same integral with illuminant A, f1' of a sum with weights b, sum b = 1, is a
    sum of absolute values that are linear in b: the minimum is that of a linear program.

    Parameters
    ----------
    sensitivities : mapping of str to SpectralTable
        Of the planes, relative to radiant power.

    Returns
    -------
    dict of str to float
        Factors of the sensitivities as given, scaled so that the sum has the response of V(lambda) to illuminant A.
    """
    from scipy.optimize import linprog

    nm, illuminant_a, visibility = spectral_weights("A")
    light = float(illuminant_a @ visibility)
    scale = {name: light / _seen(float(illuminant_a @ one.at(nm)), "A") for name, one in sensitivities.items()}
    matched = np.column_stack([scale[name] * one.at(nm) for name, one in sensitivities.items()])
    n, planes = matched.shape
    # Variables: b, and for each wavelength a bound u >= |sum b s* - V|.
    cost = np.concatenate([np.zeros(planes), np.ones(n)])
    above = np.block([[matched, -np.eye(n)], [-matched, -np.eye(n)]])
    limits = np.concatenate([visibility, -visibility])
    sum_of_b = np.concatenate([np.ones(planes), np.zeros(n)])[None]
    bounds = [(None, None)] * planes + [(0, None)] * n
    found = linprog(cost, A_ub=above, b_ub=limits, A_eq=sum_of_b, b_eq=[1.0], bounds=bounds, method="highs")
    assert found.x is not None, found.message  # feasible for any b, and bounded below by 0
    return {name: float(b) * scale[name] for name, b in zip(sensitivities, found.x[:planes], strict=True)}


def weighted_sum(sensitivities: Mapping[str, SpectralTable], weights: Mapping[str, float]) -> SpectralTable:
    """Sensitivity of a weighted sum of planes, at 1 nm from 380 to 780 nm.

    Raises
    ------
    InputError
        If the sum has no value above 0.
    """
    first, last = WAVELENGTH_RANGE_NM
    nm = np.arange(first, last + 1)
    total = np.sum([weights[name] * one.at(nm) for name, one in sensitivities.items()], axis=0)
    return SpectralTable(tuple(nm.tolist()), tuple(total.tolist()))


def mismatch_findings(
    calibration_source: Source, session_source: Source, sensitivity: SpectralTable | None
) -> list[Finding]:
    """Return what it costs to measure in another light than that of the calibration.

    Parameters
    ----------
    calibration_source, session_source : str or SpectralTable
        The two lights; two are the same if they are equal.
    sensitivity : SpectralTable or None
        Of the calibrated camera, None if it is not known.

    Returns
    -------
    list of Finding
        One, or none in the same light.
    """
    if calibration_source == session_source:
        return []
    lights = {"calibrated": _name(calibration_source), "measured": _name(session_source)}
    if sensitivity is None:
        return [warning("light-differs", **lights)]
    try:
        factor = mismatch_factor(sensitivity, session_source, calibration_source)
    except InputError as error:
        return [warning("light-differs-unknown", **lights, reason=str(error))]
    deviation = 1 / factor - 1
    values: dict[str, FindingValue] = {**lights, "deviation_rel": deviation, "f1_prime": f1_prime(sensitivity)}
    if abs(deviation) < _NEGLIGIBLE:
        return [info("light-differs-negligible", **values)]
    return [warning("light-differs-by", **values, factor=factor)]


def _name(source: Source) -> str:
    return source if isinstance(source, str) else "a measured"


def _nodes(source: Source) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    if source == THESIS_SPECTRUM:
        raise InputError(f"{THESIS_SPECTRUM} is a conversion and no spectrum: name the spectrum of the light")
    if isinstance(source, str):
        return spectral_weights(source)
    nm, _, visibility = spectral_weights("E")
    return nm, source.at(nm), visibility


def _seen(integral: float, source: str) -> float:
    if not integral > 0:
        raise InputError(f"nothing of {source} light is seen between 380 and 780 nm: check both spectra")
    return integral
