"""An archive of videos, evaluated on all cores or on a Dask cluster, each video as it would be alone."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, TypeAlias

from ...core.cluster import Cluster, TlsFiles, open_cluster
from ...core.computer import Processes
from ...core.disk.text import results_json
from ...core.errors import InputError, LabcdpError
from ...core.result import Finding, warning
from ...output import LIST_FILE, ResultsFolder
from .archive_record import ArchiveTask, finished_values, record_finished
from .settings import package_versions

#: Evaluates one video into the folders of the results of its parts, and returns what became of each: the result as
#: `labcdp.report.files` does, or why it failed. It is sent to other processes: a function of a module, or a
#: `functools.partial` of one, with the same results everywhere.
Work: TypeAlias = Callable[[Path, Mapping[str, ResultsFolder]], Mapping[str, Mapping[str, Any] | LabcdpError]]

#: The parts of a video's evaluation, done in one pass.
_Group: TypeAlias = tuple[ArchiveTask, ...]

#: Called with the number of videos done and in total, and the last one (none at the start).
Progress: TypeAlias = Callable[[int, int, "VideoOutcome | None"], None]


@dataclass(frozen=True)
class VideoOutcome:
    """What became of a video.

    Parameters
    ----------
    task : ArchiveTask
        Video and folder.
    values : mapping or None
        What the work returned; None if it failed.
    error : str
        Why it failed, else empty.
    resumed : bool
        Whether the results are of an earlier run.
    """

    task: ArchiveTask
    values: Mapping[str, Any] | None
    error: str = ""
    resumed: bool = False


@dataclass(frozen=True)
class ArchiveResult:
    """What became of an archive.

    Parameters
    ----------
    outcomes : tuple of VideoOutcome
        In the order of the tasks.
    findings : tuple of Finding
        Processes that died, with the video they were at.
    """

    outcomes: tuple[VideoOutcome, ...]
    findings: tuple[Finding, ...] = ()

    @property
    def failures(self) -> tuple[VideoOutcome, ...]:
        """Videos that failed."""
        return tuple(outcome for outcome in self.outcomes if outcome.values is None)


def archive_tasks(videos: Sequence[Path], folder: Path, parts: Sequence[str] = ()) -> tuple[ArchiveTask, ...]:
    """Give each video, and each part of its evaluation, a folder of its own below `folder`, named after it.

    Videos of one name get their suffix, then their folder's name, and at last a number into the name; it does not
    depend on the other videos of the archive unless they have the same name.

    Raises
    ------
    InputError
        If there is no video, or one is given twice.
    """
    paths = [Path(os.path.abspath(path)) for path in videos]
    if not paths:
        raise InputError("there is no video to evaluate: give files, or a folder that holds some")
    if len(set(paths)) < len(paths):
        twice = next(path for path in paths if paths.count(path) > 1)
        raise InputError(f"{twice} is given twice: give each video once")
    names = [path.stem or "video" for path in paths]
    for better in (lambda path: path.name, lambda path: f"{path.parent.name}-{path.name}"):
        names = [better(path) if names.count(name) > 1 else name for path, name in zip(paths, names, strict=True)]
    seen: dict[str, int] = {}
    folders = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        folders.append(Path(os.path.abspath(folder)) / (name if seen[name] == 1 else f"{name}-{seen[name]}"))
    if not parts:
        return tuple(map(ArchiveTask.of, paths, folders))
    named = [re.sub(r"[^\w.-]+", "-", part).strip("-.") or "part" for part in parts]
    named = [f"{number}-{name}" for number, name in enumerate(named, start=1)]
    return tuple(
        ArchiveTask.of(path, one.with_name(f"{one.name}-{name}"), part)
        for path, one in zip(paths, folders, strict=True)
        for name, part in zip(named, parts, strict=True)
    )


def require_same_archive(tasks: Sequence[ArchiveTask], folder: Path) -> None:
    """Refuse a folder with results of videos that are not among those of the tasks.

    Raises
    ------
    InputError
        If there are some.
    """
    names = {path.parent.name for path in folder.glob(f"*/{LIST_FILE}")} - {task.folder.name for task in tasks}
    if names:
        raise InputError(
            f"{folder} has results of other videos, such as {min(names)}: give them too, or another --output"
        )


@dataclass(frozen=True)
class Workers:
    """What evaluates the videos of an archive.

    Parameters
    ----------
    address : str or None
        Of a Dask scheduler, for example tls://192.0.2.7:8786; None for processes of this computer.
    n_processes : int or None
        Processes of this computer; None for one a core.
    tls : TlsFiles or None
        For a cluster at an address ``tls://``.
    """

    address: str | None = None
    n_processes: int | None = None
    tls: TlsFiles | None = None

    def opened(self, folder: Path) -> AbstractContextManager[Cluster[_Group] | Processes[_Group]]:
        """Return the context of workers that write into a folder; raises InputError as `open_cluster`."""
        if self.address is None:
            return nullcontext(Processes[_Group](self.n_processes))
        return open_cluster(self.address, self.tls, folder, package_versions())


def evaluate_archive(
    tasks: Sequence[ArchiveTask],
    work: Work,
    settings: Mapping[str, Any],
    workers: Workers | None = None,
    progress: Progress | None = None,
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
        What evaluates them; None for a process a core.
    progress : callable or None
        See `Progress`.
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
    report: Progress = progress or (lambda _done, _total, _outcome: None)
    recorded = {} if force else {task: finished_values(task, settings) for task in tasks}
    outcomes = {task: VideoOutcome(task, old, resumed=True) for task, old in recorded.items() if old is not None}
    report(len(outcomes), len(tasks), None)
    findings: tuple[Finding, ...] = ()
    left = (task for task in tasks if task not in outcomes)
    groups = [tuple(group) for _, group in groupby(left, lambda task: task.video)]
    if groups:
        folder = Path(os.path.commonpath([task.folder.parent for task in tasks]))
        with (workers or Workers()).opened(folder) as run:
            for group, found, error in run.run(evaluate_task, groups, work, settings, force, inputs):
                for outcome in found or [VideoOutcome(task, None, _reason(error)) for task in group]:
                    outcomes[outcome.task] = outcome
                    report(len(outcomes), len(tasks), outcome)
            findings = _of_died(run)
    return ArchiveResult(tuple(outcomes[task] for task in tasks), findings)


def evaluate_task(
    group: _Group, work: Work, settings: Mapping[str, Any], force: bool = False, inputs: Sequence[Path] = ()
) -> tuple[VideoOutcome, ...]:
    """Evaluate a video in one pass, and record what is finished; what is recorded already is not done again.

    Raises
    ------
    NotSeenError
        If this computer does not see the video as it was seen where the archive was begun.
    LabcdpError
        What the work raises.
    """
    group[0].require_visible()
    # A worker may be asked again for what was finished just before another one died.
    done = {task: None if force else finished_values(task, settings) for task in group}
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
        found = work(group[0].video, folders) if left else {}
        for task in left:
            new = found[task.part]
            if isinstance(new, LabcdpError):
                # The other parts keep their results.
                ends[task].__exit__(type(new), new, None)
                outcomes[task] = VideoOutcome(task, None, _reason(new))
                continue
            # As it is read back from the record.
            values = json.loads(results_json(dict(new)))
            record_finished(task, settings, values, folders[task.part])
            outcomes[task] = VideoOutcome(task, values)
    return tuple(outcomes[task] for task in group)


def _of_died(run: Cluster[_Group] | Processes[_Group]) -> tuple[Finding, ...]:
    died = run.died if isinstance(run, Processes) else []
    return tuple(warning("worker-died", f"process {pid}", video=str(group[0].video)) for pid, group in died)


def _reason(error: BaseException | None) -> str:
    """Say why a video failed, in one line."""
    text = " ".join(str(error).split())
    if isinstance(error, LabcdpError):
        return text
    if isinstance(error, MemoryError):
        return "there is not enough memory for it: use fewer workers"
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
