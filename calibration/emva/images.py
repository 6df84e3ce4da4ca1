"""Images of a data set, read bit for bit."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from hashlib import blake2b
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.disk import read_bytes
from ...core.disk.files import shown
from ...core.disk.tiff import open_tiff, pixels_of
from ...core.errors import InputError
from ..frames.statistics import Level
from .index import DataSetIndex, IndexBlock

#: File signatures: PNG (ISO/IEC 15948), and JPEG, whose compression loses values.
_PNG, _LOSSY = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
#: Bytes up to the end of a PNG's header chunk.
_PNG_HEADER = 33
#: Largest size of an image file.
_MOST_BYTES = 2**30
#: JPEG in TIFF, old and new (TIFF 6.0, section 22, and Technical Note 2).
_LOSSY_TIFF = (6, 7)
#: Largest difference of the means of a block relative to the signal; lamps flicker by tenths of it.
_LARGEST_DIFFERENCE_REL = 0.03
#: Upper bound of black level drift, in DN.
_LEAST_DIFFERENCE_DN = 1.0
#: Critical value for a frame's mean, in standard uncertainties.
_CHANCE = 5.0
#: Factor between the common divisors of values that indicates different bit depths.
_DEPTH_FACTOR = 4


def read_image(path: Path, shape: tuple[int, int], bits: int) -> NDArray[np.unsignedinteger[Any]]:
    """Read a grey PNG or TIFF image of 8 or 16 bits.

    Parameters
    ----------
    path : Path
        The image.
    shape : (int, int)
        Height and width it must have.
    bits : int
        Bits of its DN scale, 1 to 16.

    Returns
    -------
    ndarray of uint8 or uint16, shape (height, width)

    Raises
    ------
    InputError
        If it cannot be read, is damaged or compressed with loss, has colours or another size, or holds values beyond
        its DN scale.
    """
    data = read_bytes(path, "the images of the index", _MOST_BYTES)
    if not data:
        raise _damaged(path)
    dn = _tiff(data, path, shape) if path.suffix.lower() in (".tif", ".tiff") else _png(data, path, shape)
    if dn is None or dn.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path} is not a grey image of 8 or 16 bits: use PNG or TIFF files as the camera sent them")
    if dn.ndim != 2:
        raise InputError(f"{path} is a coloured image: give grey ones, as the camera sent them")
    largest = int(dn.max())
    if largest >= 2**bits:
        raise InputError(
            f"{path} holds {largest} DN, more than the {bits} bits of the index can: give images of one depth, or "
            "correct the line n"
        )
    return dn


def _png(data: bytes, path: Path, shape: tuple[int, int]) -> NDArray[Any] | None:
    import imagecodecs

    if data.startswith(_LOSSY) or data[8:12] == b"WEBP":
        raise InputError(f"{path} is compressed with loss, which alters the noise: give PNG or TIFF files")
    if not data.startswith(_PNG[:4]):
        return None
    if len(data) < _PNG_HEADER:
        raise _damaged(path)
    width, height = struct.unpack_from(">II", data, 16)
    _require_shape(path, height, width, shape)
    try:
        image: NDArray[Any] = imagecodecs.png_decode(data)
    except (ValueError, RuntimeError) as error:
        raise _damaged(path) from error
    return image


def _require_shape(path: Path, height: int, width: int, shape: tuple[int, int]) -> None:
    if (height, width) != shape:
        raise InputError(
            f"{path} has {shown(width)} x {shown(height)} pixels, the index says {shape[1]} x {shape[0]}: give images "
            "of one size, or correct the line n"
        )


def _tiff(data: bytes, path: Path, shape: tuple[int, int]) -> NDArray[Any]:
    with open_tiff(data, path) as file:
        if not file.pages:
            raise InputError(f"{path} holds no picture: give a TIFF with one")
        page = file.pages.first.aspage()
        if int(page.compression) in _LOSSY_TIFF:
            raise InputError(f"{path} is compressed with loss, which alters the noise: give PNG or TIFF files")
        _require_shape(path, page.imagelength, page.imagewidth, shape)
        if any(a + n > len(data) for a, n in zip(page.dataoffsets, page.databytecounts, strict=False)):
            raise InputError(f"{path} is truncated: its pixels reach beyond its {len(data)} bytes: copy it again")
        image = pixels_of(page, path)
    return image.astype(image.dtype.newbyteorder("="), copy=False)


def _damaged(path: Path) -> InputError:
    return InputError(f"{path} is truncated or damaged: copy it again")


class _Image(NamedTuple):
    """An image, where the index has it, and what level it is of."""

    name: str
    line: int
    level: tuple[str, float, float]

    @classmethod
    def of(cls, block: IndexBlock, number: int) -> _Image:
        level = block.kind, block.exposure_ns, block.photons
        return cls(block.images[number].name, block.image_lines[number], level)

    def __str__(self) -> str:
        return f"{self.name} (line {self.line})"


class ImageCheck:
    """Checks the images of a data set one by one for copies and another bit depth.

    Parameters
    ----------
    index : Path
        The index, for messages.
    """

    def __init__(self, index: Path) -> None:
        self._index = index
        self._seen: dict[tuple[bytes, int | None], _Image] = {}
        self._depth: tuple[np.dtype[Any], _Image] | None = None
        self._multiple: tuple[int, _Image] | None = None

    def take(self, dn: NDArray[np.unsignedinteger[Any]], block: IndexBlock, number: int) -> None:
        """Compare image `number` of a block with those before it.

        Raises
        ------
        InputError
            If its pixels are those of another image, which is allowed only to a pair and a stack of one level, or its
            depth is another. Images of one value throughout, black or saturated, may be alike.
        """
        image = _Image.of(block, number)
        where = f"{self._index}, line {image.line}: {image.name}"
        self._depth = self._depth or (dn.dtype, image)
        dtype, first = self._depth
        if dn.dtype != dtype:
            raise InputError(
                f"{where} has {8 * dn.dtype.itemsize} bits per value, {first} has {8 * dtype.itemsize}: give all "
                "images as the camera sent them, in one depth"
            )
        bits = int(np.bitwise_or.reduce(dn, axis=None))
        if bits == int(np.bitwise_and.reduce(dn, axis=None)):
            return
        multiple = min(bits & -bits, 16)
        self._multiple = self._multiple or (multiple, image)
        usual, first = self._multiple
        if max(multiple, usual) >= _DEPTH_FACTOR * min(multiple, usual):
            raise InputError(
                f"{where} has values that are multiples of {multiple}, {first} of {usual}: they have different bit "
                "depths; give all images as the camera sent them"
            )
        digest = blake2b(dn.tobytes(), digest_size=16).digest()
        twin = self._seen.setdefault((digest, block.line), image)
        other = self._seen.setdefault((digest, None), image) if twin is image else twin
        if twin is not image or other.level != image.level:
            raise InputError(
                f"{where} has the same pixels as {other}: no two exposures are alike, give the image that belongs here"
            )


def require_levels(index: DataSetIndex, measured: Sequence[tuple[IndexBlock, Level]]) -> None:
    """Refuse blocks whose images differ more than noise and lamp allow, dark signal first.

    Parameters
    ----------
    index : DataSetIndex
        For messages.
    measured : sequence of (IndexBlock, Level)
        All blocks.

    Raises
    ------
    InputError
        If the mean of an image deviates from the others of its block by more than 5 standard uncertainties, 3 % of the
        signal above dark signal, and 1 DN.
    """
    dark_dn = {block.exposure_ns: float(np.median(s.frame_means_dn)) for block, s in measured if block.kind == "dark"}
    for block, level in sorted(measured, key=lambda pair: pair[0].kind == "bright"):
        means = np.array(level.frame_means_dn)
        usual = np.array([np.median(np.delete(means, i)) for i in range(means.size)])
        signal = float(np.median(means)) - (dark_dn.get(block.exposure_ns, 0.0) if block.kind == "bright" else 0.0)
        noise = np.sqrt(level.temporal_variance_dn2 / level.n_pixels * (1 + 1 / (means.size - 1)))
        limit = max(_CHANCE * noise, _LARGEST_DIFFERENCE_REL * signal, _LEAST_DIFFERENCE_DN)
        worst = int(np.argmax(np.abs(means - usual)))
        if abs(means[worst] - usual[worst]) > limit:
            image = _Image.of(block, worst)
            others = f"the other {means.size - 1} images of its block"
            others = f"{_Image.of(block, 1 - worst)} one of" if means.size == 2 else others
            raise InputError(
                f"{index.path}, line {image.line}: {image.name} has a mean of {means[worst]:.4g} DN, {others} "
                f"{usual[worst]:.4g} DN, which noise does not explain: one of them does not belong to line "
                f"{block.line}; correct the index, or record the level again"
            )
