"""Photometry: how many photons, and how many electrons, one candela per square metre is.

For a spectrum S the luminance is K_cd times the integral of S(lambda) V(lambda), the photon radiance the
integral of S(lambda) lambda / (h c). Their ratio depends on the spectrum alone. It is the same for every pair
of photometric and photon quantity, so photons s^-1 m^-2 sr^-1 per cd/m^2 are also photons s^-1 m^-2 per lux.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from math import pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .disk.files import MOST_QUOTED, shown
from .errors import InputError

#: K_cd, lumen per watt at 540 THz; exact, SI Brochure 9th edition, section 2.2.
LUMINOUS_EFFICACY_LM_W = 683.0
#: h in J s; exact, SI Brochure 9th edition, section 2.2.
PLANCK_J_S = 6.62607015e-34
#: c in m/s; exact, SI Brochure 9th edition, section 2.2.
SPEED_OF_LIGHT_M_S = 299792458.0
#: First and last wavelength of the integrals, in nanometres: the range of the CIE tables of illuminants.
WAVELENGTH_RANGE_NM = (380.0, 780.0)

#: Shortest and longest wavelength of a quantum efficiency, so that those in um or m are refused.
_SHORTEST_NM, _LONGEST_NM = 100, 3000

#: One quantum efficiency for all wavelengths, or (wavelength_nm, value) pairs with rising wavelength.
QuantumEfficiency = float | tuple[tuple[float, float], ...]

#: Light by its name, or as (wavelength_nm, relative radiant power) pairs.
Light = str | tuple[tuple[float, float], ...]

#: A name that ends with a number.
_NUMBERED = re.compile(r"(.*?)([0-9]+)")
#: Name of the thesis' conversion: light of 500 nm at 1000 lm/W, more than the 683 lm/W there can be (L. Ebbert,
#: Implementierung von CDP, 2018); 2.517e15 photons s^-1 m^-2 sr^-1 per cd/m^2.
THESIS_SPECTRUM = "thesis-2018"
_THESIS_WAVELENGTH_NM, _THESIS_EFFICACY_LM_W = 500.0, 1000.0

_MONOCHROMATIC = re.compile(r"monochromatic (\d+(?:\.\d+)?) nm")
_OBSERVER = "CIE 1924 Photopic Standard Observer"
_COLOUR_OBSERVER = "CIE 1931 2 Degree Standard Observer"


def photon_radiance_per_cd_m2(spectrum: str) -> float:
    """Photons s^-1 m^-2 sr^-1 for a luminance of 1 cd/m^2.

    Parameters
    ----------
    spectrum : str
        A CIE illuminant as colour-science names it (``D65``, ``A``, ``LED-B1``), or ``monochromatic 555 nm``
        with any wavelength from 380 to 780 nm, or ``thesis-2018`` (`THESIS_SPECTRUM`) to repeat published values.

    Returns
    -------
    float
        Photon radiance per luminance; numerically also photons per lumen-second.

    Raises
    ------
    InputError
        If the spectrum is not known; the message lists the names.
    """
    return _electrons_per_lm_s(spectrum, 1.0)


def electron_radiance_per_cd_m2(
    spectrum: Light,
    quantum_efficiency: float | Sequence[tuple[float, float]],
    reflectance: Sequence[tuple[float, float]] = (),
) -> float:
    """Electrons s^-1 m^-2 sr^-1 a detector frees for 1 cd/m^2: the photons weighted with QE(lambda).

    Parameters
    ----------
    spectrum : str or tuple of (float, float)
        As for `photon_radiance_per_cd_m2`, or a table of rising wavelengths in nm and relative radiant power: linear
        between them, zero outside.
    quantum_efficiency : float or sequence of (float, float)
        A constant, or (wavelength_nm, value) pairs; linear between them, zero outside the table.
    reflectance : sequence of (float, float)
        Of a surface that reflects the light, as pairs likewise; () for a neutral one. The luminance is that of the
        reflected light.

    Raises
    ------
    InputError
        If the spectrum is not known, or the quantum efficiency or reflectance not usable.
    """
    return _electrons_per_lm_s(spectrum, as_quantum_efficiency(quantum_efficiency), as_reflectance(reflectance))


def as_reflectance(value: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Return a reflectance in its hashable form.

    Raises
    ------
    InputError
        If it has no two pairs of rising wavelengths in nm and values of at least 0, not all of them 0.
    """
    if isinstance(value, list | tuple) and not value:
        return ()
    try:
        table = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        table = np.empty((0, 0))
    usable = table.ndim == 2 and table.shape[1] == 2 and len(table) > 1 and not holds_truth_value(value)
    if not usable or not ((np.diff(table[:, 0]) > 0).all() and (table[:, 1] >= 0).all() and table[:, 1].any()):
        raise InputError(
            f"reflectance is {shown(value)}: give pairs of rising wavelength in nm and a value of at least 0",
            key="reflectance",
        )
    return tuple((float(wavelength), float(share)) for wavelength, share in table)


