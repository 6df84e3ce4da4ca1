"""A simulated or predicted image as a result: tables of detection and of signal and noise, findings, and the answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import inf, isfinite, isinf
from operator import attrgetter
from typing import Any

from ....chain import Chain
from ....core.result import Finding, InputFile, Result, info, warning
from ....core.table import Column, Table, uncertain, with_bound, with_interval
from ....metrics.contrast import TargetContrasts, each_contrast
from ....report.text import percent
from ..maps.axes import LARGEST_SNR, SNR_VARIABLES
from ..plan import on_axis
from .rows import SimulationEvaluation

#: Share of saturated pixels of a region from which on its luminance is too low by more than rounding.
_SATURATED_SHARE = 0.001

#: Fall of the CDP at a stage from which on it is named.
_LOSS = 0.001


def _estimated(column: Column, *, expanded: bool = True) -> tuple[Column, ...]:
    """Return the columns of a ratio; a ratio that only rounding limits is infinite and has no uncertainty."""
    estimate = attrgetter(column.name)

    def value(row: Any) -> float:
        return inf if estimate(row).value > LARGEST_SNR else float(estimate(row).value)

    def u(row: Any) -> float | None:
        return None if isinf(value(row)) else float(estimate(row).u)

    value_column, expanded_column, standard = uncertain(replace(column, value=value), u)
    if expanded:
        return value_column, expanded_column, standard
    return replace(value_column, expanded=""), replace(standard, unit=column.unit)


def _detection(part: str, suffix: str, label: str) -> tuple[Column, ...]:
    """Return the columns of a CDP of a pair, which may be missing."""
    cdp, shown = f"cdp{suffix}", not suffix
    probability = Column(cdp, label, meaning="Contrast detection probability.", value=f"{part}.cdp")
    nothing = "Share of pairs in which no pixel is above 0."
    return (
        *with_interval(probability, f"{part}.interval"),
        _hidden(f"u_{cdp}", f"u of {label}", "Its standard uncertainty.", digits=2, value=f"{part}.u"),
        Column(f"below{suffix}", "below", "", "Share of pairs with a lower contrast.", decimals=4, shown=shown,
               value=f"{part}.below"),
        Column(f"above{suffix}", "above", "", "Share of pairs with a higher contrast.", decimals=4, shown=shown,
               value=f"{part}.above"),
        _hidden(f"undefined{suffix}", "undefined", nothing, value=f"{part}.undefined"),
    )  # fmt: skip


def _hidden(name: str, label: str, meaning: str, unit: str = "", **more: Any) -> Column:
    return Column(name, label, unit, meaning, shown=False, **more)


_STAGE = Column("stage", "stage", meaning="Stage of the chain after which the values are taken.")
_SCENE = "Weber contrast of the mean luminances of the scene."
_MEASURED = "Weber contrast of the mean luminances after the stage."
_ASKED = "Weber contrast whose detection is evaluated."
_TARGET = Column("contrast", "target contrast", "%", _ASKED)
_LOWEST, _HIGHEST = (f"{end} contrast that counts as detected." for end in ("Lowest", "Highest"))
_OF_PIXELS = "Mean Weber contrast of all pairs of pixels whose dark one is above 0."
_CONTRAST = (
    _STAGE,
    Column("bright", "bright", meaning="Bright region of the pair."),
    Column("dark", "dark", meaning="Dark region of the pair."),
    Column("scene_contrast", "scene contrast", "%", _SCENE, value="true_contrast"),
    replace(_TARGET, value="cdp.contrast", shown=False),
    _hidden("lowest_contrast", "lowest detected", _LOWEST, "%", value="cdp.detected_range.0"),
    _hidden("highest_contrast", "highest detected", _HIGHEST, "%", value="cdp.detected_range.1"),
    *with_bound((Column("measured_contrast", "measured contrast", "%", _MEASURED),), "bound"),
    _hidden("mean_contrast", "mean contrast", _OF_PIXELS, "%"),
)
_RATIOS = (
    *_estimated(Column("csnr", "CSNR", meaning="Mean over standard deviation of the contrast.")),
    *_estimated(Column("cnr", "CNR", meaning="Difference of the mean luminances over the noise of the dark region.")),
    *_estimated(Column("d_prime", "d'", meaning="Difference of the mean luminances over the noise of both regions.")),
    _hidden("n_bright", "pixels of bright", "Pixels of the bright region.", value="cdp.n_bright"),
    _hidden("n_dark", "pixels of dark", "Pixels of the dark region.", value="cdp.n_dark"),
    _hidden("n_pairs_neighbours", "pairs of neighbours", "Pairs of neighbouring pixels.", value="neighbours.pairs"),
)
_OF_VALUES = "Mean over standard deviation of the values; ∞ without noise."
_OF_LIGHT = "Mean over standard deviation of that luminance; black level and subtracted glare do not raise it."
_SNR_10 = Column("snr_10log10_db", "10 lg SNR", "dB", "10 log10 of the spatial SNR, as in the 2018 thesis.", decimals=2)
_SNR_20 = Column(
    "snr_20log10_db", "20 lg SNR", "dB", "20 log10 of the spatial SNR; that of EMVA 1288 is temporal.", decimals=2
)
_LIGHT = Column("luminance_cd_m2", "luminance", "cd/m²", "Mean luminance that the values stand for.")
_SIGNAL = (
    _STAGE,
    Column("region", "region", meaning="Region of the scene."),
    Column("unit", "unit", meaning="Unit of the values that the stage hands on."),
    _hidden("quantity", "quantity", "What these values are."),
    Column("mean", "mean", meaning="Mean of the values."),
    Column("standard_deviation", "std", meaning="Standard deviation of the values, without vignetting."),
    *_estimated(Column("snr", "spatial SNR", meaning=_OF_VALUES)),
    *_estimated(_SNR_10, expanded=False),
    *_estimated(_SNR_20, expanded=False),
    Column("scene_cd_m2", "scene", "cd/m²", "Mean luminance of the scene in the region.", value="true_cd_m2"),
    *with_bound((_LIGHT,), "bound"),
    _hidden("luminance_std_cd_m2", "std", "Standard deviation of that luminance.", "cd/m²",
            value="luminance_standard_deviation_cd_m2"),
    *_estimated(Column("luminance_snr", "spatial SNR of luminance", meaning=_OF_LIGHT)),
    Column("saturated_share", "saturated", "%", "Share of the region's pixels that are saturated.", decimals=2),
)  # fmt: skip
_PREDICTED = (
    Column("cdp", "CDP", meaning="Contrast detection probability.", decimals=4),
    Column("below", "below", meaning="Share of pairs with a lower contrast.", decimals=4),
    Column("above", "above", meaning="Share of pairs with a higher contrast.", decimals=4),
    Column("mean_contrast", "mean contrast", "%", "Of the pairs with a dark value above 0.", decimals=2),
    Column("csnr", "CSNR", meaning="Mean over standard deviation of the contrast."),
    Column("snr_dark", "spatial SNR, dark region", meaning="Of the luminance; ∞ without noise."),
    Column("snr_bright", "spatial SNR, bright region", meaning="Of the luminance; ∞ without noise."),
    Column("saturated_share_dark", "saturated, dark region", "%", "Share of its pixels.", decimals=2),
    Column("saturated_share", "saturated, bright region", "%", "Share of its pixels.", decimals=2),
)
_TITLE = "Contrast detection probability"
_NOTE = (
    "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance ε = "
    "{} around the target contrast"
)


def result(evaluation: SimulationEvaluation, inputs: Sequence[InputFile] = ()) -> Result:
    """Return the numbers of an evaluation.

    Parameters
    ----------
    evaluation : SimulationEvaluation
        The evaluation.
    inputs : sequence of InputFile
        The chain file and what it names.
    """
    chain = evaluation.run.chain
    pairs = [pair for stage in evaluation.stages for pair in stage.pairs]
    regions = [region for stage in evaluation.stages for region in stage.regions]
    neighbours: tuple[Column, ...] = ()
    note = _NOTE.format(percent(evaluation.epsilon))
    if any(pair.neighbours is not None for pair in pairs):
        neighbours = _detection("neighbours", "_neighbours", "CDP, nearest-neighbour")
        note += "; nearest-neighbour: of each pixel and its right and its lower neighbour"
    targets = evaluation.contrast if isinstance(evaluation.contrast, tuple) else ()
    contrast = (
        replace(column, shown=column.shown or (bool(targets) and column.name == _TARGET.name)) for column in _CONTRAST
    )
    columns = (*contrast, *_detection("cdp", "", "CDP"), *neighbours, *_RATIOS)
    detection = Table.of_items("detection", _TITLE, columns, pairs, f"{note}.")
    if targets:
        # Also of pairs without light, which have no CDP.
        detection = replace(detection, data={**detection.data, _TARGET.name: targets * (len(pairs) // len(targets))})
    signal = Table.of_items("signal", "Signal and noise", _SIGNAL, regions)
    return Result(
        "simulate",
        chain.name or "chain",
        (detection, signal) if pairs else (signal,),
        tuple(_findings(evaluation)),
        tuple(inputs),
        {"chain": chain.document, "contrast": evaluation.contrast, "epsilon": evaluation.epsilon},
        evaluation.run.seed,
        simulated=True,
    )


def predicted_result(
    chain: Chain, contrast: TargetContrasts = None, epsilon: float = 0.5, inputs: Sequence[InputFile] = ()
) -> Result:
    """Predict the CDP of the first pair of regions behind each stage from the sensor on.

    Parameters
    ----------
    chain : Chain
        The chain.
    contrast : float, tuple of float or None
        Weber contrasts to be detected, fractions above 0; None for that of the scene.
    epsilon : float
        Its tolerance.
    inputs : sequence of InputFile
        The chain file and what it names.

    Raises
    ------
    InputError
        If the chain cannot be predicted, as `predict_chain`.
    """
    from ....chain.predict.chain import predict_chain

    stages = chain.stage_names[len(chain.before) + 1 :] or chain.stage_names[-1:]
    predictions = {stage: predict_chain(chain, stage=stage, contrast=contrast, epsilon=epsilon) for stage in stages}
    rows: list[dict[str, Any]] = [
        {
            "stage": stage,
            _TARGET.name: target,
            **{column.name: _finite_snr(column.name, getattr(prediction, column.name)[index]) for column in _PREDICTED},
        }
        for stage, prediction in predictions.items()
        for index, target in enumerate(each_contrast(contrast))
    ]
    full = [
        finding
        for row in rows[:: len(each_contrast(contrast))]
        for finding in _saturated(
            row["stage"], stages[-1:], {"dark": row["saturated_share_dark"], "bright": row["saturated_share"]}
        )
    ]
    note = f"{_NOTE.format(percent(epsilon))}; from the distributions of the values, without random numbers."
    target = (_TARGET,) if isinstance(contrast, tuple) else ()
    return Result(
        "simulate",
        chain.name or "chain",
        (Table.of_items("detection", _TITLE, (_STAGE, *target, *_PREDICTED), rows, note),),
        (*full, *on_axis(chain)),
        tuple(inputs),
        {"chain": chain.document, "contrast": contrast, "epsilon": epsilon, "method": "exact"},
        simulated=True,
    )


def answer(detection: Table, final: Sequence[str], chain: Chain, contrast: TargetContrasts = None) -> str:
    """Return what a chain detects after the stages `final`, and which stage costs most of it, in a sentence."""
    rows = [{"bright": "bright", "dark": "dark", **row} for row in detection.rows()]
    candidates = [row for row in rows if row["stage"] in final and row["cdp"] is not None]
    if not candidates:
        return ""
    name = "cdp_neighbours" if candidates[0].get("cdp_neighbours") is not None else "cdp"
    n = len(each_contrast(contrast))
    # The rows of a pair at all contrasts follow each other.
    candidates = [
        max(candidates[first : first + n], key=lambda row: row[name]) for first in range(0, len(candidates), n)
    ]
    of = f" (the largest of {n} contrasts)" if n > 1 else ""
    lowest = min(candidates, key=lambda row: row[name])
    target = lowest.get("contrast", contrast)
    what = "contrast of the scene" if target is None else percent(target, 4)
    stages = {row["stage"] for row in candidates}
    worst = f"Worst of {len(candidates)}{' pairs' if len(stages) == 1 else ''}: " if len(candidates) > 1 else ""
    sentence = (
        f"{worst}{lowest['bright']} / {lowest['dark']} ({what}), CDP {lowest[name]:.3f} after {lowest['stage']}{of}"
    )
    return f"{sentence if worst else sentence[0].upper() + sentence[1:]}{_costs(rows, lowest, name, chain)}."


def _costs(rows: Sequence[Mapping[str, Any]], last: Mapping[str, Any], name: str, chain: Chain) -> str:
    """Say which stage up to the last costs most CDP, and how much."""
    branch = next(stages for stages in chain.branches.values() if last["stage"] in stages)
    pair = [row for row in rows if all(row.get(key) == last.get(key) for key in ("bright", "dark", _TARGET.name))]
    known = [row for row in pair[: pair.index(last) + 1] if row.get(name) is not None and row["stage"] in branch]
    # What a merge of exposures brings back is not lost.
    left = [max(row[name] for row in known[index:]) for index in range(len(known))]
    falls = zip(pairwise(left), [row["stage"] for row in known[1:]], strict=True)
    (before, after), stage = max(falls, key=lambda fall: fall[0][0] - fall[0][1], default=((0.0, 0.0), ""))
    if before - after < _LOSS:
        return ""
    # Of a bracket, the sensor with all its exposures.
    return f"; CDP drops most at {chain.captures.get(stage, stage)}, by {before - after:.3f} to {after:.3f}"


def _finite_snr(name: str, value: float) -> float:
    """Return a ratio that only rounding limits as infinite; other values as they are."""
    return inf if name in SNR_VARIABLES and value > LARGEST_SNR else float(value)


def _saturated(stage: str, final: Sequence[str], shares: Mapping[str, float]) -> Iterator[Finding]:
    """Name the regions that are saturated behind a stage, by their shares of saturated pixels."""
    full = [region for region, share in shares.items() if share > _SATURATED_SHARE]
    if full:
        # A long exposure of several may saturate; what the chain hands on should not.
        finding = warning if stage in final else info
        yield finding("stage-saturated", stage, regions=full, saturated_share=max(shares.values()))


def _findings(evaluation: SimulationEvaluation) -> Iterator[Finding]:
    final = evaluation.run.chain.final_stages
    for stage in evaluation.stages:
        yield from _saturated(stage.name, final, {row.region: row.saturated_share for row in stage.regions})
    if not any(stage.pairs for stage in evaluation.stages):
        yield info("scene-without-contrast")
    for stage in evaluation.stages:
        for pair in stage.pairs[:: len(each_contrast(evaluation.contrast))]:
            if stage.name in final and pair.cdp is None:
                endless = evaluation.contrast is None and not isfinite(pair.true_contrast)
                code = "contrast-to-detect-infinite" if endless else "pair-without-light"
                yield warning(code, f"{pair.bright} / {pair.dark}", stage=stage.name)
