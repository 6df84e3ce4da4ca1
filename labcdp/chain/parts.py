"""The parts of an imaging chain: frozen dataclasses of parameters, which chain files serialise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Self

from ..core.disk import parse_toml
from ..core.disk.files import shown
from ..core.disk.text import toml_text
from ..core.errors import ConfigurationError, InputError, naming
from ..core.photometry import photon_radiance_per_cd_m2
from ..output import write_file
from .document import changed, document_of_parts, parts_of_document
from .hdr import Hdr
from .lamp import CaptureTime
from .registry import chain_text
from .scene.scene import Scene
from .signal import UNITS, ExposureSettings, SensorModel, Stage

#: Types of the fields, and what else to give.
_KINDS: dict[str, tuple[Any, str]] = {
    **dict.fromkeys(("name", "description", "spectrum", "source"), (str, "text in quotes")),
    "folder": (str | PathLike, "a path"),
    "scene": (Scene, "a scene, such as labcdp.chain.Flat"),
    "settings": (ExposureSettings | None, "labcdp.chain.ExposureSettings, or None without sensors"),
    "hdr": (Hdr | None, "labcdp.chain.Hdr, or None"),
}


def _named_parts(key: str, value: Any, kind: Any, what: str) -> tuple[tuple[str, Any], ...]:
    """Return parts with their names as tuples, from any list of pairs."""
    if not isinstance(value, list | tuple) or not all(
        isinstance(pair, list | tuple) and len(pair) == 2 and isinstance(pair[0], str) and isinstance(pair[1], kind)
        for pair in value
    ):
        raise InputError(f"{key} is {shown(value)}: give a list of pairs of a name and a {what}", key=key)
    return tuple((name, part) for name, part in value)


def _quantity_behind(quantity: str, stages: Sequence[tuple[str, Stage]]) -> str:
    """Return the quantity behind stages; refuse a stage that does not take the quantity in front of it."""
    for name, stage in stages:
        if not {stage.takes, stage.gives} <= UNITS.keys():
            raise InputError(
                f"{name} takes {stage.takes!r} and gives {stage.gives!r}: give two of {', '.join(UNITS)}", key=name
            )
        if stage.takes != quantity:
            raise InputError(
                f"{name} takes {stage.takes} in {UNITS[stage.takes]}, but its input is {quantity} in "
                f"{UNITS[quantity]}: place it elsewhere in the chain",
                key=name,
            )
        quantity = stage.gives
    return quantity


@dataclass(frozen=True)
class ChainParts:
    """The parts of a chain: the scene, the stages with their parameters, and the settings of the exposures.

    A chain is its parts, frozen dataclasses of their parameters. TOML only serialises them: a chain with other values,
    by `with_` or `dataclasses.replace`, has them in a run, a prediction and a saved file alike.

    Parameters
    ----------
    name, description : str
        Name, and description in a sentence.
    spectrum : str
        Spectrum of the light, as `labcdp.core.photometry.photon_radiance_per_cd_m2` takes it.
    scene : Scene
        The scene in front of the camera.
    before : tuple of (str, Stage)
        Stages between scene and sensor with their names, in order.
    sensors : tuple of (str, SensorModel)
        None, one, or several sensors that look at the same scene, with their names.
    settings : ExposureSettings or None
        Exposure settings of the sensors; None without sensors.
    hdr : Hdr or None
        Merge of the exposures of a sensor.
    behind : tuple of (str, Stage)
        Stages behind sensor and merge, in order.
    source : str
        Name of the chain in messages: its preset or file.
    folder : Path
        Folder that paths in `document` are relative to.

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
    source: str = field(default="chain", compare=False)
    folder: Path = field(default=Path(), compare=False)

    def __post_init__(self) -> None:
        for key, (kind, what) in _KINDS.items():
            if not isinstance(getattr(self, key), kind):
                raise InputError(f"{key} is {shown(getattr(self, key))}: give {what}", key=key)
        object.__setattr__(self, "folder", Path(self.folder))
        photon_radiance_per_cd_m2(self.spectrum)
        for key, kind, what in (
            ("before", Stage, "stage"),
            ("sensors", SensorModel, "sensor model"),
            ("behind", Stage, "stage"),
        ):
            object.__setattr__(self, key, _named_parts(key, getattr(self, key), kind, what))
        quantity = _quantity_behind("luminance", self.before)
        if self.sensors:
            self._require_exposed(quantity)
        elif self.settings is not None or self.hdr is not None or self.behind:
            raise InputError("there is no sensor to expose: add a sensor, or leave out what follows it")
        twice = sorted({name for name in self.stage_names if self.stage_names.count(name) > 1})
        if twice:
            raise InputError(
                f"two signals would have the name {twice[0]!r}: give each its own, and use exposure times that "
                "differ in their first six digits"
            )

    def _require_exposed(self, quantity: str) -> None:
        """Refuse sensors that do not fit the stages around them or their exposures."""
        if quantity != "illuminance":
            raise InputError(
                f"the sensor takes illuminance in lx, but its input is {quantity} in {UNITS[quantity]}: add optics "
                "in front of it"
            )
        height, width = self.scene.shape
        for _, sensor in self.sensors:
            if sensor.shape != (height, width):
                raise InputError(
                    f"sensor has width {sensor.shape[1]} and height {sensor.shape[0]}, the scene {width} and "
                    f"{height}: give them once, in scene or sensor"
                )
        if self.settings is None:
            raise InputError("exposure is missing: add a table [exposure] with exposure_s, in s")
        names = [[part.name for part in getattr(sensor, "captures", ())] for _, sensor in self.sensors]
        if any(other != names[0] for other in names):
            raise InputError("the sensors have other captures than the first: make a chain for each, and compare them")
        if names[0] and len(self.settings.exposure_s) > 1:
            raise InputError(
                f"exposure.exposure_s has {len(self.settings.exposure_s)} times, and the sensor has captures: give one "
                "time, and exposure_s of each capture that has another"
            )
        count = len(self.capture_names)
        if count > 1 and self.hdr is None and self.behind:
            what = "the sensor has {} captures" if names[0] else "exposure.exposure_s has {} times"
            raise InputError(
                f"{what.format(count)} and nothing merges them: add a table [hdr], or give one"
                f"{'' if names[0] else ' time'}"
            )
        _quantity_behind("digital number", self.behind)

    @classmethod
    def load(cls, name_or_path: str | Path) -> Self:
        """Load a chain by the name of a preset (`preset_names`) or the path of a chain file (``.toml``).

        Raises
        ------
        ConfigurationError
            If there is no such preset or file, or its content cannot be used.
        """
        return cls.from_toml(*chain_text(name_or_path))

    @classmethod
    def from_toml(cls, text: str, source: str = "chain", folder: Path = Path()) -> Self:
        """Make a chain of the text of a chain file; everything else as `from_document`."""
        with naming(source, ConfigurationError):
            document = parse_toml(text)
        return cls.from_document(document, source, folder)

    @classmethod
    def from_document(cls, document: Mapping[str, Any], source: str = "chain", folder: Path = Path()) -> Self:
        """Make a chain of the tables of a chain file.

        Parameters
        ----------
        document : mapping
            The tables; those between scene and sensor, and those behind, are stages in their order.
        source : str
            Name of the document in messages.
        folder : Path
            Folder that paths in it are relative to.

        Raises
        ------
        ConfigurationError
            Naming source, table and key of the first thing that cannot be used.
        """
        with naming(source, ConfigurationError):
            return cls(**parts_of_document(document, folder), source=source, folder=folder)

    @property
    def document(self) -> dict[str, Any]:
        """The tables of a chain file for this chain, made anew each time; all parameters, the size in the scene."""
        return document_of_parts(self, self.folder)

    def to_toml(self) -> str:
        """Return the text of a chain file for this chain."""
        return toml_text(self.document)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write a chain file.

        Parameters
        ----------
        path : str or Path
            The file (``.toml``). Paths in the chain become relative to its folder where they lie in it.
        force : bool
            Whether a file that exists may be replaced; its comments are lost.

        Raises
        ------
        InputError
            If the file exists, or cannot be written.
        ConfigurationError
            If a part is not registered for chain files.
        """
        if not isinstance(path, str | PathLike) or not fspath(path):
            raise InputError(f"the chain file is {shown(path)}: give its path")
        path = Path(path)
        text = toml_text(document_of_parts(self, path.parent))
        write_file(path, text.encode(), force=force)

    def with_(self, **changes: Any) -> Self:
        """Return the chain with other parameters.

        Parameters
        ----------
        **changes
            Parameters as table and key, ``scene__luminance_cd_m2=5.0`` or, in a mapping, ``scene.luminance_cd_m2``;
            ``spectrum``, ``name`` and ``description`` stand alone. With several sensors ``sensor.key`` means all of
            them, ``sensor.NAME.key`` one; parts are named likewise, ``sensor.captures.NAME.key``,
            ``sensor.planes.NAME.key`` and ``scene.spectra.REGION.key``. The size is that of scene and sensors,
            whichever is named. None stands for the default.

        Raises
        ------
        ConfigurationError
            If there is no such parameter, or the value cannot be used.
        """
        return self.from_document(changed(self.document, changes), self.source, self.folder)

    @property
    def capture_names(self) -> tuple[str, ...]:
        """Names of the signals that a sensor takes itself, one for each exposure or capture; () without a sensor."""
        if self.settings is None or not self.sensors:
            return ()
        if captures := getattr(self.sensors[0][1], "captures", ()):
            return tuple(f"sensor {capture.name}" for capture in captures)
        times = self.settings.exposure_s
        return ("sensor",) if len(times) == 1 else tuple(f"sensor {1e3 * time:g} ms" for time in times)

    def capture_times(self, sensor: SensorModel) -> tuple[CaptureTime, ...]:
        """Exposure time of each capture of a sensor and its start after that of the frame; () without exposures.

        Captures of a sensor state their starts; several exposures follow one another, in the order they are stated.
        """
        if self.settings is None:
            return ()
        times = self.settings.exposure_s
        if captures := getattr(sensor, "captures", ()):
            return tuple(CaptureTime(capture.exposure_s or times[0], capture.start_s) for capture in captures)
        return tuple(CaptureTime(time, sum(times[:index])) for index, time in enumerate(times))

    @property
    def recorded_names(self) -> tuple[str, ...]:
        """Names of the signals of one sensor: its exposures, their merge and the stages behind; () without a sensor."""
        if self.settings is None:
            return ()
        captures = self.capture_names
        merged = () if self.hdr is None else ("hdr",)
        return (*captures, *merged, *(name for name, _ in self.behind))

    @property
    def stage_names(self) -> tuple[str, ...]:
        """Names of the signals of a run, in order."""
        front = ("scene", *(name for name, _ in self.before))
        return (
            *front,
            *(
                self.sensor_stage_name(name, sensor_name)
                for sensor_name, _ in self.sensors
                for name in self.recorded_names
            ),
        )

    @property
    def captures(self) -> dict[str, str]:
        """Name of the sensor for each exposure, by the name of the exposure in a run."""
        n = len(self.capture_names)
        return {
            self.sensor_stage_name(name, sensor_name): self.sensor_stage_name("sensor", sensor_name)
            for sensor_name, _ in self.sensors
            for name in self.recorded_names[:n]
        }

    @property
    def branches(self) -> dict[str, tuple[str, ...]]:
        """Names of the signals on the way to the last one of each sensor, by its name; "" without a sensor."""
        front = ("scene", *(name for name, _ in self.before))
        recorded = self.recorded_names
        branches = {
            sensor_name: (*front, *[self.sensor_stage_name(name, sensor_name) for name in recorded])
            for sensor_name, _ in self.sensors
        }
        return branches or {"": front}

    @property
    def final_stages(self) -> tuple[str, ...]:
        """Names of the last signal of each sensor; without a sensor, of the last one."""
        return tuple(names[-1] for names in self.branches.values())

    def sensor_stage_name(self, name: str, sensor_name: str) -> str:
        """Return the name in a run of a sensor's signal."""
        return f"{name} ({sensor_name})" if len(self.sensors) > 1 else name
