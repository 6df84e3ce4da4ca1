"""A session is complete whenever its writer ends.

Run as a program, this file is the writer's nursery: it forks a writer for each line on its standard input, so
that a writer costs milliseconds and not an interpreter's start.
"""

import os
import shutil
import signal
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


def write_until_call(path, calls, configuration):
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
    known = os.path.exists(path)
    with Session.open(path, writable=True) if known else Session.create(path, configuration) as session:
        say(1, b"open\n")
        session.add_frame(frame(calls))
        say(1, f"frame {calls}\n".encode())
        session.add_reading(reading(calls), patch="upper left")
        say(1, f"reading {calls}\n".encode())
        session.add_frames([(frame(seed), "light", None) for seed in (calls, calls + 1)])
        say(1, f"frame {calls}\nframe {calls + 1}\n".encode())


def nurse():
    frame_to_tiff(frame(0), compress=False)  # loads what is loaded late, once and not in each writer
    configuration = SessionConfiguration.load(example_session() / "session.toml")
    for line in sys.stdin:
        path, calls = line.rstrip("\n").split("\t")
        child = os.fork()
        if child == 0:
            write_until_call(path, int(calls), configuration)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        os.write(1, f"ended {os.waitstatus_to_exitcode(status)}\n".encode())


def killed_at(nursery, path, calls):
    """What a writer said until it was killed, and whether it was."""
    print(path, calls, sep="\t", file=nursery.stdin)
    said = []
    while not (line := nursery.stdout.readline()).startswith("ended"):
        said.append(line.rstrip("\n"))
    assert line in (f"ended {-signal.SIGKILL}\n", "ended 0\n")
    return said, line != "ended 0\n"


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


@pytest.mark.parametrize("before", ["sound", "crashed", "new"])
def test_a_kill_at_every_call_of_the_system_loses_nothing(tmp_path, small_configuration, nursery, before):
    """Kill at the first, second, ... call that changes the disk, until none is left to kill at."""
    origin = tmp_path / "origin"
    with Session.create(origin, small_configuration) as session:
        session.add_frame(frame(0))
    if before == "crashed":
        (origin / "frames" / ".labcdp-0123456789abcdef.part.tif").write_bytes(b"half")
        with (origin / "journal.jsonl").open("ab") as file:
            file.write(b'{"sequence": 4, "ti')
    calls = torn = 0
    killed = True
    while killed:
        path = tmp_path / str(calls := calls + 1)
        if before != "new":
            shutil.copytree(origin, path)
        said, killed = killed_at(nursery, path, calls)
        if before == "new" and not path.exists():
            assert said == []
            continue
        first = [] if before == "new" else ["frame 0"]
        recorded = assert_whole(path, first + said[1:])
        torn += not (path / "journal.jsonl").read_bytes().endswith(b"\n")
        with Session.open(path, writable=True) as session:
            session.add_frame(frame(1))
            session.verify()
        assert not list(path.rglob(".labcdp-*"))
        assert_whole(path, [*recorded, "frame 1"])
    assert calls > 20
    assert torn >= 2


if __name__ == "__main__":
    nurse()
