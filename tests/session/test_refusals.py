"""A full disk or a missing permission is one clear error, and the session can be resumed."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from labcdp.core.errors import SessionError
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


def test_no_space_for_a_frame(path):
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
    attempt(lambda: session.add_frame(large))
    attempt(session.verify)
""",
        path,
    )
    assert said == [
        f"{path}/frames/0002_light_5ms.tif cannot be written (File too large): raise the limit of the file size and "
        "record it again",
        "done",
        "done",
        "done",
    ]
    assert files(path / "frames") == ["0001_light_5ms.tif", "0002_light_5ms.tif", "0003_light_5ms.tif"]
    Session.open(path).verify()


def test_no_space_for_a_line_of_the_journal(path):
    """The line is cut off in its middle, and the whole frame before it goes too."""
    said = run(
        """
with Session.open(path, writable=True) as session:
    frame = session.load(session.frames()[0])
    journal = session.path / "journal.jsonl"
    session.add_event("a line longer than a frame", {"text": "x" * 5000})
    size = journal.stat().st_size
    limit(size + 50)
    attempt(lambda: session.add_frame(frame))
    attempt(lambda: session.add_event("pause", {}))
    assert journal.stat().st_size == size
    attempt(session.verify)
    assert session.unrecorded() == []
    limit(resource.RLIM_INFINITY)
    attempt(lambda: session.add_frame(frame))
""",
        path,
    )
    refusal = (
        f"{path}/journal.jsonl cannot be written (File too large): raise the limit of the file size and record it again"
    )
    assert said == [refusal, refusal, "done", "done"]
    session = Session.open(path)
    session.verify()
    assert [record.file.name for record in session.frames()] == [
        "frames/0001_light_5ms.tif", "frames/0002_light_5ms.tif",
    ]  # fmt: skip


def test_a_full_disk_says_so(monkeypatch, path, make_frame):
    """The one errno that takes a whole disk to get for real."""

    def full(descriptor, data):
        raise OSError(28, os.strerror(28))

    with Session.open(path, writable=True) as session:
        monkeypatch.setattr(os, "write", full)
        with pytest.raises(
            SessionError,
            match=r"0002_light_5ms.tif cannot be written \(No space left on device\): free some space on the disk",
        ):
            session.add_frame(make_frame())
        monkeypatch.undo()
        session.add_frame(make_frame())
        session.verify()


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


def test_a_folder_without_the_right_to_read(shared):
    shared.chmod(0o000)
    said = run(
        WITHOUT_RIGHTS
        + """
attempt(lambda: Session.open(path))
attempt(lambda: Session.open(path, writable=True))
""",
        shared,
    )
    refusal = f"{shared} cannot be read (Permission denied): give yourself the right to have it read"
    assert said == [refusal, refusal]


def test_a_folder_without_the_right_to_write(shared):
    for file in shared.rglob("*"):
        file.chmod(0o555 if file.is_dir() else 0o444)
    shared.chmod(0o555)
    said = run(
        WITHOUT_RIGHTS
        + """
attempt(lambda: Session.open(path).verify())
attempt(lambda: Session.open(path, writable=True))
attempt(lambda: Session.create(path + "/inside", Session.open(path).configuration))
""",
        shared,
    )
    denied = "cannot be written (Permission denied): give yourself the right to have it written"
    assert said == ["done", f"{shared}/journal.jsonl {denied}", f"{shared}/inside {denied}"]


def test_a_right_lost_on_the_way(shared):
    said = run(
        """
import tifffile
session = Session.open(path, writable=True)
frame = session.load(session.frames()[0])
os.chmod(path + "/frames", 0o555)
"""
        + WITHOUT_RIGHTS
        + """
attempt(lambda: session.add_frame(frame))
attempt(session.verify)
""",
        shared,
    )
    (shared / "frames").chmod(0o755)
    denied = "cannot be written (Permission denied): give yourself the right to have it written"
    assert said == [f"{shared}/frames/0002_light_5ms.tif {denied}", "done"]
