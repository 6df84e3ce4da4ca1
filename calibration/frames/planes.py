"""Colour planes of a Bayer frame as monochrome frames of half the size; exact pixels, no demosaicing."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from ...core.errors import CalibrationError
from ...core.frame import PLANES, Frame
from ...core.roi import Roi

_log = logging.getLogger(__name__)

#: Row and column of each plane's pixel in the upper left 2 x 2 pixels, by the name of the pattern.
_POSITIONS: dict[str, dict[str, tuple[int, int]]] = {
    "RG": {"R": (0, 0), "Gr": (0, 1), "Gb": (1, 0), "B": (1, 1)},
    "GR": {"Gr": (0, 0), "R": (0, 1), "B": (1, 0), "Gb": (1, 1)},
    "GB": {"Gb": (0, 0), "B": (0, 1), "R": (1, 0), "Gr": (1, 1)},
    "BG": {"B": (0, 0), "Gb": (0, 1), "Gr": (1, 0), "R": (1, 1)},
}


def split(frame: Frame) -> dict[str, Frame]:
    """Split a Bayer frame into its four planes.

    Parameters
    ----------
    frame : Frame
        With a colour filter, shape (height, width). A last row or column without a partner is left out.

    Returns
    -------
    dict of str to Frame
        ``R``, ``Gr``, ``Gb`` and ``B``, each of shape (height // 2, width // 2), with the black level of its plane.

    Raises
    ------
    CalibrationError
        If the frame has no colour filter, or is a single row or column.
    """
    if frame.colour_filter is None:
        what = f"plane {frame.plane}" if frame.plane else "a monochrome sensor"
        raise CalibrationError(f"frame {frame.frame_id} is of {what}, it has no colour planes: use it as it is")
    height, width = frame.shape
    if height < 2 or width < 2:
        raise CalibrationError(
            f"frame {frame.frame_id} has {width} x {height} pixels: a Bayer frame has at least 2 x 2"
        )
    if height % 2 or width % 2:
        _log.info("frame %d has %d x %d pixels: the odd row or column is left out", frame.frame_id, width, height)
    black_dn = frame.plane_black_levels_dn or (frame.black_level_dn,) * len(PLANES)
    even = frame.dn[: height // 2 * 2, : width // 2 * 2]
    positions = _POSITIONS[frame.colour_filter]
    return {
        plane: replace(
            frame,
            dn=_own(even[positions[plane][0] :: 2, positions[plane][1] :: 2]),
            black_level_dn=black,
            colour_filter=None,
            plane=plane,
            plane_black_levels_dn=None,
            readout=frame.readout and frame.readout.in_larger_pixels(2),
        )
        for plane, black in zip(PLANES, black_dn, strict=True)
    }


def plane_of(frame: Frame, plane: str | None) -> Frame:
    """Return one plane of a Bayer frame, or with None the frame of a monochrome sensor itself."""
    return frame if plane is None else split(frame)[plane]


def _own(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous read-only copy, for repeated passes over the pixels."""
    copy = pixels.copy()
    copy.flags.writeable = False
    return copy


def plane_region(roi: Roi) -> Roi:
    """Return a region in pixels of the planes: a group of 2 x 2 pixels is included if its centre is."""
    return Roi(roi.name, tuple((x / 2, y / 2) for x, y in roi.corners))
