"""A library that loops, crashes or takes all memory costs a child process, and becomes an error."""

import pytest

from labcdp.core.disk.tiff import read_in_child
from labcdp.core.errors import InputError

READERS = """
import os

def length(data):
    print("what libraries print does not come between")
    return {"length": len(data)}

def loops(data):
    while True:
        pass

def crashes(data):
    os.abort()

def takes_all(data):
    return bytes(2**42)

def raises(data):
    raise OSError(-101, "NetCDF: HDF error")
"""


@pytest.fixture
def read(tmp_path, monkeypatch):
    (tmp_path / "readers_of_test.py").write_text(READERS)
    monkeypatch.syspath_prepend(tmp_path)
    return lambda name: read_in_child(f"readers_of_test:{name}", b"12345")


@pytest.mark.parametrize("name", ["loops", "crashes", "takes_all", "raises"])
def test_results_come_back_and_what_goes_wrong_is_an_error(read, monkeypatch, name):
    assert read("length") == {"length": 5}
    monkeypatch.setattr("labcdp.core.disk.tiff._SECONDS", 1)
    with pytest.raises(InputError, match=r"damaged|not read|HDF error|MemoryError|memory"):
        read(name)
