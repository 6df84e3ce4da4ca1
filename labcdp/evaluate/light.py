"""From pictures and frames of any origin to luminance: by a calibration, by a camera specification, or relative."""

from __future__ import annotations

from dataclasses import dataclass
from math import isclose
from pathlib import Path
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ..calibration import AnyCalibration
from ..errors import CalibrationError, InputError
from ..frame import Frame
from ..luminance import WHOLE, Invalid, LuminanceMap, Window
from ..pixel_format import PIXEL_FORMATS
from ..sources.picture import Picture, PictureOptions
from ..sources.stored_image import Encoding
from .camera_specification import CameraSpecification, load_camera_specification
from .dn_tables import relative_light, specified_light

Unit = Literal["cd/m^2", "relative"]
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
        clipped: NDArray[np.bool_] | None,
    ) -> LuminanceMap:
        """Light of a frame whose DN follow light by `encoding`, or of a window of the map."""

    def refusal(self, picture: Picture) -> str | None:
        """Why a picture of DN cannot be converted, None if it can."""

    def warnings(self, picture: Picture) -> list[str]:
        """Say what to mind about the result."""


@dataclass(frozen=True)
class PictureConversion:
    """Conversion of pictures and frames to light.

    Parameters
    ----------
    unit : {'cd/m^2', 'relative'}
        Of the maps; pictures whose file says that it holds luminance are in cd/m^2 in any case, see `unit_of`.
    description : str
        What it rests on, for reports.
    options : PictureOptions
        What pictures to be converted are taken to be where their files do not say.
    converter : Converter
        The way from DN.
    """

    unit: Unit
    description: str
    options: PictureOptions
    converter: Converter

    def unit_of(self, picture: Picture) -> Unit:
        """Return the unit of the map of a picture."""
        return "cd/m^2" if picture.light_is_cd_m2 else self.unit

    def luminance(self, picture: Picture) -> LuminanceMap:
        """Convert a picture.

        Raises
        ------
        CalibrationError
            If the picture is not of the camera, setting or size the calibration is for.
        InputError
            If its exposure is not known, or it holds floats of an unknown unit where DN are needed.
        """
        if picture.luminance is not None:
            return picture.luminance
        if picture.frame is None:
            return self._of_floats(picture)
        frame = self.frame_of(picture)
        if self.unit == "cd/m^2" and not picture.exposure_known:
            raise InputError(f"{picture.path} does not say its exposure time: give it with --exposure")
        encoding: Encoding = "linear" if picture.coloured else picture.encoding
        try:
            return self.converter.luminance(frame, encoding, WHOLE, picture.f_number, picture.clipped)
        except CalibrationError as error:
            raise CalibrationError(f"{picture.path}: {error}") from error

    def frame_of(self, picture: Picture) -> Frame:
        """Return the DN of a picture if they are such as the conversion is for.

        Raises
        ------
        CalibrationError
            If the picture is not of the camera or setting of the lens the calibration is for.
        InputError
            If it holds no DN.
        """
        if picture.frame is None:
            raise InputError(f"{picture.path} holds no DN, but floats: give a picture as the camera recorded it")
        reason = self.converter.refusal(picture)
        if reason is not None:
            raise CalibrationError(f"{picture.path}: {reason}")
        return picture.frame

    def warnings(self, picture: Picture) -> tuple[str, ...]:
        """Say in plain words what to mind about the map of a picture."""
        if picture.light_is_cd_m2:
            unused = f"the file holds luminance in cd/m^2 already, so this does not count: {self.description}"
            return (*picture.warnings, *([unused] if self.unit == "cd/m^2" else []))
        found = [] if picture.frame is None else self.converter.warnings(picture)
        if self.unit == "relative":
            found.insert(0, _RELATIVE)
        elif picture.frame is not None and not picture.exposure_stated:
            found.append(f"the file does not say its exposure: {picture.frame.exposure_s:g} s is taken")
        return (*picture.warnings, *found)

    def convert(self, frame: Frame, window: Window | None = None) -> LuminanceMap:
        """Convert a frame, of a video for example, or some rows and columns of its map.

        Parameters
        ----------
        frame : Frame
            DN that follow light by the encoding of the options, in proportion if that is None.
        window : Window or None
            Rows and columns of the map; None for all. The map of a window starts at its first row and column.

        Raises
        ------
        CalibrationError
            If the frame is not of the camera, setting or size the calibration is for.
        """
        return self.converter.luminance(frame, self.options.encoding or "linear", window or WHOLE, None, None)

    def _of_floats(self, picture: Picture) -> LuminanceMap:
        assert picture.light is not None
        if self.unit == "cd/m^2" and not picture.light_is_cd_m2:
            raise InputError(
                f"{picture.path} holds floats, and does not say that they are cd/m^2: calibration and camera "
                "specification convert DN; leave them out for relative values"
            )
        invalid = np.where(np.isfinite(picture.light), 0, Invalid.DEFECT).astype(np.uint8)
        return LuminanceMap(picture.light, np.zeros_like(picture.light), (), invalid)


_RELATIVE = (
    "neither calibration nor camera specification: values are proportional to light, not luminance; contrasts hold as "
    "far as darkness is 0 and the values follow light"
)


