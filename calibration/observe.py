"""Measuring patches and darkness from a stream of frames of one exposure."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError
from ..frame import Frame
from ..roi import Roi
from ..vignetting import AnyVignetting
from .observations import CameraState, DarkObservation, PatchObservation
from .region_statistics import RegionAccumulator, RegionStatistics, quantisation_variance_dn2

_log = logging.getLogger(__name__)

#: Change of the device temperature over the frames of one exposure that is reported: with a dark current that doubles
#: every 6 to 10 degC it changes the dark current by about a tenth.
TEMPERATURE_DRIFT_C = 1.0


class Defects(Protocol):
    """Pixels that must not be used."""

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Return True where a pixel is defect, shape (height, width)."""


class DarkPattern(Protocol):
    """What each pixel adds in darkness, zero on average."""

    def correction_dn(
        self, shape: tuple[int, int], exposure_s: float, temperature_c: float | None = None
    ) -> NDArray[np.floating[Any]] | None:
        """Pattern to take off at an exposure and temperature, shape (height, width); None for nothing."""

    def noise_dn(self, exposure_s: float, temperature_c: float | None = None) -> float:
        """Return the standard uncertainty of one pixel of the pattern."""


def observe_patches(
    frames: Iterable[Frame],
    regions: Sequence[Roi],
    vignetting: AnyVignetting | None = None,
    *,
    defects: Defects | None = None,
    dark_library: DarkPattern | None = None,
) -> list[PatchObservation]:
    """Measure patches in the light frames of one exposure.

    The frames are taken one by one and not kept.

    Parameters
    ----------
    frames : iterable of Frame
        At least two, all of one exposure, camera and setting.
    regions : sequence of Roi
        One for each patch, with different names.
    vignetting : AnyVignetting or None
        Fall-off of the lens, removed before averaging; None for none.
    defects : Defects or None
        Pixels to leave out of the regions.
    dark_library : DarkPattern or None
        Dark pattern to subtract; its mean, the darkness itself, stays in.

    Returns
    -------
    list of PatchObservation
        In the order of `regions`.

    Raises
    ------
    CalibrationError
        If frames differ in exposure, camera or setting, are too few or coloured, or a region is too small.
    InputError
        If a region lies outside the image.
    """
    names = [region.name for region in regions]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise CalibrationError(f"several regions are called {twice[0]!r}: give each patch its own name")
    seen = _accumulate(frames, regions, vignetting, defects, dark_library)
    return [
        PatchObservation(
            patch=region.name,
            exposure_s=seen.exposure_s,
            signal_dn=s.mean_dn,
            mean_inverse_v=s.mean_factor,
            n_pixels=s.n_pixels,
            n_frames=s.n_frames,
            temporal_variance_dn2=s.temporal_variance_dn2,
            unevenness=s.unevenness,
            saturated_share=s.saturated_share,
            black_share=s.black_share,
            state=seen.state,
            vignetting=vignetting,
            temperature_c=seen.temperature_c,
            centre_px=region.centre,
        )
        for region, s in zip(regions, seen.statistics, strict=True)
    ]


