"""Tables of a session's configuration about the luminance meter and its certificate."""

from __future__ import annotations

from os import PathLike
from typing import Literal, Self

from pydantic import Field, model_validator

from ..core.disk import read_toml
from ..core.reading import MeterIdentity
from .bench_tables import Count, Fraction, IsoDate, NotNegative, Positive, Table, Text
from .validation import validated

#: Models whose protocol and data sheet the drivers know.
SERIAL_MODELS = ("LS-110", "LS-100")


class MeterCertificate(Table):
    """Calibration certificate of a luminance meter: the link of its readings to the SI, with terms of ISO/IEC 17025."""

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

    @model_validator(mode="after")
    def _due_later(self) -> Self:
        if self.due_date is not None and self.due_date <= self.date:
            raise ValueError(f"has due_date {self.due_date}: give a day after its date, {self.date}")
        return self

    @classmethod
    def load(cls, path: str | PathLike[str]) -> MeterCertificate:
        """Read a certificate from a TOML file with the keys of ``[meter.certificate]``.

        Raises
        ------
        ConfigurationError
            If the file cannot be read, or a key or value is wrong.
        """
        return validated(cls, read_toml(path, "a meter's certificate"), str(path))

    @property
    def standard_uncertainty_rel(self) -> float:
        """U / k."""
        return self.expanded_uncertainty_rel / self.coverage_factor


class MeterConfiguration(Table):
    """Which luminance meter; it cannot report its serial number and calibration date.

    Readings come over a serial line, are typed by the user, or are in a CSV file. For the last two the accuracy of the
    instrument is given here, since no driver knows it.
    """

    model: Text = Field(description="the model's name as text")
    entry: Literal["serial", "by hand", "csv"] = Field("serial", description='"serial", "by hand" or "csv"')
    port: Text | None = Field(None, description="the serial port as text")
    rtscts: bool = Field(False, strict=True, description="true for a cable that carries RTS and CTS, or false")
    response: Literal["fast", "slow"] = Field("fast", description='"fast", or "slow" for light that flickers')
    correction: Literal["preset", "colour", "luminance", "both"] = Field(
        "preset", description='"preset" for the maker\'s calibration, "colour", "luminance" or "both" for the user\'s'
    )
    file: Text | None = Field(None, description="the path of a CSV file as text")
    serial: Text = Field(description="the serial number as text, in quotes")
    calibration_date: IsoDate | None = Field(None, description="an ISO date such as 2025-03-31")
    scale_half_width_rel: Fraction | None = Field(None, description="a fraction above 0, up to 1, 0.02 for +-2 %")
    repeatability_rel: NotNegative | None = Field(None, description="a fraction of at least 0")
    digits: Count | None = Field(None, description="a whole number of at least 1, 1 for +-1 digit")
    f1_prime: Fraction | None = Field(None, description="the meter's f1' as a fraction above 0, 0.08 for 8 %")
    certificate: MeterCertificate | None = Field(None, description="a [meter.certificate] table")

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
    def _known_or_described(self) -> Self:
        accuracy = ("scale_half_width_rel", "repeatability_rel", "digits")
        if self.entry == "serial":
            if self.model not in SERIAL_MODELS:
                raise ValueError(
                    f'has model {self.model!r}: give "LS-110" or "LS-100", or entry = "by hand" or "csv" for '
                    "another instrument"
                )
            given = [name for name in ("file", *accuracy) if getattr(self, name) is not None]
            if given:
                raise ValueError(f'has {given[0]}, which belongs to entry = "by hand" or "csv": leave it out')
            return self
        fields = type(self).model_fields
        of_the_line = ("port", "rtscts", "response", "correction")
        given = [name for name in of_the_line if getattr(self, name) != fields[name].default]
        if given:
            raise ValueError(f'has {given[0]}, which belongs to entry = "serial": leave it out')
        if (self.file is None) == (self.entry == "csv"):
            wrong = "lacks file: give the path of a CSV file" if self.entry == "csv" else "has file: leave it out"
            raise ValueError(f'{wrong} with entry = "{self.entry}"')
        missing = [name for name in accuracy if getattr(self, name) is None]
        if missing:
            raise ValueError(f'lacks {missing[0]}: with entry = "{self.entry}" give the accuracy of the instrument')
        return self
