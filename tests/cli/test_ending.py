"""How commands end before they are done."""

import os
import signal
import subprocess
import time

import cv2
import numpy as np
import pytest

from labcdp.cli.ending import EndedBySignal, unwinding


def _stopped(labcdp_path, folder, number, *arguments, until):
    """Run a command and send it a signal as soon as a file is there; returns its status and what it said."""
    command = [labcdp_path, *map(str, arguments)]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True, env=environment) as process:
        end = time.monotonic() + 300
        while not any(folder.glob(until)):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < end
            time.sleep(0.005)
        process.send_signal(number)
        said = process.stderr.read()
    return process.returncode, said


@pytest.fixture
def picture(tmp_path):
    """Picture whose pixel-to-pixel CDP takes a while."""
    rng = np.random.default_rng(0)
    cv2.imwrite(str(tmp_path / "a.png"), rng.integers(0, 65536, (3000, 4000), dtype=np.uint16))
    return tmp_path


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_command_that_is_stopped_leaves_nothing_half_done(labcdp_path, picture, number, status):
    arguments = ("image", "a.png", "--neighbours", "-o", "out/deep")
    ended, said = _stopped(labcdp_path, picture, number, *arguments, until="out/deep/.labcdp-*")
    assert ended == status
    assert [path.name for path in picture.iterdir()] == ["a.png"]
    assert "Traceback" not in said
    assert said.splitlines()[-1] == "labcdp: stopped; the same command starts again from the beginning"


def test_a_signal_unwinds_and_its_handler_comes_back():
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(EndedBySignal) as ended, unwinding():
        os.kill(os.getpid(), signal.SIGTERM)
    assert ended.value.number == signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) == before


def test_the_end_of_a_terminal_that_nohup_ignores_is_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with unwinding():
            os.kill(os.getpid(), signal.SIGHUP)
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_forked_process_ends_as_it_would_have():
    with unwinding():
        child = os.fork()
        if child == 0:
            os.kill(os.getpid(), signal.SIGTERM)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGTERM
