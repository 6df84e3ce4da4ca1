"""All observations of a fit as arrays, and the covariance of their errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from functools import cached_property
from math import inf, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.vignetting import AnyVignetting
from ..camera import BLACK_LEVEL, EXPOSURE_TIME, FLAT_FIELD, FLICKER, exposure_time_rel, vignetting_source
from ..frames.nonuniformity import slow_rel, smooth_patterns, vignetting_errors
from ..frames.observations import Groups, PatchObservation
from ..readings import PatchReading
from ..sensor.noise import GainSetting
from ..signal import NetSignals, net_signals
from ..uncertainty import NO_SCATTER, Scatter, critical_value

Array = NDArray[np.floating[Any]]

#: Sources of common errors.
DARK, DRIFT, PATCH_SHAPE = "dark and temperature", "drift", "shape of the patches"
#: Relative standard uncertainty of light, camera and meter by their drift within an hour, or a longer session, unless
#: the readings show more: lamps that have warmed up keep to about 1 %.
DRIFT_REL = 0.01


@dataclass(frozen=True, eq=False)
class SharedError:
    """An error that several observations share: an unknown number with a normal prior of mean 0 and width 1.

    Parameters
    ----------
    source : str
        Name in the budget.
    relative, dn, cd_m2 : ndarray of float, shape (n,), or float
        Its effect on each observation, relative to the luminance, in DN and in cd/m^2, for one standard uncertainty.
    dark, gain_db, dof, pattern : tuple of float, float or None, float, int or None
        As of `FitError`, whose effects on converted frames are those of the same error.
    is_parameter : bool
        Whether the observations show it, so that it is a parameter of the fit.
    """

    source: str
    relative: Array | float = 0.0
    dn: Array | float = 0.0
    dark: tuple[float, ...] = ()
    gain_db: float | None = None
    dof: float = inf
    cd_m2: Array | float = 0.0
    pattern: int | None = None
    is_parameter: bool = False


@dataclass(frozen=True, eq=False)
class Design:
    """n observations of P patches by camera and meter.

    Parameters
    ----------
    patch_readings : tuple of PatchReading
        By the meter, P of them.
    patch, exposure : ndarray of int, shape (n,)
        Indices of patch and exposure of each observation.
    exposures_s : ndarray of float, shape (m,)
        Exposures, ascending.
    signals : NetSignals
        By the camera, n of them.
    shared : tuple of SharedError
        Errors of dark signal, exposure times, vignetting, light and black level of the same frames, and drift.
    own_rel : ndarray of float, shape (P,)
        Relative standard uncertainty by the sensitivity of its pixels.
    position_patterns : ndarray of float, shape (P, 3)
        Smooth patterns over the image, see `smooth_patterns`.
    rim_rel : ndarray of float, shape (P,)
        By how much the rims of their regions make them brighter than what is inside, relative.
    delay_h : ndarray of float, shape (n,)
        Hours from the frames of each observation to the reading of its patch.
    scatter_rel : Scatter
        Unexplained relative scatter of the patches.
    scatter_each_rel, scatter_each_dn : Scatter
        The same for single observations, relative to the luminance or in DN.
    """

    patch_readings: tuple[PatchReading, ...]
    patch: NDArray[np.intp]
    exposure: NDArray[np.intp]
    exposures_s: Array
    signals: NetSignals
    shared: tuple[SharedError, ...]
    own_rel: Array
    position_patterns: Array
    rim_rel: Array
    delay_h: Array
    scatter_rel: Scatter = NO_SCATTER
    scatter_each_rel: Scatter = NO_SCATTER
    scatter_each_dn: Scatter = NO_SCATTER

    @property
    def patches(self) -> tuple[str, ...]:
        """Names of the patches, P of them."""
        return tuple(reading.patch for reading in self.patch_readings)

    @cached_property
    def reading_cd_m2(self) -> Array:
        """Meter readings, shape (P,)."""
        return np.array([reading.luminance_cd_m2 for reading in self.patch_readings])

    @cached_property
    def reading_variance(self) -> Array:
        """Variance of their random part in (cd/m^2)^2, shape (P,)."""
        return np.array([reading.random_cd_m2**2 for reading in self.patch_readings])

    @cached_property
    def read_h(self) -> Array:
        """When each patch was read, in hours after the first of them, shape (P,)."""
        start = self.patch_readings[0].read_at
        return np.array([(reading.read_at - start).total_seconds() / 3600 for reading in self.patch_readings])

    @property
    def net_dn(self) -> Array:
        """Signals above dark, shape (n,)."""
        return self.signals.net_dn

    @cached_property
    def readings(self) -> Array:
        """Reading that belongs to each observation, shape (n,)."""
        return self.reading_cd_m2[self.patch]

    @property
    def veil(self) -> Array:
        """Luminances by a veil of 1 cd/m^2, even on the sensor: brighter where vignetting is taken off, shape (n,)."""
        return self.signals.scale_per_s * self.exposures_s[self.exposure]

    def level(self, luminance: Array) -> Array:
        """Mean of reading and luminance: weights by either one would favour patches where it is too low."""
        level: Array = np.sqrt(np.abs(luminance * self.readings))
        return level

    @property
    def n_effects(self) -> int:
        """Number of effects that were found, each a parameter."""
        return sum(error.is_parameter for error in self.shared)

    @cached_property
    def same_patch(self) -> NDArray[np.bool_]:
        """Whether two observations are of one patch, shape (n, n)."""
        return np.equal.outer(self.patch, self.patch)

    def covariance(self, luminance: Array, slope: Array) -> Array:
        """Covariance of luminances less readings, shape (n, n), at luminances and slopes dL/dn of shape (n,)."""
        level = self.level(luminance)
        single = (
            slope**2 * (self.signals.noise_variance_dn2 + self.scatter_each_dn.size**2)
            + (self.scatter_each_rel.size * luminance) ** 2
        )
        of_patch = np.array([self._patch_rel * level, self.signals.dark_nonuniformity_dn * slope])
        patterns = self.patterns(level, slope)
        within_patches = self.same_patch * (of_patch.T @ of_patch)
        covariance: Array = np.diag(single) + self._reading_covariance + within_patches + patterns.T @ patterns
        return covariance

    @cached_property
    def _patch_rel(self) -> Array:
        """Relative standard uncertainty of each observation by its patch alone, shape (n,)."""
        patch_rel: Array = np.hypot(self.own_rel, self.scatter_rel.size)[self.patch]
        return patch_rel

    @cached_property
    def _reading_covariance(self) -> Array:
        """Covariance of the random parts of the readings, shape (n, n)."""
        return np.where(self.same_patch, self.reading_variance[self.patch][:, None], 0.0)

    def patterns(self, level: Array, slope: Array) -> Array:
        """Effects of the common errors on the luminances, shape (k, n)."""
        relative, dn, cd_m2 = self._shared_arrays
        return relative * level + dn * slope + cd_m2

    @cached_property
    def _shared_arrays(self) -> tuple[Array, Array, Array]:
        """Common errors relative to the luminance, in DN and in cd/m^2, shape (k, n)."""
        names, n = ("relative", "dn", "cd_m2"), self.net_dn.size
        relative, dn, cd_m2 = (np.array([getattr(e, name) + np.zeros(n) for e in self.shared]) for name in names)
        return relative.reshape(-1, n), dn.reshape(-1, n), cd_m2.reshape(-1, n)

    def without_shared(self, source: str) -> Design:
        """Return the same without the common errors of a source."""
        return replace(self, shared=tuple(error for error in self.shared if error.source != source))


def build_design(
    groups: Groups, readings: Mapping[str, PatchReading], settings: Sequence[GainSetting], exposure_jitter_s: float
) -> Design:
    """Collect usable observations by patch, and readings.

    `readings` are of the same patches as `groups`; of `settings` the factors are not used.
    """
    observations = [o for group in groups.values() for o in group]
    signals = net_signals(observations, settings)
    numbers = {name: i for i, name in enumerate(groups)}
    patch = np.array([numbers[o.patch] for o in observations])
    times = np.array([o.exposure_s for o in observations])
    exposures_s, exposure = np.unique(times, return_inverse=True)
    # As in the mean over a patch's exposures: weights are inverse variances of signal over time.
    weight = times**2 / signals.variance_dn2
    total = np.bincount(patch, weight)
    shape_rel = np.bincount(patch, weight * signals.shape_rel) / total
    # A reading of the meter's field is one of the region, too, as the frames show how they differ.
    in_field = [group[0].middle is not None and group[0].middle.is_field for group in groups.values()]
    regions = [
        reading.scaled(1 / (1 + shape)) if known else reading
        for reading, shape, known in zip((readings[name] for name in groups), shape_rel.tolist(), in_field, strict=True)
    ]
    vignetting = observations[0].vignetting
    places = observations[0].state.image_shape, [group[0].centre_px for group in groups.values()]
    patterns = smooth_patterns(*places)
    read_at = [readings[o.patch].read_at for o in observations]
    delay_h = _delay_h(observations, read_at)
    shared = [
        *_dark_errors(observations, signals.gain_index, settings),
        *(
            SharedError(EXPOSURE_TIME, np.where(times == t, exposure_time_rel(t, exposure_jitter_s), 0.0))
            for t in exposures_s
        ),
        *_place_errors(vignetting, patterns, vignetting_errors(vignetting, *places), patch),
        *_frame_errors(observations, signals, settings[0]),
        *_shape_errors(np.where(in_field, 0.0, shape_rel)),
        *_drift(observations, read_at, delay_h),
    ]
    return Design(
        patch_readings=tuple(regions),
        patch=patch,
        exposure=exposure.reshape(-1),
        exposures_s=exposures_s,
        signals=signals,
        shared=tuple(shared),
        own_rel=np.bincount(patch, weight * signals.pixels_rel) / total,
        position_patterns=patterns,
        rim_rel=np.bincount(patch, weight * signals.rim_rel) / total,
        delay_h=delay_h,
    )


def _dark_errors(
    observations: Sequence[PatchObservation], gain: NDArray[np.intp], settings: Sequence[GainSetting]
) -> list[SharedError]:
    errors = []
    for index, setting in enumerate(settings):
        sensitivities = np.array([setting.dark.sensitivities(o.exposure_s, o.temperature_c) for o in observations])
        for parameters in setting.dark.errors():
            dark_dn = np.where(gain == index, sensitivities @ parameters, 0.0)
            steps = tuple(float(v) for v in parameters)
            errors.append(SharedError(DARK, 0.0, dark_dn, steps, setting.gain_db))
    return errors


def _place_errors(
    vignetting: AnyVignetting | None, patterns: Array, of_patterns: Array, patch: NDArray[np.intp]
) -> list[SharedError]:
    """Errors of the vignetting: what a flat field leaves may be a slope over the image."""
    source = vignetting_source(vignetting)
    of_field = slow_rel(vignetting) / sqrt(patterns.shape[1]) * patterns.T
    errors = [SharedError(FLAT_FIELD, row[patch]) for row in of_field if row.any()]
    return errors + [SharedError(source, row[patch], pattern=k) for k, row in enumerate(of_patterns)]


def _frame_errors(
    observations: Sequence[PatchObservation], signals: NetSignals, setting: GainSetting
) -> list[SharedError]:
    """Flicker of the light and drift of the black level, common to all patches of the same frames."""
    frames = [o.frames for o in observations]
    errors = []
    for frame in dict.fromkeys(frames):
        same = np.array([other == frame for other in frames])
        flicker, black = np.where(same, signals.flicker_rel, 0.0), np.where(same, signals.black_level_dn, 0.0)
        errors.append(SharedError(FLICKER, flicker, dof=setting.noise.flicker_at(frame[0])[1] or inf))
        errors.append(SharedError(BLACK_LEVEL, dn=black, dof=setting.dark.drift_dof or inf))
    return [e for e in errors if np.any(e.relative) or np.any(e.dn)]


def _shape_errors(shape_rel: Array) -> list[SharedError]:
    """Return the error of all patches by what they have in common: their middle, which the meter may see, is brighter.

    `shape_rel` is how much, shape (P,). What differs from patch to patch is scatter.
    """
    n = shape_rel.size
    mean, u = float(shape_rel.mean()), float(shape_rel.std(ddof=1)) / sqrt(n)
    return [SharedError(PATCH_SHAPE, mean)] if abs(mean) > critical_value(1, n - 1) * u else []


def _delay_h(observations: Sequence[PatchObservation], read_at: Sequence[datetime]) -> Array:
    """Hours from the frames to the readings, shape (n,); from the mean reading where frames have no time."""
    hours: Array = np.array([(time - read_at[0]).total_seconds() / 3600 for time in read_at])
    recorded = [o.recorded for o in observations if o.recorded is not None]
    if len(recorded) < len(observations):
        recorded = [read_at[0] + timedelta(hours=float(hours.mean()))] * len(read_at)
    frames_h: Array = np.array([(time - read_at[0]).total_seconds() / 3600 for time in recorded])
    return np.subtract(hours, frames_h)


def _drift(observations: Sequence[PatchObservation], read_at: Sequence[datetime], delay_h: Array) -> list[SharedError]:
    """Drift of camera over meter from the frames to the readings, steady over the session."""
    recorded = [o.recorded for o in observations if o.recorded is not None]
    if len(recorded) < len(observations):
        return []
    span_h = (max(*recorded, *read_at) - min(*recorded, *read_at)).total_seconds() / 3600
    return [SharedError(DRIFT, DRIFT_REL * delay_h / max(span_h, 1.0))]
