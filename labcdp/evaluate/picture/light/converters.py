"""Ways from DN to luminance: a calibration, guessed parameters of a camera, or none of both."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import isclose
from typing import TYPE_CHECKING

from ....core.finding import Finding, info, warning
from ....core.frame import Frame
from ....core.luminance import LuminanceMap, Window
from ....files.formats.colour import Encoding
from ....files.picture.picture import Picture
from .dn_tables import relative_light, specified_light

if TYPE_CHECKING:
    from ....calibration import AnyCalibration
    from .camera_specification import CameraSpecification

#: Relative difference of f-numbers that rounding explains.
_F_NUMBER_REL = 0.01


class Converter(ABC):
    """A way from DN to light."""

    @abstractmethod
    def luminance(self, frame: Frame, encoding: Encoding, window: Window, f_number: float | None) -> LuminanceMap:
        """Return the luminance of a frame whose DN are encoded by `encoding`, or a window of it."""

    def refusal(self, picture: Picture) -> str | None:
        """Why a picture of DN cannot be converted, None if it can."""
        return None

    @abstractmethod
    def findings(self, picture: Picture) -> list[Finding]:
        """Return what a user should know about the result."""


@dataclass(frozen=True)
class Calibrated(Converter):
    """By a calibration."""

    calibration: AnyCalibration

    def luminance(self, frame: Frame, encoding: Encoding, window: Window, f_number: float | None) -> LuminanceMap:
        """Convert as `Converter.luminance`."""
        return self.calibration.to_luminance(frame, window)

    def refusal(self, picture: Picture) -> str | None:
        """Refuse as `Converter.refusal`."""
        if picture.coloured:
            return (
                "it is coloured, and the calibration is for the DN of the sensor: give the picture as the camera "
                "recorded it, grey or RAW"
            )
        stated, own = picture.f_number, self.calibration.lens.f_number
        if stated is None or isclose(stated, own, rel_tol=_F_NUMBER_REL):
            return None
        use = "use this f-number, or calibrate the other"
        return f"it was taken with f/{stated:g}, the calibration is for f/{own:g}: {use}"

    def findings(self, picture: Picture) -> list[Finding]:
        """Return what `Converter.findings` does."""
        found = []
        if not picture.camera_stated:
            found.append(warning("camera-assumed", camera=str(self.calibration.state.camera)))
        return found + ([warning("srgb-taken-as-dn")] if picture.encoding != "linear" else [])


@dataclass(frozen=True)
class Specified(Converter):
    """By guessed parameters."""

    specification: CameraSpecification

    def luminance(self, frame: Frame, encoding: Encoding, window: Window, f_number: float | None) -> LuminanceMap:
        """Convert as `Converter.luminance`."""
        return specified_light(self.specification, frame, encoding, f_number).map_of(frame, window)

    def findings(self, picture: Picture) -> list[Finding]:
        """Return what `Converter.findings` does."""
        assert picture.frame is not None
        found, own = [warning("camera-guessed")], self.specification
        stated = picture.f_number
        if stated is not None and not isclose(stated, own.f_number, rel_tol=_F_NUMBER_REL):
            found.append(warning("f-number-differs", stated=stated, specified=own.f_number))
        if own.glare_fraction > 0 and picture.frame.saturated.any():
            found.append(warning("glare-underestimated"))
        return found + _of_file(picture, own.adc_bits)


@dataclass(frozen=True)
class Relative(Converter):
    """By nothing."""

    def luminance(self, frame: Frame, encoding: Encoding, window: Window, f_number: float | None) -> LuminanceMap:
        """Convert as `Converter.luminance`."""
        return relative_light(frame, encoding).map_of(frame, window)

    def findings(self, picture: Picture) -> list[Finding]:
        """Return what `Converter.findings` does."""
        return _of_file(picture, None)


def _of_file(picture: Picture, adc_bits: int | None) -> list[Finding]:
    """Return what is assumed about a file without a calibration."""
    assert picture.frame is not None
    found = []
    if picture.encoding != "linear":
        found.append(warning("srgb-assumed"))
    bits = picture.frame.bit_depth
    if adc_bits is not None and not picture.coloured and bits != adc_bits:
        found.append(info("bits-scaled", bits=bits, adc_bits=adc_bits))
    if picture.frame.colour_filter is not None:
        found.append(info("green-pixels-only"))
    return found
