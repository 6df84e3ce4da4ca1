"""A full disk or a missing permission is one clear error, and the session can be resumed."""

import os
import resource
import tempfile
from contextlib import contextmanager
from pathlib import Path

import pytest

from labcdp.core.errors import SessionError
from labcdp.session import Session

DENIED = "(Permission denied): give yourself the right to have it"


@contextmanager
def refused(message, size=None):
    """Expect an error, with a limit of the size of files, or without the rights of root."""
    root, largest = os.geteuid() == 0 and size is None, resource.getrlimit(resource.RLIMIT_FSIZE)
    if size is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, largest[1]))
    if root:
        os.seteuid(65534)
    try:
        with pytest.raises(SessionError) as caught:
            yield
    finally:
        if root:
            os.seteuid(0)
        resource.setrlimit(resource.RLIMIT_FSIZE, largest)
    assert str(caught.value) == message


@pytest.fixture
def path(configuration, make_frame):
    """A session in a folder that everybody reaches."""
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        with Session.create(Path(folder) / "session", configuration) as session:
            session.add_frame(make_frame())
            # What is loaded late is loaded before rights are lost.
            session.load(session.frames()[0])
        yield session.path
        for one in (session.path, session.path / "frames"):
            one.chmod(0o755)


def test_no_space_for_a_frame_or_for_a_line_of_the_journal(path, make_frame):
    """Of the line a part is written, and the whole frame before it goes too."""
    remedy = "cannot be written (File too large): raise the limit of the file size and record it again"
    with Session.open(path, writable=True) as session:
        journal = path / "journal.jsonl"
        large = make_frame(shape=(120, 160))
        with refused(f"{path}/frames/0002_light_5ms.tif {remedy}", large.dn.nbytes // 2):
            session.add_frame(large)
        session.add_frame(make_frame())
        session.add_event("a line longer than a frame", {"text": "x" * 5000})
        size = journal.stat().st_size
        for add in (lambda: session.add_frame(make_frame()), lambda: session.add_event("pause", {})):
            with refused(f"{journal} {remedy}", size + 50):
                add()
        assert journal.stat().st_size == size
        session.verify()
        session.add_frame(large)
    Session.open(path).verify()
    names = sorted(file.name for file in (path / "frames").iterdir())
    assert names == ["0001_light_5ms.tif", "0002_light_5ms.tif", "0003_light_5ms.tif"]


def test_a_folder_without_the_right_to_read_or_to_write_or_that_loses_it_on_the_way(path, configuration, make_frame):
    with Session.open(path, writable=True) as session:
        for name in ("frames", "journal.jsonl", ""):
            (path / name).chmod(0o555)
        with refused(f"{path}/frames/0002_light_5ms.tif cannot be written {DENIED} written"):
            session.add_frame(make_frame())
    with refused(f"{path}/journal.jsonl cannot be written {DENIED} written"):
        Session.open(path, writable=True)
    with refused(f"{path}/inside cannot be written {DENIED} written"):
        Session.create(path / "inside", configuration)
    Session.open(path).verify()
    path.chmod(0o000)
    with refused(f"{path} cannot be read {DENIED} read"):
        Session.open(path)
