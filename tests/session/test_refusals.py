"""A full disk or a missing permission is one clear error, and the session can be resumed."""

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from labcdp.session import Session

# Each program runs in a process of its own, because limits and rights are those of a process.
PROLOGUE = """
import os, resource, sys
from labcdp.core.errors import SessionError
from labcdp.session import Session

def limit(size):
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

def attempt(call):
    try:
        call()
    except SessionError as error:
        print(error)
    else:
        print("done")

path = sys.argv[1]
"""


def run(program, path):
    result = subprocess.run(
        [sys.executable, "-c", PROLOGUE + program, str(path)], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return result.stdout.splitlines()


def files(folder):
    return sorted(str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file())


@pytest.fixture
def path(tmp_path, configuration, make_frame):
    with Session.create(tmp_path / "session", configuration) as session:
        session.add_frame(make_frame())
    return session.path


def test_no_space_for_a_frame_or_for_a_line_of_the_journal(path):
    """Of the line a part is written, and the whole frame before it goes too."""
    said = run(
        """
with Session.open(path, writable=True) as session:
    frame = session.load(session.frames()[0])
    journal = session.path / "journal.jsonl"
    large = frame.with_pixels(frame.dn.repeat(10, 0).repeat(10, 1))
    limit(large.dn.nbytes // 2)
    attempt(lambda: session.add_frame(large))
    attempt(lambda: session.add_frame(frame))
    limit(resource.RLIM_INFINITY)
    session.add_event("a line longer than a frame", {"text": "x" * 5000})
    size = journal.stat().st_size
    limit(size + 50)
    attempt(lambda: session.add_frame(frame))
    attempt(lambda: session.add_event("pause", {}))
    assert journal.stat().st_size == size
    attempt(session.verify)
    assert session.unrecorded() == []
    limit(resource.RLIM_INFINITY)
    attempt(lambda: session.add_frame(large))
""",
        path,
    )
    remedy = "cannot be written (File too large): raise the limit of the file size and record it again"
    line = f"{path}/journal.jsonl {remedy}"
    assert said == [f"{path}/frames/0002_light_5ms.tif {remedy}", "done", line, line, "done", "done"]
    Session.open(path).verify()
    assert files(path / "frames") == ["0001_light_5ms.tif", "0002_light_5ms.tif", "0003_light_5ms.tif"]


@pytest.fixture
def shared(configuration, make_frame):
    """A session in a folder anybody can reach."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        with Session.create(Path(folder) / "session", configuration) as session:
            session.add_frame(make_frame())
        yield session.path
        session.path.chmod(0o755)


# Root may do anything, so it becomes somebody else first. What is loaded late is loaded before that.
WITHOUT_RIGHTS = """
import tempfile
import tifffile
with tempfile.TemporaryDirectory() as folder, Session.open(path) as warm:
    warm.verify()
    Session.create(folder + "/session", warm.configuration).close()
    Session.open(folder + "/session", writable=True).close()
if os.geteuid() == 0:
    os.setgroups([])
    os.setuid(65534)
"""


DENIED = "(Permission denied): give yourself the right to have it"


def test_a_folder_without_the_right_to_read(shared):
    shared.chmod(0o000)
    calls = "attempt(lambda: Session.open(path))\nattempt(lambda: Session.open(path, writable=True))"
    assert run(WITHOUT_RIGHTS + calls, shared) == [f"{shared} cannot be read {DENIED} read"] * 2


def test_a_folder_without_the_right_to_write_or_that_loses_it_on_the_way(shared):
    calls = """
attempt(lambda: session.add_frame(frame))
session.close()
attempt(lambda: Session.open(path).verify())
attempt(lambda: Session.open(path, writable=True))
attempt(lambda: Session.create(path + "/inside", Session.open(path).configuration))
"""
    begin = """
import tifffile
session = Session.open(path, writable=True)
frame = session.load(session.frames()[0])
for name in ("frames/0001_light_5ms.tif", "journal.jsonl", "session.toml", "README.txt", "frames", ""):
    os.chmod(os.path.join(path, name), 0o555)
"""
    said = run(begin + WITHOUT_RIGHTS + calls, shared)
    (shared / "frames").chmod(0o755)
    refused = [f"{shared}/{name} cannot be written {DENIED} written" for name in
               ("frames/0002_light_5ms.tif", "journal.jsonl", "inside")]  # fmt: skip
    assert said == [refused[0], "done", *refused[1:]]
