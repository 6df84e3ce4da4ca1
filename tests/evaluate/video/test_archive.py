import os
from pathlib import Path
from typing import Any

import pytest

from labcdp.evaluate.video.archive.evaluate import archive_tasks, evaluate_task
from labcdp.evaluate.video.archive.record import RECORD, ArchiveTask, finished_values, record_finished
from labcdp.output import ResultsFolder

SETTINGS = {"contrasts": [1.0], "epsilon": 0.5}


@pytest.fixture
def task(tmp_path: Path) -> ArchiveTask:
    (tmp_path / "video.avi").write_bytes(b"frames")
    return ArchiveTask.of(tmp_path / "video.avi", tmp_path / "results" / "video")


def finish(task: ArchiveTask, values: dict[str, Any]) -> None:
    with ResultsFolder(task.folder, "video") as results:
        results.add({"results.nc": b"CDP"})
        record_finished(task, SETTINGS, values, results)


def test_each_video_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    videos = [tmp_path / name for name in ("day/a.avi", "day/a.mp4", "night/a.avi", "day/b.avi", "c", "x/day/a.avi")]
    tasks = archive_tasks(videos, tmp_path / "out")
    assert [task.folder.name for task in tasks] == ["day-a.avi", "a.mp4", "night-a.avi", "b", "c", "day-a.avi-2"]
    assert [task.video for task in tasks] == videos


def test_other_settings_are_another_evaluation(task: ArchiveTask) -> None:
    finish(task, {})
    assert finished_values(task, SETTINGS | {"epsilon": 0.4}) is None


def test_changed_video_is_evaluated_again(task: ArchiveTask) -> None:
    finish(task, {})
    os.utime(task.video, ns=(1, 1))
    assert finished_values(ArchiveTask.of(task.video, task.folder), SETTINGS) is None


@pytest.mark.parametrize("content", [None, b"CD"])
def test_results_that_are_damaged_are_not_finished(task: ArchiveTask, content: bytes | None) -> None:
    finish(task, {})
    result = task.folder / "results.nc"
    result.unlink() if content is None else result.write_bytes(content)
    assert finished_values(task, SETTINGS) is None


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"video": 1}'])
def test_damaged_record_is_none(task: ArchiveTask, content: bytes) -> None:
    finish(task, {})
    (task.folder / RECORD).write_bytes(content)
    assert finished_values(task, SETTINGS) is None


def test_what_was_finished_is_not_done_again(task: ArchiveTask) -> None:
    calls: list[Path] = []

    def work(video: Path, results: ResultsFolder) -> dict[str, int]:
        calls.append(video)
        return {"n_frames": 6}

    assert evaluate_task(task, work, SETTINGS) == evaluate_task(task, work, SETTINGS) == {"n_frames": 6}
    assert calls == [task.video]
