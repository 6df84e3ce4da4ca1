"""What is compiled gives the same results compiled before or not; a single thread is that of the caller."""

import json
import os
import subprocess
import sys
from threading import get_ident

from labcdp.core.computer import Threads

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


def test_results_are_the_same_whether_what_is_compiled_is_new_kept_or_cannot_be_kept(tmp_path):
    kept, nowhere = tmp_path / "kept", tmp_path / "file" / "none"
    (tmp_path / "file").write_text("")
    (tmp_path / "some_kernel.py").write_text(KERNEL)
    results = set()
    for folder in (kept, kept, nowhere):
        environment = os.environ | {"NUMBA_CACHE_DIR": str(folder)}
        command = [sys.executable, "-c", PROGRAM, tmp_path]
        results.add(json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout))
        assert list(kept.rglob("*.nbc"))
    assert len(results) == 1


def test_a_single_worker_is_the_calling_thread_which_ctrl_c_interrupts():
    run = Threads[int](1).run(lambda task: (get_ident(), 1 / task), [2, 0])
    assert next(run) == (2, (get_ident(), 0.5), None)
    assert isinstance(next(run)[2], ZeroDivisionError)
