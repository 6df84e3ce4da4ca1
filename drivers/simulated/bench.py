"""The simulated bench: one target, a camera and a meter that look at it, and the hands that move them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from itertools import combinations
from math import ceil, floor

import numpy as np
from numpy.typing import NDArray

from ...chain import ImagingChain, Optics, PatchScene, load
from ...chain import Patch as ScenePatch
from ...errors import ConfigurationError
from ...session import Patch, SessionConfiguration
from ..minolta_ls import LS100, LS110
from .camera import SimulatedDevice, SimulatedGigECamera
from .in_process import InProcessCamera
from .meter import MeterErrorModel, SimulatedLS
from .meter_pty import PtyMeter

#: A patch of the simulated target is this much larger than its region on each side, relative to the region.
_MARGIN_REL = 0.15

#: Luminance around the patches relative to the darkest of them: dark grey cardboard, which a calibration covers.
_BACKGROUND_REL = 4.0


@dataclass(frozen=True)
class BenchDevices:
    """The specimens on the simulated bench.

    Parameters
    ----------
    chain : ImagingChain
        Camera and lens; spectrum, focal length and f-number come from the session's configuration.
    meter : MeterErrorModel
        How the meter errs.
    temperature_c : float
        Sensor temperature.
    seed : int
        Of the noise.
    """

    chain: ImagingChain
    meter: MeterErrorModel
    temperature_c: float = 35.0
    seed: int = 0

    @classmethod
    def standard(cls, seed: int = 0, meter_scale_rel: float = 0.006) -> BenchDevices:
        """Return a Manta G-505B and a meter that reads 0.6 % too much, well within its 2 %."""
        meter = MeterErrorModel(meter_scale_rel, repeatability_rel=0.001, seed=seed)
        return cls(load("manta-g505").camera(), meter, seed=seed)


class SimulatedBench:
    """One simulated target, seen by camera and meter alike.

    The target has the patches of a session's configuration, at their nominal luminance. The bench does what an
    operator does: `cover_lens`, `uncover_lens`, `point_meter`.

    Parameters
    ----------
    configuration : SessionConfiguration
        Its target, lens and spectrum are simulated; each patch needs a nominal luminance.
    devices : BenchDevices
        The specimens.
    sensor_shape : (int, int) or None
        Height and width for a smaller sensor; None keeps the camera's own.

    Raises
    ------
    ConfigurationError
        If a patch has no nominal luminance, does not lie on the sensor, or overlaps another.
    """

    def __init__(
        self,
        configuration: SessionConfiguration,
        devices: BenchDevices,
        sensor_shape: tuple[int, int] | None = None,
    ) -> None:
        self.luminance_cd_m2 = {patch.name: _nominal_cd_m2(patch) for patch in configuration.target.patches}
        self.pointed_at = configuration.target.patches[0].name
        self._meter_model = configuration.meter.model
        self._devices = devices
        self._chain = _chain(configuration, devices.chain, sensor_shape)
        self._source = _Source(self._chain, self._scene(configuration), devices)

    def _scene(self, configuration: SessionConfiguration) -> PatchScene:
        height, width = self._chain.sensor.shape
        bounds = {patch.name: patch.region().bounds for patch in configuration.target.patches}
        _refuse_overlap(bounds)
        surroundings: list[ScenePatch] = []
        regions: list[ScenePatch] = []
        for patch in configuration.target.patches:
            x0, y0, x1, y1 = bounds[patch.name]
            if x1 > width or y1 > height:
                raise ConfigurationError(
                    f"patch {patch.name!r} reaches x {x1:g}, y {y1:g}, the simulated sensor has {width} x {height} "
                    "pixels: move it inside"
                )
            dx, dy = _MARGIN_REL * (x1 - x0), _MARGIN_REL * (y1 - y0)
            for drawn, mx, my in ((surroundings, dx, dy), (regions, 0.0, 0.0)):
                left, top = max(0, floor(x0 - mx)), max(0, floor(y0 - my))
                right, bottom = min(width, ceil(x1 + mx)), min(height, ceil(y1 + my))
                drawn.append(ScenePatch(left, top, right - left, bottom - top, self.luminance_cd_m2[patch.name]))
        background_cd_m2 = _BACKGROUND_REL * min(self.luminance_cd_m2.values())
        # Regions last: the margin of a close neighbour must not reach into them.
        patches = (*surroundings, *regions)
        return PatchScene(width=width, height=height, background_cd_m2=background_cd_m2, patches=patches)

    @property
    def device(self) -> SimulatedDevice:
        """What the simulated camera says of itself."""
        sensor = self._chain.sensor
        return SimulatedDevice(
            serial=f"SIM-{sensor.device_seed}",
            width=sensor.width,
            height=sensor.height,
            temperature_c=self._devices.temperature_c,
            black_level_dn=sensor.black_level_dn,
        )

    def gige_camera(self, address: str = "127.0.0.1") -> SimulatedGigECamera:
        """Return the camera as a GigE Vision device on a loopback address, to be started."""
        return SimulatedGigECamera(self.device, self._source, address)

    def in_process_camera(self) -> InProcessCamera:
        """Return the camera without a network."""
        return InProcessCamera(self.device, self._source)

    def pty_meter(self, response_time_s: float = 0.8) -> PtyMeter:
        """Return the meter on a pseudo-terminal, to be started."""
        sheet = {"LS-100": LS100, "LS-110": LS110}[self._meter_model]
        engine = SimulatedLS(lambda: self.luminance_cd_m2[self.pointed_at], sheet, self._devices.meter)
        return PtyMeter(engine, response_time_s=response_time_s)

    @property
    def covered(self) -> bool:
        """Whether the cap is on the lens."""
        return self._source.covered

    def cover_lens(self) -> None:
        """Put the cap on the lens."""
        self._source.covered = True

    def uncover_lens(self) -> None:
        """Take the cap off the lens."""
        self._source.covered = False

    def point_meter(self, patch: str) -> None:
        """Point the meter at a patch.

        Raises
        ------
        ConfigurationError
            If the target has no such patch.
        """
        if patch not in self.luminance_cd_m2:
            raise ConfigurationError(f"there is no patch {patch!r}: choose one of {', '.join(self.luminance_cd_m2)}")
        self.pointed_at = patch


class _Source:
    """Exposures of the target, or of the lens cap."""

    def __init__(self, chain: ImagingChain, scene: PatchScene, devices: BenchDevices) -> None:
        self.covered = False
        self._chain = chain
        self._scene = scene
        self._devices = devices
        self._electron_rate: NDArray[np.float32] | None = None

    @property
    def state(self) -> Hashable:
        """What the pixels depend on beside exposure and gain."""
        return self.covered

    def expose(self, exposure_s: float, gain_db: float, index: int) -> NDArray[np.uint16]:
        """Render exposure number `index`."""
        if self._electron_rate is None:
            self._electron_rate = self._chain.electron_rate(self._scene.luminance_map())
        return self._chain.expose(
            0.0 if self.covered else self._electron_rate,
            exposure_s,
            gain_db,
            temperature_c=self._devices.temperature_c,
            seed=self._devices.seed,
            exposure_index=index,
        )


def _refuse_overlap(bounds: dict[str, tuple[float, float, float, float]]) -> None:
    for (one, (ax0, ay0, ax1, ay1)), (other, (bx0, by0, bx1, by1)) in combinations(bounds.items(), 2):
        if ceil(ax1) > floor(bx0) and ceil(bx1) > floor(ax0) and ceil(ay1) > floor(by0) and ceil(by1) > floor(ay0):
            raise ConfigurationError(
                f"patches {one!r} and {other!r} overlap, so the simulated target cannot show both: move one"
            )


def _nominal_cd_m2(patch: Patch) -> float:
    if patch.nominal_luminance_cd_m2 is None:
        raise ConfigurationError(
            f"patch {patch.name!r} has no nominal_luminance_cd_m2: give one, the simulated target shows it"
        )
    return patch.nominal_luminance_cd_m2


def _chain(
    configuration: SessionConfiguration, chain: ImagingChain, sensor_shape: tuple[int, int] | None
) -> ImagingChain:
    lens = configuration.lens
    transmittance = chain.optics.transmittance if lens.transmittance is None else lens.transmittance
    optics = Optics(f_number=lens.f_number, transmittance=transmittance, focal_length_m=lens.focal_length_m)
    sensor = chain.sensor
    if sensor_shape is not None:
        height, width = sensor_shape
        sensor = replace(sensor, height=height, width=width)
    sensor = replace(sensor, pixel_pitch_m=configuration.camera.pixel_pitch_m)
    return replace(chain, spectrum=configuration.source.spectrum, optics=optics, sensor=sensor)