def observe_dark(
    frames: Iterable[Frame], *, defects: Defects | None = None, dark_library: DarkPattern | None = None
) -> DarkObservation:
    """Measure the darkness in the dark frames of one exposure, over the whole sensor.

    The frames are taken one by one; never more than two are held. The variance of the mean is that of the pixels'
    noise or that of the frames' means, whichever is larger (the black level of a camera wanders), and what
    rounding leaves.

    Parameters
    ----------
    frames : iterable of Frame
        At least two, all of one exposure, camera and setting.
    defects : Defects or None
        Pixels to leave out, as at the patches: hot ones would make the darkness of the others too high.
    dark_library : DarkPattern or None
        Dark pattern to subtract, so that the darkness is as even as at the patches it is used for.

    Raises
    ------
    CalibrationError
        If frames differ in exposure, camera or setting, or are too few or coloured.
    """
    seen = _accumulate(frames, None, None, defects, dark_library)
    (s,) = seen.statistics
    of_pixels = s.temporal_variance_dn2 / (s.n_pixels * s.n_frames)
    of_frames = s.frame_means_variance_dn2 / s.n_frames
    of_rounding = quantisation_variance_dn2(s.temporal_variance_dn2 + s.unevenness.pixel_variance_dn2(0.0))
    pattern_dn2 = max(s.unevenness.pixel_variance_dn2(0.0) - s.temporal_variance_dn2 / s.n_frames, 0.0)
    # A library made of these very frames takes their noise off too: at the patches it is still there.
    pattern_dn2 = max(pattern_dn2, seen.library_noise_dn**2)
    return DarkObservation(
        exposure_s=seen.exposure_s,
        mean_dn=s.mean_dn,
        mean_variance_dn2=max(of_pixels, of_frames) + of_rounding,
        n_pixels=s.n_pixels,
        n_frames=s.n_frames,
        temporal_variance_dn2=s.temporal_variance_dn2,
        nonuniformity_dn=sqrt(s.unevenness.slow_variance_dn2(0.0)),
        black_share=s.black_share,
        state=seen.state,
        temperature_c=seen.temperature_c,
        pattern_dn=sqrt(pattern_dn2),
    )


@dataclass(frozen=True)
class _Seen:
    exposure_s: float
    temperature_c: float | None
    state: CameraState
    statistics: list[RegionStatistics]
    library_noise_dn: float


def _accumulate(
    frames: Iterable[Frame],
    regions: Sequence[Roi] | None,
    vignetting: AnyVignetting | None,
    defects: Defects | None,
    dark_library: DarkPattern | None,
) -> _Seen:
    accumulators: list[RegionAccumulator] = []
    state: CameraState | None = None
    exposure_s = noise_dn = 0.0
    temperatures: list[float | None] = []
    for frame in frames:
        if state is None:
            state, exposure_s = CameraState.of(frame), frame.exposure_s
            pattern = None
            if dark_library is not None:
                pattern = dark_library.correction_dn(frame.shape, exposure_s, frame.temperature_c)
                noise_dn = 0.0 if pattern is None else dark_library.noise_dn(exposure_s, frame.temperature_c)
            accumulators = _accumulators(frame, regions, vignetting, defects, pattern)
        state.require(CameraState.of(frame), "the first frame", f"frame {frame.frame_id}")
        if frame.exposure_s != exposure_s:
            raise CalibrationError(
                f"frame {frame.frame_id} has an exposure of {frame.exposure_s:g} s, the first frame "
                f"{exposure_s:g} s: give frames of one exposure at a time"
            )
        temperatures.append(frame.temperature_c)
        for accumulator in accumulators:
            accumulator.add(frame)
    if state is None:
        raise CalibrationError("there is no frame: give at least 2 frames of one exposure")
    temperature_c = _mean_temperature(temperatures, exposure_s)
    return _Seen(exposure_s, temperature_c, state, [a.result() for a in accumulators], noise_dn)


def _accumulators(
    frame: Frame,
    regions: Sequence[Roi] | None,
    vignetting: AnyVignetting | None,
    defects: Defects | None,
    pattern_dn: NDArray[np.floating[Any]] | None,
) -> list[RegionAccumulator]:
    height, width = frame.shape
    factor = None if vignetting is None else 1 / vignetting.relative_illuminance(frame.shape)
    sound = None if defects is None else ~defects.mask(frame.shape)
    whole = [Roi.rectangle("whole sensor", 0, 0, width, height)]
    return [RegionAccumulator(r, factor, sound, pattern_dn) for r in (whole if regions is None else regions)]


def _mean_temperature(temperatures: Sequence[float | None], exposure_s: float) -> float | None:
    known = [t for t in temperatures if t is not None]
    if len(known) < len(temperatures):
        if known:
            _log.warning("some frames at %g s have no temperature: it is taken as unknown", exposure_s)
        return None
    if max(known) - min(known) > TEMPERATURE_DRIFT_C:
        _log.warning(
            "the camera's temperature went from %.1f to %.1f degC over the frames at %g s: let it warm up first",
            known[0],
            known[-1],
            exposure_s,
        )
    return sum(known) / len(known)
