"""Time of predicting a map of CDP without random numbers, over the time of simulating one of its cells.

Run ``python benchmarks/bench_exact.py``. The map has 200 luminances and 50 contrasts behind a windscreen with glare,
so that all 20 000 patches differ; the simulated cell has two patches of 500 x 500 pixels.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

import labcdp
from labcdp import Chain
from labcdp.chain import ExposureSettings, Hdr, Sensor
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.prediction import PatchRates, predict

REPEATS = 3
SIDE = 500
ELECTRONS_PER_S_CD_M2 = 4000.0
SENSOR = Sensor(
    pixel_pitch_m=3.45e-6,
    width=SIDE,
    height=SIDE,
    quantum_efficiency=0.5,
    full_well_e=7000.0,
    k_dn_per_e=0.6,
    read_noise_e=10.0,
    dark_current_e_s=5.0,
    bits=12,
    black_level_dn=64.0,
    prnu_rel=0.01,
    dsnu_e=2.0,
    dsnu_e_s=2.0,
)


def best_s(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def simulate_cell() -> None:
    bright, dark = (
        replace(SENSOR, device_seed=seed).expose(rate, 5e-3, temperature_c=35.0, seed=seed, exposure_index=0)
        for seed, rate in ((1, 3e5), (2, 2e5))
    )
    labcdp.cdp(bright, dark, 0.5)


def main() -> None:
    luminance = np.geomspace(0.01, 1e5, 200)[:, None]
    contrast = np.geomspace(0.05, 10, 50)
    dark, bright = luminance * ELECTRONS_PER_S_CD_M2, luminance * (1 + contrast) * ELECTRONS_PER_S_CD_M2
    veil = 0.2 * (dark + bright) / 2
    rates = PatchRates(dark + veil, bright + veil, veil)
    cell_s = best_s(simulate_cell)
    print(f"one simulated cell, one exposure    {cell_s:7.3f} s")
    cameras = {"one exposure": CameraModel(SENSOR, ExposureSettings((5e-3,), 0.0, 35.0))}
    for method in ("normal", "linear", "weighted"):
        settings = ExposureSettings((16e-3, 2e-3, 0.25e-3), 0.0, 35.0)
        cameras[f"three exposures, {method}"] = CameraModel(SENSOR, settings, Hdr(method))
    for name, camera in cameras.items():
        map_s = best_s(partial(predict, camera, rates, contrast))
        share = map_s / contrast.size / luminance.size / cell_s
        print(f"map of 200 x 50 cells, {name:25s} {map_s:7.3f} s   a cell is {share:.2g} of the simulated one")
    one, four = (best_s(partial(sweep_of_140_db, chain)) for chain in chains_of_captures())
    print(f"200 luminances over 140 dB, one capture {one:.3f} s, four captures {four:.3f} s: {four / one:.2f} times")


def chains_of_captures() -> tuple[Chain, Chain]:
    """Return the preset split-pixel with its large photodiode at low gain alone, and with a fourth, short capture."""
    document = Chain.load("split-pixel").document
    sensor = document["sensor"]
    first, low, small = sensor.pop("captures")
    photodiodes = sensor.pop("photodiodes")
    alone = sensor | {key: low[key] for key in ("k_dn_per_e", "read_noise_e")}
    captures = [first, low, small, small | {"name": "short", "exposure_s": 0.4e-3}]
    merged = sensor | {"photodiodes": photodiodes, "captures": captures}
    single = {key: value for key, value in document.items() if key != "hdr"}
    return Chain.from_document(single | {"sensor": alone}), Chain.from_document(document | {"sensor": merged})


def sweep_of_140_db(chain: Chain) -> None:
    chain.sweep(exact=True, scene__luminance_cd_m2=np.geomspace(1e-3, 1e4, 200))


if __name__ == "__main__":
    main()
