"""A picture that was read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...core.finding import Finding
from ...core.frame import Frame
from ...core.luminance import LuminanceMap
from ..formats.colour import Encoding


@dataclass(frozen=True, eq=False)
class Picture:
    """An image file that was read.

    Parameters
    ----------
    path : Path
        The file.
    sha256 : str
        Hash of its bytes.
    frame : Frame or None
        DN, grey or behind a Bayer pattern; of colours, linear luminance in 65535ths of white. None for floats.
    light : ndarray of float32, shape (height, width), or None
        Values of a file of floats, None for integers.
    light_is_cd_m2 : bool
        Whether the file says that the floats are luminance in cd/m^2.
    encoding : {'linear', 'srgb'}
        How the values of the file are encoded, by its kind or as requested.
    findings : tuple of Finding
        What was done with the values, and what the user gave that the file contradicts or that cannot count for it.
    f_number, focal_length_m : float or None
        Setting of the lens, None where the file does not say.
    exposure_stated, camera_stated : bool
        Whether the file itself says exposure and camera.
    exposure_known : bool
        Whether the file or the options say the exposure; if not, `frame.exposure_s` means nothing.
    coloured : bool
        Whether `frame` was made of colours; then it is linear, whatever `encoding`.
    scale_guessed : bool
        Whether the bits of the values are an estimate from them.
    luminance : LuminanceMap or None
        The whole map of a file that labcdp wrote as luminance, with uncertainty and flags.
    """

    path: Path
    sha256: str
    frame: Frame | None
    light: NDArray[np.float32] | None
    light_is_cd_m2: bool
    encoding: Encoding
    findings: tuple[Finding, ...]
    f_number: float | None
    focal_length_m: float | None
    exposure_stated: bool
    camera_stated: bool
    exposure_known: bool = False
    coloured: bool = False
    scale_guessed: bool = False
    luminance: LuminanceMap | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width in pixels."""
        values = self.light if self.frame is None else self.frame.dn
        assert values is not None
        return values.shape[0], values.shape[1]
