"""All observations of a fit as arrays, and the covariance of their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors.common import EXPOSURE_TIME_REL
from ..frames.observations import PatchObservation
from ..frames.place import slow_rel, smooth_patterns, vignetting_errors
from ..gains import GainSetting
from ..readings import PatchReading
from ..signal import net_signal

Array = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class DarkError:
    """One independent error of one gain's dark signal, for one standard uncertainty.

    Parameters
    ----------
    gain_db : float
        Which gain.
    parameters : ndarray of float, shape (3,)
        Errors of offset_dn, rate_dn_s and 1 / T_d.
    dark_dn : ndarray of float, shape (n,)
        Error of the dark signal at each observation.
    """

    gain_db: float
    parameters: Array
    dark_dn: Array


@dataclass(frozen=True, eq=False)
class Design:
    """n observations of P patches by camera and meter.

    Parameters
    ----------
    patches : tuple of str
        Names, P of them.
    patch, exposure, gain : ndarray of int, shape (n,)
        Indices of patch, exposure and gain of each observation.
    exposures_s : ndarray of float, shape (m,)
        Exposures, ascending.
    net_dn, scale_per_s, noise_variance_dn2, dark_nonuniformity_dn : ndarray of float, shape (n,)
        As of `NetSignal`.
    dark_errors : tuple of DarkError
        Errors common to all observations of a gain.
    reading_cd_m2, reading_variance : ndarray of float, shape (P,)
        Meter readings, and the variance of their random part in (cd/m^2)^2.
    own_rel : ndarray of float, shape (P,)
        Relative standard uncertainty by the patch's position on the sensor: sensitivity of its pixels, and residual of
        the measured vignetting.
    uneven_rel : ndarray of float, shape (P,)
        The same by the non-uniformity of the patch, which meter and camera view at slightly different positions.
    place : ndarray of float, shape (P, 3)
        Smooth patterns over the image, see `smooth_patterns`.
    place_errors : ndarray of float, shape (k, P)
        Independent relative errors of the measured vignetting, as patterns over the patches.
    read_at : tuple of datetime
        When each patch was read, P of them.
    scatter_rel : float
        Unexplained relative scatter of the patches.
    scatter_each_rel, scatter_each_dn : float
        The same for single observations, relative to the luminance or in DN.
    """

    patches: tuple[str, ...]
    patch: NDArray[np.intp]
    exposure: NDArray[np.intp]
    gain: NDArray[np.intp]
    exposures_s: Array
    net_dn: Array
    scale_per_s: Array
    noise_variance_dn2: Array
    dark_nonuniformity_dn: Array
    dark_errors: tuple[DarkError, ...]
    reading_cd_m2: Array
    reading_variance: Array
    own_rel: Array
    uneven_rel: Array
    place: Array
    place_errors: Array
    read_at: tuple[datetime, ...]
    scatter_rel: float = 0.0
    scatter_each_rel: float = 0.0
    scatter_each_dn: float = 0.0

    @property
    def readings(self) -> Array:
        """Reading that belongs to each observation, shape (n,)."""
        return self.reading_cd_m2[self.patch]

    @property
    def patch_rel(self) -> Array:
        """Independent relative standard uncertainty of each patch, shape (P,)."""
        return np.hypot(self.own_rel, self.uneven_rel)

    @property
    def same_patch(self) -> NDArray[np.bool_]:
        """Whether two observations are of one patch, shape (n, n)."""
        return np.equal.outer(self.patch, self.patch)

    def net_covariance(self) -> Array:
        """Covariance of `net_dn`, shape (n, n)."""
        uneven = self.dark_nonuniformity_dn
        own = self.noise_variance_dn2 + self.scatter_each_dn**2
        covariance: Array = np.diag(own) + np.where(self.same_patch, np.outer(uneven, uneven), 0)
        for error in self.dark_errors:
            covariance += np.outer(error.dark_dn, error.dark_dn)
        return covariance

    def patch_covariance(self, luminance: Array) -> Array:
        """Covariance of luminances less readings by all but `net_dn`, shape (n, n), with luminances of shape (n,)."""
        # The mean of reading and luminance: weights by either one would favour patches where it is too low.
        level = np.sqrt(np.abs(luminance * self.readings))
        by_patch = np.hypot(self.patch_rel, self.scatter_rel)[self.patch] * level
        by_place = self.place_errors[:, self.patch] * level
        shared = self.reading_variance[self.patch][:, None] + np.outer(by_patch, by_patch)
        covariance: Array = np.where(self.same_patch, shared, 0.0)
        together = self.exposure[:, None] == self.exposure[None, :]
        covariance += np.where(together, EXPOSURE_TIME_REL**2 * np.outer(luminance, luminance), 0.0)
        return covariance + by_place.T @ by_place + np.diag((self.scatter_each_rel * luminance) ** 2)

    def without(self, patch: int) -> Design:
        """Return the same without one patch."""
        kept, others = self.patch != patch, np.arange(len(self.patches)) != patch
        return replace(
            self,
            patches=tuple(name for name, keep in zip(self.patches, others, strict=True) if keep),
            patch=self.patch[kept] - (self.patch[kept] > patch),
            exposure=self.exposure[kept],
            gain=self.gain[kept],
            net_dn=self.net_dn[kept],
            scale_per_s=self.scale_per_s[kept],
            noise_variance_dn2=self.noise_variance_dn2[kept],
            dark_nonuniformity_dn=self.dark_nonuniformity_dn[kept],
            dark_errors=tuple(replace(e, dark_dn=e.dark_dn[kept]) for e in self.dark_errors),
            reading_cd_m2=self.reading_cd_m2[others],
            reading_variance=self.reading_variance[others],
            own_rel=self.own_rel[others],
            uneven_rel=self.uneven_rel[others],
            place=self.place[others],
            place_errors=self.place_errors[:, others],
            read_at=tuple(time for time, keep in zip(self.read_at, others, strict=True) if keep),
        )

    def with_reading(self, patch: int, reading: PatchReading) -> Design:
        """Return the same with another reading of one patch."""
        values, variances = self.reading_cd_m2.copy(), self.reading_variance.copy()
        values[patch], variances[patch] = reading.luminance_cd_m2, reading.random_cd_m2**2
        return replace(self, reading_cd_m2=values, reading_variance=variances)


def build_design(
    groups: Mapping[str, Sequence[PatchObservation]],
    readings: Mapping[str, PatchReading],
    settings: Sequence[GainSetting],
) -> Design:
    """Collect observations and readings.

    Parameters
    ----------
    groups : mapping of str to sequence of PatchObservation
        Usable observations by patch.
    readings : mapping of str to PatchReading
        Of the same patches.
    settings : sequence of GainSetting
        Dark signal and noise by gain; the factors are not used.
    """
    observations = [o for group in groups.values() for o in group]
    signals = [net_signal(o, settings) for o in observations]
    numbers = {name: i for i, name in enumerate(groups)}
    patch = np.array([numbers[o.patch] for o in observations])
    times = np.array([o.exposure_s for o in observations])
    exposures_s, exposure = np.unique(times, return_inverse=True)
    gain = np.array([s.gain_index for s in signals])
    # As in the mean over a patch's exposures: weights are inverse variances of signal over time.
    weight = times**2 / np.array([s.variance_dn2 for s in signals])
    total = np.bincount(patch, weight)
    pixels = np.bincount(patch, weight * np.array([s.pixels_rel for s in signals])) / total
    slow = np.bincount(patch, weight * np.array([s.slow_rel for s in signals])) / total
    ordered = [readings[name] for name in groups]
    shape, vignetting = observations[0].state.image_shape, observations[0].vignetting
    centres_px = [group[0].centre_px for group in groups.values()]
    place = smooth_patterns(shape, centres_px)
    # The residual of a measured vignetting may be independent between patches or a slope over the image; both are
    # allowed for.
    slow_field = slow_rel(vignetting)
    errors = [slow_field / sqrt(place.shape[1]) * place.T, vignetting_errors(vignetting, shape, centres_px)]
    return Design(
        patches=tuple(groups),
        patch=patch,
        exposure=exposure.reshape(-1),
        gain=gain,
        exposures_s=exposures_s,
        net_dn=np.array([s.net_dn for s in signals]),
        scale_per_s=np.array([s.scale_per_s for s in signals]),
        noise_variance_dn2=np.array([s.noise_variance_dn2 + s.frames_variance_dn2 for s in signals]),
        dark_nonuniformity_dn=np.array([s.dark_nonuniformity_dn for s in signals]),
        dark_errors=tuple(_dark_errors(observations, gain, settings)),
        reading_cd_m2=np.array([r.luminance_cd_m2 for r in ordered]),
        reading_variance=np.array([r.random_cd_m2**2 for r in ordered]),
        own_rel=np.hypot(pixels, slow_field),
        uneven_rel=slow,
        place=place,
        place_errors=np.concatenate(errors),
        read_at=tuple(r.read_at for r in ordered),
    )


def _dark_errors(
    observations: Sequence[PatchObservation], gain: NDArray[np.intp], settings: Sequence[GainSetting]
) -> list[DarkError]:
    errors = []
    for index, setting in enumerate(settings):
        sensitivities = np.array([setting.dark.sensitivities(o.exposure_s, o.temperature_c) for o in observations])
        for parameters in setting.dark.errors():
            dark_dn = np.where(gain == index, sensitivities @ parameters, 0.0)
            errors.append(DarkError(setting.gain_db, parameters, dark_dn))
    return errors
