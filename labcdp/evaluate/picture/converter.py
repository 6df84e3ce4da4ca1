"""From pictures and frames of any origin to luminance: by a calibration, by a camera specification, or relative."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from ...core.companding import Companding
from ...core.dn import PIXEL_FORMATS
from ...core.errors import CalibrationError, InputError
from ...core.frame import Frame, Readout
from ...core.luminance import WHOLE, Invalid, LuminanceMap, Window
from ...core.result import Finding, info, unique, warning
from ...core.roi import Roi
from ...core.vignetting import (
    AssumedVignetting,
    Cos4Vignetting,
    Lens,
    assumed_in_part,
    unknown_vignetting,
    with_doubt,
)
from ...files.doubts import MOSAIC, Doubts, contrast_matters
from ...files.frame import no_exposure
from ...files.picture import Picture, PictureOptions
from ...files.read import read_otherwise
from ...files.statements import NOTHING_STATED, FileStatements
from ...files.transfer import Encoding, as_encoding, encoding_name
from ...metrics import weber_contrast
from .light_table import AssumedVignettingMap, TableMap, make_light_table

if TYPE_CHECKING:
    from ...calibration import AnyCalibration
    from .camera_specification import CameraSpecification


Unit = Literal["cd/m^2", "relative"]
#: Options of the lens, and what users call them.
LENS = {"focal_length_m": "focal length", "pixel_pitch_m": "pixel pitch"}
#: Options that a calibration has measured, and what users call them.
_MEASURED = {"black_level_dn": "black level", **LENS, "no_vignetting": "vignetting"}
#: Relative difference of f-numbers that rounding explains.
_F_NUMBER_REL = 0.01


@dataclass(frozen=True)
class PictureSource:
    """Facts about a picture and its luminance other than the pixels.

    Parameters
    ----------
    path, sha256, shape
        As of the `Picture`.
    unit, conversion : str
        ``cd/m²``, or ``relative`` without a scale; and how values became luminance.
    encoding : str
        Assumed encoding of the values of the file, such as ``sRGB``; a calibration has a response of its own.
    exposure_s, camera, simulated
        Exposure and camera, None where they are not known, and whether it is a simulated one.
    findings : tuple of Finding
        Findings about file and conversion.
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
class Converter:
    """DN of pictures and frames to light: by a calibration, by a camera specification, or relative.

    Parameters
    ----------
    description : str
        Basis of the conversion, for reports.
    options : PictureOptions
        Assumptions about pictures whose files do not state them.
    specification : CameraSpecification or None
        Guessed parameters of the camera.
    calibration : Calibration, ColourCalibration or None
        The calibration; with neither, light is relative.
    """

    description: str
    options: PictureOptions
    specification: CameraSpecification | None = None
    calibration: AnyCalibration | None = None

    def with_lens(self, lens: Lens | None) -> Self:
        """Return the converter for images of a stated lens, or of none; values given by the user take precedence."""
        if lens is None:
            return self
        stated = {name: getattr(lens, name) for name in ("focal_length_m", "pixel_pitch_m", "vignetting_rel")}
        kept = {name: value for name, value in stated.items() if name not in self.options.overrides}
        return replace(self, options=replace(self.options, **kept))

    @property
    def unit(self) -> Unit:
        """Unit of the maps; pictures whose file says that it holds luminance are in cd/m^2 anyway, see `unit_of`."""
        return "relative" if self.specification is None and self.calibration is None else "cd/m^2"

    def given(self, **values: Any) -> Self:
        """Return the converter for pictures about which the user states something; see `PictureOptions.given`.

        Raises
        ------
        InputError
            If a value is not possible, or was measured by the calibration.
        """
        for name, what in _MEASURED.items() if self.calibration is not None else ():
            if values.get(name) is not None:
                raise InputError(f"the {what} is given: a calibration includes it; leave it out")
        return replace(self, options=self.options.given(**values))

    def vignetting(
        self,
        shape: tuple[int, int],
        readout: Readout | None = None,
        statements: FileStatements = NOTHING_STATED,
        encoding: Encoding = "linear",
    ) -> AssumedVignetting | None:
        """Return the vignetting that is assumed; None for none, and where a calibration has measured it.

        Parameters
        ----------
        shape : (int, int)
            Height and width of an image in pixels.
        readout : Readout or None
            Part of the sensor that it shows.
        statements : FileStatements
            Statements of its file.
        encoding : str
            Encoding of its values: a camera that develops its pictures may have corrected the vignetting.
        """
        options = self.options
        if options.no_vignetting or self.calibration is not None:
            return None
        given = options.override("focal_length_m") is not None
        focal_length_m = options.focal_length_m if given else statements.focal_length_m or options.focal_length_m
        pixel_pitch_m = options.pixel_pitch_m or statements.pixel_pitch_on(shape)
        if focal_length_m is None or pixel_pitch_m is None:
            return unknown_vignetting(shape, readout)
        assumed = Lens(focal_length_m, pixel_pitch_m, options.vignetting_rel).on(shape, readout)
        is_developed = not (encoding == "linear" or isinstance(encoding, Companding) or given or self.specification)
        return with_doubt(assumed, shape) if is_developed else assumed

    def _map(
        self,
        frame: Frame,
        encoding: Encoding,
        window: Window,
        f_number: float | None,
        vignetting: AssumedVignetting | None,
    ) -> LuminanceMap:
        """Return the luminance of a frame whose DN are encoded by `encoding`, or a window of it."""
        if self.calibration is not None:
            return self.calibration.to_luminance(frame, window)
        table = make_light_table(frame, encoding, self.specification, f_number, vignetting)
        return TableMap(frame, table, vignetting, window)

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
            light, vignetting = picture.light, self.picture_vignetting(picture)
            if isinstance(vignetting, Cos4Vignetting):
                light = (light / vignetting.relative_illuminance(picture.shape)).astype(np.float32)
            return AssumedVignettingMap(light, np.zeros_like(light), (), invalid, vignetting)
        frame = self.frame_of(picture)
        if self.unit == "cd/m^2" and not picture.exposure_known:
            raise InputError(no_exposure(picture.path))
        encoding: Encoding = "linear" if picture.coloured else picture.encoding
        try:
            return self._map(frame, encoding, WHOLE, picture.f_number, self.picture_vignetting(picture))
        except CalibrationError as error:
            raise CalibrationError(f"{picture.path}: {error}") from error

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
        x, y, whole = part_of or (0, 0, frame.shape)
        vignetting = self.vignetting(whole, frame.readout)
        if vignetting is not None and part_of is not None:
            vignetting = assumed_in_part(vignetting, whole, (x, y), frame.shape)
        encoding = frame.companding or self.options.encoding or "linear"
        return self._map(frame, encoding, window or WHOLE, None, vignetting)

    def frame_of(self, picture: Picture) -> Frame:
        """Return the DN of a picture, checked to be of the camera and setting that the converter is for.

        Raises
        ------
        CalibrationError
            If the picture is not of the camera or setting of the lens the calibration is for.
        InputError
            If it holds no DN.
        """
        if picture.frame is None:
            raise InputError(f"{picture.path} contains floats instead of DN: use a picture as the camera recorded it")
        if self.calibration is None:
            return picture.frame
        if picture.coloured:
            raise CalibrationError(
                f"{picture.path}: it is a colour picture, but the calibration is for sensor DN: use the picture as "
                "the camera recorded it, grey or RAW"
            )
        stated, calibrated = picture.f_number, self.calibration.lens.f_number
        if stated is not None and not isclose(stated, calibrated, rel_tol=_F_NUMBER_REL):
            raise CalibrationError(
                f"{picture.path}: it was taken with f/{stated:g}, the calibration is for f/{calibrated:g}: use this "
                "f-number, or calibrate the other"
            )
        return picture.frame

    def picture_vignetting(self, picture: Picture) -> AssumedVignetting | None:
        """Return the vignetting that is assumed of a picture; None for none, and for luminance."""
        if picture.light_is_cd_m2:
            return None
        readout = None if picture.frame is None else picture.frame.readout
        return self.with_lens(picture.lens).vignetting(picture.shape, readout, picture.statements, picture.encoding)

    def unit_of(self, picture: Picture) -> Unit:
        """Return the unit of the map of a picture."""
        return "cd/m^2" if picture.light_is_cd_m2 else self.unit

    def source(self, picture: Picture) -> PictureSource:
        """Return the facts about a picture and its luminance."""
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

    def findings(self, picture: Picture) -> tuple[Finding, ...]:
        """Return the findings about a picture and its map."""
        if picture.light_is_cd_m2:
            unused = [info("conversion-ignored", conversion=self.description)] if self.unit == "cd/m^2" else []
            given = [what for name, what in LENS.items() if name in self.options.overrides]
            unused += [warning("lens-ignored", given=what) for what in given]
            return (*picture.findings, *unused)
        frame = picture.frame
        findings = [*self.vignetting_findings(self.picture_vignetting(picture)), *self.doubt_findings(picture.doubts)]
        if frame is not None and self.calibration is not None:
            findings += _calibration_findings(self.calibration, picture, frame)
        elif frame is not None:
            findings += _specification_findings(self.specification, picture, frame)
        if self.unit == "cd/m^2" and frame is not None and not picture.exposure_stated:
            findings.append(info("exposure-assumed", exposure_s=frame.exposure_s))
        return (*picture.findings, *findings)

    def with_pairs(
        self, findings: Sequence[Finding], picture: Picture, luminance: LuminanceMap, pairs: Sequence[tuple[Roi, Roi]]
    ) -> tuple[Finding, ...]:
        """Return the findings, with doubts about a picture stated for the pair of regions that they affect most.

        Parameters
        ----------
        findings : sequence of Finding
            With those of `findings`.
        picture, luminance
            The picture, and its luminance.
        pairs : sequence of (Roi, Roi)
            Bright and dark regions; with none, findings stay as they are.
        """
        kept, doubts, about_pairs = list(findings), picture.doubts, list[Finding]()
        for code in self.doubt_codes(doubts) if pairs else ():
            with suppress(InputError):
                other = self.luminance(read_otherwise(picture, code, self.options))
                contrasts = [
                    (f"{a.name} / {b.name}", contrast_of(luminance, a, b), contrast_of(other, a, b)) for a, b in pairs
                ]
                name, taken, otherwise = max(contrasts, key=lambda row: abs(row[2] - row[1]) / (1 + row[1]))
                matters = contrast_matters(taken, otherwise)
                about_pairs += [doubts.finding(code, taken, otherwise, name)] if matters else []
                # CDP is that of a mosaic, whatever the contrast.
                if matters or code != MOSAIC:
                    kept = [finding for finding in kept if finding.code != code]
        return (*about_pairs, *kept)

    def doubt_findings(self, doubts: Doubts) -> tuple[Finding, ...]:
        """Return warnings about doubtful assumptions, with the contrast that another assumption would give."""
        codes, findings = self.doubt_codes(doubts), []
        if MOSAIC in codes:
            findings.append(warning(MOSAIC, mosaic=doubts.mosaic))
        for code in codes:
            taken, otherwise = doubts.contrast(), doubts.contrast(code)
            if code != MOSAIC and contrast_matters(taken, otherwise):
                findings.append(doubts.finding(code, taken, otherwise))
        return tuple(findings)

    def doubt_codes(self, doubts: Doubts) -> tuple[str, ...]:
        """Return the codes of doubtful assumptions that neither calibration nor camera specification settles."""
        if self.calibration is not None:
            return ()
        black_is_known = self.specification is not None and self.specification.black_dn is not None
        return tuple(code for code in doubts.codes if not (black_is_known and code == "black-level-doubtful"))

    def vignetting_findings(self, vignetting: AssumedVignetting | None) -> tuple[Finding, ...]:
        """Return the findings about the scale and the vignetting."""
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