def axial_illuminance_per_cd_m2(f_number: float, transmittance: float, magnification: float) -> float:
    """Illuminance in lux on the optical axis for 1 cd/m^2: pi t / (4 N^2 (1 + m)^2).

    With N = 1 / (2 sin(theta')), the f-number of a lens that obeys the sine condition, pi / (4 N^2) is exact for a
    distant scene. The form pi / (1 + 4 N^2) takes N for a tangent; at f/1.4 the exact one is 13 % larger. The image of
    a near scene lies 1 + m times as far behind a symmetric lens, so the working f-number is N (1 + m) (S. F. Ray,
    Applied Photographic Optics). Equation 3.1 of the thesis prints (1 + m) without the square; its values have m = 0.

    Parameters
    ----------
    f_number : float
        N.
    transmittance : float
        t, fraction of the light the lens passes.
    magnification : float
        m, image size over object size; 0 for a distant scene.

    Examples
    --------
    >>> round(axial_illuminance_per_cd_m2(2.0, 0.9, 0.0), 4)
    0.1767
    """
    return pi * transmittance / (4 * (f_number * (1 + magnification)) ** 2)


def as_quantum_efficiency(value: float | Sequence[tuple[float, float]]) -> QuantumEfficiency:
    """Return a quantum efficiency in its hashable form.

    Raises
    ------
    InputError
        If a value is not from 0 to 1, or the table has fewer than two pairs, or wavelengths that do not rise or are
        outside 100 to 3000 nm.
    """
    try:
        table = np.asarray(value)
    except ValueError:
        table = np.empty((0, 0))
    # NumPy would take text and truth values for numbers, the latter also among numbers.
    numeric = table.dtype.kind in "iuf" and not holds_truth_value(value)
    table = table.astype(float) if numeric else np.empty((0, 0))
    if table.ndim == 0:
        if not 0 < table <= 1:
            raise InputError(
                f"quantum_efficiency is {value}: give a fraction above 0, up to 1", key="quantum_efficiency"
            )
        return float(table)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise InputError(
            f"quantum_efficiency is {shown(value)}: give a fraction, or at least two pairs of wavelength in nm and "
            "value",
            key="quantum_efficiency",
        )
    wavelengths, fractions = table.T
    if not (
        (wavelengths >= _SHORTEST_NM).all() and wavelengths[-1] <= _LONGEST_NM and (np.diff(wavelengths) > 0).all()
    ):
        found, limits = shown(wavelengths.tolist()), f"from {_SHORTEST_NM} to {_LONGEST_NM} nm"
        raise InputError(
            f"quantum_efficiency has the wavelengths {found} nm: give them in rising order, {limits}",
            key="quantum_efficiency",
        )
    if not ((fractions >= 0) & (fractions <= 1)).all():
        raise InputError(
            f"quantum_efficiency has the values {shown(fractions.tolist())}: give fractions from 0 to 1",
            key="quantum_efficiency",
        )
    return tuple((float(wavelength), float(fraction)) for wavelength, fraction in table)


def holds_truth_value(value: object) -> bool:
    """Whether a value, or one in its lists, is true or false."""
    if isinstance(value, list | tuple):
        return any(map(holds_truth_value, value))
    return isinstance(value, bool | np.bool_)


@lru_cache(maxsize=64)
def _electrons_per_lm_s(
    spectrum: Light, quantum_efficiency: QuantumEfficiency, reflectance: tuple[tuple[float, float], ...] = ()
) -> float:
    wavelength_nm, power, visibility = spectral_weights(spectrum)
    if reflectance:
        known, shares = np.array(reflectance).T
        power = power * np.interp(wavelength_nm, known, shares, left=0, right=0)
        if not (power * visibility).any():
            raise InputError(
                f"the reflectance leaves nothing of {spectrum!r} that is seen: correct it", key="reflectance"
            )
    if isinstance(quantum_efficiency, float):
        efficiency: NDArray[np.float64] | float = quantum_efficiency
    else:
        known, fractions = np.array(quantum_efficiency).T
        efficiency = np.interp(wavelength_nm, known, fractions, left=0, right=0)
    # Trapezoids: each end of the range stands for half a step. A single line stands for itself.
    step = np.ones(power.size)
    if power.size > 1:
        step[[0, -1]] = 0.5
    photons = power * step * wavelength_nm * 1e-9 / (PLANCK_J_S * SPEED_OF_LIGHT_M_S)
    return float(np.sum(photons * efficiency) / (LUMINOUS_EFFICACY_LM_W * np.sum(power * step * visibility)))


