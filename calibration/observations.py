"""What the camera saw: patches and darkness at one exposure, measured from a stream of frames."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import sqrt

from ..errors import CalibrationError
from ..frame import CameraIdentity, Frame
from ..luminance import Cos4Vignetting
from ..roi import Roi
from .region_statistics import RegionAccumulator, RegionStatistics, quantisation_variance_dn2
from .unevenness import Unevenness


@dataclass(frozen=True)
class CameraState:
    """The camera and those of its settings a calibration is valid for.

    Parameters
    ----------
    camera : CameraIdentity
        Which camera.
    pixel_format : str
        GenICam PFNC name.
    bit_depth : int
        Bits of the DN scale.
    image_shape : (int, int)
        Height and width in pixels; binning changes the responsivity, cropping the optical axis.
    gain_db : float
        Analogue gain.
    saturation_dn : float
        DN from which a pixel counts as saturated.
    black_level_dn : float
        Black level set in the camera; the dark frames are right for this one only.
    """

    camera: CameraIdentity
    pixel_format: str
    bit_depth: int
    image_shape: tuple[int, int]
    gain_db: float
    saturation_dn: float
    black_level_dn: float

    @classmethod
    def of(cls, frame: Frame) -> CameraState:
        """State a frame was taken in; raises CalibrationError for a sensor with colour filters."""
        if frame.colour_filter is not None:
            raise CalibrationError(
                f"the frame has a colour filter ({frame.colour_filter}), a calibration is for a monochrome "
                "sensor: use a monochrome pixel format"
            )
        return cls(
            frame.camera,
            frame.pixel_format,
            frame.bit_depth,
            frame.shape,
            frame.gain_db,
            frame.saturation_dn,
            frame.black_level_dn,
        )

    def require(self, other: CameraState, mine: str, theirs: str) -> None:
        """Refuse another state.

        Parameters
        ----------
        other : CameraState
            The state to compare.
        mine, theirs : str
            What the two states belong to, for the message.

        Raises
        ------
        CalibrationError
            If they differ; the message names the first difference.
        """
        for name, expected, found in (
            ("camera", str(self.camera), str(other.camera)),
            ("pixel format", self.pixel_format, other.pixel_format),
            ("bit depth", f"{self.bit_depth}", f"{other.bit_depth}"),
            ("image size", _size(self.image_shape), _size(other.image_shape)),
            ("gain", f"{self.gain_db:g} dB", f"{other.gain_db:g} dB"),
            ("saturation", f"{self.saturation_dn:g} DN", f"{other.saturation_dn:g} DN"),
            ("black level", f"{self.black_level_dn:g} DN", f"{other.black_level_dn:g} DN"),
        ):
            if expected != found:
                raise CalibrationError(
                    f"{name} of {mine} is {expected}, but {theirs} has {found}: use the same, or calibrate this one"
                )


@dataclass(frozen=True)
class PatchObservation:
    """One patch at one exposure.

    Parameters
    ----------
    patch : str
        Name of the patch, the region's name.
    exposure_s : float
        Exposure time.
    signal_dn : float
        Mean over the region and the frames of DN / V, darkness included.
    mean_inverse_v : float
        Mean of 1 / V over the region: how often the darkness is contained in `signal_dn`.
    n_pixels, n_frames : int
        How many were averaged.
    temporal_variance_dn2 : float
        Variance of one pixel's DN from frame to frame (V not applied).
    unevenness : Unevenness
        Of the mean frame across the region.
    saturated_share, black_share : float
        Share of the values at or above saturation, and at DN 0.
    state : CameraState
        Camera and settings.
    vignetting : Cos4Vignetting or None
        V, None for 1.
    """

    patch: str
    exposure_s: float
    signal_dn: float
    mean_inverse_v: float
    n_pixels: int
    n_frames: int
    temporal_variance_dn2: float
    unevenness: Unevenness
    saturated_share: float
    black_share: float
    state: CameraState
    vignetting: Cos4Vignetting | None

    def net_dn(self, dark_dn: float) -> float:
        """Mean of (DN - d) / V: signal above dark, as on the optical axis."""
        return self.signal_dn - dark_dn * self.mean_inverse_v

    def net_dn_at_pixel(self, dark_dn: float) -> float:
        """Signal above dark as the region's pixels have it, V not removed."""
        return self.signal_dn / self.mean_inverse_v - dark_dn

    def fixed_pattern_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V from pixel to pixel, noise removed."""
        noise_dn2 = self.temporal_variance_dn2 * self.mean_inverse_v**2 / self.n_frames
        return max(self.unevenness.pixel_variance_dn2(dark_dn) - noise_dn2, 0.0)

    def nonuniformity_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V by slow changes across the region; 0 if not significant."""
        return self.unevenness.slow_variance_dn2(dark_dn)


