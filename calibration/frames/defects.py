"""Map of the pixels that must not be used, each with a reason."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag
from functools import lru_cache
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...core.disk.arrays import EqualByContent, StoredArray, read_only
from ...core.errors import InputError


class Defect(IntFlag):
    """Kinds of defects of a pixel."""

    HOT = 1
    DEAD = 2
    STUCK = 4
    NOISY = 8


@dataclass(frozen=True, eq=False)
class DefectMap(EqualByContent):
    """Pixels that must not be used; two maps are equal if pixels and reasons are equal.

    Parameters
    ----------
    rows, columns : ndarray of int32, shape (n,)
        Where the pixels are, in the order of the image.
    reasons : ndarray of uint8, shape (n,)
        `Defect` flags.
    image_shape : (int, int)
        Height and width of the image.

    Raises
    ------
    InputError
        If the arrays differ in length, or a pixel lies outside the image.
    """

    rows: Annotated[NDArray[np.int32], StoredArray("int32", 1)]
    columns: Annotated[NDArray[np.int32], StoredArray("int32", 1)]
    reasons: Annotated[NDArray[np.uint8], StoredArray("uint8", 1)]
    image_shape: tuple[int, int]

    def __post_init__(self) -> None:
        for name, dtype in (("rows", np.int32), ("columns", np.int32), ("reasons", np.uint8)):
            object.__setattr__(self, name, read_only(np.asarray(getattr(self, name)), dtype))
        if not self.rows.shape == self.columns.shape == self.reasons.shape:
            raise InputError("rows, columns and reasons of a defect map differ in length: give one of each a pixel")
        for values, size in zip((self.rows, self.columns), self.image_shape, strict=True):
            if values.size and not (values.min() >= 0 and values.max() < size):
                raise InputError(f"a defect pixel lies outside the image of {self.image_shape} (height, width)")

    @classmethod
    def of(cls, reasons: NDArray[np.uint8]) -> DefectMap:
        """Defect map of an image of `Defect` flags, shape (height, width)."""
        rows, columns = np.nonzero(reasons)
        height, width = reasons.shape
        return cls(rows.astype(np.int32), columns.astype(np.int32), reasons[rows, columns], (height, width))

    def joined(self, other: DefectMap) -> DefectMap:
        """Pixels of both maps with the reasons of both; raises InputError if they are of different image sizes."""
        other.mask(self.image_shape)
        reasons = np.zeros(self.image_shape, dtype=np.uint8)
        for defects in (self, other):
            reasons[defects.rows, defects.columns] |= defects.reasons
        return DefectMap.of(reasons)

    @lru_cache(maxsize=8)  # noqa: B019 - the few maps of a program, which each frame asks for
    def cropped(self, corner: tuple[int, int], shape: tuple[int, int]) -> DefectMap:
        """Map of the part of the image that has its upper left pixel at a `corner` (x, y)."""
        rows, columns = self.rows - corner[1], self.columns - corner[0]
        inside = (rows >= 0) & (rows < shape[0]) & (columns >= 0) & (columns < shape[1])
        return DefectMap(rows[inside], columns[inside], self.reasons[inside], shape)

    @property
    def n_pixels(self) -> int:
        """How many pixels are defect."""
        return self.rows.size

    def count(self, reason: Defect) -> int:
        """How many pixels have this defect."""
        return int(np.count_nonzero(self.reasons & reason))

    def mask(self, shape: tuple[int, int]) -> NDArray[np.bool_]:
        """Mask of the defect pixels; raises InputError for an image of another size."""
        if shape != self.image_shape:
            raise InputError(
                f"the defect map is for {self.image_shape[1]} x {self.image_shape[0]} pixels, the image has "
                f"{shape[1]} x {shape[0]}: find the defects with this image size"
            )
        mask = np.zeros(shape, dtype=np.bool_)
        mask[self.rows, self.columns] = True
        return mask
