"""ICC profiles: the curves and the colours of matrix and grey profiles (ICC.1:2022)."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..core.errors import InputError
from .transfer import BT709_LUMINANCE, Encoding, Weights, known_encoding, near_bt709

#: Size of the header, and of an entry of the list of tags (7.2 and 7.3); most tags, and values of a curve.
_HEADER, _ENTRY, _MOST_TAGS, _MOST_VALUES = 128, 12, 200, 65536
#: Points at which a curve is evaluated.
_POINTS = 4096
#: Tables of colours, which count before curves where both are there (9.2).
_TABLES = (b"A2B0", b"A2B1", b"A2B2", b"D2B0", b"D2B1", b"D2B2", b"D2B3")
#: Difference of curves by rounding.
_SAME = 0.001
#: Parameters of each type of parametric curve (table 68).
_PARAMETERS = (1, 3, 4, 5, 7)
#: From the illuminant D50 of profiles to D65, after Bradford (annex E.3).
_D50_TO_D65 = np.array(
    [[0.9555766, -0.0230393, 0.0631636], [-0.0282895, 1.0099416, 0.0210077], [0.0122982, -0.0204830, 1.3299098]]
)


@dataclass(frozen=True, eq=False)
class ColourProfile:
    """What an ICC profile says of an image.

    Parameters
    ----------
    encoding : str or None
        How values are encoded, if all channels have the same known curve.
    curves : tuple of ndarray of float, shape (n,)
        Light by value, at equal steps from 0 to 1: of grey, or of red, green and blue.
    weights : (float, float, float)
        Of linear red, green and blue in luminance.
    space : str
        What it is for, ``RGB`` or ``GRAY``.
    has_table : bool
        Whether it has a table of colours too, which may be more exact.
    """

    encoding: Encoding | None
    curves: tuple[NDArray[np.float64], ...]
    weights: Weights = BT709_LUMINANCE
    space: str = "RGB"
    has_table: bool = False

    def light_tables(self, bits: int) -> NDArray[np.uint16]:
        """Light of each DN of a scale of `bits` bits, in 65535ths of white; shape (1 or 3, 2**bits)."""
        values = np.linspace(0, 1, 2**bits)
        tables = [np.interp(values, np.linspace(0, 1, curve.size), curve) for curve in self.curves]
        return np.rint(65535 * np.clip(tables, 0, 1)).astype(np.uint16)


def read_profile(data: bytes, coloured: bool) -> ColourProfile:
    """Read a profile of a grey or coloured image.

    The curve of a grey profile is that of red, green and blue too, and that of all three of an RGB profile is that of
    grey, as programs leave such profiles in files that they convert.

    Parameters
    ----------
    data : bytes
        The profile.
    coloured : bool
        Whether the image has red, green and blue.

    Raises
    ------
    InputError
        If it is incomplete, is for other colours, or has no curves that serve.
    """
    if not data:
        raise InputError("it is incomplete")
    if len(data) < _HEADER + 4 or data[36:40] != b"acsp":
        raise InputError("it is not an ICC profile")
    space = data[16:20].decode("latin-1").strip()
    names = {"RGB": (b"rTRC", b"gTRC", b"bTRC"), "GRAY": (b"kTRC",)}.get(space)
    if names is None:
        raise InputError(f"it is for {space}, the picture is {'RGB' if coloured else 'grey'}")
    tags = _tags(data)
    has_table = any(name in tags for name in _TABLES)
    if any(name not in tags for name in names):
        raise InputError("it has a table of colours instead of curves" if has_table else "it has no curves")
    curves = tuple(_curve(tags[name]) for name in names)
    if data[20:24] == b"Lab " and space == "GRAY":
        # The curve gives lightness (8.3.4 and F.2), of which luminance is by CIE 1976.
        curves = tuple(np.where(curve > 0.08, ((curve + 0.16) / 1.16) ** 3, curve / 9.033) for curve in curves)
    if any(np.ptp(curve) == 0 for curve in curves):
        raise InputError("a curve maps all values to the same light")
    encodings = {known_encoding(curve) for curve in curves}
    if not coloured and not _alike(curves):
        raise InputError("its curves of red, green and blue differ, the picture is grey")
    return ColourProfile(
        encoding=encodings.pop() if len(encodings) == 1 else None,
        curves=curves if coloured else curves[:1],
        weights=_weights(tags) if coloured and space == "RGB" else BT709_LUMINANCE,
        space=space,
        has_table=has_table,
    )


def _alike(curves: Sequence[NDArray[np.float64]]) -> bool:
    sizes = {curve.size for curve in curves}
    return len(sizes) == 1 and all(np.abs(curve - curves[0]).max() < _SAME for curve in curves[1:])


def _tags(data: bytes) -> dict[bytes, bytes]:
    (count,) = struct.unpack_from(">I", data, _HEADER)
    if count > _MOST_TAGS or len(data) < _HEADER + 4 + _ENTRY * count:
        raise InputError("its list of tags is incomplete")
    tags = {}
    for number in range(count):
        name, offset, size = struct.unpack_from(">4sII", data, _HEADER + 4 + _ENTRY * number)
        tags[name] = data[offset : offset + size]
        if len(tags[name]) != size:
            raise InputError("it is truncated")
    return tags


def _curve(tag: bytes) -> NDArray[np.float64]:
    """Light at equal steps of the values, of a tag of type curveType or parametricCurveType (10.6 and 10.18)."""
    try:
        if tag[:4] == b"curv":
            return _sampled(tag)
        if tag[:4] == b"para":
            return _parametric(tag)
    except struct.error as error:
        raise InputError("a curve is incomplete") from error
    raise InputError("a curve is of an unknown kind")


def _sampled(tag: bytes) -> NDArray[np.float64]:
    (count,) = struct.unpack_from(">I", tag, 8)
    values = np.linspace(0, 1, _POINTS)
    if count == 0:
        return values
    if count == 1:
        return np.asarray(values ** (struct.unpack_from(">H", tag, 12)[0] / 256))
    if count > _MOST_VALUES:
        raise InputError(f"a curve has {count} values")
    table = np.array(struct.unpack_from(f">{count}H", tag, 12)) / 65535
    # Between values, a table is straight (10.6): a short one is no power, even where its values are those of one.
    return table if count >= _POINTS else np.interp(values, np.linspace(0, 1, count), table)


def _parametric(tag: bytes) -> NDArray[np.float64]:
    (kind,) = struct.unpack_from(">H", tag, 8)
    if kind >= len(_PARAMETERS):
        raise InputError("a curve is of an unknown kind")
    given = [number / 65536 for number in struct.unpack_from(f">{_PARAMETERS[kind]}i", tag, 12)]
    x = np.linspace(0, 1, _POINTS)
    # Table 68: Y = (a X + b)^g + c from X = d on, else e X + f.
    g, a, b, e, d, c, f = given[0], 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if kind > 0:
        a, b = given[1:3]
        d = -b / a if a else 0.0
    if kind == 2:
        c = f = given[3]
    if kind >= 3:
        e, d = given[3:5]
    if kind == 4:
        c, f = given[5:7]
    with np.errstate(all="ignore"):
        light = np.where(x >= d, np.maximum(a * x + b, 0) ** g + c, e * x + f)
    if not np.isfinite(light).all():
        raise InputError("a curve has values that are not finite")
    return np.clip(light, 0, 1)


def _weights(tags: Mapping[bytes, bytes]) -> Weights:
    """Weights of red, green and blue in luminance: the second row of the colorants, as seen in their own white."""
    names = (b"rXYZ", b"gXYZ", b"bXYZ")
    if any(len(tags.get(name, b"")) < 20 for name in names):
        return BT709_LUMINANCE
    colorants = np.array([struct.unpack_from(">3i", tags[name], 8) for name in names]).T / 65536
    adapted = tags.get(b"chad", b"")
    back = _D50_TO_D65
    if len(adapted) >= 44:
        matrix = np.array(struct.unpack_from(">9i", adapted, 8)).reshape(3, 3) / 65536
        if abs(np.linalg.det(matrix)) > 1e-6:
            back = np.linalg.inv(matrix)
    row = (back @ colorants)[1]
    if not row.sum() > 0:
        return BT709_LUMINANCE
    weights = row / row.sum()
    return near_bt709((float(weights[0]), float(weights[1]), float(weights[2])))
