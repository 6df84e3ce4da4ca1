"""Companding: the piecewise linear (PWL) curve by which a sensor sends linear values of many bits in codes of few."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache
from importlib.resources import files
from math import ceil, log2
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .disk.files import shown
from .errors import InputError


@dataclass(frozen=True)
class Companding:
    """A piecewise linear curve from the codes of a file to linear values.

    Between knees the curve is straight, and beyond the last one clipped: codes from there on are saturated. A sensor
    adds its black level to the linear value, before it compresses it (`black_value`), or to the code (`black_code`).

    Parameters
    ----------
    name : str
        Name, for reports.
    codes, values : tuple of float
        The knees: codes and their linear values, both rising, at least two.
    bits : int
        Bits of a code, 1 to 16.
    black_value : float
        Linear value without light, on the curve.
    black_code : float
        Code without light, if the black level is added behind the curve; knees are codes without it.
    shift : int
        Bits by which codes are shifted up in a file: 4 for 12 bits at the upper end of 16.
    embedded_rows : (int, int)
        Rows with data about the image above and below it, which are no pixels.

    Raises
    ------
    InputError
        If the knees do not rise, leave the range of the codes, or are fewer than two, if the black level is not on the
        curve, or if something is no number, or not whole where it must be.

    Examples
    --------
    >>> from labcdp.files import Companding
    >>> curve = Companding("20 in 12 bits", (0, 2048, 3040, 4000), (0, 2048, 65536, 1048576), bits=12)
    >>> curve.linear([2048, 3040, 3041]).tolist()
    [2048.0, 65536.0, 66560.0]
    """

    name: str
    codes: tuple[float, ...]
    values: tuple[float, ...]
    bits: int
    black_value: float = 0.0
    black_code: float = 0.0
    shift: int = 0
    embedded_rows: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        for what in ("codes", "values", "embedded_rows"):
            object.__setattr__(self, what, self._numbers(what))
        for what in ("bits", "shift", "black_value", "black_code"):
            object.__setattr__(self, what, self._number(getattr(self, what), what))
        if not (isinstance(self.bits, int) and 1 <= self.bits <= 16 and isinstance(self.shift, int)):
            raise InputError(
                f"bits and shift of the curve {shown(self.name)} are {self.bits:g} and {self.shift:g}: give whole "
                "numbers, and 1 to 16 bits"
            )
        if len(self.embedded_rows) != 2 or not all(isinstance(rows, int) and rows >= 0 for rows in self.embedded_rows):
            raise InputError(
                f"embedded_rows of the curve {shown(self.name)} is {shown(self.embedded_rows)}: give the numbers of "
                "rows above and below the image, (0, 0) for none"
            )
        n, top = len(self.codes), 2**self.bits - 1
        if n < 2 or len(self.values) != n:
            raise InputError(
                f"the curve {shown(self.name)} has {n} codes and {len(self.values)} values: give both of two knees or "
                "more"
            )
        for what, knees in (("codes", self.codes), ("values", self.values)):
            falls = np.flatnonzero(~(np.diff(knees) > 0))
            if falls.size or not np.isfinite(knees).all():
                at = int(falls[0]) if falls.size else 0
                raise InputError(
                    f"{what} of the curve {shown(self.name)} do not rise from {knees[at]:g} to {knees[at + 1]:g}: give "
                    "them in rising order, each once"
                )
        if not (self.codes[0] == 0 and self.codes[-1] + self.black_code <= top):
            raise InputError(
                f"the curve {shown(self.name)} has codes from {self.codes[0]:g} to {self.codes[-1]:g}: give the first "
                f"knee at code 0 and the last up to {top - self.black_code:g}, in {self.bits} bits"
            )
        if not 0 <= self.shift <= 16 - self.bits:
            raise InputError(f"shift is {self.shift}: give 0 to {16 - self.bits} bits, as a file has 16 at most")
        if not self.values[0] <= self.black_value < self.values[-1]:
            raise InputError(
                f"black_value of the curve {shown(self.name)} is {self.black_value:g}: give a linear value from that "
                f"of the first knee, {self.values[0]:g}, to below that of the last, {self.values[-1]:g}"
            )
        if not 0 <= self.black_code <= top:
            raise InputError(
                f"black_code of the curve {shown(self.name)} is {self.black_code:g}: give a code from 0 to {top}"
            )

    def _numbers(self, what: str) -> tuple[Any, ...]:
        """Return numbers as a tuple, with which the curve can be kept by caches."""
        given = getattr(self, what)
        given = [given] if isinstance(given, str) or not isinstance(given, Iterable) else given
        return tuple(self._number(value, what) for value in given)

    def _number(self, value: Any, what: str) -> Any:
        if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number):
            raise InputError(f"{what} of the curve {shown(self.name)} has {shown(value)}: give numbers")
        plain = value.item() if isinstance(value, np.number) else value
        return int(plain) if isinstance(plain, float) and plain.is_integer() and abs(plain) < 2**53 else plain

    @property
    def file_bits(self) -> int:
        """Bits of the values of a file."""
        return self.bits + self.shift

    @property
    def saturation_dn(self) -> float:
        """Value of a file from which a pixel is saturated: that of the last knee."""
        return float((self.codes[-1] + self.black_code) * 2**self.shift)

    @property
    def black_dn(self) -> float:
        """Value of a file without light."""
        return float((np.interp(self.black_value, self.values, self.codes) + self.black_code) * 2**self.shift)

    @cached_property
    def scale(self) -> float:
        """Power of two that the linear values are divided by to lie in 0 to 1: they stay exact."""
        return float(2 ** ceil(log2(self.values[-1] - self.black_value)))

    def linear(self, codes: ArrayLike) -> NDArray[np.float64]:
        """Linear values of codes, without the black level.

        Parameters
        ----------
        codes : array_like
            Codes, of any shape.
        """
        net = np.asarray(codes, dtype=np.float64) - self.black_code
        slope = (self.values[1] - self.values[0]) / (self.codes[1] - self.codes[0])
        values = np.interp(net, self.codes, self.values) + np.minimum(net, 0.0) * slope
        return np.asarray(values - self.black_value, dtype=np.float64)

    def code(self, values: ArrayLike) -> NDArray[np.uint16]:
        """Codes of linear values as the sensor sends them, rounded to the nearest; the inverse of `linear`.

        Parameters
        ----------
        values : array_like
            Linear values without the black level, of any shape.
        """
        codes = np.interp(np.asarray(values, dtype=np.float64) + self.black_value, self.values, self.codes)
        top = self.codes[-1] + self.black_code
        return np.clip(np.rint(codes + self.black_code), 0, top).astype(np.uint16)

    def light(self, bits: int) -> NDArray[np.float64]:
        """Linear value of each DN of a file of `bits` bits, over `scale`; shape (2**bits,)."""
        return self.linear(np.arange(2**bits) / 2.0**self.shift) / self.scale

    @cached_property
    def linear_by_dn(self) -> NDArray[np.float64]:
        """Linear value of each DN of a file, without the black level; shape (2**file_bits,), read-only."""
        values = self.linear(np.arange(2**self.file_bits) / 2.0**self.shift)
        values.flags.writeable = False
        return values

    @cached_property
    def steps_by_dn(self) -> NDArray[np.float64]:
        """Linear values that a code stands for, by the DN of a file; shape (2**file_bits,), read-only.

        A code holds what is rounded to it: half of the way to the code below and half of that to the code above.
        """
        net = np.arange(2**self.file_bits) / 2.0**self.shift - self.black_code
        last = self.codes[-1]
        edges = [np.minimum(net + half, last) for half in (-0.5, 0.5)]
        slope = (self.values[-1] - self.values[-2]) / (self.codes[-1] - self.codes[-2])
        steps = np.diff([np.interp(edge, self.codes, self.values) for edge in edges], axis=0)[0]
        first = (self.values[1] - self.values[0]) / (self.codes[1] - self.codes[0])
        steps = np.where(net < 0.5, first, np.where(net >= last, slope, steps))
        steps.flags.writeable = False
        return steps

    @property
    def linear_saturation_dn(self) -> float:
        """Linear value from which a pixel is saturated, without the black level."""
        return float(self.values[-1] - self.black_value)

    @cached_property
    def sha256(self) -> str:
        """Hash of all that it states, which tells curves of one name apart."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()

    @property
    def identity(self) -> dict[str, str]:
        """Name and hash, by which a recorded frame refers to its curve."""
        return {"name": self.name, "sha256": self.sha256}

    def __str__(self) -> str:
        """Return the name, and the beginning of the hash."""
        return f"{self.name} ({self.sha256[:8]})"

    def image_rows(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return the rows of an image without embedded ones; raises InputError if none is left."""
        above, below = self.embedded_rows
        if above + below >= len(values):
            raise InputError(
                f"the image has {len(values)} rows, of which the curve {shown(self.name)} takes {above} and {below} as "
                "embedded data: correct embedded_rows"
            )
        return values[above : len(values) - below]


def shipped_curves() -> list[str]:
    """Names of the curves that ship with labcdp.

    Examples
    --------
    >>> from labcdp.files import shipped_curves
    >>> shipped_curves()
    ['AR0231', 'AR0820', 'OX03C10']
    """
    folder = files("labcdp").joinpath("data", "curves")
    return sorted(file.name.removesuffix(".toml").upper() for file in folder.iterdir())


def shipped_curve_with(sha256: str) -> Companding | None:
    """Return the curve that ships with labcdp and has this hash; None if there is none.

    Examples
    --------
    >>> from labcdp.core.companding import shipped_curve, shipped_curve_with
    >>> shipped_curve_with(shipped_curve("AR0820").sha256).name
    'AR0820'
    """
    return next((curve for curve in map(shipped_curve, shipped_curves()) if curve.sha256 == sha256), None)


@lru_cache(maxsize=8)
def shipped_curve(name: str) -> Companding:
    """Return a curve that ships with labcdp; raises InputError for another name.

    Examples
    --------
    >>> from labcdp.files import shipped_curve
    >>> shipped_curve("AR0231").saturation_dn
    4000.0
    """
    known = shipped_curves()
    if name.upper() not in known:
        raise InputError(
            f"curve is {shown(name)}, which does not ship with labcdp: give one of {', '.join(known)}", key="curve"
        )
    text = files("labcdp").joinpath("data", "curves", f"{name.lower()}.toml").read_text(encoding="utf-8")
    document: dict[str, Any] = tomllib.loads(text)
    knees: dict[str, Any] = {key: tuple(document.pop(key)) for key in ("codes", "values")}
    return Companding(**knees, **document)
