import os
from pathlib import Path

import pytest

from labcdp.errors import InputError
from labcdp.evaluate.archive import archive_tasks, evaluate_task
from labcdp.evaluate.archive_record import RECORD, ArchiveTask, NotSeenError, finished_values, record_finished

SETTINGS = {"contrasts": [1.0], "epsilon": 0.5}


@pytest.fixture
def task(tmp_path: Path) -> ArchiveTask:
    (tmp_path / "video.avi").write_bytes(b"frames")
    folder = tmp_path / "results" / "video"
    folder.mkdir(parents=True)
    (folder / "results.nc").write_bytes(b"CDP")
    return ArchiveTask.of(tmp_path / "video.avi", folder)


def test_each_video_gets_a_folder_of_its_own(tmp_path: Path) -> None:
    videos = [tmp_path / name for name in ("day/a.avi", "day/a.mp4", "night/a.avi", "day/b.avi", "c", "x/day/a.avi")]
    tasks = archive_tasks(videos, tmp_path / "out")
    assert [task.folder.name for task in tasks] == ["day-a.avi", "a.mp4", "night-a.avi", "b", "c", "day-a.avi-2"]
    assert [task.video for task in tasks] == videos


def test_no_video_or_one_twice(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"there is no video to evaluate: give files, or a folder"):
        archive_tasks([], tmp_path)
    with pytest.raises(InputError, match=r"a\.avi is given twice: give each video once"):
        archive_tasks([tmp_path / "a.avi", tmp_path / "a.avi"], tmp_path)


def test_what_is_recorded_comes_back(task: ArchiveTask) -> None:
    assert finished_values(task, SETTINGS) is None
    record_finished(task, SETTINGS, {"n_frames": 6, "lowest": float("nan")})
    assert finished_values(task, SETTINGS) == {"n_frames": 6, "lowest": None}
    assert finished_values(ArchiveTask.of(task.video, task.folder), SETTINGS) is not None


def test_other_settings_are_another_evaluation(task: ArchiveTask) -> None:
    record_finished(task, SETTINGS, {})
    assert finished_values(task, SETTINGS | {"epsilon": 0.4}) is None


def test_changed_video_is_evaluated_again(task: ArchiveTask) -> None:
    record_finished(task, SETTINGS, {})
    os.utime(task.video, ns=(1, 1))
    assert finished_values(ArchiveTask.of(task.video, task.folder), SETTINGS) is None


@pytest.mark.parametrize("content", [None, b"CD"])
def test_results_that_are_damaged_are_made_again(task: ArchiveTask, content: bytes | None) -> None:
    record_finished(task, SETTINGS, {})
    result = task.folder / "results.nc"
    result.unlink() if content is None else result.write_bytes(content)
    assert finished_values(task, SETTINGS) is None


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"video": 1}'])
def test_damaged_record_is_none(task: ArchiveTask, content: bytes) -> None:
    (task.folder / RECORD).write_bytes(content)
    assert finished_values(task, SETTINGS) is None


def test_folder_of_images(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for name in ("2.png", "1.png"):
        (tmp_path / "run" / name).write_bytes(name.encode())
    task = ArchiveTask.of(tmp_path / "run", tmp_path / "out")
    assert [name for name, _, _ in task.seen] == ["1.png", "2.png"]
    task.require_visible()


def test_computer_that_does_not_see_the_video(task: ArchiveTask) -> None:
    elsewhere = ArchiveTask(task.video.with_name("away.avi"), task.folder, task.seen)
    message = r"away\.avi cannot be read \(No such file or directory\): put the videos where all workers see them"
    with pytest.raises(NotSeenError, match=message):
        evaluate_task(elsewhere, lambda video, folder: {}, SETTINGS)
    task.video.write_bytes(b"of another disk")
    with pytest.raises(NotSeenError, match=r"video\.avi is another file there than here: put the videos"):
        task.require_visible()


def test_video_that_is_missing_everywhere_is_left_to_the_work(tmp_path: Path) -> None:
    task = ArchiveTask.of(tmp_path / "away.avi", tmp_path)
    assert task.seen == ()
    task.require_visible()


def test_what_was_finished_is_not_done_again(task: ArchiveTask) -> None:
    calls: list[Path] = []

    def work(video: Path, folder: Path) -> dict[str, int]:
        calls.append(video)
        return {"n_frames": 6}

    assert evaluate_task(task, work, SETTINGS) == evaluate_task(task, work, SETTINGS) == {"n_frames": 6}
    assert calls == [task.video]