@lru_cache(maxsize=16)
def spectral_weights(spectrum: Light) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Nodes of the integrals over a spectrum: a sum over them takes the place of the integral.

    Parameters
    ----------
    spectrum : str or tuple of (float, float)
        As for `electron_radiance_per_cd_m2`.

    Returns
    -------
    wavelength_nm, power, visibility : ndarray of float, shape (n,)
        Wavelengths, the relative radiant power each stands for, and V(lambda) there; shared, not to be changed.

    Raises
    ------
    InputError
        If the spectrum is not known; the message lists the names.
    """
    if spectrum == THESIS_SPECTRUM:
        efficacy = np.array([_THESIS_EFFICACY_LM_W / LUMINOUS_EFFICACY_LM_W])
        return np.array([_THESIS_WAVELENGTH_NM]), np.ones(1), efficacy
    first, last = WAVELENGTH_RANGE_NM
    illuminants, observer = _colour_tables()
    if not isinstance(spectrum, str):
        wavelength_nm = np.arange(first, last + 1)
        known, powers = np.array(spectrum).T
        power = np.interp(wavelength_nm, known, powers, left=0, right=0)
    elif line := _MONOCHROMATIC.fullmatch(spectrum):
        wavelength_nm = np.array([float(line[1])])
        power = np.ones(1)
        if not first <= wavelength_nm[0] <= last:
            raise InputError(f"spectrum is {shown(spectrum)}: give a wavelength from {first:g} to {last:g} nm")
    elif spectrum in illuminants:
        # CIE 15: the integral is the sum over 1 nm steps, the tables are interpolated to them.
        wavelength_nm = np.arange(first, last + 1)
        table = illuminants[spectrum]
        power = np.interp(wavelength_nm, table.wavelengths, table.values, left=0, right=0)
    else:
        close = get_close_matches(str(spectrum)[:MOST_QUOTED], illuminants, n=3)
        meant = f"did you mean {' or '.join(close)}? Else " if close else ""
        raise InputError(
            f"spectrum is {shown(spectrum)}, which is not known: {meant}give 'monochromatic 555 nm', "
            f"{THESIS_SPECTRUM!r} or one of {_runs_text(illuminants)}"
        )
    return wavelength_nm, power, np.interp(wavelength_nm, observer.wavelengths, observer.values)


@lru_cache(maxsize=1)
def colour_matching() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Colour-matching functions of the CIE 1931 standard observer.

    Returns
    -------
    wavelength_nm : ndarray of float, shape (n,)
        At 1 nm; shared, not to be changed.
    functions : ndarray of float, shape (3, n)
        Of X, Y and Z; likewise.

    Examples
    --------
    >>> from labcdp.core.photometry import colour_matching
    >>> wavelength_nm, (x, y, z) = colour_matching()
    >>> int(wavelength_nm[y.argmax()])
    555
    """
    _colour_tables()  # imports colour-science without its warnings
    import colour

    table = colour.MSDS_CMFS[_COLOUR_OBSERVER]
    return np.asarray(table.wavelengths, dtype=float), np.asarray(table.values, dtype=float).T


def _runs_text(names: Iterable[str]) -> str:
    """Write names, of those that differ by a rising number the first and the last: FL1 to FL12."""
    runs: list[list[str]] = []
    for name in names:
        this, last = _NUMBERED.fullmatch(name), _NUMBERED.fullmatch(runs[-1][-1]) if runs else None
        if this is not None and last is not None and (last[1], int(last[2]) + 1) == (this[1], int(this[2])):
            runs[-1].append(name)
        else:
            runs.append([name])
    return ", ".join(", ".join(run) if len(run) < 3 else f"{run[0]} to {run[-1]}" for run in runs)


def source_names() -> list[str]:
    """Names of the light sources in tables; ``monochromatic 555 nm`` and the like are accepted in addition."""
    return list(_colour_tables()[0])


def _colour_tables() -> tuple[Mapping[str, Any], Any]:
    """Illuminants by name, and V(lambda), from colour-science."""
    # colour imports its plotting too: without Matplotlib, or with two of them, that warns, and the spectra do not
    # mind. It also switches NumPy to the print format of version 1.13 for the whole process.
    with warnings.catch_warnings(), np.printoptions():
        warnings.filterwarnings("ignore", message='"Matplotlib" related API features are not available')
        warnings.filterwarnings("ignore", message="Unable to import Axes3D")
        import colour
    # Only read here: `align` and `interpolate` of colour change these shared tables in place.
    return colour.SDS_ILLUMINANTS, colour.SDS_LEFS[_OBSERVER]
