"""PictureOptions: what a picture is taken to be where its file does not say."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from ...core.frame import CameraIdentity
from ...core.pixel_format import pixel_format
from ..formats.colour import Encoding
from ..formats.stored_image import MAX_PIXELS


@dataclass(frozen=True)
class PictureOptions:
    """What a file is taken to be where it does not say, and what is allowed.

    Parameters
    ----------
    exposure_s, gain_db : float or None
        Exposure time and gain; None for not known, and for 0 dB.
    camera : CameraIdentity or None
        Camera; None if unknown.
    bit_depth : int or None
        Bits of the DN in files of 16 bits, for example 12; None to guess.
    pixel_format : str or None
        GenICam pixel format the DN came in: says bits and colour filter of grey files, and the layout of raw dumps.
    size : (int, int) or None
        Width and height of raw dumps.
    saturation_dn, black_level_dn : float or None
        DN from which a pixel is saturated, and of dark signal; None for the highest DN, and for 0.
    encoding : {'linear', 'srgb', 'bt709'} or None
        How values are encoded; None for what the file or its kind suggests.
    overrides : frozenset of str
        Names of the options that the user gave explicitly: these count before what a file says, with a finding where
        it says otherwise or the option cannot count. The others count where the file does not say.
    max_pixels : int
        Pixels from which a picture is refused before it is decoded.
    damaged : bool
        Whether frames of a video that are damaged, or build on damaged ones, are used, with a note.

    Raises
    ------
    InputError
        If a value is not possible.
    """

    exposure_s: float | None = None
    gain_db: float | None = None
    camera: CameraIdentity | None = None
    bit_depth: int | None = None
    pixel_format: str | None = None
    size: tuple[int, int] | None = None
    saturation_dn: float | None = None
    black_level_dn: float | None = None
    encoding: Encoding | None = None
    overrides: frozenset[str] = frozenset()
    max_pixels: int = MAX_PIXELS
    damaged: bool = False

    def __post_init__(self) -> None:
        if self.exposure_s is not None and not (np.isfinite(self.exposure_s) and self.exposure_s > 0):
            raise InputError(f"the exposure is {self.exposure_s} s: give a time above 0 s")
        if self.gain_db is not None and not np.isfinite(self.gain_db):
            raise InputError(f"the gain is {self.gain_db} dB: give a number")
        if self.bit_depth is not None and not 1 <= self.bit_depth <= 16:
            raise InputError(f"the bit depth is {self.bit_depth}: give 1 to 16 bits")
        if self.pixel_format is not None:
            pixel_format(self.pixel_format)
        if self.size is not None and min(self.size) < 1:
            raise InputError(f"the size is {self.size[0]} x {self.size[1]} pixels: give at least 1 x 1")
        if self.max_pixels < 1:
            raise InputError(f"the limit is {self.max_pixels} pixels: give at least 1")