def picture_conversion(calibration: Path | None, camera: Path | None, encoding: Encoding | None) -> PictureConversion:
    """Conversion by a calibration file, by a camera specification in TOML, or by neither: relative values.

    Parameters
    ----------
    calibration, camera : Path or None
        At most one of them.
    encoding : {'linear', 'srgb'} or None
        How values follow light; None for what each file suggests, or the camera specification says.

    Raises
    ------
    InputError
        If both are given, one cannot be read, or an encoding is given beside a calibration, which has its own.
    """
    if calibration is not None and camera is not None:
        raise InputError("a calibration and a camera specification are given: give one, the calibration knows more")
    if calibration is not None:
        return _by_calibration(calibration, encoding)
    if camera is not None:
        return _by_specification(camera, encoding)
    options = PictureOptions(encoding=encoding, told=_told(encoding))
    return PictureConversion("relative", "relative values, proportional to light", options, _Relative())


def _by_calibration(path: Path, encoding: Encoding | None) -> PictureConversion:
    from ..calibration import load_any

    if encoding == "srgb":
        raise InputError("the encoding is srgb: a calibration knows how the DN follow light, leave the encoding out")
    return calibrated_conversion(load_any(path), path.name, encoding)


def calibrated_conversion(
    loaded: AnyCalibration, name: str, encoding: Literal["linear"] | None = None
) -> PictureConversion:
    """Conversion by a calibration that was loaded from the file `name`."""
    state = loaded.state
    options = PictureOptions(
        exposure_s=loaded.exposures_s[0] if len(loaded.exposures_s) == 1 else None,
        gain_db=state.gain_db,
        camera=state.camera,
        bit_depth=state.bit_depth,
        pixel_format=state.pixel_format if state.pixel_format in PIXEL_FORMATS else None,
        saturation_dn=state.saturation_dn,
        black_level_dn=state.black_level_dn,
        encoding=encoding,
        told=_told(encoding),
    )
    description = f"calibration {name} of {state.camera}, {loaded.lens}, in {loaded.source_spectrum}"
    return PictureConversion("cd/m^2", description, options, _Calibrated(loaded))


def _by_specification(path: Path, encoding: Encoding | None) -> PictureConversion:
    specification = load_camera_specification(path)
    options = PictureOptions(
        exposure_s=specification.exposure_s,
        gain_db=specification.gain_db,
        bit_depth=specification.adc_bits,
        encoding=encoding or specification.encoding,
        told=_told(encoding),
    )
    description = f"guessed camera parameters of {path.name} ({specification.name})"
    return PictureConversion("cd/m^2", description, options, _Specified(specification))


def _told(encoding: Encoding | None) -> frozenset[str]:
    return frozenset() if encoding is None else frozenset({"encoding"})


@dataclass(frozen=True)
class _Calibrated:
    """By a calibration."""

    calibration: AnyCalibration

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
        clipped: NDArray[np.bool_] | None,
    ) -> LuminanceMap:
        return self.calibration.to_luminance(frame, window)

    def refusal(self, picture: Picture) -> str | None:
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

    def warnings(self, picture: Picture) -> list[str]:
        found = []
        if not picture.camera_stated:
            found.append(f"the file does not say its camera: it is taken for {self.calibration.state.camera}")
        if picture.encoding == "srgb":
            found.append("JPEG or sRGB values are taken as the DN the camera was calibrated with")
        return found


@dataclass(frozen=True)
class _Specified:
    """By guessed parameters."""

    specification: CameraSpecification

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
        clipped: NDArray[np.bool_] | None,
    ) -> LuminanceMap:
        light = specified_light(self.specification, frame, encoding, f_number)
        return light.map_of(frame, window, clipped)

    def refusal(self, picture: Picture) -> str | None:
        return None

    def warnings(self, picture: Picture) -> list[str]:
        assert picture.frame is not None
        specification = self.specification
        found = [
            "the camera's parameters are guessed: how far the luminance is off is not known (33 to 52 % in the 2018 "
            "thesis) and no stated uncertainty contains it; calibrate to know"
        ]
        f_number = picture.f_number
        if f_number is not None and not isclose(f_number, specification.f_number, rel_tol=_F_NUMBER_REL):
            found.append(
                f"the file says f/{f_number:g}, the specification f/{specification.f_number:g}: that of the file counts"
            )
        clipped = picture.frame.saturated if picture.clipped is None else picture.clipped
        if specification.glare_fraction > 0 and clipped.any():
            found.append("some pixels are saturated: the glare, a part of the image's mean, is taken too low")
        return found + _of_file(picture, specification.adc_bits)


@dataclass(frozen=True)
class _Relative:
    """By nothing."""

    def luminance(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
        clipped: NDArray[np.bool_] | None,
    ) -> LuminanceMap:
        return relative_light(frame, encoding).map_of(frame, window, clipped)

    def refusal(self, picture: Picture) -> str | None:
        return None

    def warnings(self, picture: Picture) -> list[str]:
        return _of_file(picture, None)


def _of_file(picture: Picture, adc_bits: int | None) -> list[str]:
    """Warnings about what is taken for granted of a file without a calibration."""
    assert picture.frame is not None
    found = []
    if picture.encoding == "srgb":
        found.append("values are taken as sRGB: a camera's own tone curve, which differs, stays in the contrasts")
    bits = picture.frame.bit_depth
    if adc_bits is not None and not picture.coloured and bits != adc_bits:
        found.append(f"values of {bits} bits are spread over the {adc_bits} bits of the converter")
    if picture.frame.colour_filter is not None:
        found.append("of the colour filter only the green pixels count: coloured light has another luminance")
    return found
