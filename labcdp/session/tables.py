"""Tables of a session's configuration that say which devices stand on the bench."""

from __future__ import annotations

import logging
from dataclasses import fields, replace
from datetime import date, datetime, timedelta
from functools import lru_cache
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator

from ..core.companding import Companding, shipped_curve, shipped_curves
from ..core.disk import read_bytes, read_toml
from ..core.disk.files import shown
from ..core.errors import ConfigurationError, InputError, naming
from ..core.frame import FILTER_NAMES, ColourFilter, Frame
from ..core.percent import plain_contrast, plain_fraction
from ..core.reading import SERIAL_MODELS, MeterIdentity
from ..core.spectra import SpectralTable, read_spectral_file
from ..core.vignetting import VIGNETTING_REL
from .validation import validated

_log = logging.getLogger(__name__)

# Strict: TOML has types of its own, so "0.01" in quotes or true is a mistake and not a number.
Text = Annotated[str, Field(strict=True, pattern=r"^\S(.*\S)?$", max_length=255)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
#: A fraction may be a percentage with its sign: "1.2%".
Percent = BeforeValidator(plain_fraction)
Fraction = Annotated[Number, Field(gt=0, le=1), Percent]
Share = Annotated[Number, Field(ge=0, le=1), Percent]
Contrast = Annotated[Positive, BeforeValidator(lambda value: plain_contrast(value, ""))]
Whole = Annotated[int, Field(strict=True, ge=0)]
#: Not Literal[1], which takes true.
Format = Annotated[int, Field(strict=True, ge=1, le=1)]
FeatureName = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$", max_length=255)]
Count = Annotated[int, Field(strict=True, ge=1)]
Several = Annotated[int, Field(strict=True, ge=2)]


def _date_of_text(value: object) -> object:
    """Take a date in quotes too; leave anything else for the type check."""
    try:
        return date.fromisoformat(value) if isinstance(value, str) else value
    except ValueError:
        return value


IsoDate = Annotated[date, Field(strict=True), BeforeValidator(_date_of_text)]


class ConfigurationTable(BaseModel):
    """Base of the tables below: unchangeable, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_by_name=True, validate_by_alias=True)


class SpectraConfiguration(ConfigurationTable):
    """Spectra from a file, and the file's name and hash: a session keeps them, so that it needs no other file."""

    file: Text = Field(description="the name of a CSV file or .xlsx as text")
    sha256: Text = Field(description="the hash of the file as text")
    wavelength_nm: tuple[Positive, ...] = Field(description="rising wavelengths in nm")
    columns: dict[str, tuple[Number, ...]] = Field(description="relative values by the name of the column")

    @model_validator(mode="after")
    def _usable(self) -> Self:
        # InputError is a ValueError, its text the reason.
        _ = self.spectra
        return self

    @property
    def spectra(self) -> dict[str, SpectralTable]:
        """Spectra by the name of the column: R, G and B, or ``relative`` for a single one."""
        return {name: SpectralTable(self.wavelength_nm, values) for name, values in self.columns.items()}


def _read(value: Any, info: ValidationInfo) -> Any:
    """Put the content of a file with spectra in the place of its name; the folder is that of the configuration."""
    if not isinstance(value, str):
        return value
    with naming("names a file that cannot be used"):
        file = read_spectral_file((info.context or {}).get("folder", Path()) / value)
    return {
        "file": Path(value).name,
        "sha256": file.sha256,
        "wavelength_nm": next(iter(file.columns.values())).wavelength_nm,
        "columns": {column: spectrum.values for column, spectrum in file.columns.items()},
    }


Spectra = Annotated[SpectraConfiguration | None, BeforeValidator(_read)]

_Knees = Annotated[tuple[Number, ...], Field(min_length=2, max_length=65536)]


class CurveConfiguration(ConfigurationTable):
    """Curve of companded data, as its file has it: a session keeps all of it, so that it needs no other file."""

    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp", exclude=True)
    name: Text = Field(description="a name as text")
    bits: Annotated[int, Field(strict=True, ge=1, le=16)] = Field(description="the bits of a code, 1 to 16")
    codes: _Knees = Field(description="the codes of the knees, rising from 0")
    values: _Knees = Field(description="the linear values of the knees, rising")
    black_value: Number = Field(0.0, description="the linear value without light")
    black_code: Annotated[Number, Field(ge=0)] = Field(0.0, description="a code of at least 0")
    shift: Annotated[int, Field(strict=True, ge=0, le=15)] = Field(0, description="a shift of 0 to 15 bits")
    embedded_rows: tuple[Whole, Whole] = Field((0, 0), description="rows above and below the image, [0, 0] for none")
    sha256: Text | None = Field(None, description="the hash of the curve as labcdp wrote it, or nothing")

    @model_validator(mode="after")
    def _usable(self) -> Self:
        # InputError is a ValueError, its text the reason.
        if self.sha256 not in (None, self.companding.sha256):
            raise ValueError("has another sha256 than its knees: restore the file, or leave sha256 out")
        return self

    @property
    def companding(self) -> Companding:
        """The curve."""
        return _companding(**{name: getattr(self, name) for name in CURVE_KEYS})

    @classmethod
    def keeping(cls, curve: Companding) -> CurveConfiguration:
        """Return the table of a curve, with its hash."""
        return cls(**{name: getattr(curve, name) for name in CURVE_KEYS}, sha256=curve.sha256)


#: What a curve consists of.
CURVE_KEYS = tuple(field.name for field in fields(Companding))
_companding = lru_cache(maxsize=16)(Companding)


def load_curve(path: Path) -> Companding:
    """Read a curve from TOML: name, bits, codes, values, and what else differs from its default.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or is no curve.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp.files import load_curve
    >>> lines = ['name = "mine"', "bits = 12", "codes = [0, 2048, 4095]", "values = [0, 2048, 65535]"]
    >>> written = Path("curve.toml").write_text(chr(10).join(lines))
    >>> load_curve(Path("curve.toml")).name
    'mine'
    """
    return validated(CurveConfiguration, read_toml(path, "a curve of companded data"), str(path)).companding


def curve_called(name: str, folder: Path = Path()) -> Companding:
    """Return the curve of that name that ships with labcdp, or of that file in TOML, sought in `folder`.

    Raises
    ------
    InputError
        If there is none.
    """
    if name.lower().endswith(".toml"):
        return load_curve(folder / name)
    if name.upper() in shipped_curves():
        return shipped_curve(name)
    raise InputError(
        f"encoding is {shown(name)}: give linear, srgb, a curve ({', '.join(shipped_curves())}), or a file in TOML "
        "with one"
    )


def _read_curve(value: Any, info: ValidationInfo) -> Any:
    """Put a curve in the place of its name, or of the file's; the folder is that of the configuration."""
    if value == "linear":
        return None
    if not isinstance(value, str):
        return value
    with naming("names a curve that cannot be used"):
        return CurveConfiguration.keeping(curve_called(value, (info.context or {}).get("folder", Path())))


Curve = Annotated[CurveConfiguration | None, BeforeValidator(_read_curve)]


#: Standard uncertainty of one exposure time relative to the others, unless the user states it: a few periods of a
#: sensor's clock of tens of MHz, by which start and end jitter.
EXPOSURE_JITTER_S = 5e-8


class CameraConfiguration(ConfigurationTable):
    """Which camera, and its pixel pitch; what is left out is not checked when the camera is opened.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> Session.open(example_session()).configuration.camera.serial
    """

    vendor: Text | None = Field(None, description="the vendor's name as text")
    model: Text | None = Field(None, description="the model's name as text")
    serial: Text | None = Field(None, description="the serial number as text, in quotes")
    address: Text | None = Field(None, description="the network address as text")
    pixel_pitch_m: Positive = Field(description="a distance of pixel centres above 0 m")
    # Set when the acquisition starts, and read back; what is left out is as after opening.
    black_level: NotNegative | None = Field(None, description="a value of the camera's register of at least 0")
    # How a sensor of many bits sends them in codes of few: frames keep the codes, and their readers expand them.
    encoding: Curve = Field(
        None, description="the name of a curve of companded data as text, for example AR0231, or of a TOML file with it"
    )
    # Which pixel formats do not say: RCCB and the like; of Bayer patterns they do.
    colour_filter: ColourFilter | None = Field(
        None, description='the first 2 x 2 pixels as text, for example "RCCB" or "RCCC"'
    )
    # Where the pixels are full below the end of the converter.
    saturation_dn: Positive | None = Field(None, description="a DN above 0, from which pixels count as saturated")
    exposure_jitter_s: NotNegative = Field(EXPOSURE_JITTER_S, description="a standard uncertainty of at least 0 s")
    # Standard deviation from frame to frame; what the dark frames show if left out.
    black_level_drift_dn: NotNegative | None = Field(None, description="a standard deviation of at least 0 DN")
    frame_rate_hz: Positive | None = Field(None, description="a frame rate above 0 Hz")
    region: tuple[Whole, Whole, Count, Count] | None = Field(
        None, description="[x, y, width, height] in pixels after binning, whole numbers"
    )
    binning: tuple[Count, Count] | None = Field(None, description="[columns, rows], whole numbers of at least 1")
    trigger: Text | None = Field(None, description='"Software", or the name of a line as text, for example "Line1"')
    packet_resend: Literal["always", "never"] | None = Field(None, description='"always" or "never"')
    features: dict[FeatureName, bool | int | float | str] | None = Field(
        None, description="a [camera.features] table of GenICam names with true, false, numbers or text"
    )
    spectral_sensitivity: Spectra = Field(
        None,
        description="the name of a CSV file or .xlsx as text: wavelength_nm and R, G, B or one column, for "
        "radiant power",
    )

    def stated(self, frame: Frame) -> Frame:
        """Return a frame with the curve, the colour filter and the saturation that are stated here.

        Raises
        ------
        ConfigurationError
            If its DN have other bits than codes of the curve, or the saturation is below black.
        """
        frame = self._with_curve(frame)
        if self.colour_filter is not None and frame.colour_filter is None and frame.plane is None:
            frame = replace(frame, colour_filter=FILTER_NAMES[self.colour_filter])
        # That of codes is stated in codes, as they are in the file.
        if self.saturation_dn is None or self.saturation_dn >= frame.saturation_dn:
            return frame
        if self.saturation_dn <= frame.nominal_black_dn:
            raise ConfigurationError(
                f"camera.saturation_dn is {self.saturation_dn:g} DN, but the black level of the camera is "
                f"{frame.nominal_black_dn:g} DN: give a value above it"
            )
        return replace(frame, saturation_dn=self.saturation_dn)

    def with_encoding(self, name: str) -> Self:
        """Return it with a curve by its name or file; raises InputError if there is none."""
        return self.model_copy(update={"encoding": CurveConfiguration.keeping(curve_called(name))})

    @property
    def curve(self) -> Companding | None:
        """The curve by which DN are codes; None for none."""
        return None if self.encoding is None else self.encoding.companding

    def _with_curve(self, frame: Frame) -> Frame:
        """Return a frame whose DN are codes of the curve that is stated, without embedded rows."""
        curve = self.curve
        if frame.companding not in (None, curve):
            raise ConfigurationError(
                f"camera.encoding is {curve or 'left out'}, but the frame has codes of the curve {frame.companding}: "
                "give the file of that curve"
            )
        if curve is None or frame.companding is not None:
            return frame
        with naming("camera.encoding", ConfigurationError):
            return frame.with_curve(curve)


#: Relative standard uncertainty of the responsivity after focus and aperture are set anew, unless the user states it:
#: focus breathing over the reading of a distance scale, and the play of an iris.
REFOCUS_REL = 0.005
#: Relative standard uncertainty of the responsivity of camera and lens from day to day, unless the user states it:
#: 0.1 % per kelvin, as good photometers have (DIN 5032-7, class L), in rooms of 23 ± 5 °C, which is 2.9 K. A judgement.
STABILITY_REL = 0.003


class LensConfiguration(ConfigurationTable):
    """Which lens, and how it is set.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> Session.open(example_session()).configuration.lens.f_number
    2.6
    """

    model: Text = Field(description="the model's name as text")
    serial: Text | None = Field(None, description="the serial number as text, in quotes, left out if it is not known")
    focal_length_m: Positive = Field(description="a focal length above 0 m")
    f_number: Positive = Field(description="an f-number above 0")
    focus_distance_m: Positive | None = Field(None, description="a distance of focus above 0 m")
    refocus_rel: Share = Field(REFOCUS_REL, description="a fraction from 0 (focus and aperture are locked) to 1")
    stability_rel: Share = Field(STABILITY_REL, description="a fraction from 0 (responsivity stays as it is) to 1")
    vignetting_rel: Share = Field(VIGNETTING_REL, description="a fraction from 0 (the vignetting is exactly cos⁴) to 1")
    transmittance: Fraction | None = Field(None, description="a fraction above 0, up to 1")


class SourceConfiguration(ConfigurationTable):
    """Light source of the target.

    Examples
    --------
    >>> from labcdp.session import SourceConfiguration
    >>> SourceConfiguration(spectrum="LED-B4").light
    'LED-B4'
    """

    spectrum: Text = Field(description="the name of the spectrum as text, for example LED-B4")
    spectrum_file: Spectra = Field(
        None, description="the name of a CSV file or .xlsx as text: wavelength_nm and a column with the measured power"
    )

    @property
    def measured(self) -> SpectralTable | None:
        """The spectrum as measured, if it was."""
        return None if self.spectrum_file is None else next(iter(self.spectrum_file.spectra.values()))

    @property
    def light(self) -> str | SpectralTable:
        """The spectrum as measured, else its name."""
        return self.spectrum if self.measured is None else self.measured

    @model_validator(mode="after")
    def _one_column(self) -> Self:
        if self.spectrum_file is not None and len(self.spectrum_file.columns) > 1:
            raise ValueError(
                f"has spectrum_file with the columns {', '.join(self.spectrum_file.columns)}: give a file with one"
            )
        return self


#: Mean year of the Gregorian calendar.
_DAYS_OF_YEAR = 365.2425


#: Largest file of a certificate: digital ones may have pictures and a PDF inside.
_MOST_BYTES = 64 * 2**20


class MeterCertificate(ConfigurationTable):
    """Calibration certificate of a luminance meter: the link of its readings to the SI, with terms of ISO/IEC 17025.

    Examples
    --------
    >>> from labcdp.session import MeterCertificate
    >>> MeterCertificate(
    ...     number="1234", laboratory="PTB", date="2026-03-31", expanded_uncertainty_rel="1.2%"
    ... ).coverage_factor
    2.0
    """

    number: Text = Field(description="the number of the certificate as text")
    laboratory: Text = Field(description="the name of the laboratory as text")
    date: IsoDate = Field(description="an ISO date such as 2026-03-31")
    due_date: IsoDate | None = Field(None, description="an ISO date such as 2027-03-31")
    # What a reading is multiplied with; 1 where the meter was adjusted, so that its readings need none.
    correction: Positive = Field(1.0, description="a factor above 0, left out if the meter applies it itself")
    expanded_uncertainty_rel: Fraction = Field(description="a fraction above 0, up to 1, 0.012 for U = 1.2 %")
    coverage_factor: Positive = Field(2.0, description="a coverage factor k above 0")
    degrees_of_freedom: Positive | None = Field(None, description="a number above 0, left out if very many")
    illuminant: Text = Field("A", description="the light it was calibrated in as text, for example A")
    conditions: str = Field("", strict=True, description="text")
    # Of the meter it was issued for; what is stated is compared with the meter and its readings.
    model: Text | None = Field(None, description="the model of the certified meter as text")
    serial: Text | None = Field(None, description="the serial number of the certified meter as text, in quotes")
    range_cd_m2: tuple[Positive, Positive] | None = Field(
        None, description="[lowest, highest] luminance above 0 cd/m2 that it was calibrated at"
    )
    # As found, before any adjustment, its values hold for the time before it too.
    as_found: bool = Field(
        False, strict=True, description="true if its values are those before any adjustment of the meter, or false"
    )
    drift_rel_per_year: Annotated[Positive, Percent] | None = Field(
        None, description="the largest change of the meter in a year as a fraction above 0, 0.005 for ±0.5 %"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.due_date is not None and self.due_date <= self.date:
            raise ValueError(f"has due_date {self.due_date}: give a day after its date, {self.date}")
        if self.range_cd_m2 is not None and self.range_cd_m2[0] >= self.range_cd_m2[1]:
            raise ValueError("has range_cd_m2 in the wrong order: give [lowest, highest]")
        return self

    @classmethod
    def load(cls, path: str | PathLike[str]) -> MeterCertificate:
        """Read a certificate from a TOML file with the keys of ``[meter.certificate]``, or a digital one (DCC, XML).

        Raises
        ------
        ConfigurationError
            If the file cannot be read, or a key or value is wrong.
        """
        from ..core.dcc import is_dcc, read_dcc
        from .dcc import meter_certificate_values

        data = read_bytes(path, "a meter's certificate", _MOST_BYTES, ConfigurationError)
        if not is_dcc(data):
            return validated(cls, read_toml(path, "a meter's certificate"), str(path))
        with naming(str(path), ConfigurationError):
            certificate = read_dcc(data, "certificate")
            values = meter_certificate_values(certificate)
        if certificate.is_signed:
            _log.warning(
                "%s: its signature was not checked: check it with a program of the laboratory's or of PTB", path
            )
        return validated(cls, values, str(path))

    def to_dcc(self, meter: MeterIdentity) -> bytes:
        """Return it as a digital calibration certificate of PTB (XML), with the luminances at the ends of its range.

        Raises
        ------
        InputError
            If it states no range.

        Examples
        --------
        >>> from labcdp.core.reading import MeterIdentity
        >>> from labcdp.session import MeterCertificate
        >>> stated = {"number": "1234", "laboratory": "PTB", "date": "2026-03-31", "expanded_uncertainty_rel": 0.012}
        >>> certificate = MeterCertificate(**stated, range_cd_m2=(1.0, 1000.0))
        >>> certificate.to_dcc(MeterIdentity("LS-110", "4711"))[:36]
        b"<?xml version='1.0' encoding='utf-8'"
        """
        from .dcc import meter_dcc

        return meter_dcc(self, meter)

    @property
    def standard_uncertainty_rel(self) -> float:
        """U / k."""
        return self.expanded_uncertainty_rel / self.coverage_factor

    @property
    def identity(self) -> tuple[object, ...]:
        """Values that distinguish it from other certificates, and its correction of the readings."""
        return self.number, self.laboratory, self.date, self.correction

    def mismatched_meter(self, meter: MeterIdentity) -> str:
        """Say which other meter it was issued for; empty if it may be this one.

        A model may be stated with the name of its maker.
        """
        models = [name.casefold() for name in (self.model or meter.model, meter.model)]
        same_model = models[0] in models[1] or models[1] in models[0]
        if same_model and (self.serial or meter.serial).casefold() == meter.serial.casefold():
            return ""
        other = " ".join(part for part in (self.model or meter.model, self.serial) if part)
        return f"the certificate {self.number} is of the meter {other}, not of {meter.model} {meter.serial}"

    def holds_at(self, time: datetime) -> bool:
        """Whether it holds for readings at a time: later ones, and earlier ones if its values are as found.

        Its date has no time zone: it may begin up to a day before that of the readings, which is mostly UTC.
        """
        return self.as_found or self.date <= (time + timedelta(days=1)).date()

    def drift_rel(self, time: datetime) -> float:
        """Limits of the relative change of the meter from its date to a time; 0 if the drift is not stated."""
        return (self.drift_rel_per_year or 0.0) * abs((time.date() - self.date).days) / _DAYS_OF_YEAR


class MeterConfiguration(ConfigurationTable):
    """Which luminance meter; it cannot report its serial number and calibration date.

    Readings come from a meter on a port, from a program on a port, are typed by the user, or are in a file, CSV or
    .xlsx. For the last three the accuracy of the instrument is given here, since no driver knows it.

    Examples
    --------
    >>> from labcdp.session import MeterConfiguration
    >>> MeterConfiguration(model="LS-110", serial="73323007", calibration_date="2026-03-31").identity.calibration_date
    '2026-03-31'
    """

    model: Text = Field(description="the model's name as text")
    entry: Literal["serial", "program", "by hand", "csv"] = Field(
        "serial", description='"serial", "program", "by hand" or "csv"'
    )
    port: Text | None = Field(None, description='the serial port as text, or "socket://HOST:PORT"')
    rtscts: bool = Field(False, strict=True, description="true for a cable that carries RTS and CTS, or false")
    response: Literal["fast", "slow"] = Field("fast", description='"fast", or "slow" for light that flickers')
    correction: Literal["preset", "colour", "luminance", "both"] = Field(
        "preset", description='"preset" for the maker\'s calibration, "colour", "luminance" or "both" for the user\'s'
    )
    file: Text | None = Field(None, description="the path of a CSV file or .xlsx as text")
    serial: Text = Field(description="the serial number as text, in quotes")
    calibration_date: IsoDate | None = Field(None, description="an ISO date such as 2025-03-31")
    scale_half_width_rel: Fraction | None = Field(None, description="a fraction above 0, up to 1, 0.02 for ±2 %")
    repeatability_rel: Annotated[NotNegative, Percent] | None = Field(None, description="a fraction of at least 0")
    digits: Count | None = Field(None, description="a whole number of at least 1, 1 for ±1 digit")
    f1_prime: Fraction | None = Field(None, description="the meter's f1' as a fraction above 0, 0.08 for 8 %")
    certificate: MeterCertificate | None = Field(None, description="a [meter.certificate] table")

    @property
    def is_connected(self) -> bool:
        """Whether readings come from a port."""
        return self.entry in ("serial", "program")

    @property
    def identity(self) -> MeterIdentity:
        """Model, serial number and calibration date."""
        date = self.calibration_date
        return MeterIdentity(self.model, self.serial, None if date is None else date.isoformat())

    @model_validator(mode="after")
    def _one_date(self) -> Self:
        certificate = self.certificate
        if certificate and self.calibration_date and certificate.date < self.calibration_date:
            raise ValueError(
                f"has calibration_date {self.calibration_date}, later than its certificate of {certificate.date}: give "
                "the certificate of the present calibration"
            )
        return self

    @model_validator(mode="after")
    def _own_certificate(self) -> Self:
        if self.certificate and (other := self.certificate.mismatched_meter(self.identity)):
            raise ValueError(f"has the certificate of another meter: {other}: give that of this meter")
        return self

    @model_validator(mode="after")
    def _known_or_described(self) -> Self:
        accuracy = ("scale_half_width_rel", "repeatability_rel", "digits")
        if self.entry == "serial":
            if self.model not in SERIAL_MODELS:
                raise ValueError(
                    f'has model {self.model!r}: give one of {", ".join(SERIAL_MODELS)}, or entry = "by hand" or "csv" '
                    "for another instrument"
                )
            given = [name for name in ("file", *accuracy) if getattr(self, name) is not None]
            if given:
                raise ValueError(
                    f'has {given[0]}, which belongs to entry = "program", "by hand" or "csv": leave it out'
                )
            return self
        fields = type(self).model_fields
        line_fields = ("correction",) if self.is_connected else ("port", "rtscts", "response", "correction")
        given = [name for name in line_fields if getattr(self, name) != fields[name].default]
        if given:
            raise ValueError(f'has {given[0]}, which belongs to entry = "serial": leave it out')
        if (self.file is None) == (self.entry == "csv"):
            wrong = "lacks file: give the path of a CSV or .xlsx" if self.entry == "csv" else "has file: leave it out"
            raise ValueError(f'{wrong} with entry = "{self.entry}"')
        missing = [name for name in accuracy if getattr(self, name) is None]
        if missing:
            lacking = ", ".join(missing)
            raise ValueError(f'lacks {lacking}: with entry = "{self.entry}" give the accuracy of the instrument')
        return self
