"""The comparison of a camera and its twin as labelled tables, and its verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import comb
from typing import Any

from ...calibration.uncertainty import critical_value
from ...core.result import Finding, InputFile, Result, info, quantity_table, warning
from ...core.table import Column, Table, uncertain, with_interval
from ..bench.session_result import provenance_table
from ..camera.result import stated
from .evaluate import TwinEvaluation
from .pair import TwinPair
from .regions import KINDS


def twin_result(
    evaluation: TwinEvaluation, inputs: Sequence[InputFile] = (), options: dict[str, Any] | None = None
) -> Result:
    """Return all numbers of the comparison of a camera and its twin.

    Parameters
    ----------
    evaluation : TwinEvaluation
        What to report.
    inputs : sequence of InputFile
        Inputs of the comparison.
    options : dict
        Options of the comparison.
    """
    name = evaluation.observed.configuration.name
    findings = [verdict(evaluation), *signal_findings(evaluation), *evaluation.findings]
    more = {"configuration": options or {}, "simulated": evaluation.calibration.state.camera.simulated}
    return Result.of("twin", name, _tables(evaluation), findings, *inputs, **more)


def _tables(evaluation: TwinEvaluation) -> Iterator[Table]:
    yield _pairs(evaluation.pairs)
    yield _signals(evaluation)
    rows = (stated(key, *named) for key, named in evaluation.parameters.quantities.items())
    yield quantity_table("parameters", "Parameters of the twin", rows, detail=True)
    yield provenance_table(evaluation.observed, evaluation.calibration)


def _pairs(pairs: Sequence[TwinPair]) -> Table:
    difference = Column("difference", "difference", "", "Measured minus predicted; U and u are those of both.")
    columns = (
        Column("pair", "bright / dark", value="name"),
        Column("target_contrast", "target contrast", "%", "Weber contrast to be detected.", 0, value="contrast"),
        Column("bright", "bright patch", shown=False),
        Column("dark", "dark patch", shown=False),
        Column("epsilon", "tolerance ε", "%", "Contrasts within the target contrast ± ε of it count.", 0),
        Column("meter_contrast", "contrast by meter", "%", "Of the mean luminances by the meter.", shown=False),
        *with_interval(Column("measured_cdp", "measured CDP", value="measured.cdp",
                              meaning="By the camera; its interval is that of the number of pixels."),
                       "measured.confidence_interval"),
        *with_interval(Column("predicted_cdp", "predicted CDP", value="predicted",
                              meaning="By the twin, for a region without end."), "predicted_interval"),
        *uncertain(difference, "u_difference"),
        Column("z", "z", "", "The difference over its standard uncertainty.", decimals=1),
        Column("judgement", "comparison", "", "Whether 0 is in the 95 % interval of the difference."),
        Column("exposure_s", "exposure", "s", "Longest that saturates neither patch.", digits=0, time=True),
        Column("frame_number", "frame", "", "Number of the frame with the bright patch.", shown=False),
        Column("dark_frame_number", "frame (dark)", "", "Number of the frame with the dark patch.", shown=False),
    )  # fmt: skip
    return Table.of_items("pairs", "Contrast detection probability of pairs of patches", columns, pairs)


def _signals(evaluation: TwinEvaluation) -> Table:
    columns = [
        Column("patch", "patch", value="name"),
        Column("luminance_cd_m2", "luminance by meter", "cd/m²", "Mean reading."),
        Column("exposure_s", "exposure", "s", "Longest that does not saturate the patch.", digits=0, time=True),
    ]
    for kind, label in KINDS.items():
        columns += _of_kind(kind, label)
    table = Table.of_items(
        "signals", "Signal of each patch", columns, evaluation.patches, "± is U (95 %).", detail=True
    )
    return table.sorted_by("luminance_cd_m2")


def _of_kind(kind: str, label: str) -> tuple[Column, ...]:
    meaning = "Measured minus predicted, of noise the variance, over its standard uncertainty."
    measured, predicted = (Column(f"{of}_{kind}", f"{label}, {of}", "DN") for of in ("measured", "predicted"))
    return (
        *uncertain(replace(measured, value=lambda one: one.measured[kind][0]), lambda one: one.measured[kind][1]),
        *uncertain(replace(predicted, value=lambda one: one.predicted[kind][0]), lambda one: one.predicted[kind][1]),
        Column(f"z_{kind}", f"{label}, z", "", meaning, decimals=1, value=lambda one: one.z[kind]),
    )


#: Significance level of the number of differing pairs, and expected share of pairs that differ by chance.
_CHANCE, _EXPECTED = 0.01, 0.05


def verdict(evaluation: TwinEvaluation) -> Finding:
    """Return whether the twin describes the camera, by the CDPs and by the signals of the patches."""
    differing = evaluation.count("differ")
    n = differing + evaluation.count("agree")
    counts: dict[str, float] = {"decided": n, "differing": differing, "by_chance": _EXPECTED * n}
    # The CDPs of a pair at several contrasts are of the same pixels: each contrast is judged on its own.
    groups = evaluation.by_contrast()
    if any(_chance(pairs) < _CHANCE / len(groups) for pairs in groups):
        return warning("twin-differs", **counts)
    if any(signal_findings(evaluation)):
        return warning("twin-signals-differ", **counts)
    return info("twin-describes-camera", **counts) if n else warning("twin-undecided", **counts)


def _chance(pairs: Sequence[TwinPair]) -> float:
    """Probability that by chance at least as many pairs differ."""
    differing = sum(pair.judgement == "differ" for pair in pairs)
    n = sum(pair.judgement != "undecided" for pair in pairs)
    return sum(comb(n, k) * _EXPECTED**k * (1 - _EXPECTED) ** (n - k) for k in range(differing, n + 1))


def signal_findings(evaluation: TwinEvaluation) -> Iterator[Finding]:
    """Yield a warning for each kind of signal in which a patch deviates by more than by chance in 1 % of sessions."""
    limit = critical_value(len(KINDS) * len(evaluation.patches))
    for kind, name in KINDS.items():
        z = {patch.name: z for patch in evaluation.patches if (z := patch.z[kind]) is not None and abs(z) > limit}
        if z:
            worst = max(z, key=lambda patch: abs(z[patch]))
            yield warning("signal-differs", name, patches=list(z), worst=worst, z=z[worst])
