"""What each stage of a chain leaves of contrast, predicted without random numbers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ....chain import Chain
from ....chain.predict.chain import predict_chain
from ....core.result import InputFile, Result, info
from ....core.table import Column, Table
from ....output import Destination, write_files
from ....report.files import result_files
from ....report.layout import SIMULATED, Card, Facts, Page, Section, Verbatim
from ....report.text import percent
from .result import answer

_COLUMNS = (
    Column("stage", "stage", meaning="Stage of the chain behind which the values are taken."),
    Column("cdp", "CDP", meaning="Contrast detection probability.", decimals=4),
    Column("below", "below", meaning="Share of pairs with a lower contrast.", decimals=4),
    Column("above", "above", meaning="Share of pairs with a higher contrast.", decimals=4),
    Column("mean_contrast", "mean contrast", "%", "Of the pairs with a dark value above 0.", decimals=2),
    Column("csnr", "CSNR", meaning="Mean over standard deviation of the contrast.", digits=4),
    Column("snr_dark", "spatial SNR, dark region", meaning="Of the luminance; ∞ without noise.", digits=4),
    Column("snr_bright", "spatial SNR, bright region", meaning="Of the luminance; ∞ without noise.", digits=4),
    Column("saturated_share_dark", "saturated, dark region", "%", "Share of its pixels.", decimals=2),
    Column("saturated_share", "saturated, bright region", "%", "Share of its pixels.", decimals=2),
)


def predicted_result(
    chain: Chain, contrast: float | None = None, epsilon: float = 0.5, inputs: Sequence[InputFile] = ()
) -> Result:
    """Predict the CDP of the first pair of regions behind each stage from the sensor on.

    Parameters
    ----------
    chain : Chain
        The chain.
    contrast : float or None
        Weber contrast to be detected, a fraction above 0; None for that of the scene.
    epsilon : float
        Its tolerance.
    inputs : sequence of InputFile
        The chain file and what it names.

    Raises
    ------
    InputError
        If the chain cannot be predicted, as `predict_chain`.
    """
    front = len(chain.before) + 1
    rows = []
    for stage in chain.stage_names[front:] or (chain.stage_names[-1],):
        found = predict_chain(chain, stage=stage, contrast=contrast, epsilon=epsilon)
        values = {one.name: float(getattr(found, one.name)[0]) for one in _COLUMNS[1:]}
        rows.append({"stage": stage, **values})
    note = (
        "CDP is the share of all pairs of a bright and a dark pixel whose Weber contrast lies within the tolerance "
        f"ε = {epsilon:g} around the contrast to detect; from the distributions of the values, without random numbers."
    )
    lens = any(getattr(part, "focal_length_m", None) for _, part in chain.before)
    return Result(
        "simulate",
        chain.name or "chain",
        (Table.of_rows("detection", "Contrast detection probability", _COLUMNS, rows, note),),
        (info("map-on-axis"),) if lens else (),
        tuple(inputs),
        {"chain": chain.document, "contrast": contrast, "epsilon": epsilon, "method": "exact"},
        simulated=True,
    )


def write_prediction(result: Result, chain: Chain, folder: Destination) -> list[Path]:
    """Write results.json, report.html, results.xlsx and chain.toml into a folder as `write_files` takes it."""
    detection = result.table("detection")
    asked = result.configuration["contrast"]
    wanted = "contrast of the scene" if asked is None else f"contrast of {percent(asked, 4)}"
    cards = [Card(f"CDP behind {row['stage']}", f"{row['cdp']:.4f}", wanted) for row in list(detection.rows())[-1:]]
    page = Page(
        "predicted imaging chain",
        result.title,
        summary=answer(detection, detection["stage"][-1:], asked) or chain.description,
        banner=SIMULATED,
        cards=cards,
        lead=(detection,),
        findings=result.findings,
        sections=[
            Section(
                "Chain and provenance",
                (Facts((("Chain", f"{chain.name}: {chain.description}"),)), Verbatim(chain.to_toml())),
                collapsed=True,
            )
        ],
    )
    return write_files(folder, "simulate", {**result_files(result, page), "chain.toml": chain.to_toml().encode()})
