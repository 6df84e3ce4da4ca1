"""An archive of videos, evaluated on all cores or on a Dask cluster, each video as it would be alone."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

from pydantic import BaseModel, ConfigDict

from ...core.cluster import Workers
from ...core.computer import Processes
from ...core.disk import open_regular, read_json, validated_as
from ...core.disk.files import plain_name
from ...core.disk.text import results_json
from ...core.errors import InputError, LabcdpError
from ...core.result import Finding, warning
from ...output import LIST_FILE, ResultsFolder
from ...output.file import is_temporary
from ...output.folder import is_staging, read_list
from .settings import package_versions

#: Evaluates one video into the folders of the results of its parts, and returns what became of each: the result as
#: `labcdp.report.files` does, or why it failed. It is sent to other processes: a function of a module, or a
#: `functools.partial` of one, with the same results everywhere.
Work: TypeAlias = Callable[[Path, Mapping[str, ResultsFolder]], Mapping[str, Mapping[str, Any] | LabcdpError]]
#: The parts of a video's evaluation, done in one pass.
_Group: TypeAlias = "tuple[ArchiveTask, ...]"
RECORD = "finished.json"


class _Record(BaseModel):
    """Record of a finished video: hashes of video and settings, and the results."""

    model_config = ConfigDict(extra="forbid")
    video: str
    settings: str
    values: dict[str, Any]


class NotSeenError(InputError):
    """A computer does not see the video that another one sees under the same path."""


@dataclass(frozen=True)
class ArchiveTask:
    """A video of an archive.

    Parameters
    ----------
    video : Path
        File, or folder of images or of a session.
    folder : Path
        For its results; no other video's.
    part : str
        Name of the part of the evaluation, such as a pair of regions; empty for the only one.
    seen : tuple of (str, int, int)
        Name, size and time of change (in ns) of the video, or of each file in its folder; none if it is not there.
    """

    video: Path
    folder: Path
    part: str = ""
    seen: tuple[tuple[str, int, int], ...] = ()

    @classmethod
    def of(cls, video: Path, folder: Path, part: str = "") -> ArchiveTask:
        """Make the task of a video; a file that cannot be read fails later, in its evaluation."""
        try:
            return cls(video, folder, part, tuple(_files(video)))
        except OSError:
            return cls(video, folder, part)

    def require_visible(self) -> None:
        """Raise NotSeenError if this computer does not see the video as it was seen where the archive was begun."""
        if not self.seen:
            return
        remedy = "put the videos where all workers see them under the same path"
        try:
            here = tuple(_files(self.video))
            with open_regular(self.video if self.video.is_file() else self.video / here[0][0]) as file:
                file.read(1)
        except (OSError, IndexError) as error:
            why = error.strerror if isinstance(error, OSError) else "empty folder"
            raise NotSeenError(f"{self.video} cannot be read ({why}): {remedy}") from error
        if [entry[:2] for entry in here] != [entry[:2] for entry in self.seen]:
            raise NotSeenError(f"{self.video} differs between the worker and this computer: {remedy}")

    def finished(self, settings: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the recorded results; None if video, settings, labcdp or a file of the results changed since."""
        try:
            record = validated_as(_Record, read_json(self.folder / RECORD, "a record of a finished video"))
            listed = read_list(self.folder)
            files = () if listed is None else listed.files
            whole = bool(files) and all((self.folder / file.name).stat().st_size == file.size for file in files)
        except (OSError, ValueError):
            return None
        same = {"video": record.video, "settings": record.settings} == self._hashes(settings)
        return record.values if same and whole and self.seen else None

    def record(self, settings: Mapping[str, Any], values: Mapping[str, Any], results: ResultsFolder) -> None:
        """Add the record of the finished video to its results; raises InputError if it cannot be written."""
        results.add({RECORD: results_json({**self._hashes(settings), "values": dict(values)}).encode()})

    def _hashes(self, settings: Mapping[str, Any]) -> dict[str, str]:
        seen = [str(self.video), *([self.part] if self.part else []), *self.seen]
        known = {"video": seen, "settings": {"settings": settings, "labcdp": version("labcdp")}}
        return {name: hashlib.sha256(results_json(values).encode()).hexdigest() for name, values in known.items()}


def _files(path: Path) -> Iterator[tuple[str, int, int]]:
    """Names, sizes and times of change of a file, or of all files in a folder, in order."""
    paths = sorted(file for file in path.rglob("*") if file.is_file()) if path.is_dir() else [path]
    for member in paths:
        if not is_temporary(member):
            state = member.stat()
            name = member.relative_to(path).as_posix() if member != path else member.name
            yield name, state.st_size, state.st_mtime_ns


@dataclass(frozen=True)
class VideoOutcome:
    """Outcome of a video: what the work returned, or None and why it failed; `resumed` if in an earlier run."""

    task: ArchiveTask
    values: Mapping[str, Any] | None
    error: str = ""
    resumed: bool = False


