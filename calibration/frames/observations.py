"""Observations of patches and dark signal at one exposure, with the camera's state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from datetime import datetime
from math import inf
from typing import Any, TypeAlias

from ...core.clock import exposure_text
from ...core.companding import Companding
from ...core.errors import CalibrationError, InputError
from ...core.frame import MOST_BITS, CameraIdentity, Frame, Readout, nominal_black_dn
from ...core.vignetting import AnyVignetting, Cos4Vignetting
from .nonuniformity import Nonuniformity
from .rounding import quantisation_variance_dn2
from .statistics import Level, lines_variance_dn2

#: Largest difference of equal gains, which cameras report rounded.
GAIN_TOLERANCE_DB = 1e-6
#: Most bits of the converter of a single capture: more are those of a merge.
MOST_BITS_OF_ONE_CAPTURE = 16
#: Largest height and width of an image.
_MOST_SIDE = 2**20


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
        Bits of the DN scale; of companded data those of a code as it is stored.
    image_shape : (int, int)
        Height and width in pixels; binning changes the responsivity, cropping the optical axis.
    gain_db : float
        Analogue gain.
    saturation_dn : float
        DN from which a pixel counts as saturated; of companded data the linear value.
    black_level_dn : float or None
        Black level that files state.
    plane : str or None
        Colour plane of a Bayer sensor, None for a monochrome one.
    readout : Readout or None
        Part of the sensor that the image shows; None if unknown, which fits any.
    black_level_register : float or None
        Black level set in the camera; dark frames are valid only for this one.
    companding : Companding or None
        Curve by which DN of frames are codes: all levels are of its linear values. None for DN as they are.

    Examples
    --------
    >>> from labcdp.calibration import CameraState
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> state = CameraState.of(session.load(session.frames("dark")[0]))
    >>> state.pixel_format, state.saturation_dn
    ('Mono12', 4095.0)
    """

    camera: CameraIdentity
    pixel_format: str
    bit_depth: int
    image_shape: tuple[int, int]
    gain_db: float
    saturation_dn: float
    black_level_dn: float | None
    plane: str | None = None
    readout: Readout | None = None
    black_level_register: float | None = None
    companding: Companding | None = None

    def __post_init__(self) -> None:
        if not all(1 <= side <= _MOST_SIDE for side in self.image_shape):
            raise InputError(f"image_shape is {self.image_shape}: give height and width in pixels, up to {_MOST_SIDE}")
        if not 1 <= self.bit_depth <= MOST_BITS:
            raise InputError(f"bit_depth is {self.bit_depth}: give 1 to {MOST_BITS} bits")

    @classmethod
    def of(cls, frame: Frame) -> CameraState:
        """State of a frame; raises CalibrationError for a sensor with colour filters."""
        if frame.colour_filter is not None:
            raise CalibrationError(
                f"the frame has a colour filter ({frame.colour_filter}), its pixels of one colour are measured apart: "
                "split it into its planes"
            )
        of_frame = {"image_shape": "shape", "saturation_dn": "linear_saturation_dn"}
        return cls(**{field.name: getattr(frame, of_frame.get(field.name, field.name)) for field in fields(cls)})

    def require(self, other: CameraState, mine: str, theirs: str, gains_db: Sequence[float] = ()) -> None:
        """Refuse another state.

        Parameters
        ----------
        other : CameraState
            The state to compare.
        mine, theirs : str
            Names of the two states in messages.
        gains_db : sequence of float
            Gains accepted in addition to this state's own.

        Raises
        ------
        CalibrationError
            If they differ; the message names the first difference.
        """
        allowed_db, gain = (self.gain_db, *gains_db), f"{other.gain_db:g} dB"
        for name, expected, theirs_is in (
            ("camera", str(self.camera), str(other.camera)),
            ("pixel format", self.pixel_format, other.pixel_format),
            ("colour plane", self.plane, other.plane),
            ("curve of its codes", str(self.companding or "none"), str(other.companding or "none")),
            ("bit depth", self.bit_depth, other.bit_depth),
            ("image size", _size(self.image_shape), _size(other.image_shape)),
            *Readout.compared(self.readout, other.readout),
            ("gain", gain if other.has_gain(*allowed_db) else " or ".join(f"{db:g} dB" for db in allowed_db), gain),
            ("saturation", f"{self.saturation_dn:g} DN", f"{other.saturation_dn:g} DN"),
            ("black level", *_where_known(self.black_level, other.black_level)),
        ):
            if expected != theirs_is:
                raise CalibrationError(
                    f"{name} of {mine} is {expected}, but {theirs} has {theirs_is}: use the same, or calibrate this one"
                )

    def require_alike(self, darks: Iterable[Any], mine: str, gains_db: Sequence[float] = ()) -> None:
        """Refuse sets of dark frames, with state and exposure, of which one is of another state; as `require`."""
        for dark in darks:
            self.require(dark.state, mine, f"the set of dark frames at {exposure_text(dark.exposure_s)}", gains_db)

    @property
    def black_level(self) -> float | None:
        """Black level for comparisons: that set in the camera, else that which files state."""
        return self.black_level_dn if self.black_level_register is None else self.black_level_register

    @property
    def nominal_black_dn(self) -> float:
        """Black level in DN where nothing was measured."""
        if self.companding is not None:
            return 0.0
        return nominal_black_dn(self.black_level_dn, self.black_level_register, self.bit_depth)

    @property
    def has_hand_overs(self) -> bool:
        """Whether values may be merged of several captures, of which each has a noise of its own."""
        return self.companding is not None or self.bit_depth > MOST_BITS_OF_ONE_CAPTURE

    def has_gain(self, *gains_db: float) -> bool:
        """Whether its gain is one of these."""
        return any(abs(self.gain_db - gain_db) <= GAIN_TOLERANCE_DB for gain_db in gains_db)


