"""Damaged files of every kind: none ends in a traceback, a crash, a hang, too much memory or a wrong number."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tools"))

from fuzzing.seeds import make_seeds  # noqa: E402
from fuzzing.targets import SEEDS, TARGETS  # noqa: E402
from fuzzing.worker import Bench  # noqa: E402

from labcdp.core.errors import LabcdpError  # noqa: E402


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz") / "seeds"
    make_seeds(folder)
    return folder


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_files_and_what_is_none_are_refused_in_one_line_or_read_as_what_they_say(seeds, tmp_path, name):
    bench = Bench(name, seeds, tmp_path, seed=1)
    n_inputs = max(1, round(0.3 / max(bench.target.cost, 0.01)))
    assert [found for number in range(n_inputs) if (found := bench.attempt(number))] == []
    if name in SEEDS:
        return
    path = next(one for one in bench.files if one.suffix != ".txt" or name in ("faults", "emva"))
    path.unlink()
    for make in (os.mkfifo, os.mkdir, lambda p: os.symlink("/dev/zero", p), lambda p: os.symlink(p, p)):
        make(path)
        # A folder that is searched for files leaves out what is none.
        with pytest.raises((LabcdpError, OSError)) as caught:
            bench.target.read(bench.folder, path)
        assert isinstance(caught.value, LabcdpError), name
        assert str(caught.value).isprintable()
        os.rmdir(path) if path.is_dir() else path.unlink()
