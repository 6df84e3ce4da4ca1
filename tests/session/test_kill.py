"""A session survives its writer's end at any moment.

Run as a program, this file is the writer's nursery: it forks a writer for each line on its standard input, so
that a writer costs milliseconds and not an interpreter's start.
"""

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from labcdp.session import Session, SessionConfiguration, example_session
from labcdp.session.frames import frame_to_tiff

EXAMPLE = Session.open(example_session())
FRAME, READING = EXAMPLE.load(EXAMPLE.frames()[0]), EXAMPLE.readings()[0].reading


def frame(seed):
    return replace(FRAME, dn=np.random.default_rng(seed).integers(0, 4096, (60, 80), dtype=np.uint16), frame_id=seed)


def reading(seed):
    return replace(READING, value=float(seed))


def write_until_call(path, calls, configuration=None):
    """Make or go on with a session, and be killed at a given call that changes the disk; a write gets half done."""
    left = calls

    def counted(name):
        call = getattr(os, name)

        def wrapper(first, *rest, **keywords):
            nonlocal left
            left -= 1
            if left == 0:
                if name == "write":
                    call(first, bytes(rest[0])[: len(rest[0]) // 2])
                os.kill(os.getpid(), signal.SIGKILL)
            return call(first, *rest, **keywords)

        setattr(os, name, wrapper)

    say = os.write
    for name in ("write", "fsync", "replace", "rename", "mkdir", "unlink"):
        counted(name)
    if os.path.exists(path):
        session = Session.open(path, writable=True)
    else:
        session = Session.create(path, SessionConfiguration.load(configuration))
    with session:
        say(1, b"open\n")
        session.add_frame(frame(calls))
        say(1, f"frame {calls}\n".encode())
        session.add_reading(reading(calls), patch="upper left")
        say(1, f"reading {calls}\n".encode())
        session.add_frames([(frame(seed), "light", None) for seed in (calls, calls + 1)])
        say(1, f"frame {calls}\nframe {calls + 1}\n".encode())


def nurse():
    frame_to_tiff(frame(0), compress=False)  # loads what is loaded late, once and not in each writer
    for line in sys.stdin:
        path, number, *rest = line.rstrip("\n").split("\t")
        child = os.fork()
        if child == 0:
            write_until_call(path, int(number), *rest)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        os.write(1, f"ended {os.waitstatus_to_exitcode(status)}\n".encode())


class Nursery:
    def __init__(self):
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def start(self, *fields):
        self._process.stdin.write("\t".join(map(str, fields)) + "\n")
        self._process.stdin.flush()

    def lines(self):
        """What the writer said until it ended, last how it ended."""
        for line in self._process.stdout:
            yield line.rstrip("\n")
            if line.startswith("ended"):
                return

    def close(self):
        self._process.stdin.close()
        self._process.stdout.close()
        self._process.wait()


@pytest.fixture
def nursery():
    nursery = Nursery()
    yield nursery
    nursery.close()


def assert_whole(path, said):
    """All that was said to be recorded is there and right, with at most one thing or batch of two more."""
    session = Session.open(path)
    recorded = []
    for record in session.records:
        if record in session.frames():
            loaded = session.load(record)
            seed = record.metadata["frame_id"]
            np.testing.assert_array_equal(loaded.dn, frame(seed).dn, strict=True)
            assert loaded.metadata() == frame(seed).metadata()
            recorded.append(f"frame {seed}")
        elif record in session.readings():
            seed = int(record.reading.value)
            assert record.reading == reading(seed)
            recorded.append(f"reading {seed}")
    assert recorded[: len(said)] == said
    assert len(recorded) <= len(said) + 2
    return recorded


@pytest.mark.parametrize("after_a_crash", [False, True])
def test_a_kill_at_every_call_of_the_system_loses_nothing(tmp_path, configuration, nursery, after_a_crash):
    """Kill at the first, second, ... call that changes the disk, until none is left to kill at."""
    sound = tmp_path / "sound"
    with Session.create(sound, configuration) as session:
        session.add_frame(frame(0))
    if after_a_crash:
        (sound / "frames" / ".labcdp-0123456789abcdef.part.tif").write_bytes(b"half")
        with (sound / "journal.jsonl").open("ab") as file:
            file.write(b'{"sequence": 4, "ti')
    torn = 0
    for calls in range(1, 300):
        path = tmp_path / str(calls)
        shutil.copytree(sound, path)
        nursery.start(path, calls)
        *heard, end = nursery.lines()
        recorded = assert_whole(path, ["frame 0", *(line for line in heard if line != "open")])
        text = (path / "journal.jsonl").read_bytes()
        with Session.open(path, writable=True) as session:
            torn += not text.endswith(b"\n")
            session.add_frame(frame(1))
            session.verify()
        assert not list(path.rglob(".labcdp-*"))
        assert_whole(path, [*recorded, "frame 1"])
        if end == "ended 0":
            break
        assert end == f"ended {-signal.SIGKILL}"
    assert end == "ended 0"
    assert calls > 20
    assert torn >= 2


def test_a_kill_while_a_session_is_made_leaves_all_or_nothing(tmp_path, bench, nursery):
    (tmp_path / "bench.toml").write_text(bench)
    for calls in range(1, 200):
        path = tmp_path / f"session {calls}"
        nursery.start(path, calls, tmp_path / "bench.toml")
        *heard, end = nursery.lines()
        if "open" in heard:
            break
        assert end == f"ended {-signal.SIGKILL}"
        if path.exists():
            Session.open(path).verify()
    assert calls > 10
    assert path.exists()


if __name__ == "__main__":
    nurse()
