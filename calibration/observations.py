"""What the camera saw: patches and darkness at one exposure, and the camera's state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import CalibrationError
from ..frame import CameraIdentity, Frame
from ..vignetting import AnyVignetting
from .unevenness import Unevenness

#: Gains up to this far apart are the same: cameras report them rounded.
GAIN_TOLERANCE_DB = 1e-6


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
    plane : str or None
        Colour plane of a Bayer sensor, None for a monochrome one.
    """

    camera: CameraIdentity
    pixel_format: str
    bit_depth: int
    image_shape: tuple[int, int]
    gain_db: float
    saturation_dn: float
    black_level_dn: float
    plane: str | None = None

    @classmethod
    def of(cls, frame: Frame) -> CameraState:
        """State a frame was taken in; raises CalibrationError for a sensor with colour filters."""
        if frame.colour_filter is not None:
            raise CalibrationError(
                f"the frame has a colour filter ({frame.colour_filter}), its pixels of one colour are measured apart: "
                "split it into its planes"
            )
        return cls(
            frame.camera,
            frame.pixel_format,
            frame.bit_depth,
            frame.shape,
            frame.gain_db,
            frame.saturation_dn,
            frame.black_level_dn,
            frame.plane,
        )

    def require(self, other: CameraState, mine: str, theirs: str, gains_db: Sequence[float] = ()) -> None:
        """Refuse another state.

        Parameters
        ----------
        other : CameraState
            The state to compare.
        mine, theirs : str
            What the two states belong to, for the message.
        gains_db : sequence of float
            Gains that are right too, beside this state's own.

        Raises
        ------
        CalibrationError
            If they differ; the message names the first difference.
        """
        for name, expected, found in (
            ("camera", str(self.camera), str(other.camera)),
            ("pixel format", self.pixel_format, other.pixel_format),
            ("colour plane", self.plane, other.plane),
            ("bit depth", f"{self.bit_depth}", f"{other.bit_depth}"),
            ("image size", _size(self.image_shape), _size(other.image_shape)),
            ("gain", *self._gains(other.gain_db, gains_db)),
            ("saturation", f"{self.saturation_dn:g} DN", f"{other.saturation_dn:g} DN"),
            ("black level", f"{self.black_level_dn:g} DN", f"{other.black_level_dn:g} DN"),
        ):
            if expected != found:
                raise CalibrationError(
                    f"{name} of {mine} is {expected}, but {theirs} has {found}: use the same, or calibrate this one"
                )

    def _gains(self, found_db: float, further_db: Sequence[float]) -> tuple[str, str]:
        """Texts to compare: equal if the gain is one of the allowed."""
        allowed = (self.gain_db, *further_db)
        found = f"{found_db:g} dB"
        if any(abs(found_db - gain_db) <= GAIN_TOLERANCE_DB for gain_db in allowed):
            return found, found
        return " or ".join(f"{gain_db:g} dB" for gain_db in allowed), found


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
    vignetting : AnyVignetting or None
        V, None for 1.
    temperature_c : float or None
        Mean device temperature of the frames, None if unknown.
    centre_px : (float, float)
        Middle (x, y) of the region in the image.
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
    vignetting: AnyVignetting | None
    temperature_c: float | None = None
    centre_px: tuple[float, float] = (0.0, 0.0)

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
    temperature_c : float or None
        Mean device temperature of the frames, None if unknown.
    pattern_dn : float
        Standard deviation of the darkness from pixel to pixel, noise removed (EMVA 1288: DSNU, in DN); with a dark
        library, what it leaves.
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
    temperature_c: float | None = None
    pattern_dn: float = 0.0


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[1]} x {shape[0]} pixels"
