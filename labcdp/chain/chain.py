"""The whole imaging chain: scene, stages before the sensor, sensors, merge, stages behind, joined and run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..core.errors import ConfigurationError, InputError
from ..core.photometry import electron_radiance_per_cd_m2
from ..core.result import html_table
from .colour import sample_factors, seen_planes, seen_sensor
from .imaging import ImagingChain
from .luminance import cell_seed, cell_sensors, combined, is_combined, luminance_weights
from .optics import Optics, Windscreen
from .parameters import COUNT, THREADS
from .parts import ChainParts
from .scene.lamp import LampScene
from .scene.scene import Scene, luminance_map
from .scene.spectra import spectra_of
from .sensor import Sensor
from .signal import SIGNAL_HEADS, Context, SensorModel, Signal, digital_signal, scene_signal


@dataclass(frozen=True)
class Chain(ChainParts):
    """An imaging chain with the scene in front of it and the settings of its exposures.

    Its parameters are those of `ChainParts`; `load` makes one from a preset or a chain file, `with_` changes values.

    Examples
    --------
    >>> from labcdp.chain import Chain
    >>> Chain.load("manta-g505").with_(scene__contrast=0.3).stage_names
    ('scene', 'optics', 'sensor')
    """

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
            If a part cannot use its input.
        """
        COUNT.check("seed", seed)
        THREADS.check("threads", 1 if threads is None else threads)
        oversampling = getattr(self.scene, "oversampling", 1)
        samples = luminance_map(self.scene.luminance_map())
        stages = {"scene": scene_signal(samples, oversampling=oversampling)}
        for sensor_name, sensor in self.sensors or (("", None),):
            pitch = None if sensor is None else sensor.pixel_pitch_m
            context = Context(self.spectrum, seed, pitch, self.settings, threads)
            scenes = self._scenes_seen(sensor, seed)
            record = self._combined if is_combined(sensor) else self._recorded
            behind = record(sensor, scenes, stages, context)
            stages |= {self.sensor_stage_name(name, sensor_name): result for name, result in behind.items()}
        return ChainRun(self, seed, stages)

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
        signal = scene_signal(levels_cd_m2, shares)
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
        windscreen = next((stage for stage in stages[:1] if isinstance(stage, Windscreen)), None)
        match [stage for stage in stages if stage is not windscreen], [sensor for _, sensor in self.sensors]:
            case [Optics() as optics], [Sensor(colour_filter="") as sensor]:
                return ImagingChain(self.spectrum, windscreen, optics, sensor)
        raise ConfigurationError(
            f"{self.name} cannot serve as the camera of a bench: use at most a windscreen, optics and one sensor of "
            "type emva1288 without a colour filter"
        )

    def _recorded(
        self, sensor: SensorModel | None, scenes: Sequence[Scene], stages: dict[str, Signal], context: Context
    ) -> Mapping[str, Signal]:
        """Return the signals of a sensor, none without one, and add what is before it to `stages`."""
        signals: list[Signal] = []
        for number, scene in enumerate(scenes):
            first = scenes.index(scene)
            signals.append(signals[first] if first < number else self._exposed(scene, stages, sensor, context))
        if sensor is None:
            return {}
        return self._behind_sensor(seen_sensor(sensor, self.spectrum), signals, context)

    def _combined(
        self, sensor: Any, scenes: Sequence[Scene], stages: dict[str, Signal], context: Context
    ) -> Mapping[str, Signal]:
        """Return the luminance combined of the four pixels of each cell, behind each stage."""
        pixels: list[tuple[str, Mapping[str, Signal]]] = []
        for number, (plane, part) in enumerate(cell_sensors(sensor)):
            other = replace(context, seed=cell_seed(context.seed, number))
            pixels.append((plane, self._recorded(part, scenes, stages, other)))
        weights = luminance_weights(sensor, self.spectrum)
        front = stages[self.before[-1][0]]
        return {
            name: combined([(plane, part[name]) for plane, part in pixels], weights, front) for name in pixels[0][1]
        }

    def _scenes_seen(self, sensor: SensorModel | None, seed: int) -> list[Scene]:
        """Return what each capture of a sensor sees: a pulsed lamp at another phase, any other scene as it is."""
        if sensor is None or not isinstance(self.scene, LampScene):
            return [self.scene] * max(len(self.capture_names), 1)
        return [self.scene.seen_by(time, seed) for time in self.capture_times(sensor)]

    def _exposed(self, scene: Scene, stages: dict[str, Signal], sensor: SensorModel | None, context: Context) -> Signal:
        """Return the illuminance on the pixels, and add what is behind each stage to `stages`."""
        samples, oversampling = luminance_map(scene.luminance_map()), getattr(scene, "oversampling", 1)
        signal = scene_signal(samples, oversampling=oversampling)
        for name, stage in self.before:
            signal = stage.process(signal, context)
            # A lens makes another image for each pixel pitch; that of the first capture of the first sensor is shown.
            stages.setdefault(name, signal)
        if not isinstance(sensor, Sensor) or not (sensor.colour_filter or spectra_of(scene)):
            return signal
        values = np.empty(sensor.shape, np.float32)
        reference = electron_radiance_per_cd_m2(self.spectrum, seen_sensor(sensor, self.spectrum).quantum_efficiency)
        for plane in seen_planes(sensor):
            coloured = scene_signal(samples * sample_factors(scene, plane, self.spectrum), oversampling=oversampling)
            for _, stage in self.before:
                coloured = stage.process(coloured, context)
            mask = plane.mask(sensor.shape)
            values[mask] = coloured.values[mask] * np.float32(plane.per_cd_m2(self.spectrum) / reference)
        return replace(signal, values=values)

    def _behind_sensor(self, sensor: SensorModel, exposed: Sequence[Signal], context: Context) -> dict[str, Signal]:
        captures = [sensor.capture(signal, context, index) for index, signal in enumerate(exposed)]
        signals = [digital_signal(capture, signal) for capture, signal in zip(captures, exposed, strict=True)]
        if self.hdr is not None:
            # The merged value has the scale of the most sensitive capture.
            scale = max(range(len(captures)), key=lambda index: captures[index].sensitivity)
            signals.append(digital_signal(self.hdr.merge(captures), exposed[scale]))
        for _, stage in self.behind:
            signals.append(stage.process(signals[-1], context))
        return dict(zip(self.recorded_names, signals, strict=True))


@dataclass(frozen=True, eq=False)
class ChainRun(Mapping[str, Signal]):
    """One run of a chain: the signals behind its stages by name, in order.

    Parameters
    ----------
    chain : Chain
        The chain that was run.
    seed : int
        Seed of the noise.
    stages : mapping of str to Signal
        ``scene``, the stages' names, ``sensor`` (with its time if there are several exposures, with its name in
        brackets if there are several sensors), ``hdr`` and so on.

    Examples
    --------
    >>> from labcdp.chain import Chain
    >>> chain = Chain.load("manta-g505").with_(scene__width=64, scene__height=48, scene__square_px=16)
    >>> run = chain.run(seed=1)
    >>> run["sensor"].values.shape
    (48, 64)
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

    def _repr_html_(self) -> str:
        """Table for notebooks."""
        rows = [(name, *signal.summary) for name, signal in self.items()]
        return html_table(("stage", *SIGNAL_HEADS), rows, f"{self.chain.name or self.chain.source}, seed {self.seed}")

    def __repr__(self) -> str:
        return f"<ChainRun of {self.chain.name or self.chain.source!r}, seed {self.seed}: {' > '.join(self.stages)}>"
