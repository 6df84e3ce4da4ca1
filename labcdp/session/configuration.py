"""Configuration of a session: bench, target and plan, read from TOML and written to it."""

from __future__ import annotations

from collections import Counter
from importlib.resources import files
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from ..core.disk import parse_toml, read_toml
from ..core.disk.text import toml_text
from ..core.dn import PIXEL_FORMATS
from ..core.errors import ConfigurationError, naming
from ..core.roi import Roi
from ..core.vignetting import Lens
from .tables import (
    CameraConfiguration,
    ConfigurationTable,
    Contrast,
    Count,
    Format,
    Fraction,
    LensConfiguration,
    MeterConfiguration,
    NotNegative,
    Number,
    Positive,
    Several,
    SourceConfiguration,
    Text,
    Whole,
)
from .validation import validated

#: Two exposures are the same setting within this relative difference: cameras round to their clock.
SAME_EXPOSURE_REL = 0.01


class PatchConfiguration(ConfigurationTable):
    """One patch of the target, given by a rectangle or by the corners of a polygon, in pixels.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> patch = Session.open(example_session()).configuration.target.patches[0]
    >>> patch.name, patch.region().bounds
    ('P01', (60.0, 20.0, 120.0, 80.0))
    """

    name: Text = Field(description="a name as text")
    roi: tuple[NotNegative, NotNegative, Positive, Positive] | None = Field(
        None,
        description="[x, y, width, height] in pixels: x and y of at least 0, width and height above 0",
    )
    corners: tuple[tuple[NotNegative, NotNegative], ...] | None = Field(
        None, min_length=3, description="at least three [x, y] corners in pixels, x and y of at least 0"
    )
    nominal_luminance_cd_m2: Positive | None = Field(None, description="a luminance above 0 cd/m2")
    # Evaluated as pass or fail, with a guard band of U.
    limits_cd_m2: tuple[NotNegative, Positive] | None = Field(
        None, description="[lowest, highest] permitted luminance in cd/m2"
    )

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        if (self.roi is None) == (self.corners is None):
            both = "both roi and corners" if self.roi else "neither roi nor corners"
            raise ValueError(f"({self.name}) has {both}: give one of them")
        if self.limits_cd_m2 is not None and self.limits_cd_m2[0] >= self.limits_cd_m2[1]:
            raise ValueError(f"({self.name}) has limits_cd_m2 in the wrong order: give [lowest, highest]")
        return self

    def region(self) -> Roi:
        """Return the patch as a region of interest."""
        if self.roi is not None:
            return Roi.rectangle(self.name, *self.roi)
        assert self.corners is not None
        return Roi(self.name, self.corners)


class TargetConfiguration(ConfigurationTable):
    """The target and its patches.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> len(Session.open(example_session()).configuration.target.patches)
    16
    """

    name: Text = Field(description="a name as text")
    presentation: Literal["together", "one by one"] = Field(
        "together", description='"together" for patches in one image, "one by one" for one patch after another'
    )
    patches: tuple[PatchConfiguration, ...] = Field(
        validation_alias="patch",
        serialization_alias="patch",
        min_length=1,
        description="at least one [[target.patch]] table",
    )

    @field_validator("patches")
    @classmethod
    def _distinct(cls, patches: tuple[PatchConfiguration, ...]) -> tuple[PatchConfiguration, ...]:
        name, times = Counter(patch.name for patch in patches).most_common(1)[0]
        if times > 1:
            raise ValueError(f"has the name {name!r} {times} times: give each patch its own name")
        return patches


class ContrastConfiguration(ConfigurationTable):
    """A pair of patches, and their target contrast.

    Examples
    --------
    >>> from labcdp.session import ContrastConfiguration
    >>> ContrastConfiguration(bright="a", dark="b", contrast="50%").contrast
    0.5
    """

    bright: Text = Field(description="the name of a patch")
    dark: Text = Field(description="the name of a patch")
    contrast: Contrast = Field(description='a Weber contrast above 0, as "100%" or as a fraction (1.0 is 100 %)')
    epsilon: Fraction = Field(0.5, description='"50%", or a fraction above 0, up to 1')
    # CDP from which the contrast counts as detected.
    cdp_limit: Fraction = Field(0.9, description='"90%", or a probability above 0, up to 1')


