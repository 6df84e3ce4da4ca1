import subprocess
import sys

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
