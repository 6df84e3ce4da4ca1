"""Reproduction of the published values of L. Ebbert, Implementierung von CDP, HS Düsseldorf, 2018.

The thesis evaluates a checkerboard of one-pixel squares, 301 x 420 pixels, nearest-neighbour, behind the sensor. Its
array of contrasts has one slot for each of the 252 119 pairs of neighbours, of which its loop writes 418 twice and
leaves as many unfilled, at a contrast of 1 %. These count as not detected in every published value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from statistics import fmean, stdev
from typing import Any

import numpy as np

from ...chain import Chain, ChainRun, Sensor, ThesisSensor, ThesisWindscreen, Windscreen
from ...core.errors import InputError
from ...metrics import cdp_neighbours

#: Pairs of neighbours of 301 x 420 pixels, and the slots of the thesis' array of them that stay unfilled.
NEIGHBOUR_PAIRS, UNFILLED_SLOTS = 252_119, 418

#: The tolerance of all published values.
EPSILON = 0.5


@dataclass(frozen=True)
class PublishedRow:
    """One column of table 5.3, or another published value.

    Parameters
    ----------
    label : str
        Name in the thesis.
    contrast : float
        Weber contrast, a fraction.
    luminance_cd_m2 : float
        Luminance of the dark squares.
    temperature_c, exposure_s, pixel_pitch_m : float
        Temperature of the sensor, exposure time and pixel pitch.
    published_cdp : float
        CDP in the thesis.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import TABLE_5_3
    >>> TABLE_5_3[0].contrast, TABLE_5_3[0].published_cdp
    (1.0, 0.8287198)
    """

    label: str
    contrast: float
    luminance_cd_m2: float
    temperature_c: float
    exposure_s: float
    pixel_pitch_m: float
    published_cdp: float

    @property
    def is_unfilled_slots(self) -> bool:
        """Whether the value is that of a CDP of 1 with the slots that the thesis' program leaves unfilled."""
        return self.published_cdp == round(1 - UNFILLED_SLOTS / NEIGHBOUR_PAIRS, 8)


#: Table 5.3; its merged cells are resolved by its text: columns 4 to 7 at 1 cd/m^2, columns 4 to 8 with 3 um.
TABLE_5_3 = (
    PublishedRow("1", 1.0, 1.0, 50.0, 0.010, 2e-6, 0.8287198),
    PublishedRow("2", 1.0, 1.0, 100.0, 0.010, 2e-6, 0.1523090),
    PublishedRow("3", 1.0, 10.0, 100.0, 0.010, 2e-6, 0.6816225),
    PublishedRow("4", 1.0, 1.0, 100.0, 0.010, 3e-6, 0.2325489),
    PublishedRow("5", 0.3, 1.0, 100.0, 0.010, 3e-6, 0.15827843),
    PublishedRow("6", 0.3, 1.0, 100.0, 0.015, 3e-6, 0.1578064),
    PublishedRow("7", 0.3, 1.0, 50.0, 0.015, 3e-6, 0.8420468),
    PublishedRow("8", 0.3, 10.0, 50.0, 0.015, 3e-6, 0.99834205),
)

#: Figure 3.10. The thesis' bright squares have 20 cd/m^2 and its dark ones half of that. Its text does not give the
#: exposure time; its program has 5 ms in the sweep of intensities and 15 ms for single images.
FIGURE_3_10 = (
    PublishedRow("figure 3.10", 1.0, 10.0, 100.0, 0.005, 2e-6, 0.66630),
    PublishedRow("figure 3.10", 1.0, 10.0, 100.0, 0.015, 2e-6, 0.66630),
)


@dataclass(frozen=True)
class ReproducedRow:
    """A published value and that of labcdp; all CDP are nearest-neighbour unless stated otherwise.

    Parameters
    ----------
    published : PublishedRow
        The published value and its setting.
    mean, standard_deviation : float
        Of our CDP over the seeds, with the thesis' physics and its unfilled slots.
    z : float
        Published value less mean, in standard deviations; 0 if the two agree to the printed digits.
    all_pairs_mean : float
        Mean of our CDP without unfilled slots.
    corrected_mean, corrected_standard_deviation : float
        The same setting with correct physics, over the seeds.
    corrected_exact : float
        Predicted without random numbers, region to region, with correct physics.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import TABLE_5_3, ReproducedRow
    >>> row = ReproducedRow(TABLE_5_3[0], 0.99, 0.01, 0.5, 1.0, 0.98, 0.01, corrected_exact=0.98)
    >>> row.published is TABLE_5_3[0]
    True
    """

    published: PublishedRow
    mean: float
    standard_deviation: float
    z: float
    all_pairs_mean: float
    corrected_mean: float
    corrected_standard_deviation: float
    corrected_exact: float