#: Light in proportion to the values, without a scale.
RELATIVE = Converter("relative luminance", PictureOptions())


def _specification_findings(specification: CameraSpecification | None, picture: Picture, frame: Frame) -> list[Finding]:
    """Return the findings about luminance by guessed parameters, or relative luminance."""
    findings, stated = [], picture.f_number
    if specification is not None:
        findings.append(warning("camera-guessed"))
        if stated is not None and not isclose(stated, specification.f_number, rel_tol=_F_NUMBER_REL):
            findings.append(warning("f-number-differs", stated=stated, specified=specification.f_number))
        if specification.glare_fraction > 0 and frame.saturated.any():
            findings.append(warning("glare-underestimated"))
    findings += encoding_findings(picture.encoding)
    has_curve = isinstance(picture.encoding, Companding)
    if specification is not None and not (picture.coloured or has_curve) and frame.bit_depth != specification.adc_bits:
        findings.append(info("bits-scaled", bits=frame.bit_depth, adc_bits=specification.adc_bits))
    if frame.colour_filter is not None:
        findings.append(info("clear-pixels-only" if "C" in frame.colour_filter else "green-pixels-only"))
    return findings


def encoding_findings(encoding: Encoding) -> list[Finding]:
    """Return what there is to say of light that is decoded from values without a calibration."""
    if isinstance(encoding, Companding):
        return [info("codes-expanded", curve=encoding.name, bits=encoding.bits, top=encoding.values[-1])]
    return [] if encoding == "linear" else [warning("srgb-assumed")]