@dataclass(frozen=True)
class ArchiveResult:
    """Outcome of an archive, in the order of the tasks, and findings about processes that died, with their videos."""

    outcomes: tuple[VideoOutcome, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def failures(self) -> tuple[VideoOutcome, ...]:
        """Videos that failed."""
        return tuple(outcome for outcome in self.outcomes if outcome.values is None)


def archive_tasks(videos: Sequence[Path], folder: Path, parts: Sequence[str] = ()) -> tuple[ArchiveTask, ...]:
    """Give each video, and each part of its evaluation, a folder of its own below `folder`, named after it.

    Videos of one name get their suffix, then their folder's name, and at last a number into the name; it does not
    depend on the other videos of the archive unless they have the same name. Raises InputError if there is no video,
    or one is given twice.
    """
    paths = [Path(os.path.abspath(path)) for path in videos]
    if not paths:
        raise InputError("there is no video to evaluate: give files, or a folder that contains some")
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise InputError(f"{twice} is given twice: give each video once")
    names = [path.stem or "video" for path in paths]
    for better in (lambda path: path.name, lambda path: f"{path.parent.name}-{path.name}"):
        names = [better(path) if names.count(name) > 1 else name for path, name in zip(paths, names, strict=True)]
    before = [names[:index].count(name) for index, name in enumerate(names)]
    names = [f"{name}-{n + 1}" if n else name for name, n in zip(names, before, strict=True)]
    named = [re.sub(r"[^\w.-]+", "-", part).strip("-.") or "part" for part in parts]
    ends = {part: f"-{number}-{name}" for number, (part, name) in enumerate(zip(parts, named, strict=True), start=1)}
    below = Path(os.path.abspath(folder))
    return tuple(
        ArchiveTask.of(path, below / f"{plain_name(name)}{end}", part)
        for path, name in zip(paths, names, strict=True)
        for part, end in (ends or {"": ""}).items()
    )


def require_same_archive(tasks: Sequence[ArchiveTask], folder: Path) -> None:
    """Refuse a folder with results of videos that are not among the tasks; raises InputError."""
    finished = {path.parent for path in folder.glob(f"*/{LIST_FILE}")}
    others = {path.name for path in finished if not is_staging(path)} - {task.folder.name for task in tasks}
    if others:
        remedy = "give them too, or another folder"
        raise InputError(f"{folder} has results of other videos, such as {min(others)}: {remedy}")


def evaluate_archive(
    tasks: Sequence[ArchiveTask],
    work: Work,
    settings: Mapping[str, Any],
    workers: Workers | None = None,
    progress: Callable[[int, int], None] | None = None,
    *,
    force: bool = False,
    inputs: Sequence[Path] = (),
) -> ArchiveResult:
    """Evaluate all videos of an archive that are not evaluated yet.

    Each video is evaluated by one process with one thread, so results are those of one video after the other, bit for
    bit. A failing one does not keep the others from being evaluated; one whose worker dies is tried once more. What is
    finished is recorded in the video's folder, and not done again with the same settings.

    Parameters
    ----------
    tasks : sequence of ArchiveTask
        Videos and the folders of their results; on a cluster all workers must see both under the same path.
    work : callable
        See `Work`.
    settings : mapping
        All inputs of the results other than the video; JSON.
    workers : Workers or None
        Workers that evaluate the videos; None for a process a core.
    progress : callable or None
        Called with the number of videos done and in total.
    force : bool
        Whether finished videos are evaluated again and their results replaced.
    inputs : sequence of Path
        Other files that are read, and never replaced.

    Raises
    ------
    InputError
        If the cluster cannot be reached, its workers have another version of labcdp, or do not see the folder.
    KeyboardInterrupt
        After what runs was stopped; finished videos are recorded.
    """
    report = progress or (lambda _done, _total: None)
    recorded = {} if force else {task: task.finished(settings) for task in tasks}
    outcomes = {task: VideoOutcome(task, old, resumed=True) for task, old in recorded.items() if old is not None}
    report(len(outcomes), len(tasks))
    findings: tuple[Finding, ...] = ()
    left = (task for task in tasks if task not in outcomes)
    groups = [tuple(group) for _, group in groupby(left, lambda task: task.video)]
    if groups:
        folder = Path(os.path.commonpath([task.folder.parent for task in tasks]))
        with (workers or Workers()).opened(Processes[_Group], folder, package_versions()) as run:
            for group, outcomes_of_group, error in run.run(evaluate_task, groups, work, settings, force, inputs):
                for outcome in outcomes_of_group or [VideoOutcome(task, None, _reason(error)) for task in group]:
                    outcomes[outcome.task] = outcome
                    report(len(outcomes), len(tasks))
            died = run.died if isinstance(run, Processes) else []
            findings = tuple(warning("worker-died", f"process {pid}", video=str(group[0].video)) for pid, group in died)
    return ArchiveResult(tuple(outcomes[task] for task in tasks), findings)


def evaluate_task(
    group: _Group, work: Work, settings: Mapping[str, Any], force: bool = False, inputs: Sequence[Path] = ()
) -> tuple[VideoOutcome, ...]:
    """Evaluate a video in one pass, and record what is finished; what is recorded already is not done again."""
    group[0].require_visible()
    # A worker may be asked again for what was finished just before another one died.
    done = {task: None if force else task.finished(settings) for task in group}
    outcomes = {task: VideoOutcome(task, values) for task, values in done.items() if values is not None}
    left = [task for task in group if task not in outcomes]
    with ExitStack() as stack:
        ends = {task: stack.enter_context(ExitStack()) for task in left}
        folders = {
            task.part: ends[task].enter_context(
                ResultsFolder(task.folder, "video", force=force, resume=True, inputs=(task.video, *inputs))
            )
            for task in left
        }
        results = work(group[0].video, folders) if left else {}
        for task in left:
            new = results[task.part]
            if isinstance(new, LabcdpError):
                # The other parts keep their results.
                ends[task].__exit__(type(new), new, None)
                outcomes[task] = VideoOutcome(task, None, _reason(new))
                continue
            # As it is read back from the record.
            values = json.loads(results_json(dict(new)))
            task.record(settings, values, folders[task.part])
            outcomes[task] = VideoOutcome(task, values)
    return tuple(outcomes[task] for task in group)


def _reason(error: BaseException | None) -> str:
    """Say why a video failed, in one line."""
    text = " ".join(str(error).split())
    if isinstance(error, LabcdpError):
        return text
    if isinstance(error, MemoryError):
        return "there is not enough memory for it: use fewer workers"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
