"""Transfer curves: how stored values stand for light, and how much red, green and blue add to luminance."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.companding import Companding
from ..core.disk.files import shown
from ..core.errors import InputError

_Array: TypeAlias = NDArray[np.float64]
#: How values are encoded: ``linear`` in proportion to light; ``srgb`` (IEC 61966-2-1), ``bt709``, ``pq``, ``hlg``,
#: ``smpte240m``, ``smpte428``, ``log100``, ``log316`` by the curve of a standard; ``gamma 2.2`` by a power; or by the
#: curve of a sensor.
Encoding: TypeAlias = str | Companding
_NAMES = {
    "srgb": "sRGB", "bt709": "BT.709", "pq": "PQ", "hlg": "HLG", "smpte240m": "SMPTE 240M",
    "smpte428": "SMPTE ST 428-1",
    "log100": "logarithmic (100:1)", "log316": "logarithmic (316:1)",
}  # fmt: skip
_GAMMA = re.compile(r"gamma (\d+(?:\.\d+)?)")

#: Codes of unspecified characteristics (ITU-T H.273, tables 2 to 4).
UNSPECIFIED = 2
#: Encodings by transfer characteristics (ITU-T H.273 of 2021, table 3). From 0 to 1, xvYCC (11) and BT.1361 (12) are as
#: BT.709.
ENCODING_OF_CODE: dict[int, Encoding] = {
    **dict.fromkeys((1, 6, 11, 12, 14, 15), "bt709"),
    4: "gamma 2.2", 5: "gamma 2.8", 7: "smpte240m", 8: "linear", 9: "log100", 10: "log316",
    13: "srgb", 16: "pq", 17: "smpte428", 18: "hlg",
}  # fmt: skip
_D65, _C, _DCI, _E = (0.3127, 0.3290), (0.310, 0.316), (0.314, 0.351), (1 / 3, 1 / 3)
#: Chromaticities x, y of red, green, blue and white by colour primaries (ITU-T H.273 of 2021, table 2).
PRIMARIES_OF_CODE: dict[int, tuple[tuple[float, float], ...]] = {
    1: ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060), _D65),
    4: ((0.67, 0.33), (0.21, 0.71), (0.14, 0.08), _C),
    5: ((0.64, 0.33), (0.29, 0.60), (0.15, 0.06), _D65),
    **dict.fromkeys((6, 7), ((0.630, 0.340), (0.310, 0.595), (0.155, 0.070), _D65)),
    8: ((0.681, 0.319), (0.243, 0.692), (0.145, 0.049), _C),
    9: ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), _D65),
    10: ((1.0, 0.0), (0.0, 1.0), (0.0, 0.0), _E),
    11: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _DCI),
    12: ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), _D65),
    22: ((0.630, 0.340), (0.295, 0.605), (0.155, 0.077), _D65),
}
#: Weights of linear red, green and blue in luminance (ITU-R BT.709-6, item 3.2; sRGB has the same primaries).
BT709_LUMINANCE = (0.2126, 0.7152, 0.0722)
#: Weights that differ less are those of BT.709, as a file rounds its chromaticities.
_SAME_WEIGHTS = 0.002
#: Curves that differ less are the same, as a share of white, and as a part of the light besides steps of 16 bits:
#: tables of profiles are rounded.
_SAME_CURVE, _SAME_PART, _STEPS = 0.001, 0.01, 2 / 65535
Weights: TypeAlias = tuple[float, float, float]


def encoding_name(encoding: Encoding) -> str:
    """Return what findings and tables call an encoding."""
    if isinstance(encoding, Companding):
        return f"companded ({encoding.name})"
    return _NAMES.get(encoding, encoding)


def as_encoding(given: Encoding | None) -> Encoding | None:
    """Return the encoding that a user means: linear, srgb, a curve's name, or that of a file in TOML.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if given in (None, "linear", "srgb") or isinstance(given, Companding):
        return given
    if not isinstance(given, str):
        raise InputError(f"encoding is {shown(given)}: give text, or a curve")
    # Few pictures have one.
    from ..session.tables import curve_called

    return curve_called(given)


def gamma_encoding(exponent: float) -> Encoding:
    """Return the encoding whose values to the power of `exponent` are light."""
    return "linear" if abs(exponent - 1) < _SAME_CURVE else f"gamma {round(exponent, 3):g}"