def _calibration_findings(calibration: AnyCalibration, picture: Picture, frame: Frame) -> list[Finding]:
    """Return the findings about luminance by a calibration."""
    findings = [] if picture.camera_stated else [warning("camera-assumed", camera=str(calibration.state.camera))]
    for plane in calibration.planes:
        dark = plane.setting(frame.gain_db).dark
        findings += dark.unknown_temperature_findings([(frame.exposure_s, frame.temperature_c)])
    curve = encoding_findings(picture.encoding) if isinstance(picture.encoding, Companding) else []
    taken = [warning("srgb-taken-as-dn")] if picture.encoding != "linear" and not curve else []
    return [*unique(findings), *curve, *taken]


def contrast_of(luminance: LuminanceMap, bright: Roi, dark: Roi) -> float:
    """Weber contrast of the means of two regions."""
    means = (float(luminance.select(roi).mean(dtype=float)) for roi in (bright, dark))
    return float(weber_contrast(*means))


def make_converter(
    calibration: Path | AnyCalibration | None = None,
    camera: Path | None = None,
    encoding: Encoding | None = None,
    **stated: Any,
) -> Converter:
    """Make a converter by a calibration, by a camera specification in TOML, or by neither: relative values.

    Parameters
    ----------
    calibration, camera : Path, or a calibration, or None
        At most one of them.
    encoding : {'linear', 'srgb'}, name or file of a curve, Companding, or None
        How values are encoded, see `as_encoding`; None for what each file suggests, or the camera specification says.
    **stated
        Statements of the user about the pictures, None for nothing; see `PictureOptions.given`.

    Raises
    ------
    InputError
        If both are given, one cannot be read, an encoding is given in addition to a calibration, which has its own, or
        a curve of companded data in addition to a black level of the camera specification; or if something that is
        stated is not possible.
    """
    encoding = as_encoding(encoding)
    options = PictureOptions().given(encoding=encoding)
    # Only where they are used: they take longer to load than a small picture to evaluate.
    if calibration is not None:
        if camera is not None:
            raise InputError("both a calibration and a camera specification are given: use one")
        from ...calibration import load_any

        name = "in memory"
        if isinstance(calibration, Path):
            name = calibration.name
            calibration = load_any(calibration)
        if encoding not in (None, calibration.state.companding or "linear"):
            raise InputError(
                f"the encoding is {encoding_name(encoding)}: a calibration includes the encoding, leave it out"
            )
        return calibrated_converter(calibration, name, encoding).given(**stated)
    if camera is None:
        return replace(RELATIVE, options=options.given(**stated))
    from .camera_specification import CameraSpecification

    specification = CameraSpecification.load(camera)
    encoding = encoding or as_encoding(specification.encoding)
    if isinstance(encoding, Companding) and specification.black_dn is not None:
        raise InputError(
            f"{camera.name} has black_dn, but the linear values of the curve {encoding.name} are without black level: "
            "state it as black_value of the curve, or with --black-level (black_level_dn in Python) as code"
        )
    description = f"guessed camera parameters of {camera.name} ({specification.name})"
    options = replace(
        options,
        exposure_s=specification.exposure_s,
        gain_db=specification.gain_db,
        bit_depth=specification.adc_bits,
        encoding=encoding,
        focal_length_m=specification.image_distance_m,
        pixel_pitch_m=specification.pixel_pitch_m,
    )
    return Converter(description, options.given(**stated), specification)


def calibrated_converter(calibration: AnyCalibration, name: str, encoding: Encoding | None = None) -> Converter:
    """Make a converter by a calibration from the file `name`; its curve expands the codes of pictures.

    Of other pictures the `encoding` may be stated, which is then linear.
    """
    state = calibration.state
    curve = state.companding
    options = replace(
        PictureOptions().given(encoding=curve or encoding),
        exposure_s=calibration.exposures_s[0] if len(calibration.exposures_s) == 1 else None,
        gain_db=state.gain_db,
        camera=state.camera,
        bit_depth=state.bit_depth,
        pixel_format=state.pixel_format if state.pixel_format in PIXEL_FORMATS else None,
        saturation_dn=state.saturation_dn if curve is None else curve.saturation_dn,
        black_level_dn=state.black_level_dn,
    )
    description = f"calibration {name} of {state.camera}, {calibration.lens}, in {calibration.source_spectrum}"
    return Converter(description, options, calibration=calibration)
