"""Truths that need numbers alone: closed forms, exact arithmetic, published values, brute force, simulated worlds."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm, poisson
from tracking_accuracy import Tally
from tracking_disturbances import CASES, frames_of
from worlds.bench import calibrate_once
from worlds.catalogue import WORLDS
from worlds.table import HIGHEST, LOWEST, NAMED, binomial_error, summarise

import labcdp
from labcdp.calibration.emva.data_set import characterise_data_set
from labcdp.evaluate.sweep.thesis import FIGURE_3_10, TABLE_5_3, ReproducedRow, reproduce_row
from labcdp.metrics import DetectionInterval, Distribution, d_prime
from labcdp.tracking import make_tracker
from tests.calibration.emva.reference_figures import NAMES, SETS
from tests.metrics.closed_forms import NORMAL, share_of_normal

from .check import Check, absolute, by_noise, not_run, relative
from .real_camera import real_camera

_VIDEOS = ("shift", "larger", "turned", "heavy noise", "jump 60 px", "fog", "something in front", "leaves the image")
_CAMERA = {"sensor.prnu_rel": 0.0, "sensor.dsnu_e": 0.0, "sensor.dsnu_e_s": 0.0}


def closed_forms() -> Iterator[Check]:
    """Compare with distributions whose CDP is known in closed form."""
    for patches, _ in NORMAL:
        dark, dark_std, bright, bright_std = patches
        regions, contrast = (
            (Distribution.normal(bright, bright_std), Distribution.normal(dark, dark_std)),
            bright / dark - 1,
        )
        found = labcdp.cdp(*regions, contrast).cdp
        truth = share_of_normal((bright, bright_std), (dark, dark_std), 0.5 * contrast, 1.5 * contrast)
        name = f"normal {bright} ± {bright_std} against {dark} ± {dark_std}, ε 50 %"
        yield absolute(name, truth, found, 1e-6, "Φ of the ratio of two normal variables")
    quanta = np.arange(1000)
    shot = [Distribution(quanta, poisson.pmf(quanta, mean)) for mean in (300, 250)]
    low, high = 1.1 * quanta, 1.3 * quanta
    share = poisson.cdf(np.floor(high + 1e-9), 300) - poisson.cdf(np.ceil(low - 1e-9) - 1, 300)
    truth = float(poisson.pmf(quanta, 250) @ share)
    yield absolute(
        "photon noise, 300 against 250 quanta, 20 %", truth, labcdp.cdp(shot[0], shot[1], 0.2).cdp, 1e-9, "Poisson sums"
    )
    strong, weak = Distribution.normal(110, 8), Distribution.normal(100, 7)
    found = labcdp.cdp(strong, weak, 0.1, DetectionInterval.at_least(1.0)).cdp
    truth = float(norm.cdf(d_prime(strong, weak).value / 2**0.5))
    yield absolute("one-sided from 0 on", truth, found, 1e-6, "Φ(d' / √2), signal detection theory")


def exact_arithmetic(regions: int = 200) -> Iterator[Check]:
    """Visit all pairs of whole numbers in rational arithmetic."""
    rng, different = np.random.default_rng(1), 0
    for _ in range(regions):
        a, b = rng.integers(0, 40, (2, 12))
        contrast, epsilon = Fraction(int(rng.integers(1, 200)), 100), Fraction(int(rng.integers(1, 101)), 100)
        bright, dark = (a, b) if a.sum() >= b.sum() else (b, a)
        low, high = 1 + contrast * (1 - epsilon), 1 + contrast * (1 + epsilon)
        pairs = product(map(int, bright), map(int, dark))
        inside = sum(low * d <= x <= high * d for x, d in pairs if d > 0)
        different += labcdp.cdp(bright, dark, float(contrast), float(epsilon)).cdp != inside / 144
    yield absolute(f"regions of {regions} whose CDP differs", 0, different, 0, "fractions.Fraction, every pair")


def reference_sets(folder: Path | None) -> Iterator[Check]:
    """Compare with the EMVA's own evaluation of its reference sets."""
    for name, truths, limit, _ in SETS:
        place = (folder or Path()) / f"EMVA1288_ReferenceSet_{name}"
        if not place.is_dir():
            yield not_run(f"set {name}", f"give --emva FOLDER or LABCDP_EMVA_DATA with {place.name} in it")
            continue
        found = characterise_data_set(place)
        for quantity, truth in zip(NAMES, truths, strict=True):
            source = "reference implementation, github.com/EMVA1288/emva1288 at 2ed0b40"
            yield relative(f"set {name}, {quantity}", truth, getattr(found, quantity).value, limit, source)
        if name.startswith("001"):
            yield from real_camera(place, found)


