"""The specimens on the simulated bench, and the file that describes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from ...chain import Chain, ImagingChain
from ...core.disk import read_toml
from ...core.errors import ConfigurationError
from ...session.tables import ConfigurationTable, FeatureName, NotNegative, Number, Positive, Text, Whole
from ...session.validation import validated
from .device import SENSOR_BITS
from .genicam import Naming, feature
from .meter import MeterErrorModel

#: Texts that fit into a camera's registers of 32 and 16 bytes.
_Name = Annotated[Text, Field(max_length=31)]
_Serial = Annotated[Text, Field(max_length=15)]


@dataclass(frozen=True)
class SimulatedDevices:
    """The specimens on the simulated bench.

    Parameters
    ----------
    chain : ImagingChain
        Camera and lens; spectrum, focal length and f-number come from the session's configuration.
    meter : MeterErrorModel
        Errors of the meter.
    temperature_c : float
        Sensor temperature.
    seed : int
        Random seed of the noise.
    vendor, model : str
        Of the camera.
    serial : str or None
        Of the camera; None derives it from the sensor.
    frame_rate_hz : float
        Of the camera, after power-on.
    naming : {'prosilica', 'sfnc'}
        Naming convention of the camera's features.
    colour_filter : {'RG', 'GR', 'GB', 'BG'} or None
        First two pixels of the camera's Bayer pattern; None for a monochrome one.
    """

    chain: ImagingChain
    meter: MeterErrorModel
    temperature_c: float = 35.0
    seed: int = 0
    vendor: str = "Allied Vision Technologies"
    model: str = "Manta_G-505B"
    serial: str | None = None
    frame_rate_hz: float = 15.0
    naming: Naming = "prosilica"
    colour_filter: str | None = None

    @classmethod
    def standard(cls, seed: int = 0) -> SimulatedDevices:
        """Return a Manta G-505B and a meter with a scale error of 0.6 %, well within its 2 %."""
        return SimulatedBenchFile(seed=seed).devices()


class _Camera(ConfigurationTable):
    chain: Text = Field(
        default="manta-g505", description="a preset (labcdp presets) or the name of a chain file as text"
    )
    colour_filter: Literal["RG", "GR", "GB", "BG"] | None = Field(
        default=None, description='the first two pixels of the Bayer pattern, for example "RG"'
    )
    vendor: _Name = Field(default="Allied Vision Technologies", description="a name of up to 31 letters")
    model: _Name = Field(
        default_factory=lambda given: "Manta_G-505C" if given.get("colour_filter") else "Manta_G-505B",
        description="a name of up to 31 letters",
    )
    serial: _Serial | None = Field(default=None, description="a serial number of up to 15 letters, in quotes")
    temperature_c: Number = Field(default=35.0, ge=-40, le=125, description="a temperature of -40 to 125 °C")
    frame_rate_hz: Positive = Field(default=15.0, le=1000, description="a frame rate above 0 Hz, up to 1000 Hz")
    naming: Naming = Field(default="prosilica", description='"prosilica" for names as of a Manta, or "sfnc"')


class _Meter(ConfigurationTable):
    scale_rel: Number = Field(default=0.006, gt=-1, description="a fraction above -1, 0.01 for readings 1 % too high")
    repeatability_rel: NotNegative = Field(default=0.001, description="a fraction of at least 0")


class SimulatedBenchFile(ConfigurationTable):
    """Devices of a simulated bench; `load` reads them from TOML."""

    seed: Whole = Field(default=0, description="a whole number of at least 0")
    camera: _Camera = Field(default=_Camera(), description="a [camera] table")
    sensor: dict[FeatureName, Any] = Field(
        default={}, description="a [sensor] table with parameters of the chain's sensor, for example black_level_dn"
    )
    meter: _Meter = Field(default=_Meter(), description="a [meter] table")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> SimulatedBenchFile:
        """Read the file.

        Raises
        ------
        ConfigurationError
            If it cannot be read, or a key or value is wrong.
        """
        return validated(cls, read_toml(path, "a simulated bench"), str(path))

    def with_camera(self, device_seed: int | None) -> SimulatedBenchFile:
        """Return the bench with another specimen of the camera: its serial number and fixed pattern, where left out."""
        if device_seed is None or self.camera.serial is not None or "device_seed" in self.sensor:
            return self
        return self.model_copy(update={"sensor": {**self.sensor, "device_seed": device_seed}})

    def devices(self, file: Path | None = None) -> SimulatedDevices:
        """Make the devices; a chain file is sought in the folder of `file`, which this was read from.

        Raises
        ------
        ConfigurationError
            If the chain or a parameter of its sensor cannot be used.
        """
        named = self.camera.chain
        chain = Chain.load((file or Path()).parent / named if named.endswith(".toml") else named)
        if file is not None:
            chain = replace(chain, source=f"{file} with {chain.source}")
        camera = chain.with_(**{f"sensor.{key}": value for key, value in self.sensor.items()}).camera()
        low, high = feature("BlackLevel")["range"]
        if camera.sensor.bits != SENSOR_BITS or not low <= camera.sensor.black_level_dn <= high:
            raise ConfigurationError(
                f"{chain.source}: the sensor has {camera.sensor.bits} bits and a black level of "
                f"{camera.sensor.black_level_dn:g} DN: give {SENSOR_BITS} bits and {low} to {high} DN"
            )
        return SimulatedDevices(
            camera,
            MeterErrorModel(self.meter.scale_rel, self.meter.repeatability_rel, self.seed),
            seed=self.seed,
            **self.camera.model_dump(exclude={"chain"}),
        )