@dataclass(frozen=True)
class DarkObservation:
    """Darkness at one exposure, over the whole sensor.

    Parameters
    ----------
    exposure_s : float
        Exposure time.
    mean_dn : float
        Mean over pixels and frames.
    mean_variance_dn2 : float
        Variance of that mean.
    n_pixels, n_frames : int
        How many were averaged.
    temporal_variance_dn2 : float
        Variance of one pixel from frame to frame.
    nonuniformity_dn : float
        Standard deviation of slow changes of the darkness across the sensor; 0 if not significant.
    black_share : float
        Share of the values at DN 0.
    state : CameraState
        Camera and settings.
    """

    exposure_s: float
    mean_dn: float
    mean_variance_dn2: float
    n_pixels: int
    n_frames: int
    temporal_variance_dn2: float
    nonuniformity_dn: float
    black_share: float
    state: CameraState


def observe_patches(
    frames: Iterable[Frame], regions: Sequence[Roi], vignetting: Cos4Vignetting | None = None
) -> list[PatchObservation]:
    """Measure patches in the light frames of one exposure.

    The frames are taken one by one and not kept.

    Parameters
    ----------
    frames : iterable of Frame
        At least two, all of one exposure, camera and setting.
    regions : sequence of Roi
        One for each patch, with different names.
    vignetting : Cos4Vignetting or None
        Fall-off of the lens, removed before averaging; None for none.

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
    exposure_s, state, statistics = _accumulate(frames, regions, vignetting)
    return [
        PatchObservation(
            patch=region.name,
            exposure_s=exposure_s,
            signal_dn=s.mean_dn,
            mean_inverse_v=s.mean_factor,
            n_pixels=s.n_pixels,
            n_frames=s.n_frames,
            temporal_variance_dn2=s.temporal_variance_dn2,
            unevenness=s.unevenness,
            saturated_share=s.saturated_share,
            black_share=s.black_share,
            state=state,
            vignetting=vignetting,
        )
        for region, s in zip(regions, statistics, strict=True)
    ]


def observe_dark(frames: Iterable[Frame]) -> DarkObservation:
    """Measure the darkness in the dark frames of one exposure, over the whole sensor.

    The frames are taken one by one; never more than two are held. The variance of the mean is that of the pixels'
    noise or that of the frames' means, whichever is larger (the black level of a camera wanders), and what
    rounding leaves.

    Parameters
    ----------
    frames : iterable of Frame
        At least two, all of one exposure, camera and setting.

    Raises
    ------
    CalibrationError
        If frames differ in exposure, camera or setting, or are too few or coloured.
    """
    exposure_s, state, (s,) = _accumulate(frames, None, None)
    of_pixels = s.temporal_variance_dn2 / (s.n_pixels * s.n_frames)
    of_frames = s.frame_means_variance_dn2 / s.n_frames
    of_rounding = quantisation_variance_dn2(s.temporal_variance_dn2 + s.unevenness.pixel_variance_dn2(0.0))
    return DarkObservation(
        exposure_s=exposure_s,
        mean_dn=s.mean_dn,
        mean_variance_dn2=max(of_pixels, of_frames) + of_rounding,
        n_pixels=s.n_pixels,
        n_frames=s.n_frames,
        temporal_variance_dn2=s.temporal_variance_dn2,
        nonuniformity_dn=sqrt(s.unevenness.slow_variance_dn2(0.0)),
        black_share=s.black_share,
        state=state,
    )


def _accumulate(
    frames: Iterable[Frame], regions: Sequence[Roi] | None, vignetting: Cos4Vignetting | None
) -> tuple[float, CameraState, list[RegionStatistics]]:
    accumulators: list[RegionAccumulator] = []
    state: CameraState | None = None
    exposure_s = 0.0
    for frame in frames:
        if state is None:
            state, exposure_s = CameraState.of(frame), frame.exposure_s
            height, width = frame.shape
            factor = None if vignetting is None else 1 / vignetting.relative_illuminance(frame.shape)
            whole = [Roi.rectangle("whole sensor", 0, 0, width, height)]
            accumulators = [RegionAccumulator(r, factor) for r in (whole if regions is None else regions)]
        state.require(CameraState.of(frame), "the first frame", f"frame {frame.frame_id}")
        if frame.exposure_s != exposure_s:
            raise CalibrationError(
                f"frame {frame.frame_id} has an exposure of {frame.exposure_s:g} s, the first frame "
                f"{exposure_s:g} s: give frames of one exposure at a time"
            )
        for accumulator in accumulators:
            accumulator.add(frame)
    if state is None:
        raise CalibrationError("there is no frame: give at least 2 frames of one exposure")
    return exposure_s, state, [accumulator.result() for accumulator in accumulators]


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[1]} x {shape[0]} pixels"
