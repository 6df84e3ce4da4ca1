"""What is compiled gives the same results whether it was compiled before or not, and where it cannot be kept."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from labcdp.sum_kernel import pairwise_sum

FOLLOWED = """
import json, sys
import cv2, numpy as np
from labcdp.evaluate.noise_correlation import noise_inflation
from labcdp.roi import Roi
from labcdp.tracking import make_tracker

rng = np.random.default_rng(3)
scene = cv2.GaussianBlur(rng.normal(0, 1, (300, 400)).astype(np.float32), (0, 0), 3)
scene = 110 + 30 * scene / scene.std()
tracker, found = None, []
for n in range(6):
    frame = scene[20 + n : 220 + n, 30 + 2 * n : 330 + 2 * n] + rng.normal(0, 2, (200, 300))
    grey = np.clip(frame + 0.5, 0, 255).astype(np.uint8)
    if tracker is None:
        tracker = make_tracker("kcf", grey, [Roi.rectangle("a", 100, 80, 40, 30), Roi.rectangle("b", 180, 90, 40, 30)])
    else:
        found += [[repr(one.roi.corners), repr(one.quality)] for one in tracker.update(grey)]
noise = cv2.GaussianBlur(rng.normal(0, 1, (120, 90)), (0, 0), 1.5)
found.append(repr(noise_inflation(noise, np.ones(noise.shape, bool))))
print(json.dumps(found))
"""


def results(**environment: str) -> list[object]:
    done = subprocess.run(
        [sys.executable, "-c", FOLLOWED], env=os.environ | environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found: list[object] = json.loads(done.stdout)
    return found


def test_results_are_the_same_before_and_after_what_is_compiled_is_kept(tmp_path: Path) -> None:
    first = results(NUMBA_CACHE_DIR=str(tmp_path))
    assert list(tmp_path.rglob("*.nbc"))
    assert results(NUMBA_CACHE_DIR=str(tmp_path)) == first


def test_without_a_folder_to_keep_it_in_it_is_compiled_anew(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    code = "from labcdp.sum_kernel import pairwise_sum; import numpy as np; print(pairwise_sum(np.ones(100)))"
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
from labcdp.compiled import compiled
import some_kernel
print(compiled(some_kernel.one)(1))
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "2\n"), done.stderr
    names = {path.name for path in kept.glob("*.nbi")}
    assert "newer.nbi" in names
    assert "older.nbi" not in names


@pytest.mark.parametrize("n", [0, 1, 15, 16, 17, 33, 1000])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_sums_are_those_of_all_values(n: int, kind: type) -> None:
    values = np.random.default_rng(n).integers(-100, 100, n).astype(kind)
    assert pairwise_sum(values.copy()) == values.sum()
