"""A simulated image as a result: tables of detection and of signal and noise, and findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import inf, isfinite, isinf
from typing import Any

from ....core.result import Finding, InputFile, Result, info, warning
from ....core.table import Column, Table, uncertain, uncertain_values
from ....metrics import DetectionResult
from ....report.text import percent
from ..maps.axes import LARGEST_SNR
from .evaluation import PairRow, RegionRow, SimulationEvaluation, StageRow, final_stages

#: Share of saturated pixels of a region from which on its luminance is too low by more than rounding.
_SATURATED_SHARE = 0.001

#: Fall of the CDP at a stage from which on it is named.
_LOSS = 0.001

_STAGE = Column("stage", "stage", meaning="Stage of the chain behind which the values are taken.")
_PAIR = (
    Column("bright", "bright", meaning="Bright region of the pair."),
    Column("dark", "dark", meaning="Dark region of the pair."),
)
_CONTRAST = (
    Column("scene_contrast", "scene contrast", "%", "Weber contrast of the mean luminances of the scene."),
    Column("contrast", "contrast to detect", "%", "Weber contrast whose detection is evaluated.", shown=False),
    Column("lowest_contrast", "lowest detected", "%", "Lowest contrast that counts as detected.", shown=False),
    Column("highest_contrast", "highest detected", "%", "Highest contrast that counts as detected.", shown=False),
    Column("measured_contrast", "measured contrast", "%", "Weber contrast of the mean luminances behind the stage."),
    Column(
        "mean_contrast",
        "mean contrast",
        "%",
        "Mean Weber contrast of all pairs of pixels whose dark one is above 0.",
        shown=False,
    ),
)
_RATIOS = (
    *uncertain(Column("csnr", "CSNR", meaning="Mean over standard deviation of the contrast.")),
    *uncertain(Column("cnr", "CNR", meaning="Difference of the mean luminances over the noise of the dark region.")),
    *uncertain(Column("d_prime", "d'", meaning="Difference of the mean luminances over the noise of both regions.")),
)
_SIZES = (
    Column("n_bright", "pixels of bright", meaning="Pixels of the bright region.", shown=False),
    Column("n_dark", "pixels of dark", meaning="Pixels of the dark region.", shown=False),
    Column("n_pairs_neighbours", "pairs of neighbours", meaning="Pairs of neighbouring pixels.", shown=False),
)
_SIGNAL = (
    _STAGE,
    Column("region", "region", meaning="Region of the scene."),
    Column("unit", "unit", meaning="Unit of the values that the stage hands on."),
    Column("quantity", "quantity", meaning="What these values are.", shown=False),
    Column("mean", "mean", meaning="Mean of the values."),
    Column("standard_deviation", "std", meaning="Standard deviation of the values, without vignetting."),
    *uncertain(Column("snr", "spatial SNR", meaning="Mean over standard deviation of the values; ∞ without noise.")),
    Column("snr_10log10_db", "10 lg SNR", "dB", "10 log10 of the spatial SNR, as in the 2018 thesis.", decimals=2),
    Column("u_snr_10log10_db", "u of 10 lg SNR", "dB", "Its standard uncertainty.", digits=2, shown=False),
    Column(
        "snr_20log10_db", "20 lg SNR", "dB", "20 log10 of the spatial SNR; that of EMVA 1288 is temporal.", decimals=2
    ),
    Column("u_snr_20log10_db", "u of 20 lg SNR", "dB", "Its standard uncertainty.", digits=2, shown=False),
    Column("scene_cd_m2", "scene", "cd/m²", "Mean luminance of the scene in the region."),
    Column("luminance_cd_m2", "luminance", "cd/m²", "Mean luminance that the values stand for."),
    Column("luminance_std_cd_m2", "std", "cd/m²", "Standard deviation of that luminance.", shown=False),
    *uncertain(
        Column(
            "luminance_snr",
            "spatial SNR of luminance",
            meaning="Mean over standard deviation of that luminance; black level and subtracted glare do not raise it.",
        )
    ),
    Column("saturated_share", "saturated", "%", "Share of the region's pixels that are saturated.", decimals=2),
)


def answer(detection: Table, final: Sequence[str], contrast: float | None = None) -> str:
    """Return what a chain detects behind its last stages, and behind which stage most is lost, in a sentence."""
    rows = [{"bright": "bright", "dark": "dark", **row} for row in detection.rows()]
    found = [row for row in rows if row["stage"] in final and row["cdp"] is not None]
    if not found:
        return ""
    name = "cdp_neighbours" if found[0].get("cdp_neighbours") is not None else "cdp"
    lowest = min(found, key=lambda row: row[name])
    _, _, sensor = lowest["stage"].partition(" (")
    pair = [row for row in rows if all(row[key] == lowest[key] for key in ("bright", "dark"))]
    known = [
        row
        for row in pair[: pair.index(lowest) + 1]
        if row.get(name) is not None and row["stage"].partition(" (")[2] in ("", sensor)
    ]
    # What a merge of exposures brings back is not lost.
    left = [max(row[name] for row in known[place:]) for place in range(len(known))]
    losses = [(before - after, row["stage"]) for row, (before, after) in zip(known, pairwise(left), strict=False)]
    loss, stage = max(losses, default=(0.0, ""))
    of = "" if len(found) == 1 else f"Lowest of {len(found)}: "
    costs = f"; the largest loss comes behind {stage}" if loss >= _LOSS else ""
    asked = lowest.get("contrast", contrast)
    what = "the contrast of the scene" if asked is None else f"a contrast of {percent(asked, 4)}"
    sentence = f"{of}{what} between {lowest['bright']} and {lowest['dark']} is detected behind {lowest['stage']}"
    return f"{sentence[0].upper()}{sentence[1:]} with a probability of {lowest[name]:.3f}{costs}."


def result(evaluation: SimulationEvaluation, inputs: Sequence[InputFile] = ()) -> Result:
    """Return the numbers of an evaluation.

    Parameters
    ----------
    evaluation : SimulationEvaluation
        The evaluation.
    inputs : sequence of InputFile
        The chain file and what it names.
    """
    chain = evaluation.chain
    tables = [detection_table(evaluation)] if any(stage.pairs for stage in evaluation.stages) else []
    return Result(
        "simulate",
        chain.name or "chain",
        (*tables, _signal_table(evaluation)),
        tuple(_findings(evaluation)),
        tuple(inputs),
        {"chain": chain.document, "contrast": evaluation.contrast, "epsilon": evaluation.epsilon},
        evaluation.seed,
        simulated=True,
    )


def detection_table(evaluation: SimulationEvaluation) -> Table:
    """Make the table of contrast and CDP of each pair behind each stage."""
    pairs = [(stage, pair) for stage in evaluation.stages for pair in stage.pairs]
    neighbours = (
        _detection("_neighbours", "CDP, nearest-neighbour") if any(pair.neighbours for _, pair in pairs) else ()
    )
    columns = (_STAGE, *_PAIR, *_CONTRAST, *_detection("", "CDP"), *neighbours, *_RATIOS, *_SIZES)
    rows = []
    for stage, pair in pairs:
        found = {**_detected("", pair.cdp), **(_detected("_neighbours", pair.neighbours) if neighbours else {})}
        rows.append({"stage": stage.name, **_contrasts(pair), **found, **_estimates(pair, "csnr", "cnr", "d_prime")})
    note = (
        "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance "
        f"ε = {evaluation.epsilon:g} around the contrast to detect"
    )
    if neighbours:
        note += "; nearest-neighbour: of each pixel and its right and its lower neighbour"
    return Table.of_rows("detection", "Contrast detection probability", columns, rows, f"{note}.")


def _detection(suffix: str, label: str) -> tuple[Column, ...]:
    low, high = f"cdp{suffix}_low", f"cdp{suffix}_high"
    return (
        Column(f"cdp{suffix}", label, "", "Contrast detection probability.", low=low, high=high),
        Column(low, f"{label}, lower end", meaning="Lower end of its 95 % interval.", shown=False),
        Column(high, f"{label}, upper end", meaning="Upper end of its 95 % interval.", shown=False),
        Column(f"u_cdp{suffix}", f"u of {label}", meaning="Its standard uncertainty.", digits=2, shown=False),
        Column(f"below{suffix}", "below", "", "Share of pairs with a lower contrast.", decimals=4, shown=not suffix),
        Column(f"above{suffix}", "above", "", "Share of pairs with a higher contrast.", decimals=4, shown=not suffix),
        Column(f"undefined{suffix}", "undefined", "", "Share of pairs in which no pixel is above 0.", shown=False),
    )


def _detected(suffix: str, found: DetectionResult | None) -> dict[str, Any]:
    if found is None:
        return {}
    low, high = found.confidence_interval
    values = {"cdp": found.cdp, "u_cdp": found.standard_error, "below": found.below, "above": found.above}
    ends = {f"cdp{suffix}_low": low, f"cdp{suffix}_high": high, f"undefined{suffix}": found.undefined}
    return {**{f"{name}{suffix}": value for name, value in values.items()}, **ends}


def _contrasts(pair: PairRow) -> dict[str, Any]:
    asked: dict[str, Any] = {"n_pairs_neighbours": None if pair.neighbours is None else pair.neighbours.pairs}
    if pair.cdp is not None:
        low, high = pair.cdp.interval
        asked |= {"contrast": pair.cdp.contrast, "lowest_contrast": low, "highest_contrast": high}
        asked |= {"n_bright": pair.cdp.bright_size, "n_dark": pair.cdp.dark_size}
    return {
        "bright": pair.bright,
        "dark": pair.dark,
        "scene_contrast": pair.true_contrast,
        "measured_contrast": pair.measured_contrast,
        "mean_contrast": pair.mean_contrast,
        **asked,
    }


def _estimates(row: PairRow | RegionRow, *names: str) -> dict[str, Any]:
    """Return values with U and u; a ratio that only rounding limits is infinite."""
    values: dict[str, Any] = {}
    for name in names:
        estimate = getattr(row, name)
        value = inf if not name.endswith("_db") and estimate.value > LARGEST_SNR else estimate.value
        values |= uncertain_values(name, value, None if isinf(value) else estimate.standard_error)
    return values


def _signal_table(evaluation: SimulationEvaluation) -> Table:
    snr = ("snr", "snr_10log10_db", "snr_20log10_db", "luminance_snr")
    rows = [
        {
            "stage": stage.name,
            "region": row.region,
            "unit": stage.unit.replace("^2", "²"),
            "quantity": stage.quantity,
            "mean": row.mean,
            "standard_deviation": row.standard_deviation,
            "scene_cd_m2": row.true_cd_m2,
            "luminance_cd_m2": row.luminance_cd_m2,
            "luminance_std_cd_m2": row.luminance_standard_deviation_cd_m2,
            "saturated_share": row.saturated_share,
            **_estimates(row, *snr),
        }
        for stage in evaluation.stages
        for row in stage.regions
    ]
    return Table.of_rows("signal", "Signal and noise", _SIGNAL, rows)


def _findings(evaluation: SimulationEvaluation) -> Iterator[Finding]:
    final = final_stages(evaluation.chain)
    for stage in evaluation.stages:
        full = [row for row in stage.regions if row.saturated_share > _SATURATED_SHARE]
        if full:
            # A long exposure of several may saturate; what the chain hands on should not.
            finding = warning if stage.name in final else info
            share = max(row.saturated_share for row in full)
            yield finding("stage-saturated", stage.name, regions=[row.region for row in full], saturated_share=share)
    yield from _without_contrast(evaluation, [stage for stage in evaluation.stages if stage.name in final])


def _without_contrast(evaluation: SimulationEvaluation, final: Sequence[StageRow]) -> Iterator[Finding]:
    if not any(stage.pairs for stage in evaluation.stages):
        yield info("scene-without-contrast")
    for stage in final:
        for pair in stage.pairs:
            if pair.cdp is None:
                endless = evaluation.contrast is None and not isfinite(pair.true_contrast)
                code = "contrast-to-detect-infinite" if endless else "pair-without-light"
                yield warning(code, f"{pair.bright} / {pair.dark}", stage=stage.name)