def decoded(values: ArrayLike, encoding: Encoding) -> _Array:
    """Linear light of values from 0 to 1, of any shape; 1 of the value 1.

    The inverse of IEC 61966-2-1:1999, 5.2 (sRGB), ITU-R BT.709-6, item 1.2, ITU-R BT.2100-2, table 4 (PQ, light of the
    display) and table 5 (HLG, light of the scene), and ITU-T H.273, table 3, for the others.
    """
    v = np.asarray(values, dtype=np.float64)
    if isinstance(encoding, Companding):
        return encoding.linear(v * (2**encoding.file_bits - 1) / 2**encoding.shift) / encoding.scale
    power = _GAMMA.fullmatch(encoding)
    if power is not None:
        return np.asarray(v ** float(power[1]))
    match encoding:
        case "linear":
            return v.copy()
        case "srgb":
            return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)
        case "bt709":
            return np.where(v < 0.081, v / 4.5, ((v + 0.099) / 1.099) ** (1 / 0.45))
        case "smpte240m":
            return np.where(v < 0.0912, v / 4, ((v + 0.1115) / 1.1115) ** (1 / 0.45))
        case "smpte428":
            return np.asarray(v**2.6)
        case "log100":
            return np.where(v > 0, 10 ** (2 * (v - 1)), 0.0)
        case "log316":
            return np.where(v > 0, 10 ** (2.5 * (v - 1)), 0.0)
        case "pq":
            m1, m2, c1, c2, c3 = 2610 / 16384, 2523 / 32, 3424 / 4096, 2413 / 128, 2392 / 128
            root = v ** (1 / m2)
            return np.asarray((np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1))
        case "hlg":
            a, b, c = 0.17883277, 0.28466892, 0.55991073
            return np.where(v <= 0.5, np.square(v) / 3, (np.exp((v - c) / a) + b) / 12)
    raise ValueError(f"no encoding is called {encoding!r}")


def decoded_table(bits: int, encoding: Encoding) -> _Array:
    """Linear light, from 0 to 1, of each DN of a scale of `bits` bits; shape (2**bits,)."""
    if isinstance(encoding, Companding):
        return encoding.light(bits)
    return decoded(np.arange(2**bits) / (2**bits - 1), encoding)


def known_encoding(light: _Array) -> Encoding | None:
    """Return the encoding that a table of light, at equal steps of the values from 0 to 1, is by; None for another."""
    values = np.linspace(0, 1, light.size)
    for encoding in ("linear", "srgb", "bt709"):
        if _is_same(decoded(values, encoding), light):
            return encoding
    middle = light.size // 2
    if 0 < light[middle] < 1 and light[-1] == 1:
        gamma = gamma_encoding(float(np.log(light[middle]) / np.log(values[middle])))
        if _is_same(decoded(values, gamma), light):
            return gamma
    return None


def _is_same(curve: _Array, light: _Array) -> bool:
    """Whether curves are the same for dark values too, of which contrasts are parts."""
    difference = np.abs(curve - light)
    return bool((difference < np.minimum(_SAME_CURVE, _STEPS + _SAME_PART * light)).all())


def luminance_weights(chromaticities: Sequence[Sequence[float]]) -> Weights | None:
    """Weights of red, green and blue in luminance by their chromaticities and that of white; None if there are none.

    Those of BT.709, as a file rounds them, give the weights of BT.709 themselves.

    Parameters
    ----------
    chromaticities : sequence of (float, float)
        x and y of red, green, blue and white.
    """
    xy = np.array(chromaticities, dtype=float)
    # Primaries may be no colours: y is 0 for X and Z, and below 0 for the blue of ACES.
    if xy.shape != (4, 2) or not (np.isfinite(xy).all() and xy[3, 1] > 0):
        return None
    xyz = np.column_stack([xy, 1 - xy.sum(axis=1)])
    try:
        # Luminances of the primaries that add up to the white point (SMPTE RP 177-1993).
        weights = np.linalg.solve(xyz[:3].T, xyz[3] / xy[3, 1]) * xy[:3, 1]
    except np.linalg.LinAlgError:
        return None
    return near_bt709((float(weights[0]), float(weights[1]), float(weights[2])))


def near_bt709(weights: Weights) -> Weights:
    """Return the weights of BT.709 for such that differ by rounding only."""
    same = np.abs(np.subtract(weights, BT709_LUMINANCE)).max() < _SAME_WEIGHTS
    return BT709_LUMINANCE if same else weights


@lru_cache(maxsize=8)
def light_tables(bits: int, encoding: Encoding, weights: Weights = BT709_LUMINANCE) -> NDArray[np.float32]:
    """Part of each DN of red, green and blue in the luminance, in 65535ths of white; shape (3, 2**bits)."""
    return np.outer(weights, 65535 * decoded_table(bits, encoding)).astype(np.float32)
