import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from labcdp.core.errors import LabcdpError
from labcdp.evaluate.video.archive import RECORD, ArchiveTask, archive_tasks, evaluate_task
from labcdp.output import ResultsFolder

SETTINGS = {"contrasts": [1.0], "epsilon": 0.5}


@pytest.fixture
def task(tmp_path: Path) -> ArchiveTask:
    (tmp_path / "video.avi").write_bytes(b"frames")
    return ArchiveTask.of(tmp_path / "video.avi", tmp_path / "results" / "video")


def finish(task: ArchiveTask, values: dict[str, Any]) -> None:
    with ResultsFolder(task.folder, "video") as results:
        results.add({"results.nc": b"CDP"})
        task.record(SETTINGS, values, results)


def test_each_video_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    videos = [tmp_path / name for name in ("day/a.avi", "day/a.mp4", "night/a.avi", "day/b.avi", "c", "x/day/a.avi")]
    tasks = archive_tasks(videos, tmp_path / "out")
    assert [task.folder.name for task in tasks] == ["day-a.avi", "a.mp4", "night-a.avi", "b", "c", "day-a.avi-2"]
    assert [task.video for task in tasks] == videos


@pytest.mark.parametrize(
    ("name", "content"),
    [("results.nc", None), ("results.nc", b"CD"), *((RECORD, text) for text in (b"", b"{", b"[]", b'{"video": 1}'))],
)
def test_what_is_damaged_or_of_another_video_or_settings_is_not_finished(
    task: ArchiveTask, name: str, content: bytes | None
) -> None:
    finish(task, {})
    assert task.finished(SETTINGS) == {}
    assert task.finished(SETTINGS | {"epsilon": 0.4}) is None
    (task.folder / name).unlink() if content is None else (task.folder / name).write_bytes(content)
    assert task.finished(SETTINGS) is None
    finish(replace(task, folder=task.folder.with_name("again")), {})
    os.utime(task.video, ns=(1, 1))
    assert ArchiveTask.of(task.video, task.folder.with_name("again")).finished(SETTINGS) is None


def test_what_was_finished_is_not_done_again(task: ArchiveTask) -> None:
    calls: list[Path] = []

    def work(video: Path, folders: Mapping[str, ResultsFolder]) -> dict[str, dict[str, int]]:
        calls.append(video)
        return {part: {"n_frames": 6} for part in folders}

    first, again = (evaluate_task((task,), work, SETTINGS)[0].values for _ in range(2))
    assert first == again == {"n_frames": 6}
    assert calls == [task.video]


def test_a_part_that_fails_leaves_the_others_their_results(task: ArchiveTask) -> None:
    tasks = archive_tasks([task.video], task.folder.parent, ("a:b", "c:d"))

    def work(video: Path, folders: Mapping[str, ResultsFolder]) -> dict[str, dict[str, int] | LabcdpError]:
        for results in folders.values():
            results.add({"results.nc": b"CDP"})
        return {"a:b": LabcdpError("no frame could be evaluated"), "c:d": {"n_frames": 6}}

    bad, good = evaluate_task(tasks, work, SETTINGS)
    assert (bad.values, bad.error) == (None, "no frame could be evaluated")
    assert good.values == {"n_frames": 6}
    assert (good.task.folder / "results.nc").exists()
    assert not (bad.task.folder / "results.nc").exists()
