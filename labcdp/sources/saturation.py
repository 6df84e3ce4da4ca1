"""Scale of DN in files of 16 bits that do not say how many bits the sensor's converter had."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Bits of converters whose DN are kept in 16 bits.
_DEPTHS = (10, 12, 14)


@dataclass(frozen=True)
class Scale:
    """Bits of the DN scale, the DN from which a pixel is saturated, and notes on how they were found."""

    bits: int
    saturation_dn: float
    notes: tuple[str, ...] = ()


def guessed_scale(values: NDArray[Any], bits: int) -> Scale:
    """Scale of DN in a wider type: that of a converter at whose highest DN the values end, else the type's own.

    Parameters
    ----------
    values : ndarray of uint16
        The DN.
    bits : int
        Bits of the type.
    """
    largest = int(values.max())
    for depth in _DEPTHS:
        if largest == 2**depth - 1 < 2**bits - 1:
            return Scale(
                depth,
                float(largest),
                (f"bit depth guessed: {depth} bits, saturated at {largest} DN, since the values end there",),
            )
    for depth in _DEPTHS:
        step = 2 ** (bits - depth)
        top = 2**bits - step
        if largest == top and not np.bitwise_or.reduce(values, axis=None) & (step - 1):
            return Scale(
                bits,
                float(top),
                (f"bit depth guessed: {depth} bits in the upper bits of {bits}, saturated at {top} DN",),
            )
    notes: tuple[str, ...] = ()
    if largest < 2 ** (bits - 1):
        notes = (
            f"bit depth not known: the values end at {largest} of {2**bits - 1}, none is taken as saturated; give the "
            "bit depth of the camera",
        )
    return Scale(bits, 2.0**bits - 1, notes)