@dataclass(frozen=True, eq=False)
class IntensitySweep:
    """CDP and SNR over the luminance of the dark squares: 100 % contrast, 100 degC, 5 ms, 2 um, 20 % glare.

    Parameters
    ----------
    luminance_cd_m2 : ndarray of float, shape (n,)
        Luminance of the dark squares.
    cdp, snr_db : ndarray of float, shape (n,)
        With the thesis' physics, nearest-neighbour; SNR as 10 log10 of mean over standard deviation of the bright
        squares' luminance, which the thesis evaluates.
    corrected_cdp, corrected_snr_db : ndarray of float, shape (n,)
        With correct physics, predicted without random numbers.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import intensity_sweep
    >>> intensity_sweep(points=3).corrected_cdp.round(3).tolist()
    [0.04, 0.0, 0.0]
    """

    luminance_cd_m2: np.ndarray[Any, np.dtype[np.float64]]
    cdp: np.ndarray[Any, np.dtype[np.float64]]
    snr_db: np.ndarray[Any, np.dtype[np.float64]]
    corrected_cdp: np.ndarray[Any, np.dtype[np.float64]]
    corrected_snr_db: np.ndarray[Any, np.dtype[np.float64]]


@dataclass(frozen=True)
class ThesisReproduction:
    """All published values that are reproduced.

    Parameters
    ----------
    seeds : int
        Number of seeds, 0 and up.
    table : tuple of ReproducedRow
        Table 5.3.
    figure : tuple of ReproducedRow
        Figure 3.10's value.
    sweep : IntensitySweep
        The sweep of intensities.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import FIGURE_3_10, TABLE_5_3, ThesisReproduction
    >>> from labcdp.evaluate.sweep.thesis import intensity_sweep, reproduce_row
    >>> rows = [reproduce_row(row, range(2)) for row in (TABLE_5_3[0], FIGURE_3_10[0])]
    >>> ThesisReproduction(2, (rows[0],), (rows[1],), intensity_sweep(points=3)).seeds
    2
    """

    seeds: int
    table: tuple[ReproducedRow, ...]
    figure: tuple[ReproducedRow, ...]
    sweep: IntensitySweep


def reproduce_thesis(seeds: int = 30, progress: Callable[[int, int], None] | None = None) -> ThesisReproduction:
    """Reproduce table 5.3, figure 3.10's value and the sweep of intensities.

    Parameters
    ----------
    seeds : int
        Over how many seeds, at least 2.
    progress : callable or None
        Called with the number of steps done and in total.

    Raises
    ------
    InputError
        If there are fewer than two seeds, from which no standard deviation can be known.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import reproduce_thesis
    >>> reproduce_thesis(seeds=1)
    Traceback (most recent call last):
        ...
    labcdp.core.errors.InputError: seeds is 1: give at least 2, for a standard deviation
    """
    if seeds < 2:
        raise InputError(f"seeds is {seeds}: give at least 2, for a standard deviation")
    rows = (*TABLE_5_3, *FIGURE_3_10)
    tell = progress or (lambda done, total: None)
    reproduced = []
    for done, row in enumerate(rows):
        tell(done, len(rows) + 1)
        reproduced.append(reproduce_row(row, range(seeds)))
    sweep = intensity_sweep()
    tell(len(rows) + 1, len(rows) + 1)
    size = len(TABLE_5_3)
    return ThesisReproduction(seeds, tuple(reproduced[:size]), tuple(reproduced[size:]), sweep)


def reproduce_row(row: PublishedRow, seeds: Sequence[int]) -> ReproducedRow:
    """Run the thesis' setting, and the same with correct physics, for each of at least two seeds.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import TABLE_5_3, reproduce_row
    >>> abs(reproduce_row(TABLE_5_3[0], range(3)).mean - TABLE_5_3[0].published_cdp) < 0.01
    True
    """
    from ...chain.predict.chain import predict_chain

    thesis, physical = thesis_chain(row), corrected_chain(row)
    all_pairs = [_neighbours(thesis.run(seed), row.contrast) for seed in seeds]
    samples = [(1 - UNFILLED_SLOTS / NEIGHBOUR_PAIRS) * share for share in all_pairs]
    # The thesis draws a fixed pattern for each frame, so here each seed is another device.
    corrected = [_neighbours(physical.with_(sensor__device_seed=seed).run(seed), row.contrast) for seed in seeds]
    mean, deviation = fmean(samples), stdev(samples)
    distance = row.published_cdp - mean
    return ReproducedRow(
        row,
        mean,
        deviation,
        # The thesis prints 7 or 8 digits.
        0.0 if abs(distance) < 1e-7 else distance / deviation,
        fmean(all_pairs),
        fmean(corrected),
        stdev(corrected),
        float(predict_chain(physical, contrast=row.contrast, epsilon=EPSILON).cdp[0]),
    )


