"""Benchmarks and validation keep up with what they import."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Needs Pyxel, which installs 1.5 GB.
WITHOUT = ("bench_pyxel", "pyxel_exposure")


def test_all_benchmarks_can_be_imported(tmp_path):
    paths = [path.relative_to(ROOT / "benchmarks").with_suffix("") for path in (ROOT / "benchmarks").rglob("*.py")]
    names = sorted(".".join(path.parts) for path in paths if path.name not in (*WITHOUT, "__init__"))
    program = "import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name)"
    # As make validate finds them, and as a benchmark that is run finds those beside it.
    names = [f"benchmarks.{name}" if name.startswith("validation.") else name for name in names]
    path = os.pathsep.join(map(str, (ROOT, ROOT / "benchmarks")))
    done = subprocess.run(
        [sys.executable, "-c", program, *names], cwd=ROOT, env=os.environ | {"PYTHONPATH": path},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


def test_the_validation_runs_and_writes_its_report(tmp_path):
    command = [sys.executable, "-m", "benchmarks.validation", "--only", "closed_forms", "--output", tmp_path / "out"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "deviates" not in (tmp_path / "out/results.json").read_text()
