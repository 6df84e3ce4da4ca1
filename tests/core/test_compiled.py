"""What is compiled gives the same results whether it was compiled before or not, and where it cannot be kept."""

import json
import os
import subprocess
import sys
import time

COLOURS = """
import json
import numpy as np
from labcdp.files.video.colour_kernel import luminance_of_ycbcr

rng = np.random.default_rng(3)
luma, blue, red = (rng.integers(0, 256, shape, np.uint8) for shape in ((31, 41), (16, 21), (16, 21)))
parts, light = rng.normal(0, 40, (5, 256)).astype(np.float32), rng.random((3, 256), np.float32)
print(json.dumps([one.tolist() for one in luminance_of_ycbcr(luma, blue, red, parts, light)]))
"""
FORGETS = """
import sys; sys.path.insert(0, sys.argv[1])
from labcdp.core.computer import compiled
import some_kernel
print(compiled(some_kernel.one)(1))
"""


def printed(program, *arguments, **environment):
    command = [sys.executable, "-c", program, *arguments]
    done = subprocess.run(command, env=os.environ | environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_results_are_the_same_whether_what_is_compiled_is_new_kept_or_cannot_be_kept(tmp_path):
    kept, nowhere = tmp_path / "kept", tmp_path / "file" / "none"
    (tmp_path / "file").write_text("")
    first = printed(COLOURS, NUMBA_CACHE_DIR=str(kept))
    assert list(kept.rglob("*.nbc"))
    assert printed(COLOURS, NUMBA_CACHE_DIR=str(kept)) == first
    assert printed(COLOURS, NUMBA_CACHE_DIR=str(nowhere)) == first


def test_what_is_older_than_a_kernel_is_forgotten(tmp_path):
    """A kernel may have changed that others call."""
    kept = tmp_path / "__pycache__"
    kept.mkdir()
    for name, age_s in (("older.nbi", 10 * 365 * 86400), ("newer.nbi", 0)):
        (kept / name).write_text("")
        os.utime(kept / name, (time.time() - age_s,) * 2)
    (tmp_path / "some_kernel.py").write_text("def one(x):\n    return x + 1\n")
    assert printed(FORGETS, tmp_path) == 2
    assert {path.name for path in kept.glob("*er.nbi")} == {"newer.nbi"}
