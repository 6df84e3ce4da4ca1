"""Planes of frames behind a colour filter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.frame import Frame, filter_name
from ...core.luminance import Invalid
from .measure import Colours

if TYPE_CHECKING:
    from ...calibration import AnyCalibration

_Array = NDArray[np.floating[Any]]


def frame_colours(frame: Frame, calibration: AnyCalibration | None = None) -> Colours:
    """Return the colours of a frame behind a colour filter.

    Parameters
    ----------
    frame : Frame
        The frame.
    calibration : Calibration, ColourCalibration or None
        Of its camera; planes that it has are luminances, others DN less the black level.

    Raises
    ------
    CalibrationError
        If the frame has no colour filter, or the calibration is not for it.
    """
    from ...calibration.frames.measure import split

    planes = split(frame)
    of_planes = () if calibration is None else calibration.planes
    calibrations = {plane.state.plane: plane for plane in of_planes}
    values, saturated = dict[str, _Array](), []
    for name, plane in planes.items():
        saturated.append(plane.saturated)
        if name in calibrations:
            luminance = calibrations[name].to_luminance(plane)
            values[name] = luminance.luminance_cd_m2
            saturated.append(luminance.invalid & Invalid.SATURATED != 0)
            continue
        values[name] = plane.linear_dn().astype(np.float32) - np.float32(plane.linear_black_dn)
        if plane.black_pattern is not None and plane.companding is None:
            values[name] = values[name] - plane.black_pattern.offsets_dn(plane.shape)
    names, joined = _joined(filter_name(frame.colour_filter or ""), values)
    return Colours(joined, names, np.any(saturated, axis=0), 2)


def _joined(pattern: str, values: dict[str, _Array]) -> tuple[tuple[str, ...], _Array]:
    """Return the names of the planes of a cell, and their values; pixels of one kind are averaged."""
    middle = (values["Gr"] + values["Gb"]) / 2
    if pattern.count("C") == len("CCC"):
        return ("R", "C"), np.stack([values["R"], (2 * middle + values["B"]) / 3], axis=-1)
    return ("R", "C" if "C" in pattern else "G", "B"), np.stack([values["R"], middle, values["B"]], axis=-1)
