"""Tables of a session's configuration that say which devices stand on the bench."""

from __future__ import annotations

from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ..core.errors import ConfigurationError, InputError
from ..core.frame import Frame
from ..core.spectral.table import SpectralTable, read_spectral_file

# Strict: TOML has types of its own, so "0.01" in quotes or true is a mistake and not a number.
Text = Annotated[str, Field(strict=True, pattern=r"^\S(.*\S)?$", max_length=255)]
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
NotNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
Fraction = Annotated[Number, Field(gt=0, le=1)]
Whole = Annotated[int, Field(strict=True, ge=0)]
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


class Table(BaseModel):
    """Base of the tables below: unchangeable, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", validate_by_name=True, validate_by_alias=True)


class SpectraConfiguration(Table):
    """Spectra from a file, and the file's name and hash: a session keeps them, so that it needs no other file."""

    file: Text = Field(description="the name of a CSV file as text")
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


class CameraConfiguration(Table):
    """Which camera, and its pixel pitch; what is left out is not checked when the camera is opened."""

    vendor: Text | None = Field(None, description="the vendor's name as text")
    model: Text | None = Field(None, description="the model's name as text")
    serial: Text | None = Field(None, description="the serial number as text, in quotes")
    address: Text | None = Field(None, description="the network address as text")
    pixel_pitch_m: Positive = Field(description="a distance of pixel centres above 0 m")
    # Set when the acquisition starts, and read back; what is left out is as after opening.
    black_level: NotNegative | None = Field(None, description="a value of the camera's register of at least 0")
    # Where the pixels are full below the end of the converter.
    saturation_dn: Positive | None = Field(None, description="a DN above 0, from which pixels count as saturated")
    frame_rate_hz: Positive | None = Field(None, description="a frame rate above 0 Hz")
    region: tuple[Whole, Whole, Count, Count] | None = Field(
        None, description="[x, y, width, height] in pixels after binning, whole numbers"
    )
    binning: tuple[Count, Count] | None = Field(None, description="[columns, rows], whole numbers of at least 1")
    trigger: Text | None = Field(None, description='"Software", or the name of a line as text, for example "Line1"')
    features: dict[FeatureName, bool | int | float | str] | None = Field(
        None, description="a [camera.features] table of GenICam names with true, false, numbers or text"
    )
    spectral_sensitivity: SpectraConfiguration | None = Field(
        None, description="the name of a CSV file as text: wavelength_nm and R, G, B or one column, for radiant power"
    )

    def stated(self, frame: Frame) -> Frame:
        """Return a frame with the saturation that is stated here; raises ConfigurationError if it is below black."""
        if self.saturation_dn is None or self.saturation_dn >= frame.saturation_dn:
            return frame
        if self.saturation_dn <= frame.nominal_black_dn:
            raise ConfigurationError(
                f"camera.saturation_dn is {self.saturation_dn:g} DN, but the black level of the camera is "
                f"{frame.nominal_black_dn:g} DN: give a value above it"
            )
        return replace(frame, saturation_dn=self.saturation_dn)


#: Relative standard uncertainty of the responsivity after focus and aperture are set anew, unless the user states it:
#: focus breathing over the reading of a distance scale, and the play of an iris.
REFOCUS_REL = 0.005


class LensConfiguration(Table):
    """Which lens, and how it is set."""

    model: Text = Field(description="the model's name as text")
    serial: Text = Field(description="the serial number as text, in quotes")
    focal_length_m: Positive = Field(description="a focal length above 0 m")
    f_number: Positive = Field(description="an f-number above 0")
    focus_distance_m: Positive | None = Field(None, description="a distance of focus above 0 m")
    refocus_rel: float = Field(
        REFOCUS_REL, ge=0, le=1, description="a fraction from 0 (focus and aperture are locked) to 1"
    )
    transmittance: Fraction | None = Field(None, description="a fraction above 0, up to 1")


class SourceConfiguration(Table):
    """What lights the target."""

    spectrum: Text = Field(description="the name of the spectrum as text, for example LED-B4")
    spectrum_file: SpectraConfiguration | None = Field(
        None, description="the name of a CSV file as text: wavelength_nm and one column with the measured power"
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


#: Keys whose value is the name of a file with spectra, with their table.
_SPECTRA = (("camera", "spectral_sensitivity"), ("source", "spectrum_file"))


def with_spectra(document: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Put the content of the files with spectra that a configuration names in the place of their names.

    Parameters
    ----------
    document : dict
        The configuration as tomllib returned it; it is not changed.
    folder : Path
        Where relative names begin: the folder of the configuration.

    Raises
    ------
    InputError
        If a file cannot be read or is no file of spectra; the message begins with the key.
    """
    result = dict(document)
    for table, key in _SPECTRA:
        values = result.get(table)
        if not isinstance(values, dict) or not isinstance(values.get(key), str):
            continue
        name = values[key]
        try:
            file = read_spectral_file(folder / name)
        except InputError as error:
            raise InputError(f"{table}.{key}: {error}") from error
        content = {
            "file": Path(name).name,
            "sha256": file.sha256,
            "wavelength_nm": next(iter(file.columns.values())).wavelength_nm,
            "columns": {column: spectrum.values for column, spectrum in file.columns.items()},
        }
        result[table] = {**values, key: content}
    return result
