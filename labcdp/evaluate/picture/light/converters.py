"""Ways from DN to luminance: a calibration, guessed parameters of a camera, or none of both."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose
from typing import TYPE_CHECKING, Protocol

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


class Converter(Protocol):
    """A way from DN to light."""

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
    ) -> LuminanceMap:
        """Return the luminance of a frame whose DN are encoded by `encoding`, or a window of it."""

    def refusal(self, picture: Picture) -> str | None:
        """Why a picture of DN cannot be converted, None if it can."""

    def findings(self, picture: Picture) -> list[Finding]:
        """Return what a user should know about the result."""


@dataclass(frozen=True)
class Calibrated:
    """By a calibration."""

    calibration: AnyCalibration

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
    ) -> LuminanceMap:
        """Convert as `Converter.luminance`."""
        return self.calibration.to_luminance(frame, window)

    def refusal(self, picture: Picture) -> str | None:
        """Refuse as `Converter.refusal`."""
        if picture.coloured:
            return (
                "it is coloured, and the calibration is for the DN of the sensor: give the picture as the camera "
                "recorded it, grey or RAW"
            )
        lens, found = self.calibration.lens, picture.f_number
        if found is not None and not isclose(found, lens.f_number, rel_tol=_F_NUMBER_REL):
            return (
                f"it was taken with f/{found:g}, the calibration is for f/{lens.f_number:g}: use this f-number, or "
                "calibrate the other"
            )
        return None

    def findings(self, picture: Picture) -> list[Finding]:
        """Return what `Converter.findings` does."""
        found = []
        if not picture.camera_stated:
            found.append(warning("camera-assumed", camera=str(self.calibration.state.camera)))
        if picture.encoding != "linear":
            found.append(warning("srgb-taken-as-dn"))
        return found


@dataclass(frozen=True)
class Specified:
    """By guessed parameters."""

    specification: CameraSpecification

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
    ) -> LuminanceMap:
        """Convert as `Converter.luminance`."""
        light = specified_light(self.specification, frame, encoding, f_number)
        return light.map_of(frame, window)

    def refusal(self, picture: Picture) -> str | None:
        """Refuse as `Converter.refusal`."""
        return None

    def findings(self, picture: Picture) -> list[Finding]:
        """Return what `Converter.findings` does."""
        assert picture.frame is not None
        specification = self.specification
        found = [warning("camera-guessed")]
        f_number = picture.f_number
        if f_number is not None and not isclose(f_number, specification.f_number, rel_tol=_F_NUMBER_REL):
            found.append(warning("f-number-differs", stated=f_number, specified=specification.f_number))
        if specification.glare_fraction > 0 and picture.frame.saturated.any():
            found.append(warning("glare-underestimated"))
        return found + _of_file(picture, specification.adc_bits)


@dataclass(frozen=True)
class Relative:
    """By nothing."""

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
    ) -> LuminanceMap:
        """Convert as `Converter.luminance`."""
        return relative_light(frame, encoding).map_of(frame, window)

    def refusal(self, picture: Picture) -> str | None:
        """Refuse as `Converter.refusal`."""
        return None

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
