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
from ..core.errors import ConfigurationError, InputError
from ..core.photometry import photon_radiance_per_cd_m2
from ..output import write_file
from .document import changed, document_of_parts, parts_of_document
from .hdr import Hdr
from .registry import chain_text
from .scene.scene import Scene
from .signal import UNITS, ExposureSettings, SensorModel, Stage

_Stages = Sequence[tuple[str, Stage]]


def require_consistent(
    scene: Scene,
    before: _Stages,
    sensors: Sequence[tuple[str, SensorModel]],
    settings: ExposureSettings | None,
    hdr: Hdr | None,
    behind: _Stages,
) -> None:
    """Refuse parts that do not fit together; parameters as those of `Chain`.

    Raises
    ------
    InputError
        Naming the first part that does not fit.
    """
    quantity = "luminance"
    for name, stage in before:
        _require_takes(name, stage, quantity)
        quantity = stage.gives
    if not sensors:
        if settings is not None or hdr is not None or behind:
            raise InputError("there is no sensor to expose: add a sensor, or leave out what follows it")
        return
    if quantity != "illuminance":
        raise InputError(
            f"the sensor takes illuminance in lx, but what comes to it is {quantity} in {UNITS[quantity]}: add "
            "optics in front of it"
        )
    for _, sensor in sensors:
        if sensor.shape != scene.shape:
            raise InputError(
                f"sensor has width {sensor.shape[1]} and height {sensor.shape[0]}, the scene {scene.shape[1]} and "
                f"{scene.shape[0]}: give them once, in scene or sensor"
            )
    if settings is None:
        raise InputError("exposure is missing: add a table [exposure] with exposure_s, in s")
    if len(settings.exposure_s) > 1 and hdr is None and behind:
        raise InputError(
            f"exposure.exposure_s has {len(settings.exposure_s)} times and nothing merges them: add a table "
            "[hdr], or give one time"
        )
    quantity = "digital number"
    for name, stage in behind:
        _require_takes(name, stage, quantity)
        quantity = stage.gives


def _require_takes(name: str, stage: Stage, quantity: str) -> None:
    for asked in (stage.takes, stage.gives):
        if asked not in UNITS:
            raise InputError(f"{name} takes {stage.takes!r} and gives {stage.gives!r}: give two of {', '.join(UNITS)}")
    if stage.takes != quantity:
        raise InputError(
            f"{name} takes {stage.takes} in {UNITS[stage.takes]}, but what comes to it is {quantity} in "
            f"{UNITS[quantity]}: put it elsewhere in the chain"
        )


def _require(is_right: bool, key: str, value: object, what: str) -> None:
    """Refuse a value of a wrong type before anything is made of it."""
    if not is_right:
        raise InputError(f"{key} is {shown(value)}: give {what}")


def _named_parts(key: str, value: Any, kind: Any) -> tuple[tuple[str, Any], ...]:
    """Return parts with their names as tuples, from any list of pairs."""
    how = f"a list of pairs of a name and a {'sensor model' if kind is SensorModel else 'stage'}"
    _require(isinstance(value, list | tuple), key, value, how)
    for one in value:
        is_pair = isinstance(one, list | tuple) and len(one) == 2
        _require(is_pair and isinstance(one[0], str) and isinstance(one[1], kind), key, value, how)
    return tuple((name, part) for name, part in value)


@dataclass(frozen=True)
class ChainParts:
    """What a chain consists of: the scene, the stages with their parameters, the settings of the exposures.

    A chain is its parts, frozen dataclasses of their parameters. TOML only serialises them: a chain with other values,
    by `with_` or `dataclasses.replace`, has them in a run, a prediction and a saved file alike.

    Parameters
    ----------
    name, description : str
        What the chain is.
    spectrum : str
        Spectrum of the light, as `labcdp.core.photometry.photon_radiance_per_cd_m2` takes it.
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
    source : str
        What messages call the chain: its preset or file.
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
        for key in ("name", "description", "spectrum", "source"):
            _require(isinstance(getattr(self, key), str), key, getattr(self, key), "text")
        _require(isinstance(self.folder, str | PathLike), "folder", self.folder, "a path")
        object.__setattr__(self, "folder", Path(self.folder))
        photon_radiance_per_cd_m2(self.spectrum)
        _require(isinstance(self.scene, Scene), "scene", self.scene, "a scene, such as labcdp.chain.Flat")
        _require(
            isinstance(self.settings, ExposureSettings | None),
            "settings",
            self.settings,
            "labcdp.chain.ExposureSettings, or None without sensors",
        )
        _require(isinstance(self.hdr, Hdr | None), "hdr", self.hdr, "labcdp.chain.Hdr, or None")
        for key, kind in (("before", Stage), ("sensors", SensorModel), ("behind", Stage)):
            object.__setattr__(self, key, _named_parts(key, getattr(self, key), kind))
        require_consistent(self.scene, self.before, self.sensors, self.settings, self.hdr, self.behind)
        names = self.stage_names
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(
                f"two signals would have the name {twice[0]!r}: give each its own, and exposure times that differ in "
                "their first six digits"
            )

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
        try:
            document = parse_toml(text)
        except InputError as error:
            raise ConfigurationError(f"{source}: {error}") from error
        return cls.from_document(document, source, folder)

    @classmethod
    def from_document(cls, document: Mapping[str, Any], source: str = "chain", folder: Path = Path()) -> Self:
        """Make a chain of the tables of a chain file.

        Parameters
        ----------
        document : mapping
            The tables; those between scene and sensor, and those behind, are stages in their order.
        source : str
            What messages call the document.
        folder : Path
            Folder that paths in it are relative to.

        Raises
        ------
        ConfigurationError
            Naming source, table and key of the first thing that cannot be used.
        """
        try:
            return cls(**parts_of_document(document, folder), source=source, folder=folder)
        except InputError as error:
            raise ConfigurationError(f"{source}: {error}") from error

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
            them, ``sensor.NAME.key`` one. The size is that of scene and sensors, whichever is named. None stands for
            the default.

        Raises
        ------
        ConfigurationError
            If there is no such parameter, or the value cannot be used.
        """
        return self.from_document(changed(self.document, changes), self.source, self.folder)

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
