"""Curves that bring a large range into few bits: a logarithmic tone curve, and the piecewise linear one of sensors."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.companding import Companding, shipped_curve
from ..core.disk.files import shown
from ..core.errors import InputError
from .parameters import Bits, MergedBits, Parameters
from .signal import Context, Signal


class CodeCurve(Parameters):
    """A curve from DN to codes, whose inverse is known: base of the stages below."""

    takes: ClassVar[str] = "digital number"
    gives: ClassVar[str] = "digital number"

    @abstractmethod
    def encode(self, dn: ArrayLike) -> NDArray[np.uint16]:
        """Return the codes of DN of any shape, whole or not."""

    @abstractmethod
    def decode(self, code: ArrayLike) -> NDArray[np.float64]:
        """Return the DN that codes stand for."""

    @property
    @abstractmethod
    def n_codes(self) -> int:
        """Number of codes."""

    @property
    @abstractmethod
    def top_dn(self) -> float:
        """DN from which on they cannot be told apart."""

    @property
    @abstractmethod
    def first_dn(self) -> NDArray[np.float64]:
        """DN at which each code begins, shape (n_codes,)."""

    def process(self, signal: Signal, _context: Context) -> Signal:
        """Return the codes of a signal in DN, with their inverse; DN that the curve clips are saturated."""
        clipped = signal.values >= self.top_dn
        return replace(
            signal,
            values=self.encode(signal.values),
            saturated=clipped if signal.saturated is None else clipped | signal.saturated,
            to_luminance=lambda codes: signal.to_luminance(self.decode(codes)),
        )


@dataclass(frozen=True)
class ToneCurve(CodeCurve):
    """Logarithmic tone curve: code = floor(log(1 + DN) 2^bits / log(2^isp_bits)), clipped to 0 .. 2^bits - 1.

    Parameters
    ----------
    isp_bits : int
        Bits of the DN going in, 1 to 48.
    bits : int
        Bits of the codes coming out, 1 to 16.

    Raises
    ------
    InputError
        If a value is out of its range.

    Notes
    -----
    L. Ebbert, Implementierung von CDP, 2018, eq. 3.4, with its misplaced bracket put right. Without the clip, which is
    ours, the largest DN 2^isp_bits - 1 would have the code 2^bits.

    Examples
    --------
    >>> from labcdp.chain import ToneCurve
    >>> ToneCurve(isp_bits=20, bits=8)
    ToneCurve(isp_bits=20, bits=8)
    """

    isp_bits: MergedBits = 20
    bits: Bits = 8

    def encode(self, dn: ArrayLike) -> NDArray[np.uint16]:
        """Return the codes of DN of any shape, whole or not; DN below 0 have the code 0."""
        position = np.log2(1 + np.maximum(np.asarray(dn, dtype=np.float64), 0.0))
        position *= 2**self.bits / self.isp_bits
        codes: NDArray[np.uint16] = np.minimum(position, 2**self.bits - 1).astype(np.uint16)
        return codes

    def decode(self, code: ArrayLike) -> NDArray[np.float64]:
        """Return the middle of the DN that have a code, so that decoding has no bias within a code.

        It is the mean of all whole DN with that code. At the dark end one DN more skips several codes; these, which
        only DN that are not whole have, decode to the middle of their interval.

        Raises
        ------
        InputError
            If a code is not a whole number from 0 to 2^bits - 1.
        """
        codes = np.asarray(code)
        if codes.dtype.kind not in "iu":
            raise InputError(f"codes have the type {codes.dtype}: give whole numbers")
        if codes.size and not (codes.min() >= 0 and codes.max() < 2**self.bits):
            raise InputError(f"codes are from {codes.min()} to {codes.max()}: give 0 to {2**self.bits - 1}")
        decoded: NDArray[np.float64] = self._middles[codes]
        return decoded

    @property
    def n_codes(self) -> int:
        """Number of codes."""
        return int(2**self.bits)

    @property
    def top_dn(self) -> float:
        """Largest DN of its range; from it on they cannot be told apart."""
        return 2.0**self.isp_bits - 1

    @cached_property
    def first_dn(self) -> NDArray[np.float64]:
        """DN at which each code begins, shape (2^bits,)."""
        edges: NDArray[np.float64] = np.exp2(np.arange(2**self.bits) * (self.isp_bits / 2**self.bits)) - 1
        return edges

    @cached_property
    def _middles(self) -> NDArray[np.float64]:
        end = np.append(self.first_dn[1:], 2.0**self.isp_bits)
        first_whole = self._first_whole()
        last_whole = np.append(first_whole[1:], 2.0**self.isp_bits) - 1
        middles: NDArray[np.float64] = np.where(
            last_whole >= first_whole, (first_whole + last_whole) / 2, (self.first_dn + end) / 2
        )
        return middles

    def _first_whole(self) -> NDArray[np.float64]:
        """Lowest whole DN with each code or a higher one, by `encode` itself where rounding could decide."""
        guess = np.rint(self.first_dn)
        codes: NDArray[Any] = np.arange(2**self.bits)
        lowest = guess + 1
        for candidate in (guess, guess - 1):
            lowest = np.where((candidate >= 0) & (self.encode(candidate) >= codes), candidate, lowest)
        return lowest


@dataclass(frozen=True)
class PiecewiseLinear(CodeCurve):
    """Piecewise linear (PWL) compression, as sensors of series cameras send values of 20 or 24 bits in codes of 12.

    Parameters
    ----------
    curve : str
        Name of a curve that ships with labcdp, such as ``AR0231``; empty for one by its knees.
    codes, values : tuple of float
        Knees: codes, and their DN, both rising.
    bits : int
        Bits of a code, 1 to 16; with a curve its own.

    Raises
    ------
    InputError
        If there is no such curve, it has other bits, both or neither are given, or the knees are none of a curve.

    Examples
    --------
    >>> from labcdp.chain import PiecewiseLinear
    >>> PiecewiseLinear("AR0231").encode([2048, 65536, 1e6]).tolist()
    [2048, 3040, 3953]
    """

    curve: str = ""
    codes: tuple[float, ...] = ()
    values: tuple[float, ...] = ()
    bits: Bits = 12

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("codes", "values"):
            knees = getattr(self, name)
            if not isinstance(knees, list | tuple) or not all(
                isinstance(knee, int | float) and not isinstance(knee, bool) for knee in knees
            ):
                raise InputError(f"{name} is {shown(knees)}: give a list of numbers", key=name)
            object.__setattr__(self, name, tuple(knees))
        if not isinstance(self.curve, str) or bool(self.curve) == bool(self.codes or self.values):
            raise InputError(f"curve is {shown(self.curve)}: give a curve's name, or codes and values", key="curve")
        if self.bits != self._companding.bits:
            raise InputError(
                f"bits is {self.bits}, but codes of the curve {self.curve} have {self._companding.bits}: leave bits "
                "out, or give codes and values",
                key="bits",
            )

    @cached_property
    def _companding(self) -> Companding:
        if self.curve:
            return shipped_curve(self.curve)
        # A chain has its black level elsewhere.
        return Companding("codes", self.codes, self.values, self.bits, black_value=min(self.values, default=0.0))

    def encode(self, dn: ArrayLike) -> NDArray[np.uint16]:
        """Return the nearest codes of DN of any shape, whole or not; DN below the first knee have the code 0."""
        return self._companding.code(np.asarray(dn, dtype=np.float64) - self._companding.black_value)

    def decode(self, code: ArrayLike) -> NDArray[np.float64]:
        """Return the DN at which codes lie on the curve."""
        return self._companding.linear(code) + self._companding.black_value

    @property
    def n_codes(self) -> int:
        """Number of codes, up to that of the last knee."""
        return int(self._companding.codes[-1]) + 1

    @property
    def top_dn(self) -> float:
        """DN of the last knee; from it on they cannot be told apart."""
        return float(self._companding.values[-1])

    @cached_property
    def first_dn(self) -> NDArray[np.float64]:
        """DN at which each code begins, half a code below it, shape (n_codes,)."""
        halves = np.arange(self.n_codes) - 0.5
        return np.asarray(self._companding.linear(halves) + self._companding.black_value, dtype=np.float64)
