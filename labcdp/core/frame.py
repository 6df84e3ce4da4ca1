"""Frame: an image in digital numbers together with what is needed to understand it."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..core.clock import exposure_text
from .companding import Companding, shipped_curve_with
from .disk import quoted, record_of
from .disk.files import shown
from .dn import look_up
from .errors import InputError, naming
from .result import html_table

_DN_TYPES = (np.dtype(np.uint8), np.dtype(np.uint16), np.dtype(np.uint32))
#: Most bits of DN: those that float32, in which images are displayed and stored, holds exactly.
MOST_BITS = 24

#: Place of the red pixel in the first 2 x 2, row by row, by the pattern of the colour filter: those of the GenICam
#: Bayer pixel formats by their first two pixels, and those with clear pixels by all four.
_RED_AT = {"RG": 0, "GR": 1, "GB": 2, "BG": 3, "RCCB": 0, "CRBC": 1, "CBRC": 2, "BCCR": 3,
           "RCCC": 0, "CRCC": 1, "CCRC": 2, "CCCR": 3}  # fmt: skip
#: Patterns of colour filters.
COLOUR_FILTERS = tuple(_RED_AT)
#: How users write patterns, by all four pixels of the first 2 x 2.
ColourFilter: TypeAlias = Literal[
    "RGGB", "GRBG", "GBRG", "BGGR", "RCCB", "CRBC", "CBRC", "BCCR", "RCCC", "CRCC", "CCRC", "CCCR"
]
#: Patterns as users write them, by all four pixels of the first 2 x 2.
FILTER_NAMES = {"RGGB": "RG", "GRBG": "GR", "GBRG": "GB", "BGGR": "BG"} | {
    name: name for name in COLOUR_FILTERS if "C" in name
}
_NOT_RECORDED = ("dn", "camera", "clipped", "companding")
#: Most bits of DN for each of which tables have a value.
_INDEXED_BITS = 16
#: Depth of the DN in which the register of a Manta counts.
_REGISTER_BITS = 12
#: Colour planes of a Bayer frame: green pixels by the colour they share a row with. Clear pixels of other filters take
#: the place of green ones, and of RCCC that of blue ones too.
PLANES = ("R", "Gr", "Gb", "B")


@dataclass(frozen=True)
class CameraIdentity:
    """Identity of a camera.

    Parameters
    ----------
    vendor, model, serial : str
        As the camera reports them (GenICam ``DeviceVendorName``, ``DeviceModelName``, ``DeviceID``).
    simulated : bool
        True if the device is labcdp's simulated camera, however real the protocol.

    Examples
    --------
    >>> from labcdp.core.frame import CameraIdentity
    >>> print(CameraIdentity("Allied Vision", "Manta G-505B", "50-0503363706"))
    Allied Vision Manta G-505B (50-0503363706)
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    vendor: str
    model: str
    serial: str
    simulated: bool = False

    def __str__(self) -> str:
        """Return vendor, model and serial number on one line."""
        return f"{self.vendor} {self.model} ({self.serial}{', simulated' if self.simulated else ''})"


