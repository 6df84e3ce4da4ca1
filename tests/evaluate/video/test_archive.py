"""An archive of videos: what is finished stays so, and all processes and clusters do as one by one."""

import os
import shutil
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import psutil
import pytest
import xarray as xr

from labcdp.cli.pictures.video import VideoOptions, evaluate_values
from labcdp.core.cluster import TlsFiles, Workers
from labcdp.core.computer import Processes
from labcdp.core.errors import InputError, LabcdpError
from labcdp.evaluate.sweep.plan import Axis, Sweep
from labcdp.evaluate.sweep.run import run_sweep
from labcdp.evaluate.video.archive import (
    RECORD,
    ArchiveResult,
    ArchiveTask,
    archive_tasks,
    evaluate_archive,
    evaluate_task,
)
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings
from labcdp.output import ResultsFolder

from ...conftest import wait_until
from ..sweep.chains import small
from .videos import MOVING, STILL, driving, write


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two videos of a target that moves, and a file that is none."""
    folder = tmp_path_factory.mktemp("videos")
    for seed, name in enumerate(("first.avi", "second.avi")):
        write(folder / name, driving(12, 1, 2.0, seed), "MJPG")
    (folder / "third.avi").touch()
    return sorted(folder.iterdir())


def evaluate_videos(videos: list[Path], settings: VideoSettings, folder: Path, **options: Any) -> ArchiveResult:
    """Evaluate as the command does."""
    work = partial(evaluate_values, {"": settings}, VideoOptions())
    return evaluate_archive(archive_tasks(videos, folder), work, {"contrasts": settings.contrasts}, **options)


def assert_as_one_by_one(result: ArchiveResult, videos: list[Path], settings: VideoSettings) -> None:
    assert [outcome.task.video for outcome in result.outcomes] == videos
    for outcome in result.outcomes[:2]:
        assert outcome.error == ""
        with xr.open_dataset(outcome.task.folder / "results.nc") as found:
            xr.testing.assert_identical(found.load(), evaluate_video(outcome.task.video, settings))
    (failure,) = result.failures
    assert failure.task.video.name == "third.avi"
    assert "third.avi" in failure.error


def test_processes_of_this_computer_do_as_one_by_one(videos: list[Path], tmp_path: Path) -> None:
    settings = VideoSettings((0.5, 3.0), (MOVING, STILL), method="follow", reference="first")
    told: list[tuple[int, int]] = []
    result = evaluate_videos(
        videos, settings, tmp_path, workers=Workers(n_workers=2), progress=lambda *one: told.append(one)
    )
    assert_as_one_by_one(result, videos, settings)
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    written = (tmp_path / "first" / "results.nc").stat().st_mtime_ns
    # Nothing is left to do, so that no process is started.
    again = evaluate_videos(videos[:2], settings, tmp_path)
    assert [outcome.resumed for outcome in again.outcomes] == [True, True]
    assert again.outcomes[0].values == result.outcomes[0].values
    assert (tmp_path / "first" / "results.nc").stat().st_mtime_ns == written


def test_workers_that_die_are_named_and_their_videos_tried_once_more_without_a_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = """
        import os
        import psutil

        def work(video, folders):
            kind = video.read_text()
            if kind == "always" or (kind == "once" and not video.with_suffix(".tried").exists()):
                video.with_suffix(".tried").touch()
                os._exit(9)
            family = [psutil.Process(), psutil.Process(os.getppid())]
            ports = [one for process in family for one in process.net_connections() if one.status == "LISTEN"]
            return {"": {"kind": kind, "ports": len(ports)}}
        """
    (tmp_path / "archive_work.py").write_text(textwrap.dedent(module))
    monkeypatch.syspath_prepend(tmp_path)
    from archive_work import work

    for kind in ("always", "good", "once"):
        (tmp_path / f"{kind}.avi").write_text(kind)
    tasks = archive_tasks(sorted(tmp_path.glob("*.avi")), tmp_path / "results")
    result = evaluate_archive(tasks, work, {}, Workers(n_workers=1))
    always, good, once = result.outcomes
    assert always.error.endswith("or evaluate this file alone")
    assert (good.values, once.values) == ({"kind": "good", "ports": 0}, {"kind": "once", "ports": 0})
    died = [Path(str(one.values["video"])).name for one in result.findings if one.code == "worker-died"]
    assert sorted(died) == ["always.avi", "always.avi", "once.avi"]


def test_workers_end_with_a_process_that_is_killed(tmp_path: Path) -> None:
    module = """
        import os, time
        from pathlib import Path
        from labcdp.core.computer import Processes

        def work(folder):
            Path(folder, "new").write_text(str(os.getpid()))
            Path(folder, "new").rename(Path(folder, "worker"))
            time.sleep(900)

        if __name__ == "__main__":
            import sys
            list(Processes(1).run(work, [sys.argv[1]]))
        """
    (tmp_path / "program.py").write_text(textwrap.dedent(module))
    with subprocess.Popen([sys.executable, tmp_path / "program.py", tmp_path]) as process:
        wait_until((tmp_path / "worker").exists, "the worker works")
        worker = psutil.Process(int((tmp_path / "worker").read_text()))
        process.kill()
    wait_until(lambda: not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE, "the worker ended")


@pytest.fixture
def cluster(tmp_path: Path) -> Any:
    """Scheduler and worker with TLS: address and certificates."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=labcdp", "-days", "2"]
    subprocess.run([*request, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    dask = (sys.executable, "-m", "dask")
    options = ["--no-dashboard", "--host", "tls://127.0.0.1", "--tls-ca-file", certificate]
    options += ["--tls-cert", certificate, "--tls-key", key]
    address = f"tls://127.0.0.1:{port}"
    with (
        subprocess.Popen([*dask, "scheduler", "--port", str(port), *options], stderr=subprocess.DEVNULL) as scheduler,
        subprocess.Popen(
            [*dask, "worker", address, "--nthreads", "1", "--no-nanny", *options], stderr=subprocess.DEVNULL
        ) as worker,
    ):
        until = time.monotonic() + 300
        while time.monotonic() < until:
            with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
                break
            time.sleep(0.1)
        yield address, TlsFiles(certificate, certificate, key)
        worker.kill()
        scheduler.kill()


@pytest.mark.long
def test_cluster_with_certificates_until_its_only_worker_dies(
    videos: list[Path], tmp_path: Path, cluster: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    address, tls = cluster
    settings = VideoSettings((0.2, 1.0))
    monkeypatch.setattr("labcdp.core.cluster._WORKER_S", 300)
    with_tls = Workers(address, tls=tls)
    assert_as_one_by_one(evaluate_videos(videos, settings, tmp_path / "a", workers=with_tls), videos, settings)
    sweep = Sweep(small(), (Axis("scene.contrast", (0.2, 1.0)),), exact=False, seed=5)
    assert run_sweep(sweep, workers=with_tls).identical(run_sweep(sweep))
    other = tmp_path / "other.pem"
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=other", "-days", "2"]
    subprocess.run([*request, "-keyout", tmp_path / "other-key.pem", "-out", other], check=True, capture_output=True)
    for wrong in (TlsFiles(other, other, tmp_path / "other-key.pem"), replace(tls, key=tmp_path / "other-key.pem")):
        with pytest.raises(InputError, match=r"certificates of this computer and of the scheduler at .* do not match"):
            evaluate_videos(videos, settings, tmp_path / "b", workers=Workers(address, tls=wrong))
    with pytest.raises(InputError, match=r"an address that begins with tls://"):
        evaluate_videos(videos, settings, tmp_path / "b", workers=Workers(address))
    with with_tls.opened(Processes, tmp_path / "c", {}) as opened:
        monkeypatch.setattr("labcdp.core.cluster._WORKER_S", 3)
        with pytest.raises(InputError, match="the cluster has had no worker for 3 s: start workers, and try again"):
            list(opened.run(os._exit, [1]))


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


@pytest.mark.parametrize(
    ("address", "is_open"),
    [(None, False), ("tcp://127.0.0.1:8786", False), ("tcp://[::1]:8786", False), ("tcp://192.0.2.7:8786", True)],
)
def test_a_cluster_without_encryption_is_warned_of(address: str | None, is_open: bool) -> None:
    assert Workers(address).is_open_to_others is is_open