@dataclass(frozen=True, kw_only=True)
class Observation(Level):
    """Level at one exposure.

    Parameters
    ----------
    exposure_s : float
        Exposure time.
    state : CameraState
        Camera and settings.
    temperature_c : float or None
        Mean device temperature of the frames, None if unknown.
    """

    exposure_s: float
    state: CameraState
    temperature_c: float | None = None


@dataclass(frozen=True)
class PatchPart:
    """Means over a part of a region: what the meter sees of it, or what is inside its rim.

    Parameters
    ----------
    mean_dn, mean_inverse_v : float
        Of DN / V and of 1 / V.
    share : float
        Share of the region's pixels.
    is_field : bool
        Whether it is the meter's measuring field.
    """

    mean_dn: float
    mean_inverse_v: float
    share: float
    is_field: bool = False

    def scaled(self, factor: float) -> PatchPart:
        """Return it with another 1 / V."""
        return replace(self, mean_dn=factor * self.mean_dn, mean_inverse_v=factor * self.mean_inverse_v)


@dataclass(frozen=True, kw_only=True)
class PatchObservation(Observation):
    """One patch at one exposure; the mean is that of DN / V, dark signal included, those of single frames of DN.

    Parameters
    ----------
    patch : str
        Name of the patch, the region's name.
    mean_inverse_v : float
        Mean of 1 / V over the region: the factor of the dark signal in the mean.
    nonuniformity : Nonuniformity
        Of the mean frame in the region.
    vignetting : AnyVignetting or None
        V, None for 1.
    centre_px : (float, float)
        Middle (x, y) of the region in the image.
    n_lines : (float, float)
        Effective numbers of columns and rows that were averaged.
    recorded : datetime or None
        When the first of the frames was recorded: patches of the same frames share their errors. None if unknown.
    middle : PatchPart or None
        What the meter sees of the region, or the middle third, which stands for it; None for all of it.
    inside : PatchPart or None
        The region without its rim, an eighth of its width on each side; None if it has none.

    Examples
    --------
    >>> from labcdp.calibration import observe_patches
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> light, patch = session.frames("light"), session.configuration.target.patches[0]
    >>> frames = [session.load(r) for r in light if r.exposure_s == light[0].exposure_s]
    >>> (observation,) = observe_patches(frames, [patch.region()])
    >>> observation.patch, observation.n_frames
    ('P01', 2)
    """

    patch: str
    mean_inverse_v: float
    nonuniformity: Nonuniformity
    vignetting: AnyVignetting | None
    centre_px: tuple[float, float] = (0.0, 0.0)
    n_lines: tuple[float, float] = (inf, inf)
    recorded: datetime | None = None
    middle: PatchPart | None = None
    inside: PatchPart | None = None

    def with_vignetting(self, vignetting: AnyVignetting | None) -> PatchObservation:
        """Return the same with another vignetting, where that differs only by what patches have shown of it."""
        before = self.vignetting
        if before == vignetting or not (
            isinstance(vignetting, Cos4Vignetting) and vignetting.is_but_for_corners(before)
        ):
            return self
        assert isinstance(before, Cos4Vignetting)
        factor = 1 / vignetting.more_than(before, self.state.image_shape, self.centre_px)
        return replace(
            self,
            mean_dn=factor * self.mean_dn,
            mean_inverse_v=factor * self.mean_inverse_v,
            nonuniformity=self.nonuniformity.scaled(factor),
            middle=self.middle and self.middle.scaled(factor),
            inside=self.inside and self.inside.scaled(factor),
            vignetting=vignetting,
        )

    def saturating_at(self, saturation_dn: float) -> PatchObservation:
        """Return the same of a camera whose pixels are full from a lower DN on than its frames state."""
        if saturation_dn >= self.state.saturation_dn:
            return self
        full = self.net_dn_at_pixel(0.0) >= saturation_dn
        state = replace(self.state, saturation_dn=saturation_dn)
        return replace(self, state=state, saturated_share=1.0 if full else self.saturated_share)

    @property
    def frames(self) -> tuple[float, float, datetime | None]:
        """Exposure time, gain and time of its frames; patches of the same frames share their errors."""
        return self.exposure_s, self.state.gain_db, self.recorded

    def net_dn(self, dark_dn: float) -> float:
        """Mean of (DN - d) / V: signal above dark, as on the optical axis."""
        return self.mean_dn - dark_dn * self.mean_inverse_v

    def shape_dn(self, level_dn: float) -> float:
        """Return by how much the part that the meter sees is brighter than the region, of (DN - level) / V."""
        return self._brighter_dn(self.middle, level_dn)

    def rim_dn(self, level_dn: float) -> float:
        """Return by how much the rim makes the region brighter than what is inside, of (DN - level) / V."""
        return -self._brighter_dn(self.inside, level_dn)

    def _brighter_dn(self, part: PatchPart | None, level_dn: float) -> float:
        return 0.0 if part is None else part.mean_dn - level_dn * part.mean_inverse_v - self.net_dn(level_dn)

    def net_dn_at_pixel(self, dark_dn: float) -> float:
        """Signal above dark of the region's pixels, V not removed."""
        return self.mean_dn / self.mean_inverse_v - dark_dn

    def fixed_pattern_variance_dn2(self, dark_dn: float) -> float:
        """Variance of (DN - d) / V from pixel to pixel, noise removed; below 0 by chance."""
        noise_dn2 = self.temporal_variance_dn2 * self.mean_inverse_v**2 / self.n_frames
        return self.nonuniformity.pixel_variance_dn2(dark_dn) - noise_dn2