@dataclass(frozen=True)
class Readout:
    """Part of the sensor that a frame shows, in pixels of the frame, and how it was read out.

    Two are equal if the pixel at the same row and column of their frames is the same of the sensor.

    Parameters
    ----------
    x, y : float
        First column and row (SFNC OffsetX, OffsetY); colour planes of an odd offset have half pixels.
    binning, decimation : (int, int)
        Columns and rows that became one pixel.
    mirrored : (bool, bool)
        Whether columns and rows are in reverse order (SFNC ReverseX, ReverseY).
    sensor_size : (float, float) or None
        Width and height of the largest region (SFNC WidthMax, HeightMax); None if unknown.

    Examples
    --------
    >>> from labcdp.core.frame import Readout
    >>> Readout(x=100, y=40, binning=(2, 2)).parts["first pixel on the sensor"]
    'column 100, row 40'
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    x: float = 0
    y: float = 0
    binning: tuple[int, int] = (1, 1)
    decimation: tuple[int, int] = (1, 1)
    mirrored: tuple[bool, bool] = (False, False)
    sensor_size: tuple[float, float] | None = field(default=None, compare=False)

    @property
    def parts(self) -> dict[str, str]:
        """Each property as text, by its name in messages; the origin last, which binning and mirroring move."""
        turned = [axis for axis, turned in zip(("columns", "rows"), self.mirrored, strict=True) if turned]
        return {
            "binning": "{} x {}".format(*self.binning),
            "decimation": "{} x {}".format(*self.decimation),
            "mirroring": " and ".join(turned) or "none",
            "first pixel on the sensor": f"column {self.x:g}, row {self.y:g}",
        }

    @staticmethod
    def compared(mine: Readout | None, theirs: Readout | None) -> list[tuple[str, str, str]]:
        """Name and both texts of each property; none if one of the readouts is unknown."""
        if mine is None or theirs is None:
            return []
        return [(name, text, theirs.parts[name]) for name, text in mine.parts.items()]

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Readout:
        """Make it of the values of its fields; JSON has lists where they are tuples."""
        known: dict[str, Any] = {k: tuple(value) if isinstance(value, list) else value for k, value in values.items()}
        return cls(**known)

    def in_larger_pixels(self, factor: float) -> Readout:
        """Return the same in pixels so many times larger: 2 from a Bayer frame to its planes, 1/2 back."""
        size = self.sensor_size and (self.sensor_size[0] / factor, self.sensor_size[1] / factor)
        return replace(self, x=self.x / factor, y=self.y / factor, sensor_size=size)

    @property
    def pitches(self) -> float:
        """Pitches of the sensor from pixel to pixel; where columns and rows differ, the geometric mean."""
        return math.sqrt(math.prod((*self.binning, *self.decimation)))

    def axis_px(self, shape: tuple[int, int]) -> tuple[float, float] | None:
        """Middle of the sensor, (x, y) in pixels of a frame of `shape`; None if it is that of the frame, or unknown."""
        if self.sensor_size is None:
            return None
        x, y = self.sensor_size[0] / 2 - self.x, self.sensor_size[1] / 2 - self.y
        return None if (y, x) == (shape[0] / 2, shape[1] / 2) else (x, y)

    def window_in(
        self, shape: tuple[int, int], whole: Readout, whole_shape: tuple[int, int]
    ) -> tuple[slice, slice] | None:
        """Return where a frame of `shape` lies in a larger one; None if it is no part of it, or read out otherwise."""
        row, column = self.y - whole.y, self.x - whole.x
        inside = 0 <= row <= whole_shape[0] - shape[0] and 0 <= column <= whole_shape[1] - shape[1]
        # Cameras differ in whether the offset is that before or after mirroring.
        turned = any((*self.mirrored, *whole.mirrored))
        alike = (self.binning, self.decimation) == (whole.binning, whole.decimation) and not turned
        if not (inside and alike and row == int(row) and column == int(column)):
            return None
        return slice(int(row), int(row) + shape[0]), slice(int(column), int(column) + shape[1])


@dataclass(frozen=True)
class BlackPattern:
    """What the black levels of pixels add to that of their frame, in DN: a group that repeats, columns and rows.

    Parameters
    ----------
    group : tuple of tuple of float
        Rows of a group of pixels, which repeats from the first pixel of the frame on.
    columns, rows : tuple of float
        What all pixels of each column, and of each row, have in common besides; empty for nothing.

    Examples
    --------
    >>> from labcdp.core.frame import BlackPattern
    >>> BlackPattern(group=((-1.0, 1.0),)).offsets_dn((2, 4)).tolist()
    [[-1.0, 1.0, -1.0, 1.0], [-1.0, 1.0, -1.0, 1.0]]
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    group: tuple[tuple[float, ...], ...]
    columns: tuple[float, ...] = ()
    rows: tuple[float, ...] = ()

    @classmethod
    def split(
        cls, group: NDArray[Any], columns: NDArray[Any] | None = None, rows: NDArray[Any] | None = None
    ) -> tuple[float, BlackPattern | None]:
        """Split black levels into their mean, and the pattern around it; None if all pixels have the same.

        Parameters
        ----------
        group : ndarray of float, shape (m, n)
            Levels of a group of pixels, which repeats.
        columns, rows : ndarray of float, shape (width,) and (height,), or None
            What is added by columns and rows; None for nothing.
        """
        parts = [np.asarray(part, float) for part in (group, *(part for part in (columns, rows) if part is not None))]
        mean_dn = sum(float(part.mean()) for part in parts)
        around = [part - part.mean() for part in (group, columns, rows) if part is not None]
        if not any(np.any(part) for part in around):
            return mean_dn, None
        of_lines = [
            () if part is None or not np.ptp(part) else tuple((part - part.mean()).tolist()) for part in (columns, rows)
        ]
        return mean_dn, cls(tuple(tuple(row) for row in around[0].tolist()), *of_lines)

    def offsets_dn(self, shape: tuple[int, int]) -> NDArray[np.float32]:
        """Return it for each pixel of a frame; shape (height, width)."""
        return _offsets_dn(self, shape)

    def require_fit(self, shape: tuple[int, int]) -> None:
        """Refuse a frame of another size; raises InputError."""
        lengths = {len(row) for row in self.group}
        fits = (
            len(lengths) == 1
            and 0 not in lengths
            and all(len(offsets) in (0, size) for offsets, size in ((self.rows, shape[0]), (self.columns, shape[1])))
        )
        if not fits:
            raise InputError(f"the black pattern does not fit a frame of {shape[1]} x {shape[0]} pixels")

    def of_plane(self, shape: tuple[int, int], row: int, column: int) -> tuple[float, BlackPattern | None]:
        """Return mean and pattern of every second pixel of every second row of a frame, from a place on."""
        group = np.array(self.group)
        # A group of an odd size repeats after twice as many pixels of the plane.
        twice = np.tile(group, [1 + size % 2 for size in group.shape])
        starts, lines = (column, row), (self.columns, self.rows)
        columns, rows = (
            np.array(values[start:end:2]) if values else None
            for values, start, end in zip(lines, starts, (shape[1], shape[0]), strict=True)
        )
        return self.split(twice[row::2, column::2], columns, rows)


