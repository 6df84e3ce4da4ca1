"""From pictures and frames of any origin to luminance: by a calibration, by a camera specification, or relative."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from ....core.errors import CalibrationError, InputError
from ....core.finding import Finding, info
from ....core.frame import Frame
from ....core.luminance import WHOLE, Invalid, LuminanceMap, Window
from ....core.pixel_format import PIXEL_FORMATS
from ....files.formats.colour import Encoding
from ....files.picture.picture import Picture
from ....files.picture.read import PictureOptions
from .converters import Calibrated, Converter, Relative, Specified

if TYPE_CHECKING:
    from ....calibration import AnyCalibration

Unit = Literal["cd/m^2", "relative"]


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
            raise InputError(f"{picture.path} does not state its exposure time: give it with --exposure")
        encoding: Encoding = "linear" if picture.coloured else picture.encoding
        try:
            return self.converter.luminance(frame, encoding, WHOLE, picture.f_number)
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

    def findings(self, picture: Picture) -> tuple[Finding, ...]:
        """Return what a user should know about a picture and its map."""
        if picture.light_is_cd_m2:
            unused = [info("conversion-ignored", conversion=self.description)] if self.unit == "cd/m^2" else []
            return (*picture.findings, *unused)
        found = [] if picture.frame is None else self.converter.findings(picture)
        if self.unit == "relative":
            found.insert(0, info("relative-luminance"))
        elif picture.frame is not None and not picture.exposure_stated:
            found.append(info("exposure-assumed", exposure_s=picture.frame.exposure_s))
        return (*picture.findings, *found)

    def convert(self, frame: Frame, window: Window | None = None) -> LuminanceMap:
        """Convert a frame, of a video for example, or some rows and columns of its map.

        Parameters
        ----------
        frame : Frame
            DN that are encoded by the encoding of the options, in proportion if that is None.
        window : Window or None
            Rows and columns of the map; None for all. The map of a window starts at its first row and column.

        Raises
        ------
        CalibrationError
            If the frame is not of the camera, setting or size the calibration is for.
        """
        return self.converter.luminance(frame, self.options.encoding or "linear", window or WHOLE, None)

    def _of_floats(self, picture: Picture) -> LuminanceMap:
        assert picture.light is not None
        if self.unit == "cd/m^2" and not picture.light_is_cd_m2:
            raise InputError(
                f"{picture.path} holds floats, and does not say that they are cd/m^2: calibration and camera "
                "specification convert DN; leave them out for relative values"
            )
        invalid = np.where(np.isfinite(picture.light), 0, Invalid.DEFECT).astype(np.uint8)
        return LuminanceMap(picture.light, np.zeros_like(picture.light), (), invalid)


def picture_conversion(calibration: Path | None, camera: Path | None, encoding: Encoding | None) -> PictureConversion:
    """Conversion by a calibration file, by a camera specification in TOML, or by neither: relative values.

    Parameters
    ----------
    calibration, camera : Path or None
        At most one of them.
    encoding : {'linear', 'srgb'} or None
        How values are encoded; None for what each file suggests, or the camera specification says.

    Raises
    ------
    InputError
        If both are given, one cannot be read, or an encoding is given in addition to a calibration, which has its own.
    """
    if calibration is not None and camera is not None:
        raise InputError("a calibration and a camera specification are given: give one")
    if calibration is not None:
        return _by_calibration(calibration, encoding)
    if camera is not None:
        return _by_specification(camera, encoding)
    options = PictureOptions(encoding=encoding, overrides=_overrides(encoding))
    return PictureConversion("relative", "relative values, proportional to light", options, Relative())


def _by_calibration(path: Path, encoding: Encoding | None) -> PictureConversion:
    from ....calibration import load_any

    if encoding not in (None, "linear"):
        raise InputError(f"the encoding is {encoding}: a calibration includes the encoding, leave it out")
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
        overrides=_overrides(encoding),
    )
    description = f"calibration {name} of {state.camera}, {loaded.lens}, in {loaded.source_spectrum}"
    return PictureConversion("cd/m^2", description, options, Calibrated(loaded))


def _by_specification(path: Path, encoding: Encoding | None) -> PictureConversion:
    # Only where it is used, as is the calibration: they take longer to load than a small picture to evaluate.
    from .camera_specification import load_camera_specification

    specification = load_camera_specification(path)
    options = PictureOptions(
        exposure_s=specification.exposure_s,
        gain_db=specification.gain_db,
        bit_depth=specification.adc_bits,
        encoding=encoding or specification.encoding,
        overrides=_overrides(encoding),
    )
    description = f"guessed camera parameters of {path.name} ({specification.name})"
    return PictureConversion("cd/m^2", description, options, Specified(specification))


def _overrides(encoding: Encoding | None) -> frozenset[str]:
    return frozenset() if encoding is None else frozenset({"encoding"})
