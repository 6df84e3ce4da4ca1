"""Camera specification: parameters of a camera as one knows or guesses them, in TOML."""

from __future__ import annotations

from os import PathLike
from typing import Annotated, Any, Self

from pydantic import Field, field_validator, model_validator

from ...chain.optics import Optics, Windscreen
from ...core.disk import read_toml
from ...core.errors import InputError
from ...core.frame import MOST_BITS
from ...core.photometry import QuantumEfficiency, as_quantum_efficiency, electron_radiance_per_cd_m2
from ...files.transfer import as_encoding
from ...session.tables import ConfigurationTable, Format, Fraction, NotNegative, Number, Positive, Text
from ...session.validation import validated


class CameraSpecification(ConfigurationTable):
    """Parameters that convert DN to luminance without a calibration, by section 3 of the 2018 thesis.

    Keys of the TOML file are the fields; with units in their names.
    """

    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp")
    name: Text = Field(description="a name as text")
    adc_bits: Annotated[int, Field(strict=True, ge=1, le=MOST_BITS)] = Field(
        description="the bits of the converter, or of merged exposures, 1 to 24"
    )
    exposure_s: Positive | None = Field(None, description="an exposure time above 0 s")
    gain_db: Number = Field(0.0, description="a gain in dB")
    quantum_efficiency: QuantumEfficiency = Field(
        description="a fraction above 0, up to 1, or pairs [wavelength in nm, fraction]"
    )
    pixel_pitch_m: Positive = Field(le=1e-3, description="a distance of pixel centres above 0 m, up to 1e-3 m (1 mm)")
    f_number: Positive = Field(ge=0.5, le=128, description="an f-number from 0.5 to 128")
    k_dn_per_e: Positive = Field(description="an overall system gain above 0 DN/e⁻ at 0 dB")
    lens_transmittance: Fraction = Field(description="a fraction above 0, up to 1")
    windscreen_transmittance: Fraction = Field(1.0, description="a fraction above 0, up to 1")
    glare_fraction: NotNegative = Field(0.0, description="veiling over mean scene luminance, at least 0 (1.0 is 100 %)")
    spectrum: Text = Field(description="the light of the scene, for example D65")
    focal_length_m: Positive | None = Field(
        None, ge=1e-4, le=1, description="a focal length from 1e-4 to 1 m; left out, the vignetting is unknown"
    )
    magnification: NotNegative = Field(0.0, description="image over object size, at least 0")
    black_dn: NotNegative | None = Field(None, description="a black level of at least 0 DN")
    saturation_dn: Positive | None = Field(None, description="a saturation above 0 DN")
    read_noise_e: NotNegative = Field(0.0, description="a read noise of at least 0 e-")
    dark_current_e_s: NotNegative = Field(
        0.0, description="a dark current of at least 0 e⁻/s at reference_temperature_c"
    )
    reference_temperature_c: Number = Field(25.0, ge=-100, le=200, description="a temperature from -100 to 200 °C")
    doubling_temperature_c: Positive = Field(8.0, ge=1, le=100, description="a difference of 1 to 100 K")
    temperature_c: Number = Field(25.0, ge=-100, le=200, description="a sensor temperature from -100 to 200 °C")
    encoding: Text | None = Field(
        None, description='"linear", "srgb", the name of a curve such as "AR0231", or of a file in TOML with one'
    )

    @field_validator("encoding")
    @classmethod
    def _known_encoding(cls, value: str | None) -> str | None:
        try:
            as_encoding(value)
        except InputError as error:
            raise ValueError(f"is {value!r}: {error}") from error
        return value

    @field_validator("quantum_efficiency", mode="plain")
    @classmethod
    def _usable_efficiency(cls, value: Any) -> QuantumEfficiency:
        try:
            return as_quantum_efficiency(value)
        except InputError as error:
            raise ValueError(error.problem) from error

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        top = 2**self.adc_bits - 1
        for key in ("black_dn", "saturation_dn"):
            value = getattr(self, key)
            if value is not None and value > top:
                raise ValueError(f"{key} is {value:g} DN, {self.adc_bits} bits end at {top}: give a value up to that")
        try:
            seen = electron_radiance_per_cd_m2(self.spectrum, self.quantum_efficiency)
        except InputError as error:
            raise ValueError(str(error)) from error
        if seen == 0:
            raise ValueError(f"quantum_efficiency is 0 wherever {self.spectrum!r} has light: give values there")
        return self

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Self:
        """Read a specification; raises ConfigurationError with file, key, value and what to give."""
        return validated(cls, read_toml(path, "a camera specification"), str(path))

    @property
    def windscreen(self) -> Windscreen:
        """The windscreen."""
        return Windscreen(self.windscreen_transmittance, self.glare_fraction)

    def optics(self, f_number: float | None = None) -> Optics:
        """Return the lens, at another f-number if one is given."""
        return Optics(f_number or self.f_number, self.lens_transmittance, self.focal_length_m, self.magnification)

    @property
    def image_distance_m(self) -> float | None:
        """Distance f (1 + m) of the image behind a thin lens, which decides the vignetting; None if f is not known."""
        return None if self.focal_length_m is None else self.focal_length_m * (1 + self.magnification)

    def system_gain_dn_per_e(self, gain_db: float) -> float:
        """K at a gain: K(0 dB) 10^(gain / 20)."""
        return self.k_dn_per_e * 10 ** (gain_db / 20)

    def dark_electrons(self, exposure_s: float, temperature_c: float | None) -> float:
        """Mean dark electrons: mu_ref 2^((T - T_ref) / T_d) t, EMVA 1288 Release 3.1, section 3.2."""
        temperature_c = self.temperature_c if temperature_c is None else temperature_c
        doublings = (temperature_c - self.reference_temperature_c) / self.doubling_temperature_c
        return self.dark_current_e_s * 2**doublings * exposure_s

    def electrons_per_cd_m2_s(self, f_number: float | None = None) -> float:
        """Photo-electrons a pixel on the axis collects in a second at 1 cd/m^2 behind the windscreen.

        pi t / (4 N^2 (1 + m)^2) lux (`labcdp.chain.optics`) times the electrons per lux, second and square metre of the
        spectrum, times the pixel's area.
        """
        per_lx_s = electron_radiance_per_cd_m2(self.spectrum, self.quantum_efficiency) * self.pixel_pitch_m**2
        return self.optics(f_number).axial_illuminance_per_cd_m2 * per_lx_s
