import os
import shutil
import socket
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import xarray as xr

from labcdp.cli.pictures.options import MadeOptions
from labcdp.cli.pictures.video import evaluate_values
from labcdp.core.cluster import TlsFiles, open_cluster
from labcdp.core.errors import InputError
from labcdp.core.roi import Roi
from labcdp.evaluate.video.archive import ArchiveResult, Workers, archive_tasks, evaluate_archive
from labcdp.evaluate.video.evaluate import evaluate_video
from labcdp.evaluate.video.settings import VideoSettings

ROIS = (Roi.rectangle("bright", 22, 22, 16, 16), Roi.rectangle("dark", 42, 22, 16, 16))


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two videos of a target that moves, and a file that is none."""
    folder = tmp_path_factory.mktemp("videos")
    for seed, name in enumerate(("first.avi", "second.avi")):
        rng = np.random.default_rng(seed)
        writer = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*"MJPG"), 25, (96, 64))
        for place in range(12):
            frame = np.full((64, 96), 90.0)
            frame[20:40, 20 + place : 40 + place] = 200
            frame[20:40, 40 + place : 60 + place] = 30
            noisy = np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8)
            writer.write(cv2.cvtColor(noisy, cv2.COLOR_GRAY2BGR))
        writer.release()
    (folder / "third.avi").touch()
    return sorted(folder.iterdir())


def evaluate_videos(videos: list[Path], settings: VideoSettings, folder: Path, **options: Any) -> ArchiveResult:
    """Evaluate as the command does."""
    work = partial(evaluate_values, {"": settings}, MadeOptions(annotated=False, frames=False))
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
    settings = VideoSettings((0.5, 3.0), ROIS, method="follow", reference="first")
    told: list[tuple[int, int]] = []
    result = evaluate_videos(
        videos, settings, tmp_path, workers=Workers(n_processes=2), progress=lambda *one: told.append(one)
    )
    assert_as_one_by_one(result, videos, settings)
    assert told == [(0, 3), (1, 3), (2, 3), (3, 3)]
    written = (tmp_path / "first" / "results.nc").stat().st_mtime_ns
    # Nothing is left to do, so that no process is started.
    again = evaluate_videos(videos[:2], settings, tmp_path)
    assert [outcome.resumed for outcome in again.outcomes] == [True, True]
    assert again.outcomes[0].values == result.outcomes[0].values
    assert (tmp_path / "first" / "results.nc").stat().st_mtime_ns == written


def test_workers_that_die_are_named_and_their_videos_tried_once_more(
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
            if kind == "error":
                raise ValueError("surprise")
            family = [psutil.Process(), psutil.Process(os.getppid())]
            ports = [one for process in family for one in process.net_connections() if one.status == "LISTEN"]
            return {"": {"kind": kind, "ports": len(ports)}}
        """
    (tmp_path / "archive_work.py").write_text(textwrap.dedent(module))
    monkeypatch.syspath_prepend(tmp_path)
    from archive_work import work

    for kind in ("always", "error", "good", "once"):
        (tmp_path / f"{kind}.avi").write_text(kind)
    tasks = archive_tasks(sorted(tmp_path.glob("*.avi")), tmp_path / "results")
    result = evaluate_archive(tasks, work, {}, Workers(n_processes=1))
    always, error, good, once = result.outcomes
    assert always.error.endswith("or evaluate this file alone")
    assert "died, as did one before" in always.error
    assert error.error == "ValueError: surprise"
    assert (good.values, once.values) == ({"kind": "good", "ports": 0}, {"kind": "once", "ports": 0})
    assert all(one.subject.startswith("process ") for one in result.findings)
    died = [Path(str(one.values["video"])).name for one in result.findings if one.code == "worker-died"]
    assert sorted(died) == ["always.avi", "always.avi", "once.avi"]


@pytest.fixture
def programs() -> Iterator[ExitStack]:
    """Programs that end with the test."""
    with ExitStack() as stack:
        yield stack


