"""The comparison of a camera and its twin as labelled tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ....core.finding import unique
from ....core.quantity import quantity_table
from ....core.result import InputFile, Result
from ....core.table import Column, Table, uncertain, uncertain_values
from ...bench.calibration.quantities import lens_text, meter_text
from ...camera.result import stated
from ..evaluate import TwinEvaluation
from ..pair import TwinPair
from ..signal import KINDS
from .verdict import signal_findings, verdict

#: Parameters, by their names in a chain file.
_NAMES = {
    "k_dn_per_e": "system gain K",
    "read_noise_e": "read noise",
    "black_level_dn": "black level",
    "dark_current_e_s": "dark current",
    "doubling_temperature_c": "doubling temperature",
    "prnu_rel": "PRNU",
    "dsnu_e": "DSNU",
    "column_dsnu_e": "DSNU of columns",
    "row_dsnu_e": "DSNU of rows",
    "dsnu_e_s": "DSNU of the dark current",
    "full_well_e": "full well",
}


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
    return Result(
        "twin",
        evaluation.observed.configuration.name,
        tuple(_tables(evaluation)),
        unique([verdict(evaluation), *signal_findings(evaluation), *evaluation.findings]),
        tuple(inputs),
        options or {},
        simulated=evaluation.calibration.state.camera.simulated,
    )


def _tables(evaluation: TwinEvaluation) -> Iterator[Table]:
    yield _summary(evaluation)
    yield _pairs(evaluation.pairs)
    yield _signals(evaluation)
    rows = (stated(key, _NAMES.get(key, key), one) for key, one in evaluation.parameters.quantities.items())
    yield quantity_table("parameters", "Parameters of the twin", rows, detail=True)
    yield _provenance(evaluation)


def _summary(evaluation: TwinEvaluation) -> Table:
    columns = (
        Column("pairs", "pairs", meaning="Pairs of patches that were compared."),
        Column("agreeing", "agree", meaning="Measured and predicted CDP agree within the joint 95 % interval."),
        Column("differing", "differ", meaning="They do not agree."),
        Column("undecided", "undecided", meaning="80 % or more of all possible CDPs would agree."),
    )
    row = {
        "pairs": len(evaluation.pairs),
        "agreeing": evaluation.count("agree"),
        "differing": evaluation.count("differ"),
        "undecided": evaluation.count("undecided"),
    }
    return Table.of_rows("summary", "Camera and twin", columns, [row])


def pair_name(pair: TwinPair) -> str:
    """Return "bright / dark"."""
    return f"{pair.asked.bright} / {pair.asked.dark}"


def _interval(name: str, label: str, what: str) -> tuple[Column, ...]:
    """Return a column of a CDP and those of the ends of its 95 % interval."""
    ends = (("low", "lower"), ("high", "upper"))
    return (
        Column(name, label, meaning=what, low=f"{name}_low", high=f"{name}_high"),
        *(
            Column(f"{name}_{end}", f"{label}, {text} end", "", f"Of the 95 % interval: {text} end.", 5, shown=False)
            for end, text in ends
        ),
    )


def _pairs(pairs: Sequence[TwinPair]) -> Table:
    columns = (
        Column("pair", "bright / dark"),
        Column("target_contrast", "target contrast", "%", "Weber contrast to be detected.", digits=0),
        Column("bright", "bright patch", shown=False),
        Column("dark", "dark patch", shown=False),
        Column("epsilon", "tolerance ε", "%", "Contrasts within the target contrast ± ε of it count.", digits=0),
        Column("meter_contrast", "contrast by meter", "%", "Of the mean luminances by the meter.", shown=False),
        *_interval("measured_cdp", "measured CDP", "By the camera; its interval is that of the number of pixels."),
        *_interval("predicted_cdp", "predicted CDP", "By the twin, for a region without end."),
        Column("u_predicted_cdp", "u of predicted CDP", "", "By parameters and readings.", 2, shown=False),
        Column("u_pixels", "u by pixels", "", "Scatter of the CDP of so many pixels.", 2, shown=False),
        *uncertain(Column("difference", "difference", "", "Measured minus predicted; U and u are those of both.")),
        Column("z", "z", "", "The difference over its standard uncertainty.", decimals=1),
        Column("judgement", "comparison", "", "Whether 0 is in the 95 % interval of the difference."),
        Column("largest", "largest uncertainty", "", "Largest part of the variance of the difference."),
        Column("largest_share", "its share", "%", "Of the variance.", decimals=0, shown=False),
        Column("exposure_s", "exposure", "s", "Longest that saturates neither patch.", digits=0, time=True),
        Column("frame_number", "frame", "", "Number of the frame with the bright patch.", shown=False),
        Column("dark_frame_number", "frame (dark)", "", "Number of the frame with the dark patch.", shown=False),
    )
    return Table.of_rows("pairs", "Contrast detection probability of pairs of patches", columns, map(_pair, pairs))


def _pair(pair: TwinPair) -> dict[str, Any]:
    low, high = pair.measured.confidence_interval
    predicted_low, predicted_high = pair.predicted_interval
    return {
        "pair": pair_name(pair),
        "target_contrast": pair.asked.contrast,
        "bright": pair.asked.bright,
        "dark": pair.asked.dark,
        "epsilon": pair.asked.epsilon,
        "meter_contrast": pair.asked.meter_contrast,
        "measured_cdp": pair.measured.cdp,
        "measured_cdp_low": low,
        "measured_cdp_high": high,
        "predicted_cdp": pair.predicted,
        "predicted_cdp_low": predicted_low,
        "predicted_cdp_high": predicted_high,
        "u_predicted_cdp": pair.u_predicted,
        "u_pixels": pair.u_pixels,
        **uncertain_values("difference", pair.difference, pair.u_difference),
        "z": pair.z,
        "judgement": pair.judgement,
        "largest": pair.largest,
        "largest_share": pair.largest_share,
        "exposure_s": pair.exposure_s,
        "frame_number": pair.frame_number,
        "dark_frame_number": pair.dark_frame_number,
    }


def _signals(evaluation: TwinEvaluation) -> Table:
    columns = [
        Column("patch", "patch"),
        Column("luminance_cd_m2", "luminance by meter", "cd/m²", "Mean reading."),
        Column("exposure_s", "exposure", "s", "Longest that does not saturate the patch.", digits=0, time=True),
    ]
    for name, label in KINDS.items():
        for of in ("measured", "predicted"):
            columns += uncertain(Column(f"{of}_{name}", f"{label}, {of}", "DN"))
        meaning = "Measured minus predicted, of noise the variance, over its standard uncertainty."
        columns.append(Column(f"z_{name}", f"{label}, z", "", meaning, decimals=1))
    rows = []
    for patch in evaluation.patches:
        row: dict[str, Any] = {
            "patch": patch.name,
            "luminance_cd_m2": patch.luminance_cd_m2,
            "exposure_s": patch.exposure_s,
        }
        for name, z in patch.z.items():
            row |= uncertain_values(f"measured_{name}", *patch.measured[name])
            row |= uncertain_values(f"predicted_{name}", *patch.predicted[name])
            row[f"z_{name}"] = z
        rows.append(row)
    table = Table.of_rows("signals", "Signal of each patch", columns, rows, "± is U (95 %).", detail=True)
    return table.sorted_by("luminance_cd_m2")


def _provenance(evaluation: TwinEvaluation) -> Table:
    configuration, calibration = evaluation.observed.configuration, evaluation.calibration
    rows = [
        ("session", configuration.name),
        ("operator", configuration.operator),
        ("camera", str(calibration.state.camera)),
        ("lens", lens_text(configuration.lens)),
        ("luminance meter", meter_text(calibration.meter_scale.meter)),
        ("light", configuration.source.spectrum),
        ("SHA-256 of frames and readings", evaluation.observed.input_sha256),
        ("SHA-256 of those of the calibration", calibration.provenance.input_sha256),
    ]
    columns = (Column("item", "item"), Column("value", "value"))
    kept = [{"item": item, "value": value} for item, value in rows if value]
    return Table.of_rows("provenance", "Provenance", columns, kept, detail=True)
