"""What is compiled gives the same results whether it was compiled before or not, and where it cannot be kept."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from labcdp.metrics.correlation.lags_kernel import chosen, summed

LOOK_UP = """
import json
import numpy as np
from labcdp.files.video.pixels_kernel import looked_up

rng = np.random.default_rng(3)
print(json.dumps(looked_up(rng.normal(size=256), rng.integers(0, 256, (30, 40), np.uint8)).tolist()))
"""


LAGS = """
import json
import numpy as np
from labcdp.metrics.correlation.lags_kernel import chosen, summed

values = np.random.default_rng(3).normal(size=(120, 90)).cumsum(axis=1)
values -= values.mean()
found = chosen(values, np.ones(values.shape), 0.1, 5, 2.3)
print(json.dumps([repr(found), repr(summed(values, *found))]))
"""


def results(program: str, **environment: str) -> list[object]:
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found: list[object] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize(
    "program",
    [LOOK_UP, pytest.param(LAGS, marks=pytest.mark.long)],
    ids=["look-up", "lags"],
)
def test_results_are_the_same_before_and_after_what_is_compiled_is_kept(tmp_path: Path, program: str) -> None:
    first = results(program, NUMBA_CACHE_DIR=str(tmp_path))
    assert list(tmp_path.rglob("*.nbc"))
    assert results(program, NUMBA_CACHE_DIR=str(tmp_path)) == first


def test_without_a_folder_to_keep_it_in_it_is_compiled_anew(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code = (
        "from labcdp.files.video.pixels_kernel import looked_up; import numpy as np; "
        "print(looked_up(np.arange(5.0), np.full((10, 10), 1, np.uint8)).sum())"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "file" / "none")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "100.0\n"), done.stderr


def test_what_is_older_than_a_kernel_is_forgotten(tmp_path: Path) -> None:
    """A kernel may have changed that others call."""
    kept = tmp_path / "__pycache__"
    kept.mkdir()
    for name, age_s in (("older.nbi", 10 * 365 * 86400), ("newer.nbi", 0)):
        (kept / name).write_text("")
        os.utime(kept / name, (time.time() - age_s,) * 2)
    (tmp_path / "some_kernel.py").write_text("def one(x):\n    return x + 1\n")
    code = """
import sys; sys.path.insert(0, sys.argv[1])
from labcdp.core.compiled import compiled
import some_kernel
print(compiled(some_kernel.one)(1))
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "2\n"), done.stderr
    names = {path.name for path in kept.glob("*.nbi")}
    assert "newer.nbi" in names
    assert "older.nbi" not in names


@pytest.mark.parametrize("shape", [(1, 9), (30, 40), (700, 3)])
@pytest.mark.parametrize("smoothed", [False, True])
def test_numpy_and_compiled_code_give_the_same_sums_over_lags(shape: tuple[int, int], smoothed: bool) -> None:
    image = np.random.default_rng(4).normal(size=shape)
    if smoothed:
        image = image.cumsum(axis=1) * np.linspace(1, 2, shape[1])
    image -= image.mean()
    found = chosen(image, np.ones(shape), 0.1, 5, 2.3)
    assert found == chosen.__wrapped__(image, np.ones(shape), 0.1, 5, 2.3)  # type: ignore[attr-defined]
    assert summed(image, *found) == pytest.approx(summed.__wrapped__(image, *found), rel=1e-9)  # type: ignore[attr-defined]
