"""What is compiled gives the same results whether it was compiled before or not, and where it cannot be kept."""

import json
import os
import subprocess
import sys
import time

PROGRAM = """
import sys; sys.path.insert(0, sys.argv[1])
import numpy as np
from labcdp.core.computer import compiled
import some_kernel
print(compiled(some_kernel.total)(np.random.default_rng(3).normal(0, 40, 1000).astype(np.float32)))
"""
KERNEL = """
def total(values):
    result = 0.1
    for value in values:
        result += value * value / 3
    return result
"""


def printed(folder, **environment):
    command = [sys.executable, "-c", PROGRAM, folder]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_results_are_the_same_whether_what_is_compiled_is_new_kept_or_cannot_be_kept(tmp_path):
    kept, nowhere = tmp_path / "kept", tmp_path / "file" / "none"
    (tmp_path / "file").write_text("")
    (tmp_path / "some_kernel.py").write_text(KERNEL)
    first = printed(tmp_path, NUMBA_CACHE_DIR=str(kept))
    assert list(kept.rglob("*.nbc"))
    assert printed(tmp_path, NUMBA_CACHE_DIR=str(kept)) == first
    assert printed(tmp_path, NUMBA_CACHE_DIR=str(nowhere)) == first


def test_what_is_older_than_a_kernel_is_forgotten(tmp_path):
    """A kernel may have changed that others call."""
    kept = tmp_path / "__pycache__"
    kept.mkdir()
    for name, age_s in (("older.nbi", 10 * 365 * 86400), ("newer.nbi", 0)):
        (kept / name).write_text("")
        os.utime(kept / name, (time.time() - age_s,) * 2)
    (tmp_path / "some_kernel.py").write_text(KERNEL)
    assert printed(tmp_path) > 0
    assert {path.name for path in kept.glob("*er.nbi")} == {"newer.nbi"}
