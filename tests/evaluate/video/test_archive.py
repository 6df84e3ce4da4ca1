import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import pytest

from labcdp.core.errors import LabcdpError
from labcdp.evaluate.video.archive import RECORD, ArchiveTask, archive_tasks, evaluate_task
from labcdp.output import ResultsFolder

SETTINGS = {"contrasts": [1.0], "epsilon": 0.5}


def work(video: Path, folders: Mapping[str, ResultsFolder]) -> dict[str, dict[str, int] | LabcdpError]:
    """Fail the first of several parts."""
    for results in folders.values():
        results.add({"results.nc": b"CDP"})
    first = {next(iter(folders)): LabcdpError("no frame could be evaluated")} if len(folders) > 1 else {}
    return {part: {"n_frames": 6} for part in folders} | first


@pytest.fixture
def task(tmp_path: Path) -> ArchiveTask:
    (tmp_path / "video.avi").write_bytes(b"frames")
    return ArchiveTask.of(tmp_path / "video.avi", tmp_path / "results" / "video")


def test_each_video_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    videos = [tmp_path / name for name in ("day/a.avi", "day/a.mp4", "night/a.avi", "day/b.avi", "c", "x/day/a.avi")]
    tasks = archive_tasks(videos, tmp_path / "out")
    assert [task.folder.name for task in tasks] == ["day-a.avi", "a.mp4", "night-a.avi", "b", "c", "day-a.avi-2"]
    assert [task.video for task in tasks] == videos


@pytest.mark.parametrize(
    ("name", "content"),
    [("results.nc", None), ("results.nc", b"CD"), *((RECORD, text) for text in (b"", b"{", b"[]", b'{"video": 1}'))],
)
def test_only_what_is_whole_and_of_the_same_video_and_settings_is_finished(
    task: ArchiveTask, name: str, content: bytes | None
) -> None:
    (first,) = evaluate_task((task,), work, SETTINGS)
    assert task.finished(SETTINGS) == first.values == {"n_frames": 6}
    # What is finished is not done again.
    assert evaluate_task((task,), lambda *_: pytest.fail("done again"), SETTINGS)[0].values == first.values
    assert task.finished(SETTINGS | {"epsilon": 0.4}) is None
    (task.folder / name).unlink() if content is None else (task.folder / name).write_bytes(content)
    assert task.finished(SETTINGS) is None
    again = replace(task, folder=task.folder.with_name("again"))
    evaluate_task((again,), work, SETTINGS)
    os.utime(task.video, ns=(1, 1))
    assert ArchiveTask.of(task.video, again.folder).finished(SETTINGS) is None


def test_a_part_that_fails_leaves_the_others_their_results(task: ArchiveTask) -> None:
    bad, good = evaluate_task(archive_tasks([task.video], task.folder.parent, ("a:b", "c:d")), work, SETTINGS)
    assert (bad.values, bad.error) == (None, "no frame could be evaluated")
    assert good.values == {"n_frames": 6}
    assert (good.task.folder / "results.nc").exists()
    assert not (bad.task.folder / "results.nc").exists()
