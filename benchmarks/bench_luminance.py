"""Time of converting a 5-megapixel frame to luminance over the time of one look-up in a table.

Run ``python benchmarks/bench_luminance.py``. The floor is ``np.take`` of every pixel of a 12-bit frame through a
table of 4096 float32 values as anybody would write it. Each ratio compares medians of calls that took turns in this
run, so it holds on any machine.

A conversion can be faster than the floor: NumPy turns DN into addresses of 8 bytes first, and block by block those stay
in the processor's cache.

Last, ``labcdp luminance`` merges twelve such frames in a process of its own: its seconds and peak memory.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np

from labcdp.calibration import (
    Calibration,
    CameraState,
    DarkModel,
    LensIdentity,
    MeterScale,
    PatchResidual,
    Provenance,
    ResponsivityFit,
    TemporalNoise,
    save,
)
from labcdp.calibration.fit_records import FitError
from labcdp.core.dn import Response
from labcdp.core.frame import CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity
from labcdp.core.vignetting import AnyVignetting, FlatField, RadialVignetting, middle_of
from labcdp.session.frames import frame_to_tiff

REPEATS = 21
SHAPE = (2056, 2452)
CAMERA = CameraIdentity("Allied Vision", "Manta G-505B", "1")


def calibration(vignetting: AnyVignetting | None) -> Calibration:
    start = datetime(2018, 3, 1, tzinfo=UTC)
    knots = tuple(np.linspace(1, 4000, 9).tolist())
    of_fit = [FitError("fit", knots, tuple((0.001 * np.cos(k * np.arange(9))).tolist())) for k in range(3)]
    dark_covariance = ((0.04, 0.0, 0.0), (0.0, 0.01, 0.0), (0.0, 0.0, 0.0))
    of_dark = [FitError("dark and temperature", (1.0, 4000.0), (0.0, 0.0), (), (0.2, 0.1, 0.0), 0.0)]
    return Calibration(
        state=CameraState(CAMERA, "Mono12", 12, SHAPE, 0.0, 4095.0, 64.0),
        lens=LensIdentity("Kowa LM6NCL", "", 0.006, 2.6),
        source_spectrum="LED-B4",
        meter_scale=MeterScale(MeterIdentity("LS-110", "1"), 0.02),
        responsivity=ResponsivityFit(1200.0, 0.003, 10.0, 11, 0.0, 0.0, None, None),
        response=Response("quadratic", (0.0, 4000.0), (0.0, 4080.0)),
        fit_errors=(*of_fit, *of_dark),
        dark=DarkModel(64.0, 40.0, dark_covariance, 1.5, 0.0, (0.001, 0.064)),
        noise=TemporalNoise(0.25, 1.5),
        gains=(),
        vignetting=vignetting,
        defects=None,
        dark_library=None,
        range_cd_m2=(0.5, 2000.0),
        range_net_dn=(5.0, 4000.0),
        exposures_s=(0.001, 0.064),
        residuals=(PatchResidual("P1", 100.0, 0.1, 4, 100.0, (0.008,), 0.0, 0.0, (32.0, 24.0), None),),
        held_out=(),
        left_out=(),
        ladder=(),
        tests=(),
        findings=(),
        provenance=Provenance(start, "0" * 64, {}),
    )


def frame() -> Frame:
    """All luminances from dark to saturation, in no order."""
    dn = np.random.default_rng(1).integers(64, 4096, SHAPE).astype(np.uint16)
    return Frame(dn, 0.008, 0.0, 12, 4095.0, 64.0, "Mono12", None, None, datetime.now(UTC), 0, 0, CAMERA)


def flat_field() -> FlatField:
    fall_off = RadialVignetting(-0.4, 0.05, 0.0).relative_illuminance(SHAPE)
    relative = fall_off * np.random.default_rng(2).normal(1, 0.005, SHAPE)
    return FlatField(relative / relative[middle_of(SHAPE)].mean(), 0.001, 0.01, 16)


def luminance_alone(chosen: Calibration, of: Frame) -> None:
    _ = chosen.to_luminance(of).luminance_cd_m2


def everything(chosen: Calibration, of: Frame) -> None:
    seen = chosen.to_luminance(of)
    _ = seen.luminance_cd_m2, seen.random_rel, seen.common_rel, seen.invalid


def interleaved_ms(*actions: Callable[[], object]) -> list[float]:
    times: list[list[float]] = [[] for _ in actions]
    for _ in range(REPEATS):
        for action, taken in zip(actions, times, strict=True):
            start = time.perf_counter()
            action()
            taken.append(time.perf_counter() - start)
    return [median(taken) * 1e3 for taken in times]


def merge_twelve(folder: Path) -> None:
    """Print time and memory of `labcdp luminance` with four frames at each of three exposures of a still scene."""
    chosen = replace(calibration(RadialVignetting(0.0, 0.0, 0.0)), response=Response("linear"))
    save(chosen, folder / "calibration.json")
    rng, files = np.random.default_rng(3), []
    scene = np.exp(rng.uniform(np.log(0.6), np.log(1900), SHAPE))
    for number, exposure_s in enumerate(np.repeat([0.001, 0.008, 0.064], 4).tolist()):
        net_dn = 1200 * scene * exposure_s
        noisy = 64 + 40 * exposure_s + net_dn + np.sqrt(0.25 * net_dn + 1.5**2) * rng.standard_normal(SHAPE)
        dn = np.clip(np.rint(noisy), 0, 4095).astype(np.uint16)
        files.append(folder / f"{number:02d}.tif")
        one = Frame(
            dn, exposure_s, 0.0, 12, 4095.0, 64.0, "Mono12", None, None, datetime.now(UTC), number, number, CAMERA
        )
        files[-1].write_bytes(frame_to_tiff(one, compress=False))
    command = [
        str(Path(sys.executable).with_name("labcdp")),
        "luminance",
        "calibration.json",
        *files,
        "--output",
        "scene.exr",
    ]
    start = time.perf_counter()
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)
    seconds, used = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s, memory_gb = used.ru_utime + used.ru_stime, used.ru_maxrss / 1e6
    print(f"labcdp luminance of twelve frames: {seconds:.1f} s, {cpu_s:.1f} s of one core, {memory_gb:.2f} GB")


def main() -> None:
    table, taken = np.linspace(0, 1, 4096, dtype=np.float32), frame()
    plain, flat = calibration(None), calibration(flat_field())
    actions = {
        "np.take through a table of float32": partial(np.take, table, taken.dn),
        "luminance, no flat field": partial(luminance_alone, plain, taken),
        "luminance, flat field": partial(luminance_alone, flat, taken),
        "with uncertainty and flags, no flat field": partial(everything, plain, taken),
        "with uncertainty and flags, flat field": partial(everything, flat, taken),
    }
    everything(flat, taken)  # 1 / V is computed for the first frame and kept
    times_ms = interleaved_ms(*actions.values())
    for label, ms in zip(actions, times_ms, strict=True):
        print(f"{label:42s}  {ms:7.1f} ms   ratio {ms / times_ms[0]:.2f}")
    with TemporaryDirectory() as folder:
        merge_twelve(Path(folder))


if __name__ == "__main__":
    main()