@lru_cache(maxsize=8)
def _offsets_dn(pattern: BlackPattern, shape: tuple[int, int]) -> NDArray[np.float32]:
    group = np.array(pattern.group, dtype=np.float32)
    height, width = shape
    tiled = np.tile(group, (-(-height // group.shape[0]), -(-width // group.shape[1])))[:height, :width]
    for values, axes in ((pattern.columns, (None, slice(None))), (pattern.rows, (slice(None), None))):
        if values:
            tiled = tiled + np.array(values, dtype=np.float32)[axes]
    tiled.flags.writeable = False
    return tiled


@dataclass(frozen=True, eq=False)
class DnLevels:
    """Linear values of a frame in the order of an index.

    Parameters
    ----------
    values_dn : ndarray of float64, shape (n,)
        Linear value by index, rising.
    steps_dn : ndarray of float64, shape (n,)
        Linear values that share a DN, by index: what rounding is relative to.
    index : ndarray of unsigned integers, shape (height, width)
        Index of each pixel.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.core.frame import DnLevels
    >>> levels = DnLevels(np.array([0.0, 4.0]), np.ones(2), np.array([[1, 0]], dtype=np.uint8))
    >>> levels.values_dn[levels.index].tolist()
    [[4.0, 0.0]]
    """

    values_dn: NDArray[np.float64]
    steps_dn: NDArray[np.float64]
    index: NDArray[np.unsignedinteger[Any]]


@dataclass(frozen=True, eq=False)
class Frame:
    """An immutable image in DN, from a camera, recorded session, file or simulation.

    Parameters
    ----------
    dn : ndarray of uint8, uint16 or uint32, shape (height, width)
        Digital numbers; made read-only on construction (copied only if writable elsewhere). uint32 for more than 16
        bits.
    exposure_s : float
        Exposure time in seconds, as the device applied it.
    gain_db : float
        Analogue gain in dB (20 log10 of the amplitude ratio).
    bit_depth : int
        Bits of the DN scale, 1 to 24.
    saturation_dn : float
        DN from which a pixel counts as saturated; at most ``2**bit_depth - 1``.
    black_level_dn : float or None
        DN of the dark signal that a file states, else None: of a camera it is measured from dark frames.
    pixel_format : str
        GenICam PFNC name the data came in, for example ``Mono12Packed``.
    colour_filter : str or None
        ``RG``, ``GB``, ``GR`` or ``BG`` for a Bayer sensor, all four pixels for one with clear ones, such as ``RCCB``
        or ``RCCC``; None for monochrome.
    temperature_c : float or None
        Device temperature in degrees Celsius, if known.
    timestamp : datetime
        Host time of arrival, with time zone.
    camera_timestamp_ns : int
        The camera's own clock, nanoseconds.
    frame_id : int
        The camera's frame counter.
    camera : CameraIdentity
        Camera.
    plane : str or None
        ``R``, ``Gr``, ``Gb`` or ``B`` if these are the pixels of one colour of a Bayer frame, None for a whole frame.
    readout : Readout or None
        Which part of the sensor it shows; None if unknown.
    black_level_register : float or None
        Black level that is set in the camera, in the register's own unit, which is not that of the DN; None if it is
        not from a camera.
    black_pattern : BlackPattern or None
        What the black levels of pixels add to `black_level_dn`; None if all pixels have the same.
    clipped : ndarray of bool, shape (height, width), or None
        Of DN that were made of colours: pixels of which a colour was at its highest value. Not recorded.
    companding : Companding or None
        Curve by which the DN are codes of linear values; None if they are in proportion to light, or to a response that
        is to be found. Its name and hash are recorded.

    Raises
    ------
    InputError
        If the array is not 2-D unsigned integer, or a value is out of its range.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> frame = session.load(session.frames("light")[0])
    >>> frame.shape, frame.bit_depth
    ((400, 480), 12)
    """

    dn: NDArray[np.unsignedinteger[Any]]
    exposure_s: float
    gain_db: float
    bit_depth: int
    saturation_dn: float
    black_level_dn: float | None
    pixel_format: str
    colour_filter: str | None
    temperature_c: float | None
    timestamp: datetime
    camera_timestamp_ns: int
    frame_id: int
    camera: CameraIdentity
    plane: str | None = None
    black_pattern: BlackPattern | None = None
    clipped: NDArray[np.bool_] | None = None
    readout: Readout | None = None
    black_level_register: float | None = None
    companding: Companding | None = None

    def __post_init__(self) -> None:
        dn = np.asarray(self.dn)
        if dn.ndim != 2 or dn.size == 0 or dn.dtype not in _DN_TYPES:
            raise InputError(
                f"a frame is a non-empty 2-D array of uint8, uint16 or uint32, got {dn.dtype} of shape {dn.shape}"
            )
        if not 1 <= self.bit_depth <= MOST_BITS:
            raise InputError(f"bit_depth is {self.bit_depth}: give 1 to {MOST_BITS} bits")
        if self.companding is not None and self.companding.file_bits != self.bit_depth:
            raise InputError(
                f"bit_depth is {self.bit_depth}, but the curve {self.companding.name} is for values of "
                f"{self.companding.file_bits} bits: correct bits and shift of the curve"
            )
        if not (math.isfinite(self.exposure_s) and self.exposure_s > 0):
            raise InputError(f"exposure_s is {self.exposure_s}: give a positive number of seconds")
        if not math.isfinite(self.gain_db):
            raise InputError(f"gain_db is {self.gain_db}: give a finite number of decibels")
        largest_dn = 2**self.bit_depth - 1
        if not 0 < self.saturation_dn <= largest_dn:
            raise InputError(f"saturation_dn is {self.saturation_dn}: give a value above 0, up to {largest_dn}")
        if self.colour_filter is not None and self.colour_filter not in COLOUR_FILTERS:
            raise InputError(f"colour_filter is {quoted(self.colour_filter)}: give one of {COLOUR_FILTERS} or None")
        if self.plane is not None and (self.plane not in PLANES or self.colour_filter is not None):
            raise InputError(
                f"plane is {quoted(self.plane)} with colour_filter {quoted(self.colour_filter)}: give one of {PLANES} "
                "without a colour filter, or None"
            )
        if self.black_pattern is not None:
            self.black_pattern.require_fit((dn.shape[0], dn.shape[1]))
        if self.timestamp.tzinfo is None:
            raise InputError("timestamp has no time zone: give an aware datetime")
        if dn.flags.writeable or (isinstance(dn.base, np.ndarray) and dn.base.flags.writeable):
            dn = dn.copy()
            dn.flags.writeable = False
        object.__setattr__(self, "dn", dn)

    def __repr__(self) -> str:
        height, width = self.shape
        settings = f"{self.pixel_format}, {exposure_text(self.exposure_s)}, {self.gain_db:g} dB"
        return f"<Frame {width} x {height} {settings}, {self.camera.model}>"

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        return html_table((str(self.camera), ""), [("frame", repr(self)[7:-1]), ("taken", str(self.timestamp))])

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.dn.shape[0], self.dn.shape[1]

    @property
    def nominal_black_dn(self) -> float:
        """Black level in DN where nothing was measured; see `nominal_black_dn`."""
        return nominal_black_dn(self.black_level_dn, self.black_level_register, self.bit_depth)

    @property
    def linear_saturation_dn(self) -> float:
        """Linear value from which a pixel is saturated: of codes that of the curve, else `saturation_dn`."""
        curve = self.companding
        if curve is None:
            return self.saturation_dn
        return float(curve.linear(min(self.saturation_dn, curve.saturation_dn) / 2.0**curve.shift))

    @property
    def linear_black_dn(self) -> float:
        """Linear value without light where nothing was measured: 0 of codes, whose curve is without black level."""
        return self.nominal_black_dn if self.companding is None else 0.0

    def linear_dn(self, window: tuple[slice, slice] = (slice(None), slice(None))) -> NDArray[Any]:
        """Return the linear values of some rows and columns: DN as they are, or float64 of the curve of codes."""
        dn = self.dn[window]
        return dn if self.companding is None else look_up(self.companding.linear_by_dn, dn)

    def with_curve(self, curve: Companding) -> Frame:
        """Return the frame whose DN are codes of a curve, without embedded rows.

        Raises
        ------
        InputError
            If a DN is beyond the bits of the codes, or no row is left.
        """
        dn = curve.image_rows(self.dn)
        if dn.max() >= 2**curve.file_bits:
            raise InputError(
                f"the frame has values up to {dn.max()}, but codes of the curve {curve.name} end at "
                f"{2**curve.file_bits - 1}: correct bits and shift of the curve"
            )
        return replace(
            self.with_pixels(dn),
            bit_depth=curve.file_bits,
            companding=curve,
            saturation_dn=min(self.saturation_dn, curve.saturation_dn),
            black_level_dn=curve.black_dn,
            readout=self.readout and replace(self.readout, y=self.readout.y + curve.embedded_rows[0]),
        )

    def dn_at(self, linear_dn: float) -> int:
        """Return the highest DN whose linear value is not above this one."""
        if self.companding is None:
            return int(linear_dn)
        return int(np.searchsorted(self.companding.linear_by_dn, linear_dn, side="right")) - 1

    @cached_property
    def levels(self) -> DnLevels:
        """Linear values in the order of an index, and the index of each pixel, for tables with a value for each.

        The index is the DN itself where these have at most 16 bits; of more bits it numbers the values of the frame.
        """
        if self.companding is not None:
            return DnLevels(self.companding.linear_by_dn, self.companding.steps_by_dn, self.dn)
        if self.bit_depth <= _INDEXED_BITS:
            values = np.arange(2**self.bit_depth, dtype=np.float64)
            return DnLevels(values, np.ones(values.size), self.dn)
        found, index = np.unique(self.dn, return_inverse=True)
        return DnLevels(found.astype(np.float64), np.ones(found.size), index.reshape(self.shape).astype(np.uint32))

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Mask of pixels at or above `saturation_dn`, or with a colour at its end; shape (height, width)."""
        return self.dn >= self.saturation_dn if self.clipped is None else self.clipped

    def metadata(self) -> dict[str, Any]:
        """Everything but the pixels, as values JSON can hold; the inverse is `from_metadata`."""
        values = {name: getattr(self, name) for name in self.__dataclass_fields__ if name not in _NOT_RECORDED}
        for name in ("plane", "black_pattern", "readout"):
            # What a frame lacks is not written: its files stay as they always were.
            if values[name] is None:
                del values[name]
        for name in ("black_pattern", "readout"):
            if values.get(name) is not None:
                values[name] = asdict(values[name])
        if self.companding is not None:
            values["companding"] = self.companding.identity
        return values | {"timestamp": self.timestamp.isoformat(), "camera": asdict(self.camera)}

    @classmethod
    def from_metadata(
        cls, dn: NDArray[np.unsignedinteger[Any]], metadata: dict[str, Any], curve: Companding | None = None
    ) -> Frame:
        """Join pixels with what `metadata` returned for them.

        Parameters
        ----------
        dn : ndarray
            The pixels.
        metadata : dict
            As of `metadata`; ``features`` of the camera, as `labcdp snap` writes them, are left out.
        curve : Companding or None
            Curve that is stated for the frame, for example by its session; curves that ship with labcdp need not be.

        Raises
        ------
        InputError
            If a field is missing, unknown or has an unusable value, or the frame has codes of another curve.
        """
        metadata = {name: value for name, value in metadata.items() if name != "features"}
        companding = recorded_curve(metadata, curve)
        return cls(dn=dn, **_recorded(metadata) | black_levels(metadata), companding=companding)

    def with_pixels(self, dn: NDArray[np.unsignedinteger[Any]]) -> Frame:
        """Return the same frame with other pixels; of another size, they have no black pattern."""
        return replace(self, dn=dn, black_pattern=self.black_pattern if dn.shape == self.dn.shape else None)


def checked_metadata(metadata: dict[str, Any]) -> dict[str, Any]:
    """Return metadata of a frame as they are, or raise InputError naming the key; `Frame` itself checks ranges.

    Examples
    --------
    >>> from labcdp.core.frame import checked_metadata
    >>> checked_metadata({"exposure_s": "long"})
    Traceback (most recent call last):
        ...
    labcdp.core.errors.InputError: frame metadata cannot be read: key exposure_s: Input should be a valid number
    """
    _recorded(metadata)
    return metadata


def _recorded(metadata: dict[str, Any]) -> dict[str, Any]:
    others = {name: value for name, value in metadata.items() if name != "companding"}
    with naming("frame metadata cannot be read"):
        return record_of(Frame, _with_pattern(others), "dn", "clipped", "companding")


def recorded_curve(metadata: dict[str, Any], stated: Companding | None = None) -> Companding | None:
    """Return the curve of a frame's codes by its metadata; None for none.

    Raises
    ------
    InputError
        If it is another one than that stated, or none is stated and none of its hash ships with labcdp.

    Examples
    --------
    >>> from labcdp.core.frame import recorded_curve
    >>> recorded_curve({"exposure_s": 0.01}) is None
    True
    """
    recorded = metadata.get("companding")
    if recorded is None:
        return None
    if not (isinstance(recorded, dict) and recorded.keys() == {"name", "sha256"}):
        raise InputError(f"companding is {quoted(recorded)}: restore the file from a copy")
    if stated is not None and stated.sha256 == recorded["sha256"]:
        return stated
    shipped = shipped_curve_with(str(recorded["sha256"]))
    if stated is None and shipped is not None:
        return shipped
    name = shown(str(recorded["name"]))
    other = "is not in it" if stated is None else f"is not {stated.name} as stated"
    raise InputError(f"it has codes of the curve {name}, which {other}: give the curve it was recorded with")


def _with_pattern(metadata: dict[str, Any]) -> dict[str, Any]:
    """Metadata that have the black levels of the planes R, Gr, Gb and B, as those once had, with their pattern."""
    levels, filter_name = metadata.get("plane_black_levels_dn"), metadata.get("colour_filter")
    if levels is None or filter_name not in COLOUR_FILTERS:
        return metadata
    with naming("plane_black_levels_dn"):
        if not (
            isinstance(levels, list | tuple)
            and len(levels) == 4
            and all(isinstance(v, int | float) and not isinstance(v, bool) for v in levels)
        ):
            raise InputError(f"it is {quoted(levels)}: restore the file from a copy")
    kept = {name: value for name, value in metadata.items() if name != "plane_black_levels_dn"}
    _, pattern = BlackPattern.split(plane_group(filter_name, levels))
    return kept if pattern is None else kept | {"black_pattern": asdict(pattern)}


def filter_name(colour_filter: str) -> str:
    """Return how users write a pattern: all four pixels of the first 2 x 2.

    Examples
    --------
    >>> filter_name("GR"), filter_name("RCCC")
    ('GRBG', 'RCCC')
    """
    return next(name for name, pattern in FILTER_NAMES.items() if pattern == colour_filter)


def luminance_pixels(colour_filter: str) -> tuple[tuple[int, int], ...]:
    """Return row and column of the pixels of each 2 x 2 that stand for luminance: the green, or the clear ones.

    Examples
    --------
    >>> luminance_pixels("RG"), luminance_pixels("RCCC")
    (((0, 1), (1, 0)), ((0, 1), (1, 0), (1, 1)))
    """
    return tuple(divmod(at, 2) for at, colour in enumerate(filter_name(colour_filter)) if colour in "GC")


def plane_positions(colour_filter: str) -> dict[str, tuple[int, int]]:
    """Return row and column of each plane's pixel in the first 2 x 2, by the names of `PLANES`.

    Examples
    --------
    >>> from labcdp.core.frame import plane_positions
    >>> plane_positions("RG")
    {'R': (0, 0), 'Gr': (0, 1), 'Gb': (1, 0), 'B': (1, 1)}
    """
    row, column = divmod(_RED_AT[colour_filter], 2)
    # Gr shares the row of R, Gb its column.
    places = ((row, column), (row, 1 - column), (1 - row, column), (1 - row, 1 - column))
    return dict(zip(PLANES, places, strict=True))


def plane_group(colour_filter: str, levels: Sequence[float]) -> NDArray[np.float64]:
    """Return values of the planes R, Gr, Gb and B by their places in the first 2 x 2 pixels.

    Examples
    --------
    >>> from labcdp.core.frame import plane_group
    >>> plane_group("BG", (1, 2, 3, 4)).tolist()
    [[4.0, 3.0], [2.0, 1.0]]
    """
    group = np.empty((2, 2))
    for position, level in zip(plane_positions(colour_filter).values(), levels, strict=True):
        group[position] = level
    return group


def nominal_black_dn(stated_dn: float | None, register: float | None, bit_depth: int) -> float:
    """Return the black level in DN that is stated, else a guess: a register in DN of 12 bits, as of a Manta; else 0.

    Examples
    --------
    >>> from labcdp.core.frame import nominal_black_dn
    >>> nominal_black_dn(None, register=4.0, bit_depth=8), nominal_black_dn(64.0, None, 12)
    (0.25, 64.0)
    """
    if stated_dn is not None:
        return stated_dn
    return (register or 0.0) * 2.0 ** (bit_depth - _REGISTER_BITS)


def black_levels(metadata: dict[str, Any]) -> dict[str, float | None]:
    """Return black level in DN and register of a frame's metadata, which once had one name for both.

    Examples
    --------
    >>> from labcdp.core.frame import black_levels
    >>> black_levels({"black_level_dn": 64.0, "camera_timestamp_ns": 0})
    {'black_level_dn': 64.0, 'black_level_register': None}
    """
    stated = metadata["black_level_dn"]
    if "black_level_register" in metadata:
        return {"black_level_dn": stated, "black_level_register": metadata["black_level_register"]}
    # Files have no clock of a camera.
    of_file = metadata["camera_timestamp_ns"] == 0
    return {"black_level_dn": stated if of_file else None, "black_level_register": None if of_file else stated}


def pixels_sha256(frame: Frame) -> str:
    """Return a hash of shape, type, exposure and pixels, which noise makes unique to each frame.

    Examples
    --------
    >>> from labcdp.core.frame import pixels_sha256
    >>> from labcdp.session import Session, example_session
    >>> session = Session.open(example_session())
    >>> first, second = (session.load(record) for record in session.frames("dark")[:2])
    >>> pixels_sha256(first) == pixels_sha256(second)
    False
    """
    digest = hashlib.sha256(f"{frame.shape} {frame.dn.dtype.name} {frame.exposure_s!r}".encode())
    digest.update(frame.dn.tobytes())
    return digest.hexdigest()
