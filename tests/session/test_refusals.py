"""A full disk is one clear error, and the session can be resumed."""

import resource
from contextlib import contextmanager

import pytest

from labcdp.core.errors import SessionError
from labcdp.session import Session


@contextmanager
def full_at(size):
    """A limit of the size of files, which is met."""
    largest = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, largest[1]))
    try:
        with pytest.raises(SessionError, match=r"cannot be written \(File too large\): raise the limit"):
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, largest)


def test_no_space_for_a_frame_or_for_a_line_of_the_journal(tmp_path, configuration, make_frame):
    """Of the line a part is written, and the whole frame before it goes too."""
    path, large = tmp_path / "session", make_frame(shape=(120, 160))
    with Session.create(path, configuration) as session:
        session.add_frame(make_frame())
        journal = path / "journal.jsonl"
        with full_at(large.dn.nbytes // 2):
            session.add_frame(large)
        session.add_frame(make_frame())
        session.add_event("a line longer than a frame", {"text": "x" * 5000})
        size = journal.stat().st_size
        for add in (lambda: session.add_frame(make_frame()), lambda: session.add_event("pause", {})):
            with full_at(size + 50):
                add()
        assert journal.stat().st_size == size
        session.verify()
        session.add_frame(large)
    Session.open(path).verify()
    names = sorted(file.name for file in (path / "frames").iterdir())
    assert names == ["0001_light_5ms.tif", "0002_light_5ms.tif", "0003_light_5ms.tif"]