def thesis_chain(row: PublishedRow, **changes: Any) -> Chain:
    """Return the thesis' chain for a row of its table, up to the sensor.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import TABLE_5_3, thesis_chain
    >>> thesis_chain(TABLE_5_3[0]).stage_names
    ('scene', 'windscreen', 'optics', 'sensor')
    """
    return replace(Chain.load("thesis-2018").with_(**(_setting(row) | changes)), hdr=None, behind=())


def corrected_chain(row: PublishedRow, glare_fraction: float = 1.0) -> Chain:
    """Return the same setting with correct physics.

    Light of D65; glare subtracted as it was added; photons and dark electrons in one Poisson process, so that light
    has its shot noise; a fixed pattern that is fixed, of the dark current in pixels and of offsets in rows and columns
    as large as the thesis' at this temperature and time; rounding instead of cutting off. The thesis gives no
    read noise and no black level, so there are none.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import TABLE_5_3, corrected_chain
    >>> corrected_chain(TABLE_5_3[0]).spectrum
    'D65'
    """
    thesis = thesis_chain(row)
    (name, old), *_ = thesis.sensors
    assert isinstance(old, ThesisSensor)
    growth = 2 ** ((row.temperature_c - 25.0) / old.doubling_temperature_c) * row.exposure_s
    alike = {field.name for field in fields(old)} & {field.name for field in fields(Sensor)} - {"dark_current_e_s"}
    sensor = Sensor(
        **{key: getattr(old, key) for key in alike},
        read_noise_e=0.0,
        dark_current_e_s=old.dark_current_e_s + old.row_dark_current_e_s + old.column_dark_current_e_s,
        dsnu_e_s=old.pixel_pattern_e_s,
        row_dsnu_e=old.row_pattern_e_s * growth,
        column_dsnu_e=old.column_pattern_e_s * growth,
    )
    screens = {
        stage: Windscreen(screen.transmittance, glare_fraction, glare_subtracted=True)
        for stage, screen in thesis.before
        if isinstance(screen, ThesisWindscreen)
    }
    return replace(
        thesis,
        name="thesis-2018 with correct physics",
        spectrum="D65",
        before=tuple((stage, screens.get(stage, screen)) for stage, screen in thesis.before),
        sensors=((name, sensor),),
    )


def intensity_sweep(points: int = 200) -> IntensitySweep:
    """Sweep the intensity as the thesis' program does: logspace(-3, 9), 20 % glare, 5 ms.

    Examples
    --------
    >>> from labcdp.evaluate.sweep.thesis import intensity_sweep
    >>> intensity_sweep(points=3).luminance_cd_m2.tolist()
    [0.001, 1000.0, 1000000000.0]
    """
    from ...chain.predict.chain import predict_chain

    row = PublishedRow("sweep", 1.0, 1.0, 100.0, 0.005, 2e-6, float("nan"))
    luminances = np.logspace(-3, 9, points)
    base = thesis_chain(row, **{"windscreen.glare_fraction": 0.2})
    shares, ratios = np.empty(points), np.empty(points)
    for index, luminance_cd_m2 in enumerate(luminances):
        run = base.with_(scene__luminance_cd_m2=float(luminance_cd_m2)).run(index)
        shares[index] = _neighbours(run, row.contrast)
        bright = run["sensor"].luminance_cd_m2[run.chain.scene.regions()["bright"]].astype(np.float64)
        bright = bright[bright > 0]
        # As in the thesis, pixels at 0 and below are left out, and a region without noise has an infinite ratio.
        noisy = bright.size > 0 and bright.std() > 1e-6 * bright.mean()
        ratios[index] = bright.mean() / bright.std() if noisy else np.inf
    physical = corrected_chain(row, glare_fraction=0.2)
    predicted = predict_chain(
        physical, {"luminance_cd_m2": luminances.tolist()}, contrast=row.contrast, epsilon=EPSILON
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        return IntensitySweep(
            luminances, shares, 10 * np.log10(ratios), predicted.cdp, 10 * np.log10(predicted.snr_bright)
        )


def _setting(row: PublishedRow) -> dict[str, Any]:
    return {
        "scene.contrast": row.contrast,
        "scene.luminance_cd_m2": row.luminance_cd_m2,
        "exposure.temperature_c": row.temperature_c,
        "exposure.exposure_s": row.exposure_s,
        "sensor.pixel_pitch_m": row.pixel_pitch_m,
    }


def _neighbours(run: ChainRun, contrast: float) -> float:
    luminance = run["sensor"].luminance_cd_m2
    # A frame of dark signal has no contrast anywhere; the thesis counts such pairs as not detected.
    return cdp_neighbours(luminance, contrast, EPSILON).cdp if luminance.max() > 0 else 0.0
