"""The whole imaging chain: scene, stages before the sensor, sensors, merge, stages behind, joined and run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import ConfigurationError, InputError
from ..photometry import photon_radiance_per_cd_m2
from .capture import Capture, SensorModel
from .exposure import ExposureSettings
from .hdr import Hdr
from .imaging import ImagingChain
from .optics import Optics
from .parameters import check_whole
from .patches import luminance_map
from .scene import Scene
from .sensor import Sensor
from .signal import UNITS, Context, Signal, Stage
from .windscreen import ThesisWindscreen, Windscreen


@dataclass(frozen=True, eq=False)
class Chain:
    """An imaging chain with the scene in front of it and the settings of its exposures.

    Parameters
    ----------
    name, description : str
        What the chain is.
    spectrum : str
        Spectrum of the light, as `labcdp.photometry.photon_radiance_per_cd_m2` takes it.
    scene : Scene
        What the camera looks at.
    before : tuple of (str, Stage)
        Stages between scene and sensor with their names, in order.
    sensors : tuple of (str, SensorModel)
        None, one, or several sensors that look at the same scene, with their names.
    settings : ExposureSettings or None
        How the sensors are exposed; None without sensors.
    hdr : Hdr or None
        How the exposures of a sensor are merged.
    behind : tuple of (str, Stage)
        Stages behind sensor and merge, in order.
    document : mapping
        The tables of the chain file it was made from.
    source : str
        What messages call the chain: its preset or file.
    folder : Path
        Folder that paths in the tables are relative to.

    Raises
    ------
    InputError
        If the parts do not fit together.
    """

    name: str
    description: str
    spectrum: str
    scene: Scene
    before: tuple[tuple[str, Stage], ...]
    sensors: tuple[tuple[str, SensorModel], ...]
    settings: ExposureSettings | None
    hdr: Hdr | None
    behind: tuple[tuple[str, Stage], ...]
    document: Mapping[str, Any]
    source: str = "chain"
    folder: Path = Path()

    def __post_init__(self) -> None:
        photon_radiance_per_cd_m2(self.spectrum)
        quantity = "luminance"
        for name, stage in self.before:
            _check_takes(name, stage, quantity)
            quantity = stage.gives
        if not self.sensors:
            if self.settings is not None or self.hdr is not None or self.behind:
                raise InputError("there is no sensor to expose: add a sensor, or leave out what follows it")
            return
        if quantity != "illuminance":
            raise InputError(
                f"the sensor takes illuminance in lx, but what comes to it is {quantity} in {UNITS[quantity]}: add "
                "optics in front of it"
            )
        if self.settings is None:
            raise InputError("exposure is missing: add a table [exposure] with exposure_s, in s")
        if len(self.settings.exposure_s) > 1 and self.hdr is None and self.behind:
            raise InputError(
                f"exposure.exposure_s has {len(self.settings.exposure_s)} times and nothing merges them: add a table "
                "[hdr], or give one time"
            )
        quantity = "digital number"
        for name, stage in self.behind:
            _check_takes(name, stage, quantity)
            quantity = stage.gives
        names = self.stage_names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(
                f"two signals would have the name {twice[0]!r}: give each its own, and exposure times that differ in "
                "their first six digits"
            )

    def run(self, seed: int = 0, threads: int | None = None) -> ChainRun:
        """Send the scene through all stages.

        Parameters
        ----------
        seed : int
            Fixes the noise; the same seed gives the same values on any number of threads.
        threads : int or None
            Number of threads, None for one a processor.

        Returns
        -------
        ChainRun
            The signal behind every stage by name, in order.

        Raises
        ------
        InputError
            If a part cannot use what it is given.
        """
        check_whole("seed", seed, "", 0)
        if threads is not None:
            check_whole("threads", threads, "", 1)
        scene = self._scene_signal()
        stages = {"scene": scene}
        for sensor_name, sensor in self.sensors or (("", None),):
            pitch = None if sensor is None else sensor.pixel_pitch_m
            context = Context(self.spectrum, seed, pitch, self.settings, threads)
            signal = scene
            for name, stage in self.before:
                signal = stage.process(signal, context)
                # A lens makes another image for each pixel pitch; the one of the first sensor is shown.
                stages.setdefault(name, signal)
            if sensor is not None:
                behind = self._behind_sensor(sensor, signal, context)
                stages |= {self.of_sensor(name, sensor_name): result for name, result in behind.items()}
        return ChainRun(self, seed, stages)

    @property
    def recorded_names(self) -> tuple[str, ...]:
        """Names of what one sensor gives: its exposures, their merge and the stages behind; () without a sensor."""
        if self.settings is None:
            return ()
        times = self.settings.exposure_s
        captures = ("sensor",) if len(times) == 1 else tuple(f"sensor {1e3 * time:g} ms" for time in times)
        merged = () if self.hdr is None else ("hdr",)
        return (*captures, *merged, *(name for name, _ in self.behind))

    @property
    def stage_names(self) -> tuple[str, ...]:
        """Names of the signals of a run, in order."""
        front = ("scene", *(name for name, _ in self.before))
        return (*front, *(self.of_sensor(name, own) for own, _ in self.sensors for name in self.recorded_names))

    def of_sensor(self, name: str, sensor_name: str) -> str:
        """Name in a run of what one sensor gives."""
        return f"{name} ({sensor_name})" if len(self.sensors) > 1 else name

    def front(self, levels_cd_m2: NDArray[np.float64], shares: NDArray[np.float64]) -> Signal:
        """Send levels of luminance through the stages before the sensor, on the optical axis.

        Parameters
        ----------
        levels_cd_m2 : ndarray of float, shape (cells, levels)
            In each row the luminances of one scene in cd/m^2.
        shares : ndarray of float, shape (cells, levels)
            Share of the scene's area each takes.

        Returns
        -------
        Signal
            Of the same shape.
        """
        signal = Signal(levels_cd_m2, "luminance", lambda luminance: luminance, shares)
        for _, stage in self.before:
            signal = stage.process(signal, Context(self.spectrum))
        return signal

    def camera(self) -> ImagingChain:
        """Return windscreen, optics and sensor for scenes given from outside.

        Raises
        ------
        ConfigurationError
            If the chain has other stages before the sensor, or not one EMVA 1288 sensor.
        """
        stages = [stage for _, stage in self.before]
        first = stages[0] if stages else None
        windscreen = first if isinstance(first, Windscreen) and not isinstance(first, ThesisWindscreen) else None
        if windscreen is not None:
            del stages[0]
        if (
            len(stages) == 1
            and isinstance(stages[0], Optics)
            and len(self.sensors) == 1
            and isinstance(self.sensors[0][1], Sensor)
        ):
            return ImagingChain(self.spectrum, windscreen, stages[0], self.sensors[0][1])
        raise ConfigurationError(
            f"{self.name} is no camera for a bench: give at most a windscreen, optics and one sensor of EMVA 1288"
        )

    def _scene_signal(self) -> Signal:
        return Signal(luminance_map(self.scene.luminance_map()), "luminance", lambda luminance: luminance)

    def _behind_sensor(self, sensor: SensorModel, signal: Signal, context: Context) -> dict[str, Signal]:
        assert self.settings is not None
        captures = [sensor.capture(signal, context, index) for index in range(len(self.settings.exposure_s))]
        signals = [_digital(capture, signal) for capture in captures]
        if self.hdr is not None:
            signals.append(_digital(self.hdr.merge(captures), signal))
        for _, stage in self.behind:
            signals.append(stage.process(signals[-1], context))
        return dict(zip(self.recorded_names, signals, strict=True))


def _digital(capture: Capture, before: Signal) -> Signal:
    return replace(
        before,
        values=capture.dn,
        quantity="digital number",
        # The capture's own numbers are not kept alive twice by its way back.
        to_luminance=partial(_luminance_of_dn, replace(capture, dn=capture.dn[:0]), before),
        saturated=capture.saturated,
    )


def _luminance_of_dn(capture: Capture, before: Signal, dn: NDArray[Any]) -> NDArray[Any]:
    return before.to_luminance(capture.illuminance_lx(dn))


def _check_takes(name: str, stage: Stage, quantity: str) -> None:
    for asked in (stage.takes, stage.gives):
        if asked not in UNITS:
            raise InputError(f"{name} takes {stage.takes!r} and gives {stage.gives!r}: give two of {', '.join(UNITS)}")
    if stage.takes != quantity:
        raise InputError(
            f"{name} takes {stage.takes} in {UNITS[stage.takes]}, but what comes to it is {quantity} in "
            f"{UNITS[quantity]}: put it elsewhere in the chain"
        )


@dataclass(frozen=True, eq=False)
class ChainRun(Mapping[str, Signal]):
    """One run of a chain: the signals behind its stages by name, in order.

    Parameters
    ----------
    chain : Chain
        What was run.
    seed : int
        Seed of the noise.
    stages : mapping of str to Signal
        ``scene``, the stages' names, ``sensor`` (with its time if there are several exposures, with its name in
        brackets if there are several sensors), ``hdr`` and so on.
    """

    chain: Chain
    seed: int
    stages: Mapping[str, Signal]

    def __getitem__(self, name: str) -> Signal:
        """Return the signal behind a stage; raises InputError with the names there are."""
        if name not in self.stages:
            raise InputError(f"stage is {name!r}: give one of {', '.join(self.stages)}")
        return self.stages[name]

    def __contains__(self, name: object) -> bool:
        return name in self.stages

    def get(self, name: str, default: Any = None) -> Any:
        """Return the signal behind a stage, or the default if there is no such stage."""
        return self.stages.get(name, default)

    def __iter__(self) -> Iterator[str]:
        return iter(self.stages)

    def __len__(self) -> int:
        return len(self.stages)
