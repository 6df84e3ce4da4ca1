"""Colours of a picture: linear values of its planes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ...core.frame import Frame, filter_name
from ...core.luminance import Invalid
from ...core.vignetting import Cos4Vignetting
from ...files.picture import Picture
from ...files.transfer import decoded_table
from ..colour.measure import Colours
from .converter import Converter

_Array = NDArray[np.floating[Any]]


def picture_colours(picture: Picture, converter: Converter) -> Colours:
    """Return the colours of a picture, in linear light.

    Parameters
    ----------
    picture : Picture
        A picture in colours, or the DN of a sensor behind a colour filter. The black level of these is subtracted, and
        a calibration for the colour filter is used.
    converter : Converter
        Conversion to luminance, whose vignetting of known focal length is corrected here too.

    Raises
    ------
    InputError
        If the picture is grey.
    CalibrationError
        If it is not of the camera and setting that the calibration is for.
    """
    if picture.rgb is not None:
        table = decoded_table(picture.rgb.bits, picture.rgb.encoding).astype(np.float32)
        colours = Colours(table[picture.rgb.values], ("R", "G", "B"), picture.rgb.saturated, 1)
    elif picture.frame is not None and picture.frame.colour_filter is not None:
        colours = frame_colours(converter.frame_of(picture), converter)
    else:
        raise InputError(
            f"{picture.path} is grey: the colours of regions need a picture in colours, or the values of a sensor "
            "behind a colour filter; give its pattern with --bayer (bayer in Python)"
        )
    vignetting = converter.picture_vignetting(picture) if converter.calibration is None else None
    if isinstance(vignetting, Cos4Vignetting):
        inverse = 1 / vignetting.relative_illuminance(picture.shape)
        height, width = colours.saturated.shape
        # The first pixel stands for its cell.
        inverse = inverse[:: colours.step, :: colours.step][:height, :width, None]
        colours = replace(colours, values=colours.values * inverse.astype(np.float32))
    return colours


def frame_colours(frame: Frame, converter: Converter) -> Colours:
    """Return the colours of a frame behind a colour filter; raises CalibrationError."""
    from ...calibration.frames.measure import split

    assert frame.colour_filter is not None
    planes = split(frame)
    of_planes = () if converter.calibration is None else converter.calibration.planes
    calibrations = {calibration.state.plane: calibration for calibration in of_planes}
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
    names, joined = _joined(filter_name(frame.colour_filter), values)
    return Colours(joined, names, np.any(saturated, axis=0), 2)


def _joined(pattern: str, values: dict[str, _Array]) -> tuple[tuple[str, ...], _Array]:
    """Return the names of the planes of a cell, and their values; pixels of one kind are averaged."""
    middle = (values["Gr"] + values["Gb"]) / 2
    if pattern.count("C") == len("CCC"):
        return ("R", "C"), np.stack([values["R"], (2 * middle + values["B"]) / 3], axis=-1)
    return ("R", "C" if "C" in pattern else "G", "B"), np.stack([values["R"], middle, values["B"]], axis=-1)
