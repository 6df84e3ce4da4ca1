"""One calibration of a world by labcdp, and patches it has not seen, against the truth."""

from __future__ import annotations

import logging
import tempfile
import zlib
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import labcdp
from labcdp.calibration import contrast_U
from labcdp.core.errors import LabcdpError

from .camera import make_device
from .meter import read_patches, scale_errors
from .recorder import LIGHT_S, READ_S, Recorder
from .target import Pair, Target, asked_pair, calibration_target, measured_range, use_target
from .truth import cdp, true_pixels
from .world import BRIGHTEST_CD_M2, DOUBLING_K, HEIGHT, WIDTH, World

QUANTITIES = ("luminance", "contrast", "cdp")
#: Light and dark frames of each exposure, and those of a flat field.
FRAMES, FLAT_FRAMES = (3, 4), (16, 16)
#: Order of the planes' weights, and a folder in memory.
PLANES = ("R", "Gr", "Gb", "B")
_MEMORY = "/dev/shm"
#: Findings that say which patterns are taken off.
_WITHOUT = {"dark-pattern-subtracted": "dsnu", "flat-field-for-pixels": "prnu", "flat-field-for-shape": "prnu"}


@dataclass(frozen=True)
class Outcome:
    """What one calibration showed.

    Parameters
    ----------
    refused : str
        Why there is no result; empty if there is one.
    error, expanded : dict of str to float
        Actual error and stated expanded uncertainty by quantity: relative for the luminance, in units of 1 + K for the
        contrast K, absolute for the CDP.
    inside : dict of str to bool
        Whether the stated 95 % interval contains the true value.
    findings : tuple of (str, str)
        Severity and code of all findings.
    """

    refused: str = ""
    error: dict[str, float] = field(default_factory=dict)
    expanded: dict[str, float] = field(default_factory=dict)
    inside: dict[str, bool] = field(default_factory=dict)
    findings: tuple[tuple[str, str], ...] = ()


def calibrate_once(world: World, number: int) -> Outcome:
    """Calibrate one camera of a world, and measure patches that were not used; the same for the same number."""
    rng = np.random.default_rng([zlib.crc32(world.name.encode()), number])
    logging.disable(logging.CRITICAL)
    try:
        # In memory, where the system has such a folder: sessions are flushed to the disk.
        with tempfile.TemporaryDirectory(dir=_MEMORY if Path(_MEMORY).is_dir() else None) as folder:
            return _measured(world, rng, Path(folder))
    except LabcdpError as error:
        return Outcome(refused=f"{error}")
    except Exception as error:
        return Outcome(refused=f"crash, {type(error).__name__}: {error}")
    finally:
        logging.disable(logging.NOTSET)


def _measured(world: World, rng: np.random.Generator, folder: Path) -> Outcome:
    if world.drift_spread_rel:
        world = replace(world, drift_rel=world.drift_spread_rel * float(rng.normal()))
    device = make_device(world, rng)
    recorder = Recorder(device, rng, folder)
    scales = scale_errors(world, rng)
    target = calibration_target(world, rng)
    shown = read_patches(world, target.luminance_cd_m2, scales, rng, LIGHT_S, READ_S)
    with (
        recorder.record("calibration", target, shown, frames=FRAMES) as session,
        _flat_field(recorder, rng) if world.correction == "flat" else nullcontext() as flat,
    ):
        calibration = session.calibrate(
            flat_field=flat,
            nonuniformity_rel=world.nonuniformity_rel,
            response="debevec" if world.bracket else None,
        ).calibration
    pair, single_cd_m2 = asked_pair(device, rng), float(np.exp(rng.uniform(*np.log(measured_range(world)))))
    # The lamp stays as it is, the meter too, and nobody misreads it.
    after = later(replace(world, wrong_reading_rel=0.0, recalibrated="", drift_rel=0.0), rng)
    recorder.device = device = replace(device, world=after)
    target = use_target(after, pair, single_cd_m2, rng)
    shown = read_patches(after, target.luminance_cd_m2, scales, rng, LIGHT_S, READ_S)
    breathing = 1 + world.breathing_rel * float(rng.normal())
    breathing *= 1 + after.aged_rel * float(rng.normal()) if after.aged_rel else 1.0
    asked = {"bright": "B", "dark": "D", "contrast": pair.contrast, "epsilon": pair.epsilon}
    with recorder.record("use", target, shown, frames=(FRAMES[0], 2), contrast=asked, after=breathing) as session:
        evaluation = session.evaluate(calibration).evaluation
    return _compared(recorder, calibration, evaluation, pair, target, rng)


