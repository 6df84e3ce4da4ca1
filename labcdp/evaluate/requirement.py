"""A requirement of a camera: contrast, luminances, temperature, veil and CDP, as a file."""

from __future__ import annotations

from importlib.resources import files
from os import PathLike
from typing import Self

from pydantic import Field, model_validator

from ..core.disk import read_toml
from ..session.tables import ConfigurationTable, Contrast, Format, Fraction, NotNegative, Number, Positive, Text
from ..session.validation import validated


class Requirement(ConfigurationTable):
    """A contrast that must be detected, over a range of luminances, at a temperature and behind a veil.

    Examples
    --------
    >>> import labcdp
    >>> labcdp.Requirement.model_fields["contrast"].description
    'a Weber contrast above 0, as "50%" or as a fraction'
    """

    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp")
    name: Text = Field("requirement", description="a name as text")
    contrast: Contrast = Field(description='a Weber contrast above 0, as "50%" or as a fraction')
    epsilon: Fraction = Field(0.5, description='"50%", or a fraction above 0, up to 1')
    luminance_cd_m2: tuple[Positive, Positive] = Field(
        description="[lowest, highest] luminance of the darker region above 0 cd/m2"
    )
    temperature_c: Number | None = Field(None, description="a temperature of the sensor in °C")
    glare_cd_m2: NotNegative = Field(0.0, description="a veil of at least 0 cd/m2")
    cdp_limit: Fraction = Field(0.9, description='"90%", or a probability above 0, up to 1')
    # By table and key of a chain, such as "sensor.read_noise_e"; others have a typical one.
    uncertainty_rel: dict[str, Fraction] = Field(
        {}, description='standard uncertainties by parameter, such as "sensor.read_noise_e" = "10%"'
    )

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.luminance_cd_m2[0] >= self.luminance_cd_m2[1]:
            raise ValueError("luminance_cd_m2 is in the wrong order: give [lowest, highest]")
        return self

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Requirement:
        """Read a requirement from a TOML file; raises ConfigurationError if a key or value is wrong."""
        return validated(cls, read_toml(path, "a requirement"), str(path))


def requirement_template() -> str:
    """Return the text of a requirement to start from."""
    return files("labcdp").joinpath("data/requirement.toml").read_text(encoding="utf-8")