class PlanConfiguration(ConfigurationTable):
    """Frames and readings to record, and the drift above which a repetition is offered.

    Examples
    --------
    >>> from labcdp.session import PlanConfiguration
    >>> PlanConfiguration(exposures_s=(0.002, 0.02)).readings_per_patch
    3
    """

    # Left out: searched before the first frame, so that each patch lies between black and saturation at one.
    exposures_s: tuple[Positive, ...] | None = Field(None, min_length=1, description="exposures above 0 s")
    gain_db: Number = Field(0.0, description="a finite number of dB")
    pixel_format: Text = Field("Mono12", description="a GenICam pixel format as text, for example Mono12")
    # Two at least: noise and its uncertainty come from the difference of frames.
    frames_per_exposure: Several = Field(2, description="a whole number of at least 2")
    dark_frames_per_exposure: Several = Field(2, description="a whole number of at least 2")
    readings_per_patch: Count = Field(3, description="a whole number of at least 1")
    # From the start of one frame to that of the next; 0 for as fast as the camera is.
    interval_s: NotNegative = Field(0.0, description="a time of at least 0 s")
    # Before anything is recorded, at each start: at most so long, and shorter if the temperature is steady to so much.
    warm_up_s: NotNegative = Field(0.0, description="a time of at least 0 s")
    stable_within_c: Positive | None = Field(None, description="a difference of temperature above 0 °C")
    # After each start of the camera's stream.
    discard_frames: Whole = Field(0, description="a whole number of at least 0")
    drift_check: bool = Field(
        False, strict=True, description="true to read the first patch also before the frames, or false"
    )
    largest_flicker_rel: Fraction = Field(0.01, description="a fraction above 0, up to 1")
    largest_drift_rel: Fraction = Field(0.01, description="a fraction above 0, up to 1")

    @field_validator("exposures_s")
    @classmethod
    def _distinct(cls, exposures_s: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if exposures_s is None:
            return None
        exposure_s, times = Counter(exposures_s).most_common(1)[0]
        if times > 1:
            raise ValueError(f"has {exposure_s:g} s {times} times: give each exposure once")
        for shorter, longer in pairwise(sorted(exposures_s)):
            if longer < shorter * (1 + SAME_EXPOSURE_REL):
                raise ValueError(
                    f"has {shorter:g} s and {longer:g} s, which a camera may round to one: give exposures at least "
                    f"{SAME_EXPOSURE_REL:.0%} apart"
                )
        return exposures_s


class ConditionsConfiguration(ConfigurationTable):
    """Geometry and surroundings, as a certificate states them.

    The distances and the measuring field say which part of a patch the meter sees.

    Examples
    --------
    >>> from labcdp.session import ConditionsConfiguration
    >>> ConditionsConfiguration(camera_distance_m=2.0, temperature_c=21.5).camera_distance_m
    2.0
    """

    camera_distance_m: Positive | None = Field(None, description="a distance of camera and target above 0 m")
    meter_distance_m: Positive | None = Field(None, description="a distance of meter and target above 0 m")
    measuring_field_deg: Positive | None = Field(None, description="the meter's measuring angle above 0 degrees")
    angle_deg: NotNegative | None = Field(None, description="the angle to the target's normal, at least 0 degrees")
    temperature_c: Number | None = Field(None, description="the temperature of the room in °C")
    relative_humidity: Fraction | None = Field(None, description="a fraction above 0, up to 1, 0.45 for 45 %")
    place: Text | None = Field(None, description="where it is measured as text, for example Building 3, room 12")
    camera_condition: Text | None = Field(None, description="the condition of the camera as text")


class PartyConfiguration(ConfigurationTable):
    """A laboratory or its customer, as a certificate names them (ISO/IEC 17025:2017, 7.8.2)."""

    name: Text = Field(description="a name as text")
    address: Text = Field(description="an address as text")
    # With that of the laboratory, calibrations also have a digital certificate.
    country: str | None = Field(
        None, strict=True, pattern="^[A-Z]{2}$", description='the country as two letters (ISO 3166), for example "DE"'
    )


class GuessConfiguration(ConfigurationTable):
    """Camera parameters as one would guess them without a calibration, to show what the guess costs."""

    quantum_efficiency: Fraction = Field(description="a fraction above 0, up to 1")
    k_dn_per_e: Positive = Field(description="a system gain above 0 DN/e⁻")
    f_number: Positive = Field(description="an f-number above 0")
    transmittance: Fraction = Field(description="a fraction above 0, up to 1")
    pixel_pitch_m: Positive = Field(description="a distance of pixel centres above 0 m")
    dark_dn: NotNegative = Field(description="a dark value of at least 0 DN")


class SessionConfiguration(ConfigurationTable):
    """Configuration of a session before its first frame; `load` and `from_toml` read it, `to_toml` writes it.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> configuration = Session.open(example_session()).configuration
    >>> [patch.name for patch in configuration.target.patches][:2]
    ['P01', 'P07']
    """

    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp")
    name: Text = Field(description="a name as text")
    operator: Text = Field(description="the operator's name as text")
    notes: str = Field("", strict=True, description="text")
    laboratory: PartyConfiguration | None = Field(None, description="a [laboratory] table")
    customer: PartyConfiguration | None = Field(None, description="a [customer] table")
    camera: CameraConfiguration = Field(description="a [camera] table")
    lens: LensConfiguration = Field(description="a [lens] table")
    meter: MeterConfiguration = Field(description="a [meter] table")
    source: SourceConfiguration = Field(description="a [source] table")
    target: TargetConfiguration = Field(description="a [target] table")
    contrasts: tuple[ContrastConfiguration, ...] = Field(
        (), validation_alias="contrast", serialization_alias="contrast", description="[[contrast]] tables"
    )
    plan: PlanConfiguration = Field(description="a [plan] table")
    conditions: ConditionsConfiguration | None = Field(None, description="a [conditions] table")
    guess: GuessConfiguration | None = Field(None, description="a [guess] table")

    @model_validator(mode="after")
    def _saturation_within_range(self) -> Self:
        stated, name = self.camera.saturation_dn, self.plan.pixel_format
        if stated is None:
            return self
        # The black level of the camera itself is known from its first frame on.
        guessed_dn = None if self.guess is None else self.guess.dark_dn
        darks = {"camera.black_level": self.camera.black_level, "guess.dark_dn": guessed_dn}
        for key, dark_dn in darks.items():
            if dark_dn is not None and stated <= dark_dn:
                raise ValueError(f"camera.saturation_dn is {stated:g} DN, {key} {dark_dn:g}: give a value above it")
        # A format that is not known is refused when the camera is opened.
        known = PIXEL_FORMATS.get(name)
        if known is not None and stated > 2**known.bit_depth - 1:
            raise ValueError(
                f"camera.saturation_dn is {stated:g} DN: give a value up to {2**known.bit_depth - 1}, the end of {name}"
            )
        return self

    @model_validator(mode="after")
    def _contrasts_of_patches(self) -> Self:
        names = [patch.name for patch in self.target.patches]
        for index, pair in enumerate(self.contrasts):
            for key, name in (("bright", pair.bright), ("dark", pair.dark)):
                if name not in names:
                    raise ValueError(
                        f"contrast[{index}].{key} is {name!r}: give the name of a patch, one of {', '.join(names)}"
                    )
            if pair.bright == pair.dark:
                raise ValueError(f"contrast[{index}] has {pair.bright!r} as bright and as dark: give two patches")
        return self

    @property
    def optics(self) -> Lens:
        """Parameters of lens and camera that determine the natural vignetting."""
        return Lens(self.lens.focal_length_m, self.camera.pixel_pitch_m, self.lens.vignetting_rel)

    @classmethod
    def load(cls, path: str | PathLike[str]) -> SessionConfiguration:
        """Read a configuration from a TOML file.

        Raises
        ------
        ConfigurationError
            If the file cannot be read, or as `from_toml`.
        """
        return validated(cls, read_toml(path, "a session's configuration"), str(path), folder=Path(path).parent)

    @classmethod
    def from_toml(cls, text: str, source: str, folder: Path = Path()) -> SessionConfiguration:
        """Read a configuration from TOML text; messages call it `source`.

        Files with spectra that it names are sought in `folder`, and their content becomes part of the configuration.

        Raises
        ------
        ConfigurationError
            If the text is not TOML (with line and column), or a key or value is wrong (with the key, the value,
            its unit and what to give).
        """
        with naming(source, ConfigurationError):
            document = parse_toml(text)
        return validated(cls, document, source, folder=folder)

    def to_toml(self) -> str:
        """Write all values, also those left at their default, as TOML; the inverse is `from_toml`."""
        return toml_text(self.model_dump(by_alias=True, exclude_none=True))


_DATA = Path(str(files("labcdp"))) / "data"


def example_configuration() -> str:
    """Return the configuration of the demonstration as TOML, with comments.

    Examples
    --------
    >>> from labcdp.session import SessionConfiguration, example_configuration
    >>> configuration = SessionConfiguration.from_toml(example_configuration(), "example")
    >>> len(configuration.target.patches)
    16
    """
    return (_DATA / "bench.toml").read_text(encoding="utf-8")


def example_simulated_bench() -> str:
    """Return the description of the standard simulated bench as TOML, with comments."""
    return (_DATA / "simulated-bench.toml").read_text(encoding="utf-8")


def example_session() -> Path:
    """Return the folder of a small session recorded on the simulated bench.

    Examples
    --------
    >>> from labcdp.session import Session, example_session
    >>> Session.open(example_session()).configuration.name
    "Example: the demonstration's target on a small part of the sensor"
    """
    return _DATA / "example-session"


def example_camera() -> str:
    """Return a camera specification as TOML, with comments: that of the 2018 thesis' camera."""
    return (_DATA / "cameras" / "thesis-2018.toml").read_text(encoding="utf-8")
