"""The log of a day at the live bench: readings, snapshots of contrasts and settings, in a file that is always whole."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from math import hypot
from pathlib import Path
from typing import Any

from ...core.disk import read_json, record_of
from ...core.disk.text import numbered, results_json
from ...core.errors import InputError
from ...core.result import Result
from ...core.table import Column, Table
from ...output.file import write_file
from ...report.sheets import result_workbook
from ...report.text import Z_95

#: Version of the file.
_FORMAT = "labcdp bench log 1"


def now() -> datetime:
    """Return the time of day here, with its zone."""
    return datetime.now().astimezone().replace(microsecond=0)


@dataclass(frozen=True)
class MeterReading:
    """A reading of the meter on the page.

    Parameters
    ----------
    time : datetime
        When it was taken, with time zone.
    origin : str
        Meter, or that the reading was typed.
    luminance_cd_m2 : float
        Reading of the meter, mean of several, or what a person typed.
    region : str
        Region selected when it was taken; empty if none was.
    camera_cd_m2 : float or None
        Mean luminance of that region by the calibrated camera at the same time.
    meter_u_cd_m2, camera_u_cd_m2 : float or None
        Their standard uncertainties; None if they are not known.
    n_readings : int
        Number of readings.
    scatter_rel : float or None
        Standard deviation of the readings, relative to their mean; None for one.
    saturated : bool
        Whether the region was saturated, so that the camera says nothing about its luminance.
    deleted : str
        When it was deleted, as ISO text; empty if it was not.
    """

    time: datetime
    origin: str
    luminance_cd_m2: float
    region: str
    camera_cd_m2: float | None
    meter_u_cd_m2: float | None = None
    camera_u_cd_m2: float | None = None
    n_readings: int = 1
    scatter_rel: float | None = None
    saturated: bool = False
    deleted: str = ""

    @property
    def disagrees(self) -> bool:
        """Whether camera and meter differ by more than the U (95 %) of their difference."""
        if self.camera_cd_m2 is None or self.meter_u_cd_m2 is None or self.camera_u_cd_m2 is None:
            return False
        expanded = Z_95 * hypot(self.meter_u_cd_m2, self.camera_u_cd_m2)
        return abs(self.camera_cd_m2 - self.luminance_cd_m2) > expanded

    @property
    def deviation(self) -> float | None:
        """Deviation of the camera from the meter, relative."""
        if self.camera_cd_m2 is None or not self.luminance_cd_m2:
            return None
        return self.camera_cd_m2 / self.luminance_cd_m2 - 1


@dataclass(frozen=True)
class Snapshot:
    """Contrast and CDP of two regions at one moment.

    Parameters
    ----------
    time : datetime
        When, with time zone.
    first, second : str
        Names of the regions.
    contrast, contrast_u : float or None
        Measured contrast and its standard uncertainty, fractions; None if it is not known, as of saturated regions.
    target_contrast, epsilon : float
        Target contrast and tolerance, fractions.
    cdp, low, high : float or None
        Its CDP with the 95 % interval; None of saturated regions.
    verdict : str
        As on the card.
    exposure_s, gain_db : float
        Settings of the frame.
    unit : str
        ``cd/m^2`` with a calibration, else ``relative``.
    """

    time: datetime
    first: str
    second: str
    contrast: float | None
    contrast_u: float | None
    target_contrast: float
    epsilon: float
    cdp: float | None
    low: float | None
    high: float | None
    verdict: str
    exposure_s: float
    gain_db: float
    unit: str


@dataclass(frozen=True)
class SettingsInForce:
    """Settings of the camera from a moment on.

    Parameters
    ----------
    time : datetime
        When they were read back first, with time zone.
    exposure_s, gain_db : float
        Exposure and gain.
    pixel_format : str
        GenICam name.
    width, height : int
        Size of the image.
    frame_rate_hz : float or None
        Frame rate that is set.
    black_level : float or None
        Register of the black level.
    """

    time: datetime
    exposure_s: float
    gain_db: float
    pixel_format: str
    width: int
    height: int
    frame_rate_hz: float | None
    black_level: float | None


_KINDS: dict[str, type] = {"readings": MeterReading, "snapshots": Snapshot, "settings": SettingsInForce}


@dataclass(frozen=True)
class Day:
    """Entries in the log of a day, the oldest first.

    Parameters
    ----------
    readings : tuple of MeterReading
        Also deleted ones.
    snapshots : tuple of Snapshot
        Snapshots that a person noted.
    settings : tuple of SettingsInForce
        One for each change.
    """

    readings: tuple[MeterReading, ...] = ()
    snapshots: tuple[Snapshot, ...] = ()
    settings: tuple[SettingsInForce, ...] = ()

    @classmethod
    def read(cls, path: Path) -> Day:
        """Read a log; raises InputError if it is none."""
        stored, what = read_json(path, "a log of labcdp bench"), f"labcdp bench cannot continue the log {path}"
        if not isinstance(stored, dict) or stored.get("format") != _FORMAT:
            raise InputError(f"{what}: move it away")
        entries_by_name: dict[str, Any] = {}
        for name, kind in _KINDS.items():
            entries = stored.get(name, [])
            if not isinstance(entries, list):
                raise InputError(f"{what}: its {name} are not a list; move the file away")
            try:
                entries_by_name[name] = tuple(kind(**record_of(kind, entry)) for entry in entries)
            except InputError as error:
                raise InputError(f"{what}: {error} in its {name}; move the file away") from error
        return cls(**entries_by_name)

    def encode(self) -> bytes:
        """Return the content of the file."""
        entries = {name: [_values(entry) for entry in getattr(self, name)] for name in _KINDS}
        return results_json({"format": _FORMAT, **entries}).encode()


def _values(entry: Any) -> dict[str, Any]:
    return {name: value.isoformat() if isinstance(value, datetime) else value for name, value in asdict(entry).items()}


class DayLog:
    """The log of the present day; each entry is on the disk when it has been added.

    Parameters
    ----------
    regions : Path
        File of the regions, beside which the logs of the days are, with its name: who holds its lock has them alone.
    time : function
        Return the time of day, with time zone.

    Raises
    ------
    InputError
        If the file of this day is no log.
    """

    def __init__(self, regions: Path, time: Callable[[], datetime] = now) -> None:
        self._regions, self.time = regions, time
        self._date, self.day = self.time().date(), Day()
        #: Why the last entry is not on the disk; empty if it is.
        self.error = ""
        if self.path.exists():
            self.day = Day.read(self.path)

    @property
    def path(self) -> Path:
        """File of the day."""
        return self._beside(".json")

    @property
    def readings(self) -> tuple[tuple[int, MeterReading], ...]:
        """Readings that are not deleted, with their numbers, the newest first."""
        return tuple((n, reading) for n, reading in reversed(list(enumerate(self.day.readings))) if not reading.deleted)

    def add(self, *entries: MeterReading | Snapshot | SettingsInForce) -> None:
        """Add entries, after midnight to the log of the next day."""
        if self.time().date() != self._date:
            self._date, self.day = self.time().date(), Day()
        for name, kind in _KINDS.items():
            new = tuple(entry for entry in entries if isinstance(entry, kind))
            self.day = replace(self.day, **{name: (*getattr(self.day, name), *new)})
        self._write()

    def delete(self, number: int) -> None:
        """Mark a reading as deleted: the file and the sheet still have it; raises InputError if there is none."""
        readings = list(self.day.readings)
        if not (0 <= number < len(readings)) or readings[number].deleted:
            raise InputError("this reading has already been deleted")
        readings[number] = replace(readings[number], deleted=self.time().isoformat())
        self.day = replace(self.day, readings=tuple(readings))
        self._write()

    def export(self, simulated: bool) -> Path:
        """Write a new workbook of the day; raises InputError if it cannot be written."""
        paths = (self._beside(f"{ending}.xlsx") for ending in numbered("-{}"))
        path = next(path for path in paths if not path.exists())
        title = f"Log of {self._date.isoformat()}"
        result = Result("bench", title, log_tables(self.day), simulated=simulated)
        write_file(path, result_workbook(result, self.time()))
        return path

    def _beside(self, end: str) -> Path:
        name = self._regions.stem.removesuffix(".rois")
        return self._regions.with_name(f"{name}-log-{self._date.isoformat()}{end}")

    def _write(self) -> None:
        try:
            write_file(self.path, self.day.encode(), force=True)
            self.error = ""
        except InputError as error:
            self.error = f"The log of the day could not be written: {error}"


def _time_of(entry: Any) -> str:
    return str(entry.time.isoformat(sep=" ", timespec="seconds"))


_TIME = Column("time", "time", meaning="Time of day, with the difference from UTC.", value=_time_of)
_EXPOSURE = (
    Column("exposure_s", "exposure", "s", "Exposure time.", time=True),
    Column("gain_db", "gain", "dB", "Gain of the camera."),
)


def _expanded(name: str) -> Callable[[Any], float | None]:
    return lambda entry: None if getattr(entry, name) is None else Z_95 * getattr(entry, name)


def log_tables(day: Day) -> tuple[Table, ...]:
    """Return readings, snapshots and settings of a day as tables."""
    luminance = "Luminance in cd/m²"
    readings = (
        _TIME,
        Column("region", "region", meaning="Region that was selected."),
        Column("meter_cd_m2", "meter", "cd/m²", f"{luminance} from the meter.", value="luminance_cd_m2"),
        Column("meter_u_expanded_cd_m2", "U of the meter", "cd/m²", "U (95 %).", value=_expanded("meter_u_cd_m2")),
        Column("camera_cd_m2", "camera", "cd/m²", f"{luminance} from the camera; empty if it was saturated."),
        Column("camera_u_expanded_cd_m2", "U of the camera", "cd/m²", "U (95 %).", value=_expanded("camera_u_cd_m2")),
        Column("deviation_rel", "deviation", "%", "Of the camera from the meter.", value="deviation"),
        Column("n_readings", "readings", meaning="Number of readings in the mean."),
        Column("scatter_rel", "scatter", "%", "Standard deviation of the readings."),
        Column("saturated", "saturated", meaning="Whether the region was saturated in the camera."),
        Column("origin", "origin", meaning="Meter, or that the reading was typed."),
        Column("deleted", "deleted", meaning="When it was deleted on the page; empty if it counts."),
    )
    snapshots = (
        _TIME,
        Column("first", "region A", meaning="First region."),
        Column("second", "region B", meaning="Second region."),
        Column("contrast", "measured contrast", "%", "Weber contrast; empty of saturated regions."),
        Column("contrast_u_expanded", "U of the contrast", "%", "U (95 %).", value=_expanded("contrast_u")),
        Column("target_contrast", "target contrast", "%", "Contrast to be detected."),
        Column("epsilon", "ε", "%", "Its relative tolerance."),
        Column("cdp", "CDP", meaning="Contrast detection probability; empty of saturated regions.", decimals=4),
        Column("low", "CDP from", meaning="Lower end of the 95 % interval.", decimals=4),
        Column("high", "CDP to", meaning="Upper end of the 95 % interval.", decimals=4),
        Column("verdict", "verdict", meaning="As on the page."),
        *_EXPOSURE,
        Column("unit", "unit", meaning="Of the luminances: cd/m^2, or relative without a calibration."),
    )
    settings = (
        _TIME,
        *_EXPOSURE,
        Column("pixel_format", "pixel format", meaning="GenICam name."),
        Column("width", "width", "px", "Of the image."),
        Column("height", "height", "px", "Of the image."),
        Column("frame_rate_hz", "frame rate", "Hz", "As set."),
        Column("black_level", "black level", meaning="Register of the black level."),
    )
    columns: Sequence[tuple[str, str, tuple[Column, ...], tuple[Any, ...]]] = (
        ("readings", "Readings of the meter", readings, day.readings),
        ("snapshots", "Contrast and CDP", snapshots, day.snapshots),
        ("settings", "Settings of the camera", settings, day.settings),
    )
    return tuple(Table.of_items(name, title, of, items, detail=True) for name, title, of, items in columns)