def start(programs: ExitStack, *command: str) -> int:
    """Start a program and return its number."""
    program = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    programs.callback(program.wait)
    programs.callback(program.kill)
    return program.pid


def free_port() -> int:
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        return int(listening.getsockname()[1])


def make_certificate(folder: Path) -> TlsFiles:
    """Make a certificate that is its own authority."""
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    request = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=labcdp", "-days", "2"]
    subprocess.run([*request, "-keyout", key, "-out", certificate], check=True, capture_output=True)
    return TlsFiles(certificate, certificate, key)


def start_cluster(programs: ExitStack, blind: Path | None, tls: TlsFiles | None = None) -> tuple[str, int]:
    """Start a scheduler and a worker, which may not see a folder, as on a computer without it.

    Return the scheduler's address and the number of its process.
    """
    port = free_port()
    address = f"{'tcp' if tls is None else 'tls'}://127.0.0.1:{port}"
    dask = (sys.executable, "-m", "dask")
    quiet: tuple[str, ...] = ("--no-dashboard", "--host", address.rpartition(":")[0])
    if tls is not None:
        quiet += ("--tls-ca-file", str(tls.ca), "--tls-cert", str(tls.certificate), "--tls-key", str(tls.key))
    number = start(programs, *dask, "scheduler", "--port", str(port), *quiet)
    worker = (*dask, "worker", address, "--nthreads", "1", "--no-nanny", *quiet)
    script = 'mount -t tmpfs none "$0" && exec "$@"'
    start(programs, *(() if blind is None else ("unshare", "--mount", "sh", "-c", script, str(blind))), *worker)
    until = time.monotonic() + 300
    while time.monotonic() < until:
        with suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
            return address, number
        time.sleep(0.1)
    raise AssertionError("the scheduler does not listen")


def may_mount(folder: Path) -> bool:
    command = ["unshare", "--mount", "mount", "-t", "tmpfs", "none", str(folder)]
    return os.geteuid() == 0 and shutil.which("unshare") is not None and subprocess.run(command).returncode == 0


def test_a_worker_that_does_not_see_the_folder_is_refused(
    videos: list[Path], tmp_path: Path, programs: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "results"
    folder.mkdir()
    if not may_mount(folder):
        pytest.skip("only root may mount")
    monkeypatch.setattr("labcdp.core.cluster._WORKER_S", 300)
    address, _ = start_cluster(programs, folder)
    with pytest.raises(InputError, match=rf"worker tcp://\S+ does not see the folder {folder}: give a folder that all"):
        evaluate_videos(videos, VideoSettings((0.2, 1.0)), folder, workers=Workers(address))
    assert not list(folder.iterdir())


def test_cluster_with_certificates_until_its_only_worker_dies(
    videos: list[Path], tmp_path: Path, programs: ExitStack, monkeypatch: pytest.MonkeyPatch
) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("openssl is not installed")
    tls = make_certificate(tmp_path)
    address, _ = start_cluster(programs, None, tls)
    settings = VideoSettings((0.2, 1.0))
    assert_as_one_by_one(
        evaluate_videos(videos, settings, tmp_path / "a", workers=Workers(address, tls=tls)), videos, settings
    )
    with pytest.raises(InputError, match=r"give its TLS files with an address that begins with tls://"):
        evaluate_videos(videos, settings, tmp_path / "b", workers=Workers(address))
    with pytest.raises(InputError, match=r"no Dask scheduler answers at nonsense://x"):
        evaluate_videos(videos, settings, tmp_path, workers=Workers("nonsense://x"))
    with pytest.raises(InputError, match=r"none.pem is no file: give the key of the cluster as a PEM file"):
        TlsFiles(tls.ca, tls.certificate, tmp_path / "none.pem")
    with open_cluster(address, tls, tmp_path / "c", {}) as cluster:
        monkeypatch.setattr("labcdp.core.cluster._WORKER_S", 3)
        with pytest.raises(InputError, match="the cluster has had no worker for 3 s: start workers, and try again"):
            list(cluster.run(os._exit, [1]))
