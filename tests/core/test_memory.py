"""Memory of a process that runs for hours and has images in many threads."""

import subprocess
import sys

import pytest

#: Threads that live on, each with images that come and go, and with something small that stays.
PROGRAM = """
import sys
from threading import Barrier, Thread

import numpy as np
import psutil

from labcdp.core.computer import give_back_memory

if sys.argv[1:]:
    give_back_memory()
np.ones((2056, 2452), np.float32)  # is freed: from then on as large ones are cut from heaps
kept, done, end = [], Barrier(9), Barrier(9)

def run(seed):
    for size in np.random.default_rng(seed).integers(1_000_000, 5_000_000, 20):
        images = [np.ones(size, np.float32) for _ in range(3)]
        kept.append(np.ones(20_000))
        del images
    done.wait()
    end.wait()

before = psutil.Process().memory_info().rss
threads = [Thread(target=run, args=(seed,)) for seed in range(8)]
for one in threads:
    one.start()
done.wait()
print((psutil.Process().memory_info().rss - before) / 1e6)
end.wait()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have another allocator")
def test_memory_of_images_is_given_back():
    grown = [
        float(subprocess.run([sys.executable, "-c", PROGRAM, *how], check=True, capture_output=True, text=True).stdout)
        for how in ((), ("given back",))
    ]
    # What is kept is 26 MB.
    assert grown[1] < 60, grown
    assert grown[0] > 2 * grown[1], grown
