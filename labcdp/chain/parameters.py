"""Parameters of the chain: unit and range stand at the field, and one form of message names key, value and range."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import inf, isfinite
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, TypeAlias, get_args, get_type_hints

import numpy as np

from ..core.disk.files import shown
from ..core.errors import InputError
from ..core.percent import plain_contrast, plain_fraction

#: Most pixels of a side of a scene or sensor; a larger frame would not fit into any memory.
LARGEST_SIDE = 20_000

#: Highest luminance of a scene: well above the sun's 1.6e9 cd/m^2, and low enough that no stage leaves float32.
HIGHEST_CD_M2 = 1e12


@dataclass(frozen=True)
class Number:
    """Unit and range of a number, in its annotation: ``Annotated[float, Number("cd/m^2", 0, 1e12)]``.

    Parameters
    ----------
    unit : str
        Unit as messages name it.
    low, high : float
        Lowest and highest value.
    above : bool
        Whether the lowest itself is refused.
    """

    unit: str
    low: float
    high: float = inf
    above: bool = False

    def check(self, name: str, value: Any) -> None:
        """Refuse a value that is not a finite number in the range.

        Raises
        ------
        InputError
            Naming the key, its value, the range and the unit.
        """
        if not _is_number(value) or not self.low <= value <= self.high or (self.above and value == self.low):
            raise InputError(
                f"{name} is {shown(value)}: give {self._interval()}{self.unit and ' '}{self.unit}", key=name
            )

    def _interval(self) -> str:
        start = f"a number above {self.low:g}" if self.above else f"a number from {self.low:g}"
        if self.high == inf:
            return start if self.above else f"a number of at least {self.low:g}"
        return f"{start} to {self.high:g}"


@dataclass(frozen=True)
class Whole(Number):
    """Unit and range of a whole number."""

    def check(self, name: str, value: Any) -> None:
        """Refuse a value that is not a whole number in the range; raises InputError as `Number.check`."""
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
            raise InputError(
                f"{name} is {shown(value)}: give a whole number{self.unit and ' of '}{self.unit}", key=name
            )
        super().check(name, value)


class Ratio(Number):
    """Unit and range of a fraction, which may be given as a percentage such as "50%"."""

    def plain(self, _name: str, value: Any) -> Any:
        """Return a percentage as a fraction, anything else as it is."""
        return plain_fraction(value)


class Contrast(Ratio):
    """Unit and range of a contrast."""

    def plain(self, name: str, value: Any) -> Any:
        """Return a percentage as a fraction; raises InputError for one without its sign."""
        return plain_contrast(value, name)


class Flag:
    """True or false."""

    def check(self, name: str, value: Any) -> None:
        """Refuse a value that is not true or false; raises InputError."""
        if not isinstance(value, bool | np.bool_):
            raise InputError(f"{name} is {shown(value)}: give true or false", key=name)


Side: TypeAlias = Annotated[int, Whole("pixels", 1, LARGEST_SIDE)]
Luminance: TypeAlias = Annotated[float, Number("cd/m²", 0, HIGHEST_CD_M2)]
Fraction: TypeAlias = Annotated[float, Ratio("(a fraction)", 0, 1, above=True)]
Bits: TypeAlias = Annotated[int, Whole("bits", 1, 16)]
MergedBits: TypeAlias = Annotated[int, Whole("bits", 1, 48)]
Oversampling: TypeAlias = Annotated[int, Whole("samples", 1, 64)]
ElectronRate: TypeAlias = Annotated[float, Number("e⁻/s", 0, 1e7)]
# Ranges are those of real cameras with a margin, so that a value in another unit is outside.
PixelPitch: TypeAlias = Annotated[float, Number("m", 1e-7, 2e-4)]
# Wells are often stated in ke-; float32 holds whole numbers up to 1.6e7.
FullWell: TypeAlias = Annotated[float, Number("e⁻", 25, 1e7)]
SystemGain: TypeAlias = Annotated[float, Number("DN/e⁻", 1e-4, 1e4)]
Doubling: TypeAlias = Annotated[float, Number("K", 1, 100)]
Noise: TypeAlias = Annotated[float, Number("e⁻", 0, 1e4)]

TEMPERATURE, GAIN = Number("°C", -100, 200), Number("dB", -60, 60)
Temperature: TypeAlias = Annotated[float, TEMPERATURE]

#: Rule for seeds and numbers that are counted from 0.
COUNT = Whole("", 0)
THREADS = Whole("", 1)


class Parameters:
    """A dataclass that refuses values its annotations do not allow.

    Raises
    ------
    InputError
        Naming the first field out of its range.
    """

    def __post_init__(self) -> None:
        cls: Any = type(self)
        for name, rule, optional in _rules(cls):
            value = getattr(self, name)
            if isinstance(rule, Ratio):
                value = rule.plain(name, value)
                object.__setattr__(self, name, value)
            if not (optional and value is None):
                rule.check(name, value)


@dataclass(frozen=True)
class Sized(Parameters):
    """Parameters with a size in pixels.

    Parameters
    ----------
    width, height : int
        Size in pixels.

    Raises
    ------
    InputError
        If the size is not two whole numbers of pixels.
    """

    width: Side
    height: Side

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        return self.height, self.width


@lru_cache
def _rules(cls: type) -> list[tuple[str, Number | Flag, bool]]:
    """Fields with their rules, and whether they may be None."""
    return [
        (name, rule, NoneType in (*get_args(hint), *get_args(get_args(part)[0])))
        for name, hint in get_type_hints(cls, include_extras=True).items()
        # Of ``Length | None`` the rule stands in a part.
        for part in (hint, *get_args(hint))
        for rule in getattr(part, "__metadata__", ())
        if isinstance(rule, Number | Flag)
    ]


def _is_number(value: Any) -> bool:
    """Whether a value is a finite number; a truth value is none, nor a whole number too large for a float."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    return isfinite(value) if not isinstance(value, int) else abs(value) < 2**1000


def file_state(path: Path) -> tuple[int, int] | None:
    """Return time and size of a file, by which it is read again where it changed; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size
