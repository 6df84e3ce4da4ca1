"""Time of a characterisation after EMVA 1288 over the time of reading its images alone, on one thread.

Run ``python benchmarks/bench_characterise.py``. It takes reference set 001 if LABCDP_EMVA_DATA names the folder it is
in, and else writes a data set of the same size: 300 images of 640 x 480 pixels and 12 bits.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp

import cv2
import numpy as np

from labcdp.calibration.emva.data_set import characterise_data_set
from labcdp.calibration.emva.images import read_image
from labcdp.calibration.emva.index import INDEX_NAME, load_index
from labcdp.evaluate.camera.result import characterisation_files, result
from labcdp.output import ResultsFolder

REFERENCE = "EMVA1288_ReferenceSet_001_CCD_12Bit"
REPEATS = 3
LEVELS, STACK, SHAPE, BITS = 50, 50, (480, 640), 12


def best_s(action: Callable[[], object]) -> float:
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        action()
        times.append(time.perf_counter() - start)
    return min(times)


def write_set(folder: Path) -> Path:
    rng = np.random.default_rng(1)
    lines = ["v 3.1", f"n {BITS} {SHAPE[1]} {SHAPE[0]}"]
    blocks = [(40_000.0 * number / LEVELS, number * 280_000, 2) for number in range(1, LEVELS + 1)]
    blocks.append((15_500.0, 5_160_000, STACK))
    for number, (photons, exposure_ns, count) in enumerate(blocks):
        for letter, light in (("b", photons), ("d", 0.0)):
            lines.append(f"b {exposure_ns} {photons}" if letter == "b" else f"d {exposure_ns}")
            for image in range(count):
                electrons = rng.poisson(0.45 * light, SHAPE) + 11 * rng.standard_normal(SHAPE)
                dn = np.clip(np.rint(0.28 * electrons + 15), 0, 2**BITS - 1).astype(np.uint16)
                name = f"{letter}_{number:03d}_{image:03d}.png"
                cv2.imwrite(str(folder / name), dn)
                lines.append(f"i {name}")
    (folder / INDEX_NAME).write_text("\n".join(lines) + "\n")
    return folder


def read_all(folder: Path) -> None:
    index = load_index(folder)
    for block in index.blocks:
        for image in block.images:
            read_image(image, (index.height, index.width), index.bits)


def reported(folder: Path, place: Path) -> None:
    found = characterise_data_set(folder)
    with ResultsFolder(Path(mkdtemp(dir=place)) / "results", "characterise") as results:
        results.add(characterisation_files(found, result(found)))


def main() -> None:
    # One thread, so that the ratio does not depend on the number of processors.
    cv2.setNumThreads(1)
    with TemporaryDirectory() as temporary:
        given = Path(os.environ.get("LABCDP_EMVA_DATA", "")) / REFERENCE
        folder = given if (given / INDEX_NAME).is_file() else write_set(Path(temporary))
        reading = best_s(lambda: read_all(folder))
        whole = best_s(lambda: characterise_data_set(folder))
        report = best_s(lambda: reported(folder, Path(temporary)))
    print(f"{'reference set 001' if folder == given else 'a set of the size of reference set 001'}, 300 images")
    print(f"reading the images alone     {reading:7.2f} s")
    print(f"characterise                 {whole:7.2f} s    ratio {whole / reading:.2f}")
    print(f"characterise, with report    {report:7.2f} s    ratio {report / reading:.2f}")


if __name__ == "__main__":
    main()
