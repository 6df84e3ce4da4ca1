"""Colours of a picture: linear values of its planes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...core.errors import InputError
from ...core.vignetting import Cos4Vignetting
from ...files.picture import Picture
from ...files.transfer import decoded_table
from ..colour.measure import Colours
from ..colour.planes import frame_colours
from .converter import Converter


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
        colours = frame_colours(converter.frame_of(picture), converter.calibration)
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
