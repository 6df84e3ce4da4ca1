import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from labcdp import Chain
from labcdp.chain.hdr import Hdr
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.value_bins import Noise, ValueBins
from labcdp.core.errors import PredictionError

# In a process of its own: what the other tests have used does not count.
PROGRAM = """
import re
from pathlib import Path
from labcdp.chain import Chain
chain = Chain.load("manta-g505")
run = chain.run(seed=0)
height, width = chain.scene.shape
# Unlike what getrusage tells, it does not begin with the peak of the process that started this one.
peak_mb = int(re.search(r"VmHWM:\\s+(\\d+) kB", Path("/proc/self/status").read_text())[1]) / 1024
print(peak_mb, len(run), 4e-6 * height * width)
"""


def test_peak_memory_of_a_full_frame():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=600, check=True)
    peak_mb, stages, frame_mb = map(float, done.stdout.split())
    assert peak_mb < 2 * frame_mb * stages + 300


def test_a_merge_of_many_values_has_bins_that_fit_in_memory():
    """Its values are 134 and 51 parts of 4556 apart: 9 million, one of which took 1 GB for 16 pixels."""
    chain = Chain.load("manta-g505")
    settings = replace(chain.settings, exposure_s=(1e-4, 2.66e-4, 2.66e-2))
    camera = CameraModel(chain.camera().sensor, settings, Hdr("weighted", 24))
    noise = Noise(camera.k_dn_per_e * 10.0, 0.0, camera.sensor.black_level_dn)
    found = ValueBins.of_merge("weighted", camera.ladder, noise)
    assert found.values.size < 500_000
    assert (np.diff(found.edges) > 0).all()
    assert found.values[found.exact][0] == 0
    with pytest.raises(PredictionError, match="too many values of the merge"):
        ValueBins.of_merge("weighted", camera.ladder, replace(noise, read_dn=0.0))
