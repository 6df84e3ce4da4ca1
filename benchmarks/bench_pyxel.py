"""Time of the same simulated exposure in Pyxel, ESA's detector simulation, over its time in labcdp.

Run ``python benchmarks/bench_pyxel.py``. The first run installs Pyxel with pip in an environment of its own
(1.5 GB; ``--environment FOLDER`` says where), because its packages must not touch labcdp's. The two take turns, and
the best time of each counts. Imports, set-up and the first exposure of each are not timed.

Both simulate 2048 x 2048 pixels of 12 bits: photon shot noise, dark current, PRNU, full well, gain, read noise, black
level and converter. The mean and standard deviation of the images tell that they are the same exposure. In Pyxel these
are the models illumination, shot_noise, simple_conversion, dark_current, simple_collection, fixed_pattern_noise,
simple_full_well, simple_measurement, output_node_noise, dc_offset and simple_adc, with their defaults.

What differs:

- Pyxel draws the photons, which of them free an electron, and the dark electrons; labcdp draws the sum of photo- and
  dark electrons, which has the same distribution.
- Pyxel draws the fixed pattern for each exposure; labcdp draws it once for a device. "no pattern" is Pyxel without it,
  "drawing the pattern" is the first exposure of a device in labcdp.
- "leanest" is Pyxel without the pattern, with light in electrons instead of photons, and with a dark current that
  does not depend on the temperature.
- "models" are Pyxel's models alone; "run_mode" is the call its users make, which also empties the detector and gathers
  the arrays of all steps.
- Pyxel computes in float64 in one thread, labcdp in float32 in all.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import time
import venv
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np

from labcdp.chain import Sensor

PYXEL = "pyxel-sim==3.0.2"
REPEATS = 5
EXPOSURE_S = 1e-3
LEVELS_E = (10.0, 3000.0)
# Typical of a machine vision camera. Pyxel's fixed pattern has no offsets, so there are none here.
SENSOR = Sensor(
    pixel_pitch_m=3.45e-6,
    width=2048,
    height=2048,
    quantum_efficiency=0.5,
    full_well_e=7000.0,
    k_dn_per_e=0.6,
    read_noise_e=10.0,
    dark_current_e_s=5.0,
    bits=12,
    black_level_dn=64.0,
    reference_temperature_c=26.85,  # 300 K, where Pyxel states the dark current
    prnu_rel=0.01,
)
REFERENCE = "labcdp, all threads"

Ask = Callable[[str], dict[str, float]]


def default_environment() -> Path:
    cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(cache) / "labcdp" / PYXEL.replace("==", "-")


def prepare(environment: Path) -> Path:
    """Return the Python of an environment with Pyxel; make it first if necessary."""
    python = environment / "bin" / "python"
    if not python.exists():
        print(f"Installing {PYXEL} in {environment}", flush=True)
        venv.create(environment, with_pip=True)
    pip = [str(python), "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", PYXEL], check=True)
    return python


@contextmanager
def pyxel_exposures(python: Path, electrons: float) -> Iterator[Ask]:
    settings = asdict(SENSOR) | {"electrons_s": electrons / EXPOSURE_S, "exposure_s": EXPOSURE_S}
    command = [str(python), str(Path(__file__).with_name("pyxel_exposure.py")), json.dumps(settings)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:

        def ask(variant: str) -> dict[str, float]:
            assert child.stdin is not None
            assert child.stdout is not None
            print(variant, file=child.stdin, flush=True)
            line = child.stdout.readline()
            if not line:
                raise RuntimeError(f"Pyxel ended without an exposure of {variant!r}: its own message stands above")
            answer: dict[str, float] = json.loads(line)
            return answer

        yield ask


def labcdp_exposure(sensor: Sensor, electrons: float, threads: int | None) -> dict[str, float]:
    start = time.perf_counter()
    image = sensor.expose(
        electrons / EXPOSURE_S,
        EXPOSURE_S,
        temperature_c=sensor.reference_temperature_c,
        seed=1,
        exposure_index=0,
        threads=threads,
    )
    seconds = time.perf_counter() - start
    return {"": seconds, "mean_dn": float(image.mean()), "std_dn": float(image.std())}


def first_exposure(electrons: float) -> dict[str, float]:
    # A copy has not drawn its pattern yet.
    return labcdp_exposure(replace(SENSOR), electrons, None)


def measure(exposures: dict[str, Callable[[], dict[str, float]]]) -> tuple[dict[str, float], dict[str, str]]:
    """Return the best seconds of each exposure, and what its last image looks like."""
    for expose in exposures.values():
        expose()
    best: dict[str, float] = {}
    looks: dict[str, str] = {}
    for _ in range(REPEATS):
        for name, expose in exposures.items():
            answer = expose()
            look = f"{answer.pop('mean_dn'):8.1f} +- {answer.pop('std_dn'):4.1f}"
            for part, seconds in answer.items():
                label = f"{name}, {part}" if part else name
                best[label] = min(seconds, best.get(label, np.inf))
                looks[label] = look
    return best, looks


def main() -> None:
    parser = argparse.ArgumentParser(description="Time of one exposure in Pyxel over its time in labcdp.")
    parser.add_argument(
        "--environment", type=Path, default=default_environment(), help="folder of the environment with Pyxel"
    )
    python = prepare(parser.parse_args().environment)
    for electrons in LEVELS_E:
        with pyxel_exposures(python, electrons) as ask:
            best, looks = measure(
                {
                    REFERENCE: partial(labcdp_exposure, SENSOR, electrons, None),
                    "labcdp, 1 thread": partial(labcdp_exposure, SENSOR, electrons, 1),
                    "labcdp, drawing the pattern": partial(first_exposure, electrons),
                    "Pyxel, all models": partial(ask, "all models"),
                    "Pyxel, no pattern": partial(ask, "no pattern"),
                    "Pyxel, leanest": partial(ask, "leanest"),
                }
            )
        title = f"{electrons:.0f} e-, {os.cpu_count()} processors"
        print(f"\n{title:30s}      time    megapixel/s    over labcdp         image in DN")
        for label, seconds in best.items():
            ratio = seconds / best[REFERENCE]
            megapixels_s = SENSOR.width * SENSOR.height * 1e-6 / seconds
            print(f"{label:30s}  {seconds:6.3f} s  {megapixels_s:11.1f}    {ratio:11.1f}    {looks[label]}")


if __name__ == "__main__":
    main()
