"""From pictures and frames of any origin to luminance: by a calibration, by a camera specification, or relative."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from ...core.dn import PIXEL_FORMATS
from ...core.errors import CalibrationError, InputError
from ...core.frame import Frame, Readout
from ...core.luminance import WHOLE, Invalid, LuminanceMap, Window
from ...core.result import Finding, FindingValue, info, unique, warning
from ...core.roi import Roi
from ...core.vignetting import (
    AssumedVignetting,
    Cos4Vignetting,
    Lens,
    assumed_in_part,
    unknown_vignetting,
    with_doubt,
)
from ...files.doubts import Doubts
from ...files.exif import NOTHING_SAID, ExifFacts
from ...files.frame import no_exposure
from ...files.picture import Picture
from ...files.read import PictureOptions, read_picture
from ...files.transfer import Encoding, encoding_name
from ...metrics import weber_contrast
from .dn_light import light_of_dn, vignetting_errors

if TYPE_CHECKING:
    from ...calibration import AnyCalibration
    from .camera_specification import CameraSpecification


Unit = Literal["cd/m^2", "relative"]
#: Relative difference of two ratios from which it matters how values are read.
_MATTERS = 0.02
#: Options of the lens, and what users call them.
LENS = {"focal_length_m": "focal length", "pixel_pitch_m": "pixel pitch"}
#: Beginnings of the codes of warnings that values may be read otherwise.
DOUBTS = ("encoding-assumed", "black-level-doubtful", "mosaic-doubtful")
#: Code of the warning of a mosaic.
MOSAIC = "mosaic-doubtful"
#: Relative difference of f-numbers that rounding explains.
_F_NUMBER_REL = 0.01


@dataclass(frozen=True)
class PictureSource:
    """What is known of a picture and its luminance, beside the pixels.

    Parameters
    ----------
    path, sha256, shape
        As of the `Picture`.
    unit, conversion : str
        ``cd/m²``, or ``relative`` without a scale; and how values became luminance.
    encoding : str
        How the values of the file are taken to be encoded, such as ``sRGB``; a calibration has a response of its own.
    exposure_s, camera, simulated
        Exposure and camera, None where they are not known, and whether it is a simulated one.
    findings : tuple of Finding
        What a user should know about file and conversion.
    """

    path: Path
    sha256: str
    shape: tuple[int, int]
    unit: str
    conversion: str
    encoding: str = "linear"
    exposure_s: float | None = None
    camera: str | None = None
    simulated: bool = False
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class OtherReading:
    """How values may be read otherwise.

    Parameters
    ----------
    code : str
        Of the warning; ``-pair`` follows where it is about two regions.
    reading : dict
        Arguments of `Doubts.contrast`; none for behind a colour filter.
    about : dict
        Values of the warning.
    """

    code: str
    reading: dict[str, Any]
    about: dict[str, Any]

    def matters(self, taken: float, otherwise: float) -> bool:
        """Whether two contrasts differ so that it matters."""
        return abs(otherwise - taken) > _MATTERS * (1 + min(taken, otherwise)) * (taken > 0)

    def of(self, picture: Picture, options: PictureOptions) -> Picture:
        """Return a picture as it is read so; raises InputError if its file is needed and cannot be read again."""
        doubts, frame, encoding = picture.doubts, picture.frame, self.reading.get("encoding")
        if encoding is None:
            assert frame is not None
            black, colour_filter = self.reading.get("black"), doubts.colour_filter
            return replace(
                picture, frame=replace(frame, **({"black_level_dn": doubts.black_dn} if black else
                                                 {"colour_filter": colour_filter}))
            )  # fmt: skip
        if picture.coloured:
            return read_picture(picture.path, replace(options, encoding=encoding))
        return replace(picture, encoding=encoding)

    def finding(self, pair: str, taken: float, otherwise: float, **of_frames: FindingValue) -> Finding:
        """Return the warning, about a pair of regions if it is named, of a video with what is said of its frames."""
        code = f"{self.code}-frames" if of_frames else f"{self.code}-pair" if pair else self.code
        return warning(code, pair, taken=taken, otherwise=otherwise, **self.about, **of_frames)


@dataclass(frozen=True)
class PictureConversion:
    """Conversion of pictures and frames to light: relative values, or by guessed parameters of a camera.

    Parameters
    ----------
    description : str
        What it rests on, for reports.
    options : PictureOptions
        What pictures to be converted are taken to be where their files do not say.
    specification : CameraSpecification or None
        The guessed parameters; None for relative values.
    """

    description: str
    options: PictureOptions
    specification: CameraSpecification | None = None

    def through(self, lens: Lens | None) -> Self:
        """Return the same for images of a lens that is stated, None for none; what the user gave counts before it."""
        if lens is None:
            return self
        stated = {name: getattr(lens, name) for name in ("focal_length_m", "pixel_pitch_m", "vignetting_rel")}
        kept = {name: value for name, value in stated.items() if name not in self.options.overrides}
        return replace(self, options=replace(self.options, **kept))

    @property
    def unit(self) -> Unit:
        """Unit of the maps; pictures whose file says that it holds luminance are in cd/m^2 anyway, see `unit_of`."""
        return "relative" if self.specification is None else "cd/m^2"

    def given(self, **values: Any) -> Self:
        """Return the same for pictures of which the user states something; see `PictureOptions.given`.

        Raises
        ------
        InputError
            If a value is not possible, or the conversion has it already.
        """
        return replace(self, options=self.options.given(**values))

    def vignetting(
        self,
        shape: tuple[int, int],
        readout: Readout | None = None,
        facts: ExifFacts = NOTHING_SAID,
        encoding: Encoding = "linear",
    ) -> AssumedVignetting | None:
        """Return the vignetting that is taken, None for none.

        Parameters
        ----------
        shape : (int, int)
            Height and width of an image in pixels.
        readout : Readout or None
            Which part of the sensor it shows.
        facts : ExifFacts
            What its file says.
        encoding : str
            How its values are encoded: a camera that develops its pictures may have corrected them.
        """
        options = self.options
        if options.no_vignetting:
            return None
        given = options.override("focal_length_m") is not None
        focal_length_m = options.focal_length_m if given else facts.focal_length_m or options.focal_length_m
        pixel_pitch_m = options.pixel_pitch_m or facts.pixel_pitch_on(shape)
        if focal_length_m is None or pixel_pitch_m is None:
            return unknown_vignetting(shape, readout)
        found = Lens(focal_length_m, pixel_pitch_m, options.vignetting_rel).on(shape, readout)
        return with_doubt(found, shape) if encoding != "linear" and not (given or self.specification) else found

    def _map(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
        vignetting: AssumedVignetting | None,
        /,
    ) -> LuminanceMap:
        """Return the luminance of a frame whose DN are encoded by `encoding`, or a window of it."""
        return light_of_dn(frame, encoding, self.specification, f_number, vignetting).map_of(frame, window)

    def _require_fit(self, picture: Picture) -> None:
        """Refuse a picture of DN that cannot be converted; raises CalibrationError."""

    def _findings(self, picture: Picture, frame: Frame) -> list[Finding]:
        """Return what a user should know about the result."""
        found, own, stated = [], self.specification, picture.f_number
        if own is not None:
            found.append(warning("camera-guessed"))
            if stated is not None and not isclose(stated, own.f_number, rel_tol=_F_NUMBER_REL):
                found.append(warning("f-number-differs", stated=stated, specified=own.f_number))
            if own.glare_fraction > 0 and frame.saturated.any():
                found.append(warning("glare-underestimated"))
        if picture.encoding != "linear":
            found.append(warning("srgb-assumed"))
        if own is not None and not picture.coloured and frame.bit_depth != own.adc_bits:
            found.append(info("bits-scaled", bits=frame.bit_depth, adc_bits=own.adc_bits))
        if frame.colour_filter is not None:
            found.append(info("green-pixels-only"))
        return found

    def source(self, picture: Picture) -> PictureSource:
        """Return what is known of a picture and its luminance."""
        frame = picture.frame
        simulated = frame is not None and frame.camera.simulated
        return PictureSource(
            path=picture.path,
            sha256=picture.sha256,
            shape=picture.shape,
            unit=self.unit_of(picture).replace("^2", "²"),
            conversion=self.description,
            encoding=encoding_name(picture.encoding),
            exposure_s=frame.exposure_s if frame is not None and picture.exposure_known else None,
            camera=str(frame.camera) if frame is not None and picture.camera_stated else None,
            simulated=simulated,
            findings=(*([info("camera-simulated")] if simulated else ()), *self.findings(picture)),
        )

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
        if picture.light is not None:
            if self.unit == "cd/m^2" and not picture.light_is_cd_m2:
                raise InputError(
                    f"{picture.path} holds floats, and does not state that they are cd/m²: calibrations and camera "
                    "specifications convert DN; leave them out to get relative values"
                )
            invalid = np.where(np.isfinite(picture.light), 0, Invalid.DEFECT).astype(np.uint8)
            light, vignetting = picture.light, self._vignetting_of(picture)
            if isinstance(vignetting, Cos4Vignetting):
                light = (light / vignetting.relative_illuminance(picture.shape)).astype(np.float32)
            errors = partial(vignetting_errors, vignetting, picture.shape, 1)
            return LuminanceMap(light, np.zeros_like(light), errors, invalid)
        frame = self.frame_of(picture)
        if self.unit == "cd/m^2" and not picture.exposure_known:
            raise InputError(no_exposure(picture.path))
        encoding: Encoding = "linear" if picture.coloured else picture.encoding
        try:
            return self._map(frame, encoding, WHOLE, picture.f_number, self._vignetting_of(picture))
        except CalibrationError as error:
            raise CalibrationError(f"{picture.path}: {error}") from error

    def _vignetting_of(self, picture: Picture) -> AssumedVignetting | None:
        """Return the vignetting of a picture that is taken; None for none, and for luminance."""
        if picture.light_is_cd_m2:
            return None
        readout = None if picture.frame is None else picture.frame.readout
        return self.through(picture.lens).vignetting(picture.shape, readout, picture.facts, picture.encoding)

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
            raise InputError(f"{picture.path} contains floats instead of DN: use a picture as the camera recorded it")
        self._require_fit(picture)
        return picture.frame

    def findings(self, picture: Picture) -> tuple[Finding, ...]:
        """Return what a user should know about a picture and its map."""
        if picture.light_is_cd_m2:
            unused = [info("conversion-ignored", conversion=self.description)] if self.unit == "cd/m^2" else []
            given = [what for name, what in LENS.items() if name in self.options.overrides]
            unused += [warning("lens-ignored", given=what) for what in given]
            return (*picture.findings, *unused)
        found = [] if picture.frame is None else self._findings(picture, picture.frame)
        found = [*self.vignetting_findings(self._vignetting_of(picture)), *self.doubt_findings(picture.doubts), *found]
        if self.unit == "cd/m^2" and picture.frame is not None and not picture.exposure_stated:
            found.append(info("exposure-assumed", exposure_s=picture.frame.exposure_s))
        return (*picture.findings, *found)

    def with_pairs(
        self, findings: Sequence[Finding], picture: Picture, luminance: LuminanceMap, pairs: Sequence[tuple[Roi, Roi]]
    ) -> tuple[Finding, ...]:
        """Return findings whose doubts about a picture are about the pair of regions for which they matter most.

        Parameters
        ----------
        findings : sequence of Finding
            With those of `findings`.
        picture, luminance
            The picture, and its luminance.
        pairs : sequence of (Roi, Roi)
            Bright and dark regions; with none, findings stay as they are.
        """
        kept, found = list(findings), list[Finding]()
        for doubt in self.other_readings(picture.doubts) if pairs else ():
            with suppress(InputError):
                other = self.luminance(doubt.of(picture, self.options))
                both = [
                    (f"{a.name} / {b.name}", contrast_of(luminance, a, b), contrast_of(other, a, b)) for a, b in pairs
                ]
                name, taken, otherwise = max(both, key=lambda one: abs(one[2] - one[1]) / (1 + one[1]))
                matters = doubt.matters(taken, otherwise)
                found += [doubt.finding(name, taken, otherwise)] if matters else []
                # CDP is that of a mosaic, whatever the contrast.
                if matters or doubt.code != MOSAIC:
                    kept = [one for one in kept if one.code != doubt.code]
        return (*found, *kept)

    def doubt_findings(self, doubts: Doubts) -> tuple[Finding, ...]:
        """Return warnings of what is doubtful about values, with what a contrast would be otherwise."""
        found = []
        if doubts.mosaic:
            found.append(warning(MOSAIC, mosaic=doubts.mosaic))
        for doubt in self.other_readings(doubts):
            if doubt.code == MOSAIC:
                continue
            taken, otherwise = doubts.contrast(), doubts.contrast(**doubt.reading)
            if doubt.matters(taken, otherwise):
                found.append(doubt.finding("", taken, otherwise))
        return tuple(found)

    def other_readings(self, doubts: Doubts) -> tuple[OtherReading, ...]:
        """Return how values may be read otherwise."""
        found, specified = [], self.specification
        if doubts.other_encoding is not None:
            other = doubts.other_encoding
            about = {"encoding": encoding_name(doubts.encoding), "other": encoding_name(other)}
            found.append(OtherReading("encoding-assumed", {"encoding": other}, about))
        if doubts.black_dn is not None and (specified is None or specified.black_dn is None):
            found.append(OtherReading("black-level-doubtful", {"black": True}, {"black_dn": doubts.black_dn}))
        if doubts.mosaic:
            found.append(OtherReading(MOSAIC, {}, {"mosaic": doubts.mosaic}))
        return tuple(found)

    def vignetting_findings(self, vignetting: AssumedVignetting | None) -> tuple[Finding, ...]:
        """Return what a user should know about the scale and the vignetting."""
        given = [what for name, what in LENS.items() if name in self.options.overrides]
        if len(given) == 1 and not isinstance(vignetting, Cos4Vignetting):
            (missing,) = set(LENS.values()) - set(given)
            return (warning("lens-incomplete", given=given[0], missing=missing), *self._scale_findings(vignetting))
        return self._scale_findings(vignetting)

    def _scale_findings(self, vignetting: AssumedVignetting | None) -> tuple[Finding, ...]:
        relative = self.unit == "relative"
        if isinstance(vignetting, Cos4Vignetting):
            code = "relative-luminance-cos4" if relative else "natural-vignetting-corrected"
            lens = {"focal_length_m": vignetting.focal_length_m, "pixel_pitch_m": vignetting.pixel_pitch_m}
            doubted = vignetting.corner_rel > self.options.vignetting_rel
            return (info(code, **lens), *([warning("vignetting-of-developed")] if doubted else []))
        if vignetting is None:
            return (info("relative-luminance-as-given"),) if relative else ()
        return (info("relative-luminance") if relative else warning("natural-vignetting-unknown"),)

    def convert(
        self, frame: Frame, window: Window | None = None, part_of: tuple[int, int, tuple[int, int]] | None = None
    ) -> LuminanceMap:
        """Convert a frame, of a video for example, or some rows and columns of its map.

        Parameters
        ----------
        frame : Frame
            DN that are encoded by the encoding of the options, in proportion if that is None.
        window : Window or None
            Rows and columns of the map; None for all. The map of a window starts at its first row and column.
        part_of : (int, int, (int, int)) or None
            Of a frame that is a part of an image: its first column and row, and height and width of the image.

        Raises
        ------
        CalibrationError
            If the frame is not of the camera, setting or size the calibration is for.
        """
        encoding = self.options.encoding or "linear"
        x, y, whole = part_of or (0, 0, frame.shape)
        found = self.vignetting(whole, frame.readout)
        if found is not None and part_of is not None:
            found = assumed_in_part(found, whole, (x, y), frame.shape)
        return self._map(frame, encoding, window or WHOLE, None, found)


def contrast_of(luminance: LuminanceMap, bright: Roi, dark: Roi) -> float:
    """Weber contrast of the means of two regions."""
    means = (float(luminance.select(roi).mean(dtype=float)) for roi in (bright, dark))
    return float(weber_contrast(*means))


#: What a calibration has measured, and what users call it.
_OF_CALIBRATION = {
    "black_level_dn": "black level", "focal_length_m": "focal length", "pixel_pitch_m": "pixel pitch",
    "no_vignetting": "vignetting",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Calibrated(PictureConversion):
    """By a calibration."""

    calibration: AnyCalibration

    def doubt_findings(self, doubts: Doubts) -> tuple[Finding, ...]:
        """Return nothing: the calibration has the response of the values."""
        return ()

    def other_readings(self, doubts: Doubts) -> tuple[OtherReading, ...]:
        """Return nothing."""
        return ()

    def given(self, **values: Any) -> Self:
        """Return the same for pictures of which the user states something; raises InputError for what was measured."""
        for name, what in _OF_CALIBRATION.items():
            if values.get(name) is not None:
                raise InputError(f"the {what} is given: a calibration includes it; leave it out")
        return super().given(**values)

    @property
    def unit(self) -> Unit:
        """Unit of the maps."""
        return "cd/m^2"

    def vignetting(
        self,
        shape: tuple[int, int],
        readout: Readout | None = None,
        facts: ExifFacts = NOTHING_SAID,
        encoding: Encoding = "linear",
    ) -> AssumedVignetting | None:
        """Return None: that of the calibration was measured."""
        return None

    def _map(self, frame: Frame, encoding: Encoding, window: Window, /, *_: object) -> LuminanceMap:
        return self.calibration.to_luminance(frame, window)

    def _require_fit(self, picture: Picture) -> None:
        if picture.coloured:
            raise CalibrationError(
                f"{picture.path}: it is a colour picture, but the calibration is for sensor DN: use the picture as "
                "the camera recorded it, grey or RAW"
            )
        stated, own = picture.f_number, self.calibration.lens.f_number
        if stated is not None and not isclose(stated, own, rel_tol=_F_NUMBER_REL):
            raise CalibrationError(
                f"{picture.path}: it was taken with f/{stated:g}, the calibration is for f/{own:g}: use this f-number, "
                "or calibrate the other"
            )

    def _findings(self, picture: Picture, frame: Frame) -> list[Finding]:
        assumed = warning("camera-assumed", camera=str(self.calibration.state.camera))
        found = [] if picture.camera_stated else [assumed]
        for plane in self.calibration.planes:
            dark = plane.setting(frame.gain_db).dark
            found += dark.unknown_temperature_findings([(frame.exposure_s, frame.temperature_c)])
        return [*unique(found)] + ([warning("srgb-taken-as-dn")] if picture.encoding != "linear" else [])


def picture_conversion(
    calibration: Path | AnyCalibration | None, camera: Path | None, encoding: Encoding | None
) -> PictureConversion:
    """Conversion by a calibration, by a camera specification in TOML, or by neither: relative values.

    Parameters
    ----------
    calibration, camera : Path, or a calibration, or None
        At most one of them.
    encoding : {'linear', 'srgb'} or None
        How values are encoded; None for what each file suggests, or the camera specification says.

    Raises
    ------
    InputError
        If both are given, one cannot be read, or an encoding is given in addition to a calibration, which has its own.
    """
    stated = PictureOptions().given(encoding=encoding)
    # Only where they are used: they take longer to load than a small picture to evaluate.
    if calibration is not None:
        if camera is not None:
            raise InputError("both a calibration and a camera specification are given: use one")
        if encoding not in (None, "linear"):
            raise InputError(f"the encoding is {encoding}: a calibration includes the encoding, leave it out")
        from ...calibration import load_any

        if isinstance(calibration, Path):
            return calibrated_conversion(load_any(calibration), calibration.name, stated)
        return calibrated_conversion(calibration, "in memory", stated)
    if camera is None:
        return PictureConversion("relative luminance", stated)
    from .camera_specification import CameraSpecification

    specification = CameraSpecification.load(camera)
    description = f"guessed camera parameters of {camera.name} ({specification.name})"
    options = replace(
        stated,
        exposure_s=specification.exposure_s,
        gain_db=specification.gain_db,
        bit_depth=specification.adc_bits,
        encoding=encoding or specification.encoding,
        focal_length_m=specification.image_distance_m,
        pixel_pitch_m=specification.pixel_pitch_m,
    )
    return PictureConversion(description, options, specification)


def calibrated_conversion(loaded: AnyCalibration, name: str, stated: PictureOptions | None = None) -> Calibrated:
    """Conversion by a calibration that was loaded from the file `name`."""
    state = loaded.state
    options = replace(
        stated or PictureOptions(),
        exposure_s=loaded.exposures_s[0] if len(loaded.exposures_s) == 1 else None,
        gain_db=state.gain_db,
        camera=state.camera,
        bit_depth=state.bit_depth,
        pixel_format=state.pixel_format if state.pixel_format in PIXEL_FORMATS else None,
        saturation_dn=state.saturation_dn,
        black_level_dn=state.black_level_dn,
    )
    description = f"calibration {name} of {state.camera}, {loaded.lens}, in {loaded.source_spectrum}"
    return Calibrated(description, options, calibration=loaded)
