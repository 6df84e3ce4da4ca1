"""Validation: every outside truth with labcdp's deviation, recomputed; see docs/validation.md."""

import os
import sys
from pathlib import Path

os.environ["OMP_NUM_THREADS"] = "1"
# Benchmarks are programs that stand alone; the truths of some tests are used too.
sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parents[2])]
