import subprocess
import sys

# In a process of its own: what the other tests have used does not count.
PROGRAM = """
import resource
from labcdp.chain import load
chain = load("manta-g505")
run = chain.run(seed=0)
height, width = chain.scene.shape
peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(peak_mb, len(run), 4e-6 * height * width)
"""


def test_peak_memory_of_a_full_frame():
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=120, check=True)
    peak_mb, stages, frame_mb = map(float, done.stdout.split())
    assert peak_mb < 2 * frame_mb * stages + 300
