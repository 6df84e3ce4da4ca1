"""Options that several commands share, and the paths of what commands write, checked before any work starts."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ..core.disk.files import SESSION_JOURNAL
from ..core.errors import InputError
from ..core.reading import SerialMeterModel
from ..core.result import Result
from ..evaluate.contrasts import parse_contrasts
from ..evaluate.judgement import Verdict, worst_verdict
from ..metrics.contrast import TargetContrasts
from ..output import ResultsFolder, check_file, read_list
from .commands import COMMAND, GIVEN, As, Json
from .terminal import print_result, say, say_where
from .values import (
    fraction_of_percent,
    parse_changes,
    parse_hertz,
    parse_length,
    parse_seconds,
    parse_temperature,
    parse_tolerance,
)

if TYPE_CHECKING:
    from ..core.cluster import Workers
    from ..web.server import Address

#: Exit status by verdict of a requirement.
REQUIREMENT_STATUS: dict[Verdict, int] = {"met": 0, "not met": 3, "undecided": 4}
#: Parameters of commands that name what is written, or no file at all.
_WRITTEN = {"output", "preview", "transcript", "template"}

Force = Annotated[bool, As("Replace earlier results of the same command, or an existing output file; never an input.")]
Open = Annotated[bool, As("Open the page in the browser.", ("--open",))]
OpenAtOnce = Annotated[bool, As("Open the page in the browser.", ("--open/--no-open",))]
Output = Annotated[
    Path | None, As("New folder for the results; default: NAME-COMMAND, named after the input.", ("--output", "-o"))
]
Natural = Annotated[int, As(least=0)]
Positive = Annotated[int, As(least=1)]
NonNegative = Annotated[float, As(least=0)]
Seed = Annotated[int, As("Random seed of the noise.", least=0)]
Percent = Annotated[float, As(parse=fraction_of_percent, show=lambda value: f"{100 * value:g}%")]
Tolerance = Annotated[
    float,
    As("Relative tolerance of the contrast.", parse=parse_tolerance, show=lambda value: f"{100 * value:g}%"),
]
Seconds = Annotated[float, As(parse=parse_seconds, show=lambda value: f"{1e3 * value:g}ms")]
Temperature = Annotated[float, As(parse=parse_temperature)]
Length = Annotated[float, As(parse=parse_length, show=lambda value: f"{1e3 * value:g}mm")]
#: Changed parameters of a chain, by name.
Changes = Annotated[
    tuple[tuple[str, Any], ...],
    As(names=("--set",), parse=lambda texts, name: tuple(parse_changes(texts, name).items()), many=True),
]
#: Contrasts; None for the measured ones.
Contrasts = Annotated[
    tuple[float, ...] | None,
    As(
        "Target contrasts: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log] such as 10%:200%:20. "
        "May be repeated; default: the measured contrast of each pair.",
        parse=lambda texts, name: parse_contrasts(texts, name) or None,
        many=True,
    ),
]
Port = Annotated[int, As("Port of the page; default: any free port.", least=0, most=65535)]
PageAddress = Annotated[str, As("Address of the page; the default is reachable from this computer and through ssh.")]
MeterPort = Annotated[
    str | None,
    As("Serial port of the meter, for example /dev/ttyUSB0; default: as configured, or the only one.", ("--meter",)),
]
MeterModel = Annotated[
    SerialMeterModel, As("Model of the meter; it cannot be read from the meter.", ("--meter-model",))
]
Certificate = Annotated[
    Path | None,
    As("TOML file with the meter's calibration certificate; default: as configured in meter.certificate."),
]
SimulatedBenchPath = Annotated[
    Path | None,
    As("Use the simulated bench that this file describes, see labcdp init simulated-bench; default: a Manta G-505B."),
]
Without = Annotated[
    tuple[str, ...], As("Patch to leave out, or PATCH:NUMBER for one of its readings; may be repeated.")
]


#: File of a requirement.
Require = Annotated[
    Path | None,
    As("TOML file with a requirement to judge by; it sets contrast, tolerance and limit, and the exit status."),
]


def _given(options: Mapping[str, object]) -> list[str]:
    return [option for option, value in options.items() if value is not None and value is not False]


def require_together(options: Mapping[str, object], required: Mapping[str, object]) -> None:
    """Refuse options, by name with their values, that require another one that is not given."""
    for option in _given(options) if not _given(required) else ():
        raise InputError(f"{option} requires {', '.join(required)}: give both or neither")


def require_apart(options: Mapping[str, object], others: Mapping[str, object]) -> None:
    """Refuse options, by name with their values, that exclude another one that is given."""
    for option in _given(options) if _given(others) else ():
        raise InputError(f"{option} cannot be combined with {', '.join(others)}: leave one out")


def say_unmet(verdicts: Mapping[str, Verdict]) -> None:
    """Say which ones do not meet a requirement, or may not, by name."""
    for verdict, words in (("not met", "not met"), ("undecided", "undecided for")):
        if names := [name for name, of_name in verdicts.items() if of_name == verdict]:
            say(f"Requirement {words}: {', '.join(names)}")


def end_by_requirement(verdicts: Mapping[str, Verdict]) -> None:
    """Do the same and end with the exit status, unless all meet it."""
    say_unmet(verdicts)
    worst = worst_verdict(["met", *verdicts.values()])
    if worst != "met":
        raise typer.Exit(REQUIREMENT_STATUS[worst])


def one_or_all(contrasts: tuple[float, ...] | None) -> TargetContrasts:
    """Return the contrasts of an option, a single one as a number: results then have no dimension for it."""
    return contrasts[0] if contrasts is not None and len(contrasts) == 1 else contrasts


@dataclass(frozen=True)
class FlickerOptions:
    """Options of the flicker of lamps.

    Parameters
    ----------
    flicker
        Also evaluate how the light of each patch flickers from frame to frame: FMI and MMP.
    flicker_threshold
        Excess over the light with the lamp off from which a frame shows the lamp, for the FDI; default: 10%.
    flicker_tolerance
        Deviation from the mean up to which a frame is not modulated, for the MMP; default: 10%.
    lamp_frequency
        Frequency of the lamp, for example 90Hz: it tells a lamp that is locked to the frames from a steady one.
    """

    flicker: bool = False
    flicker_threshold: Annotated[float | None, As(parse=fraction_of_percent)] = None
    flicker_tolerance: Annotated[float | None, As(parse=fraction_of_percent)] = None
    lamp_frequency: Annotated[float | None, As(parse=parse_hertz)] = None

    def require_flicker(self) -> None:
        """Refuse options without ``--flicker``; raises InputError."""
        if self.flicker_limits() and not self.flicker:
            raise InputError("limits of flicker, frames with the lamp off and its frequency need --flicker: give it")

    def flicker_limits(self) -> dict[str, Any]:
        """Return what is given besides `flicker`, by the parameters of `labcdp.flicker`."""
        values = {
            "threshold": self.flicker_threshold,
            "tolerance": self.flicker_tolerance,
            "frequency_hz": self.lamp_frequency,
        }
        return {name: value for name, value in values.items() if value is not None}


@dataclass(frozen=True)
class PageOptions:
    """Options of commands that serve a page."""

    port: Port = 0
    address: PageAddress = "127.0.0.1"
    open_page: OpenAtOnce = True

    def served(self, end: ExitStack, address: Address) -> None:
        """Say where the page is, and open it in the browser, until `end`, if that is wanted."""
        from ..web.browser import opened_in_browser

        say_where(address)
        if self.open_page:
            end.enter_context(opened_in_browser(address))


@dataclass(frozen=True)
class Results:
    """Options of commands that write a folder of results with a page."""

    output: Output = None
    force: Force = False
    open_page: Open = False
    as_json: Json = False

    def folder(self, source: str | Path, *, resume: bool = False) -> ResultsFolder:
        """Return the folder of a command's results: ``NAME-COMMAND`` in the current directory, or as given.

        Entering it refuses, before any work, a folder with anything that must not be replaced, such as what the command
        was given.

        Parameters
        ----------
        source : str or Path
            What the results are of; a file gives its name without suffix, a folder its name.
        resume : bool
            Whether finished results are completed.
        """
        command = COMMAND.get()
        folder = self.output or default_folder(source, command)
        return ResultsFolder(folder, command, force=self.force, resume=resume, inputs=_inputs("--output"))

    def show(self, result: Result, folder: ResultsFolder, page: str = "report.html", *following: str) -> None:
        """Print a result, where its page and the files beside it are, and the lines that follow."""
        self.print(result, _report_line(folder.folder, page), *following, page=folder.folder / page)

    def print(self, result: Result, *following: str, page: Path) -> None:
        """Print a result and, unless as JSON, the lines that follow; open the page if that is wanted."""
        print_result(result, *following)
        if self.open_page and page.suffix == ".html":
            typer.launch(str(page))


def _report_line(folder: Path, page: str) -> str:
    """Say where a page is, and name the files beside it."""
    written = read_list(folder)
    names = [] if written is None else [file.name for file in written.files if "/" not in file.name]
    others = [name for name in names if name != page]
    more = f"; also {', '.join(others[:-1])}{' and ' if others[1:] else ''}{others[-1]}" if others else ""
    return f"Report: {folder / page}{more}"


#: Length of a name that file systems allow.
_MOST_NAME_BYTES = 255


def default_folder(source: str | Path, command: str) -> Path:
    """Return the folder in which a command writes its results unless another one is given."""
    path = Path(source)
    # The name of "." or ".." is that of the folder it stands for.
    name = path.resolve().name if path.is_dir() else path.name if _has_namesake(path) else path.stem
    while len(os.fsencode(f"{name}-{command}")) > _MOST_NAME_BYTES:
        name = name[:-1]
    return Path(f"{name or 'root'}-{command}")


def _has_namesake(path: Path) -> bool:
    """Whether another picture or video beside a file differs in its suffix alone: night.jpg beside night.png."""
    from ..files import DUMP_SUFFIXES
    from ..files.read import STATED_SUFFIXES
    from ..files.video.open import VIDEO_SUFFIXES

    kinds = {*STATED_SUFFIXES, *DUMP_SUFFIXES, *VIDEO_SUFFIXES}
    if path.suffix.lower() not in kinds:
        return False
    with suppress(OSError):
        return any(
            sibling.stem == path.stem
            and sibling.name != path.name
            and sibling.suffix.lower() in kinds
            and sibling.is_file()
            for sibling in path.absolute().parent.iterdir()
        )
    return False


def output_file(path: Path, force: bool, option: str = "--output") -> Path:
    """Check, before any work, that a file can be written and is no input of the command; see `check_file`."""
    check_file(path, force=force, inputs=_inputs(option), option=option)
    # The files of a session are a record, which no option replaces.
    if os.path.lexists(path) and any((folder / SESSION_JOURNAL).is_file() for folder in path.absolute().parents[:2]):
        raise InputError(f"{option} {path} is part of a recorded session: choose another name")
    return path


def _inputs(option: str) -> Iterator[Path]:
    """Files and folders that a command was given to read, and texts that may name one; not what `option` names."""
    written = _WRITTEN | {option.lstrip("-").lower()}
    for name, value in GIVEN.get().items():
        for path in value if isinstance(value, list | tuple) else (value,):
            if name not in written and isinstance(path, str | Path) and str(path):
                yield Path(path)


@dataclass(frozen=True)
class ClusterOptions:
    """Options for where several videos, or the cells of a sweep, are evaluated.

    Parameters
    ----------
    cluster : ADDRESS
        Address of a Dask scheduler whose workers evaluate, for example tls://192.0.2.7:8786.
    cluster_tls : CA CERTIFICATE KEY
        PEM files for a scheduler at a tls:// address: certificate of the authority, own certificate and key.
    workers
        Number of workers on this computer, for several videos and sweeps; default: one per core.
    """

    cluster: str | None = None
    cluster_tls: tuple[Path, Path, Path] | None = None
    workers: Annotated[int | None, As(least=1)] = None

    def chosen_workers(self) -> Workers:
        """Return the workers of this computer or the cluster."""
        from ..core.cluster import TlsFiles, Workers

        tls = None if self.cluster_tls is None else TlsFiles(*self.cluster_tls)
        workers = Workers(self.cluster, self.workers, tls)
        if workers.is_open_to_others:
            say(
                f"warning: {self.cluster} is not encrypted and has no passwords: anyone on its network can run "
                "programs on all its computers; use tls:// with --cluster-tls, or an isolated network"
            )
        return workers