#: Observations by patch.
Groups: TypeAlias = Mapping[str, Sequence[PatchObservation]]


@dataclass(frozen=True, kw_only=True)
class DarkObservation(Observation):
    """Dark signal at one exposure, over the whole sensor.

    Parameters
    ----------
    nonuniformity_dn : float
        Standard deviation of slow changes of the dark signal across the sensor; 0 if not significant.
    pattern_dn : float
        Standard deviation of the dark signal from pixel to pixel, noise removed (EMVA 1288: DSNU, in DN); with a dark
        library, its residual.
    line_noise_dn, line_pattern_dn : (float, float)
        Parts of noise and pattern that whole columns and rows have in common, as standard deviations.

    Examples
    --------
    >>> from labcdp.calibration import observe_dark
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> records = session.frames("dark")
    >>> dark = observe_dark([session.load(r) for r in records if r.exposure_s == records[0].exposure_s])
    >>> dark.n_frames, dark.mean_variance_dn2 > 0
    (2, True)
    """

    nonuniformity_dn: float
    pattern_dn: float = 0.0
    line_noise_dn: tuple[float, float] = (0.0, 0.0)
    line_pattern_dn: tuple[float, float] = (0.0, 0.0)

    @property
    def mean_noise_dn2(self) -> float:
        """Variance of the mean of one frame by noise of pixels, columns and rows, with rounding as the least noise."""
        rows, columns = self.state.image_shape
        of_lines = lines_variance_dn2(self.line_noise_dn, (columns, rows))
        return max(self.temporal_variance_dn2, self.rounding_dn2_of_pixel) / self.n_pixels + of_lines

    @property
    def rounding_dn2(self) -> float:
        """Variance of the mean by rounding."""
        return quantisation_variance_dn2(self.temporal_variance_dn2 + self.pattern_dn**2, self.step_dn)

    @property
    def mean_variance_dn2(self) -> float:
        """Variance of the mean by noise, drift of the black level between these frames, and rounding."""
        return max(self.mean_noise_dn2, self.frame_means_variance_dn2) / self.n_frames + self.rounding_dn2


def _where_known(expected: object, actual: object) -> tuple[str, str]:
    """Texts to compare: equal if either is unknown."""
    return ("", "") if expected is None or actual is None else (_text(expected), _text(actual))


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _size(shape: tuple[int, int]) -> str:
    return f"{shape[1]} x {shape[0]} pixels"