def later(world: World, rng: np.random.Generator) -> World:
    """Return what a world is like when the session that is evaluated is recorded."""
    if not world.later:
        return world
    changes: dict[str, Any] = dict(world.later)
    warmer_k, shift_dn = (changes.pop(name, 0.0) * float(rng.normal()) for name in ("warmer_k", "black_shift_dn"))
    return replace(
        world,
        temperature_c=world.temperature_c + warmer_k,
        dark_current_e_s=world.dark_current_e_s * 2 ** (warmer_k / DOUBLING_K),
        black_dn=world.black_dn + shift_dn,
        **changes,
    )


def _flat_field(recorder: Recorder, rng: np.random.Generator) -> labcdp.Session:
    """Record a source at half of saturation whose light is as non-uniform as stated, by a smooth random pattern."""
    world = recorder.device.world
    y, x = (np.pi * (np.arange(n) + 0.5) / n for n in (HEIGHT, WIDTH))
    pattern = sum(
        rng.normal() / (i**2 + k**2) * np.outer(np.cos(i * y), np.cos(k * x))
        for i in range(3)
        for k in range(3)
        if i + k > 0
    )
    source = np.asarray(0.8 * BRIGHTEST_CD_M2 * (1 + world.nonuniformity_rel * pattern / np.std(pattern)))
    target = Target({"source": (0, 0, WIDTH, HEIGHT)}, {}, {}, source)
    return recorder.record("flat", target, (), frames=FLAT_FRAMES, exposures_s=(min(world.exposures_s),), after=1.0)


def _codes(findings: Sequence[Any]) -> set[tuple[str, str]]:
    """Return severities and codes; of several causes, one of which is right, the codes are one, joined by ``|``."""
    several = [one for one in findings if one.code == "one-of"]
    joined = {code for one in several for code in one.values["codes"]}
    single = {(one.severity, one.code) for one in findings if one.code != "one-of" and one.code not in joined}
    return single | {(one.severity, "|".join(one.values["codes"])) for one in several}


def _compared(
    recorder: Recorder, calibration: Any, evaluation: Any, pair: Pair, target: Target, rng: np.random.Generator
) -> Outcome:
    device = recorder.device
    row = evaluation.contrasts[0]
    single = next(one.calibrated for one in evaluation.patches if one.patch.name == "S")
    truth_cd_m2 = target.luminance_cd_m2["S"]
    findings = _codes((*calibration.findings, *evaluation.findings))
    without = frozenset(_WITHOUT[code] for _, code in findings if code in _WITHOUT)
    weights = dict(zip(PLANES, calibration.weights, strict=True)) if device.world.bayer else {"": 1.0}
    pixels = [
        true_pixels(
            device,
            target,
            patch,
            row.exposure_s,
            rng,
            weights=weights,
            lamp=recorder.light[row.exposure_s],
            without=without,
        )
        for patch in "BD"
    ]
    true_cdp = cdp(pixels[0], pixels[1], pair.contrast, pair.epsilon)
    low, high = single.interval_95_cd_m2
    cdp_low, cdp_high = row.cdp.interval
    of_contrast = contrast_U(row.bright.calibrated, row.dark.calibrated)
    error = {
        "luminance": single.luminance_cd_m2 / truth_cd_m2 - 1,
        "contrast": (row.camera_contrast - pair.true_contrast) / (1 + pair.true_contrast),
        "cdp": row.cdp.cdp - true_cdp,
    }
    return Outcome(
        error=error,
        expanded={
            "luminance": (high - low) / 2 / single.luminance_cd_m2,
            "contrast": of_contrast / (1 + pair.true_contrast),
            "cdp": (cdp_high - cdp_low) / 2,
        },
        inside={
            "luminance": bool(low <= truth_cd_m2 <= high),
            "contrast": bool(abs(row.camera_contrast - pair.true_contrast) <= of_contrast),
            "cdp": bool(cdp_low <= true_cdp <= cdp_high),
        },
        findings=tuple(sorted(findings)),
    )