def thesis(seeds: int) -> Iterator[Check]:
    """Compare with table 5.3 and figure 3.10 of the 2018 thesis, over seeds."""
    with ProcessPoolExecutor() as pool:
        rows = list(pool.map(partial(reproduce_row, seeds=range(seeds)), (*TABLE_5_3, *FIGURE_3_10)))
    yield from map(_thesis_row, rows)


def _thesis_row(row: ReproducedRow) -> Check:
    published, source = row.published, "Ebbert 2018, table 5.3"
    name = f"row {published.label}"
    if published.is_unfilled_slots:
        source += ": every pair is detected; 1 - 418 / 252119, slots that its program leaves unfilled"
    if published in FIGURE_3_10:
        name = f"figure 3.10 with {published.exposure_s * 1e3:g} ms"
        source = "Ebbert 2018; its text has no exposure time, its program 5 ms and 15 ms"
    return by_noise(name, published.published_cdp, row.mean, row.z, source)


def prediction() -> Iterator[Check]:
    """Compare predicted CDP with frames simulated with random numbers, pixels without a fixed pattern."""
    chain = labcdp.Chain.load("manta-g505").with_(scene__width=256, scene__height=256, scene__square_px=32, **_CAMERA)
    chain = replace(chain, before=tuple((n, replace(s, focal_length_m=None)) for n, s in chain.before))
    axes: dict[str, Any] = {"scene__luminance_cd_m2": [0.5, 3.0, 20.0, 80.0], "scene__contrast": [0.1, 0.3, 1.0]}
    predicted, simulated = chain.sweep(exact=True, **axes), chain.sweep(seed=1, **axes)
    for luminance, contrast in product(*axes.values()):
        cell = {"scene.luminance_cd_m2": luminance, "scene.contrast": contrast}
        truth, found = simulated.sel(cell), predicted.sel(cell).cdp.item()
        u = max(truth.standard_error.item(), 1e-5)
        z = (found - truth.cdp.item()) / u
        yield by_noise(f"{luminance:g} cd/m², {contrast:.0%}", truth.cdp.item(), found, z, "65 536 simulated pixels")


def coverage(calibrations: int) -> Iterator[Check]:
    """Count the 95 % intervals that contain the truth in all worlds outside labcdp's model."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for world in WORLDS:
            summary = summarise(world, list(pool.map(partial(calibrate_once, world), range(calibrations))))
            done = summary.calibrations - summary.refused
            if not done:
                yield not_run(f"{world.name}: refused", "; ".join(summary.reasons))
            for quantity, share in summary.coverage.items():
                nearest = min(max(share, LOWEST), HIGHEST)
                error = binomial_error(nearest, done)
                source = (
                    f"{share:.0%} ± {error:.0%} of {done} calibrations (binomial); {LOWEST:.0%} to {HIGHEST:.0%} hold"
                )
                # Where intervals are too short, a finding that names the effect is asked for instead.
                named = share < nearest and summary.named_where_wrong is not None and summary.named_where_wrong >= NAMED
                deviation = (share - nearest) / error
                if named:
                    source += f"; a finding names the effect in {summary.named_where_wrong:.0%} of the failures"
                limit = None if named else 2.0
                name = f"{world.name}: {quantity}"
                yield Check(name, 0.95, share, deviation, limit, "standard deviations", source)


def tracking() -> Iterator[Check]:
    """Compare places of followed regions in simulated videos with the true ones."""
    with ProcessPoolExecutor() as pool:
        tallies = list(pool.map(_followed, _VIDEOS))
    places, near, off, wrong = (
        sum(getattr(one, name) for one in tallies) for name in ("places", "near", "off", "wrong")
    )
    source = f"{len(tallies)} simulated videos with {places} places in sight; benchmarks/tracking_accuracy.py has all"
    yield Check("share of places within 2 pixels", 1.0, near / places, near / places - 1, None, "absolute", source)
    yield absolute("places said to be found more than 2 pixels off", 0, off, 0, source)
    yield absolute("places said to be found though gone", 0, wrong, 0, source)


def _followed(name: str) -> Tally:
    """Follow the regions of a video."""
    tally, tracker = Tally(), None
    tally.start()
    for frame in frames_of(CASES[name], 0):
        if tracker is None:
            tracker = make_tracker("follow", frame.grey, frame.rois)
        else:
            tally.add(frame, tracker.update(frame.grey))
    return tally
