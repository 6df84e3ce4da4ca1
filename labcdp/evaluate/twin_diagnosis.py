"""Which parameters of a twin the signals of the patches contradict."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..calibration import DarkObservation
from ..calibration.emva.result import Quantity
from .twin_corrected import LEFT_BY_FLAT_FIELD, LEFT_BY_LIBRARY, CorrectedTwin
from .twin_noise import known
from .twin_parameters import TwinParameters
from .twin_prediction import Mending
from .twin_rounding import DITHERED_DN2
from .twin_signal import PatchSignal, TwinPatch, longest_exposures, pattern_parts, variance_uncertainty

FloatArray = NDArray[np.float64]

#: Standard uncertainties from which on a deviation is reported: with some twenty patches, one in a hundred sessions.
_SIGNIFICANT = 3.5
#: Fewest patches that tell a parameter of the camera from a reading, and an offset from a slope.
_LEAST_PATCHES = 3


@dataclass(frozen=True)
class Finding:
    """A parameter that the signals of the patches contradict.

    Parameters
    ----------
    name : str
        The parameter in plain words.
    stated, needed : float
        What the twin has, and what the patches ask for.
    unit : str
        Of the two.
    z : float
        Their difference in its standard uncertainties.
    mending : Mending
        What makes the twin as needed.
    """

    name: str
    stated: float
    needed: float
    unit: str
    z: float
    mending: Mending

    def to_dict(self) -> dict[str, Any]:
        """Values JSON can hold."""
        return {
            "parameter": self.name,
            "stated": self.stated,
            "needed": self.needed,
            "unit": self.unit,
            "standardised_deviation": self.z,
        }


@dataclass(frozen=True, eq=False)
class Suspect:
    """A parameter that may be off.

    Parameters
    ----------
    direction : ndarray of float, shape (n,)
        Change of the n values by one unit of the parameter.
    finding : callable
        Makes a finding of the change that is needed, and of that in its standard uncertainties.
    only_more : bool
        Whether it can only be more than it is.
    """

    direction: FloatArray
    finding: Callable[[float, float], Finding]
    only_more: bool = False


def diagnose(
    corrected: CorrectedTwin, patches: Sequence[TwinPatch], darks: Sequence[DarkObservation]
) -> tuple[Finding, ...]:
    """Find the parameters that the patches' signals contradict, the strongest contradiction first.

    A CDP cannot tell a noisier camera from a brighter patch; the signals can. Means tell the responsivity (all off by
    one factor), stray light (by one luminance), the black level (by one DN, dark frames too) and single readings. The
    temporal variance, which grows from the read noise with K times the signal, tells these two; the spatial one, which
    grows from the DSNU with the squared PRNU times the squared signal, tells those (EMVA 1288). Noise is compared at
    the mean that was measured, so that a wrong mean does not look like wrong noise. It takes all exposures, since only
    short ones of dark patches show the noise of darkness; the mean takes one for each patch, as small departures from
    linearity would stand out of the little noise that means have. Where noise is less than the converter's step, its
    variance depends on where between two DN the mean lies; such signals tell nothing of the noise.

    Parameters
    ----------
    corrected : CorrectedTwin
        The twin, and what the signals were corrected for.
    patches : sequence of TwinPatch
        Its patches, each at all exposures that do not saturate it.
    darks : sequence of DarkObservation
        Dark frames of the same session.
    """
    twin = corrected.uncorrected
    found = _of_means(twin, longest_exposures(patches), darks)
    dithered = [patch for patch in patches if _is_dithered(patch.predicted) and _is_dithered(patch.measured)]
    if len(dithered) >= _LEAST_PATCHES:
        darkness_dn = sum(one.mending.darkness_dn for one in found)
        net, shift = _net_dn(twin, dithered, darkness_dn)
        found += [*_of_temporal_noise(twin, dithered, net, shift), *_of_fixed_pattern(corrected, dithered, net, shift)]
    return tuple(sorted(found, key=lambda one: -abs(one.z)))


def _is_dithered(signal: PatchSignal) -> bool:
    return signal.temporal_dn[0] ** 2 >= DITHERED_DN2


def pursue(values: FloatArray, covariance: FloatArray, suspects: Sequence[Suspect]) -> list[Finding]:
    """Name the suspects that explain values which should be 0.

    Each suspect's change is estimated alone by generalised least squares; the most significant one is taken, then that
    which is most significant beside it, until none is (score tests of a growing model). The changes of those taken are
    estimated together.

    Parameters
    ----------
    values : ndarray of float, shape (n,)
        Measured less predicted.
    covariance : ndarray of float, shape (n, n)
        Of the values.
    suspects : sequence of Suspect
        What may be off.
    """
    # In units of each value's own uncertainty, as they span decades.
    unit = np.sqrt(np.diag(covariance))
    white = np.linalg.inv(np.linalg.cholesky(covariance / np.outer(unit, unit)))
    y, directions = white @ (values / unit), [white @ (one.direction / unit) for one in suspects]
    taken: list[int] = []
    for _ in suspects:
        left = y - _projected(y, [directions[i] for i in taken])
        z = np.zeros(len(suspects))
        for i, direction in enumerate(directions):
            own = direction - _projected(direction, [directions[j] for j in taken])
            size = float(np.linalg.norm(own))
            # What is left of a direction that those taken hold is rounding.
            if i not in taken and size > 1e-3 * np.linalg.norm(direction):
                z[i] = own @ left / size
        z[[i for i, one in enumerate(suspects) if one.only_more and z[i] < 0]] = 0.0
        strongest = int(np.argmax(abs(z)))
        if abs(z[strongest]) <= _SIGNIFICANT:
            break
        taken.append(strongest)
    if not taken:
        return []
    design = np.stack([directions[i] for i in taken], axis=1)
    inverse = np.linalg.inv(design.T @ design)
    change = inverse @ (design.T @ y)
    z = change / np.sqrt(np.diag(inverse))
    return [suspects[i].finding(float(c), float(of)) for i, c, of in zip(taken, change, z, strict=True)]


def _projected(vector: FloatArray, onto: Sequence[FloatArray]) -> FloatArray:
    """Part of a vector in the space of others."""
    if not onto:
        return np.zeros_like(vector)
    base, _ = np.linalg.qr(np.stack(onto, axis=1))
    result: FloatArray = base @ (base.T @ vector)
    return result


def _of_means(twin: TwinParameters, patches: Sequence[TwinPatch], darks: Sequence[DarkObservation]) -> list[Finding]:
    """Compare the means of the patches, and below them those of the dark frames, which no light changes."""
    none = np.zeros(len(darks))
    slope = np.append([patch.dn_per_cd_m2 for patch in patches], none)
    light = np.append([patch.dn_per_cd_m2 * patch.luminance_cd_m2 for patch in patches], none)
    by_r = known(twin.responsivity) / twin.responsivity.value * light
    places = [(patch.exposure_s, twin.temperature_c) for patch in patches]
    places += [
        (dark.exposure_s, twin.temperature_c if dark.temperature_c is None else dark.temperature_c) for dark in darks
    ]
    sensitivity = np.array([twin.dark.sensitivities(*place) for place in places])
    by_dark = sensitivity @ np.array(twin.dark.covariance) @ sensitivity.T
    both = np.array([(*patch.measured.mean_dn, *patch.predicted.mean_dn) for patch in patches])
    n = len(patches)
    of_patches = both[:, 1] ** 2 + np.maximum(both[:, 3] ** 2 - by_r[:n] ** 2 - np.diag(by_dark)[:n], 0.0)
    # A darkness that is not even is not known better than that.
    of_darks = [dark.mean_variance_dn2 + twin.dark.nonuniformity_dn**2 for dark in darks]
    covariance = np.diag([*of_patches, *of_darks]) + np.outer(by_r, by_r) + by_dark
    dark_dn = [twin.dark.mean_dn(*place) for place in places[n:]]
    values = np.append(both[:, 0] - both[:, 2], [dark.mean_dn for dark in darks] - np.array(dark_dn))
    suspects = [_reading(patch, at) for patch, at in zip(patches, np.diag(light), strict=False)]
    if len(patches) >= _LEAST_PATCHES:
        suspects += [_responsivity(twin, light), _stray_light(slope), _black_level(twin, slope)]
    return pursue(values, covariance, suspects)


def _reading(patch: TwinPatch, direction: FloatArray) -> Suspect:
    def finding(change: float, z: float) -> Finding:
        name, stated = f"meter reading of {patch.name}", patch.luminance_cd_m2
        mending = Mending(patch=patch.name, light_rel=change)
        return Finding(name, stated, stated * (1 + change), "cd/m2", z, mending)

    return Suspect(direction, finding)


def _responsivity(twin: TwinParameters, light: FloatArray) -> Suspect:
    r = twin.responsivity

    def finding(change: float, z: float) -> Finding:
        return Finding("responsivity", r.value, r.value * (1 + change), r.unit, z, Mending(light_rel=change))

    return Suspect(light, finding)


def _stray_light(slope: FloatArray) -> Suspect:
    def finding(change: float, z: float) -> Finding:
        return Finding("stray light", 0.0, change, "cd/m2", z, Mending(light_cd_m2=change))

    return Suspect(slope, finding, only_more=True)


def _black_level(twin: TwinParameters, slope: FloatArray) -> Suspect:
    stated = twin.dark.offset_dn

    def finding(change: float, z: float) -> Finding:
        return Finding("black level", stated, stated + change, "DN", z, Mending(darkness_dn=change))

    return Suspect(np.ones_like(slope), finding)


def _of_temporal_noise(
    twin: TwinParameters, patches: Sequence[TwinPatch], net: FloatArray, shift: FloatArray
) -> list[Finding]:
    noise, k = twin.noise, twin.noise.k_dn_per_e
    dark_dn_s = twin.dark_current_e_s.value * k.value
    signal = net + dark_dn_s * np.array([patch.exposure_s for patch in patches])
    values, own = _variances("temporal_dn", patches)
    read = noise.read_noise_dn
    by_read = variance_uncertainty(read.value, known(read)) * np.ones_like(signal)
    by_k = known(k) * signal
    covariance = np.diag(own**2) + np.outer(by_read, by_read) + np.outer(by_k, by_k)

    def of_k(change: float, z: float) -> Finding:
        # Less than nothing is none; as good as none keeps the electrons finite.
        needed = replace(k, value=max(k.value + change, 1e-3 * k.value))
        return Finding("system gain K", k.value, needed.value, "DN/e-", z, Mending({"k_dn_per_e": needed}))

    suspects = [
        _of_square("read noise", "read_noise_dn", read, np.ones_like(signal), (1 / k.value, "e-")),
        Suspect(signal, of_k),
    ]
    return pursue(values - k.value * shift, covariance, suspects)


def _of_fixed_pattern(
    corrected: CorrectedTwin, patches: Sequence[TwinPatch], net: FloatArray, shift: FloatArray
) -> list[Finding]:
    exposures_s = [patch.exposure_s for patch in patches]
    noises = [corrected.at(t).noise for t in exposures_s]
    values, own = _variances("spatial_dn", patches)
    parts = [pattern_parts(*one) for one in zip(noises, net, exposures_s, strict=True)]
    covariance = np.diag(own**2)
    for of_patches in zip(*parts, strict=True):
        by = np.array([variance_uncertainty(q.value, known(q)) * factor**2 for q, factor in of_patches])
        covariance += np.outer(by, by)
    taken_off = np.array([corrected.takes_pattern_off(t) for t in exposures_s])
    suspects = [_dark_pattern(corrected, patches, taken_off == off) for off in sorted(set(taken_off.tolist()))]
    name = "PRNU" if corrected.flat_field is None else LEFT_BY_FLAT_FIELD
    prnu = noises[0].prnu_rel
    suspects.append(_of_square(name, "prnu_rel", prnu, net**2, (1.0, "1")))
    return pursue(values - prnu.value**2 * (net**2 - (net - shift) ** 2), covariance, suspects)


def _dark_pattern(corrected: CorrectedTwin, patches: Sequence[TwinPatch], where: NDArray[np.bool_]) -> Suspect:
    """Suspect the pattern of the darkness at exposures all of which have it taken off, or none."""
    exposures_s = [patch.exposure_s for patch, there in zip(patches, where, strict=True) if there]
    longest_s, k = max(exposures_s), corrected.uncorrected.noise.k_dn_per_e.value
    stated_dn = corrected.at(longest_s).noise.dsnu_dn.value
    name = LEFT_BY_LIBRARY if corrected.takes_pattern_off(longest_s) else "DSNU"

    def finding(change: float, z: float) -> Finding:
        needed_dn = sqrt(max(stated_dn**2 + change, 0.0))
        return Finding(
            name, stated_dn / k, needed_dn / k, "e-", z, Mending(dsnu_dn2=dict.fromkeys(exposures_s, change))
        )

    return Suspect(where.astype(float), finding)


def _of_square(name: str, field: str, stated: Quantity, direction: FloatArray, shown: tuple[float, str]) -> Suspect:
    """Suspect a quantity whose square is in the values; it is shown times a factor, in a unit."""
    factor, unit = shown

    def finding(change: float, z: float) -> Finding:
        needed = replace(stated, value=sqrt(max(stated.value**2 + change, 0.0)))
        return Finding(name, stated.value * factor, needed.value * factor, unit, z, Mending({field: needed}))

    return Suspect(direction, finding)


def _net_dn(twin: TwinParameters, patches: Sequence[TwinPatch], darkness_dn: float) -> tuple[FloatArray, FloatArray]:
    """Mean DN above dark that were measured, and their difference to those predicted; by a darkness that is other."""
    means = np.array([(patch.measured.mean_dn[0], patch.predicted.mean_dn[0]) for patch in patches])
    dark_dn = np.array([twin.dark_dn(patch.exposure_s) for patch in patches])
    return means[:, 0] - dark_dn - darkness_dn, means[:, 0] - means[:, 1] - darkness_dn


def _variances(name: str, patches: Sequence[TwinPatch]) -> tuple[FloatArray, FloatArray]:
    """Variance measured less predicted, and the standard uncertainty of the measured one."""
    rows = []
    for patch in patches:
        predicted, measured = getattr(patch.predicted, name), getattr(patch.measured, name)
        rows.append((measured[0] ** 2 - predicted[0] ** 2, variance_uncertainty(*measured)))
    values, own = np.array(rows).T
    return values, np.maximum(own, 1e-12)
