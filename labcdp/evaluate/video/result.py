"""A video in a few numbers: how often a contrast was detected, and where regions were lost."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk import parse_json
from ...core.result import InputFile, Result, unique
from ...core.table import Column, Table, with_bound
from ...metrics.region import SATURATED_SHARE
from ...report.text import percent
from ..judgement import Judgement, SeenContrast, judged_pairs
from ..verdict import CDP_LIMIT, LIMIT, cdp_verdict
from .dataset import check_video, restored
from .findings import frame_tables, times_s

if TYPE_CHECKING:
    from xarray import Dataset

CONTRASTS = (
    Column("kind", "contrast", meaning="Whether it was given, measured in the first frame, or is the reference."),
    Column("contrast", "Weber contrast", "%", "Contrast to be detected; missing if frames differ in it.", digits=4),
    Column("detected_share", "detected", "%", "Share of the evaluated frames whose CDP reaches the limit.", decimals=1),
    Column("n_detected", "detected frames", meaning="Number of these frames.", decimals=0, shown=False),
    Column("undecided_share", "interval includes limit", "%", "Share of the evaluated frames whose 95 % interval "
           "includes the limit or is unknown, by their CDP detected or not.", decimals=1),
    Column("n_evaluated", "evaluated frames", meaning="Frames that have a CDP.", decimals=0),
    Column("n_lost", "lost frames", meaning="Chosen frames without a CDP as a region was lost.", decimals=0),
    Column("n_other", "others without a CDP", meaning="Chosen frames without a CDP for another reason.", decimals=0),
    LIMIT,
    Column("mean_cdp", "mean CDP", meaning="Mean over the frames that have a CDP.", decimals=4),
    Column("lowest_cdp", "lowest CDP", meaning="Lowest of them.", decimals=4),
    Column("lowest_frame", "in frame", meaning="The first frame with the lowest CDP.", decimals=0),
)  # fmt: skip
REGIONS = (
    Column("region", "region"),
    *with_bound(
        [Column("mean", "mean", meaning="Mean over the frames in which the region was found.")],
        lambda row: row["mean_bound"],
    ),
    Column("snr", "spatial SNR", "", "Mean over standard deviation of the pixels of a frame, over the same frames."),
    Column("mean_quality", "mean quality", meaning="Quality of the tracking, 0 to 1.", decimals=3),
    Column("lowest_quality", "lowest quality", meaning="Lowest quality in these frames.", decimals=3),
    Column("n_lost", "frames in which it was lost", meaning="Their number.", decimals=0),
    Column("lost_share", "share", "%", "Share of all frames in which it was lost.", decimals=1),
)
_SUMMARY = (
    Column("quantity", "quantity"),
    Column("value", "value", unit_of="unit"),
    Column("unit", "unit"),
    Column("meaning", "meaning"),
)


def video_result(dataset: Dataset) -> Result:
    """Return the tables and findings of a video.

    Parameters
    ----------
    dataset : xarray.Dataset
        Results of a video. Of one that is read from a file, one column at a time is in memory.

    Raises
    ------
    InputError
        If the dataset is no result of a video.
    """
    check_video(dataset)
    video = InputFile("video", str(dataset.attrs.get("file", "")), str(dataset.attrs.get("sha256", "")))
    regions = _regions(dataset)
    findings = restored(_json(dataset, "findings", []))
    judgement = judged_video(dataset)
    verdicts = [] if judgement is None else [judgement.table]
    if judgement is not None:
        findings = unique([*findings, *judgement.findings])
    tables = [*verdicts, _contrasts(dataset), _summary(dataset), *([regions] if len(regions) else [])]
    if "csp" in dataset:
        from .colours import colours_table

        tables.append(colours_table(dataset))
    tables += frame_tables(dataset)
    return Result(
        "video",
        PurePath(str(dataset.attrs.get("file", ""))).name or "video",
        tuple(tables),
        findings,
        (video, *(InputFile(**file) for file in _json(dataset, "inputs", []))),
        configuration_of(dataset),
    )


def judged_video(dataset: Dataset) -> Judgement | None:
    """Return the judgement of a video by the requirement it was evaluated for; None for none."""
    required = configuration_of(dataset).get("requirement")
    if required is None:
        return None
    regions = "region" in dataset.dims
    pair = " / ".join(map(str, dataset["region"].values)) if regions else "nearest-neighbour"
    unknown = np.full(dataset.sizes["frame"], np.nan)
    luminance = dataset["mean"].min("region").values if regions and unit_of(dataset) else unknown
    contrast = dataset["measured_contrast"].values if "measured_contrast" in dataset else unknown
    saturated = dataset["saturated"].max("region").values if "saturated" in dataset else unknown
    cdp, low, high = (dataset[name].isel(contrast=0).values for name in ("cdp", "cdp_low", "cdp_high"))
    values = zip(dataset["frame"].values, luminance, contrast, saturated, cdp, low, high, strict=True)
    from ..requirement import Requirement

    return judged_pairs(Requirement.model_validate(required), (
        SeenContrast(pair, f"frame {frame}", float(at) if unit_of(dataset) and regions else None, float(measured),
                     bool(share > SATURATED_SHARE), float(cdp_value), (float(lowest), float(highest)))
        for frame, at, measured, share, cdp_value, lowest, highest in values
    ))  # fmt: skip


def is_neighbours(dataset: Dataset) -> bool:
    """Whether pixels were compared with their neighbours, and not two regions."""
    return str(dataset.attrs.get("mode", "regions")) == "neighbours"


def unit_of(dataset: Dataset) -> str:
    """Return the unit of the means, empty for relative luminance."""
    return "cd/m²" if dataset.attrs.get("unit") == "cd/m^2" else ""


def configuration_of(dataset: Dataset) -> dict[str, Any]:
    """Return the configuration that determines the results."""
    names = ("mode", "method", "unit", "conversion")
    stated = {name: dataset.attrs[name] for name in names if name in dataset.attrs}
    return {**_json(dataset, "configuration", {}), **stated}


def contrast_name(row: Mapping[str, Any]) -> str:
    """Return the name of a row of the table of contrasts, as curves and cards have it."""
    if row["contrast"] is None:
        return "reference contrast of each frame"
    # What was measured has as many digits as a float.
    text = percent(row["contrast"]) if row["kind"] == "given" else f"{100 * row['contrast']:.4g} %"
    return {"reference": f"reference contrast {text}", "measured": f"contrast {text} as first measured"}.get(
        row["kind"], f"contrast {text}"
    )


def _contrasts(dataset: Dataset) -> Table:
    frames, rows, limit = dataset["frame"].values, [], limit_of(dataset)
    lost = lost_frames(dataset)
    if "reference_cdp" in dataset:
        contrasts = dataset["reference_contrast"].values
        given = np.unique(contrasts[np.isfinite(contrasts)]).tolist()
        if given:
            reference = {"kind": "reference", "contrast": given[0] if len(given) == 1 else None}
            cdp = [dataset[f"reference_cdp{end}"].values for end in _ENDS]
            rows.append(reference | _over_all(cdp, frames, lost, limit))
    kind = "measured" if configuration_of(dataset).get("contrasts", ()) is None else "given"
    for index, contrast in enumerate(dataset["contrast"].values.tolist()):
        cdp = [dataset[f"cdp{end}"].isel(contrast=index).values for end in _ENDS]
        rows.append({"kind": kind, "contrast": contrast} | _over_all(cdp, frames, lost, limit))
    note = (
        "CDP is the share of all pairs of "
        + ("neighbouring pixels" if is_neighbours(dataset) else "a bright and a dark pixel")
        + " whose Weber contrast is within the tolerance around the contrast to be detected. "
        f"Detected: CDP ≥ {limit:g}. Shares, mean and lowest CDP are of the evaluated frames, those that have a CDP, "
        f"of {frames.size} chosen ones."
    )
    # A column of zeros takes the room of others.
    empty = {name for name in ("n_other", "undecided_share") if not any(row[name] for row in rows)}
    columns = [replace(column, shown=column.shown and column.name not in empty) for column in CONTRASTS]
    return Table.of_items("contrasts", "CDP over the evaluated frames", columns, rows, note)


#: Ends of the names of a CDP and of the ends of its interval.
_ENDS = ("", "_low", "_high")


def lost_frames(dataset: Dataset) -> NDArray[np.bool_]:
    """Return in which frames a region was lost."""
    if "lost" not in dataset:
        return np.zeros(dataset.sizes["frame"], dtype=bool)
    return np.asarray(dataset["lost"].any("region").values, dtype=bool)


def limit_of(dataset: Dataset) -> float:
    """Return the CDP from which a contrast counts as detected in a frame."""
    return float(configuration_of(dataset).get("cdp_limit", CDP_LIMIT))


def answer_of(row: Mapping[str, Any]) -> float | None:
    """Return how often a contrast of the table is detected; where that is the same, the CDP decides.

    None if no frame has a CDP of it.
    """
    return float(row["detected_share"] + row["mean_cdp"] / 100) if row["n_evaluated"] else None


def _over_all(
    cdp_and_ends: Sequence[NDArray[np.float64]], frames: NDArray[Any], lost: NDArray[np.bool_], limit: float
) -> dict[str, Any]:
    """Return the row of a contrast, by its CDP and the ends of its interval in each frame."""
    cdp, low, high = cdp_and_ends
    known = np.isfinite(cdp)
    cdps = zip(cdp[known], low[known], high[known], strict=True)
    n_undecided = sum(cdp_verdict(value, (least, most), limit) == "undecided" for value, least, most in cdps)
    n_detected, n_evaluated, n_lost = int((cdp[known] >= limit).sum()), int(known.sum()), int((lost & ~known).sum())
    row = {
        "detected_share": n_detected / n_evaluated if n_evaluated else None,
        "n_detected": n_detected,
        "undecided_share": n_undecided / n_evaluated if n_evaluated else None,
        "n_evaluated": n_evaluated,
        "n_lost": n_lost,
        "n_other": cdp.size - n_evaluated - n_lost,
        "cdp_limit": limit,
    }
    if not known.any():
        return row
    lowest_at = int(np.nanargmin(cdp))
    lowest = {"lowest_cdp": float(cdp[lowest_at]), "lowest_frame": int(frames[lowest_at])}
    return {**row, "mean_cdp": float(cdp[known].mean()), **lowest}


def _summary(dataset: Dataset) -> Table:
    frames, times = dataset["frame"].values, times_s(dataset)
    rows = [
        ("chosen frames", len(frames), "", "Including those without a result."),
        ("first frame", int(frames[0]), "", "Its number in the video, from 0."),
        ("last frame", int(frames[-1]), "", "Its number in the video."),
        ("start", float(times[0]), "s", "Time of the first frame."),
        ("end", float(times[-1]), "s", "Time of the last frame."),
        ("detected from CDP", limit_of(dataset), "", "CDP from which on a contrast counts as detected in a frame."),
    ]
    data = dict(zip(("quantity", "value", "unit", "meaning"), zip(*rows, strict=True), strict=True))
    return Table("summary", "Frames", _SUMMARY, data, detail=True)


def _regions(dataset: Dataset) -> Table:
    unit = unit_of(dataset)
    columns = [replace(column, unit=unit) if column.name == "mean" else column for column in REGIONS]
    rows = [_region(dataset.isel(region=number)) for number in range(dataset.sizes.get("region", 0))]
    note = "" if unit else "Means are relative luminance."
    table = Table.of_items("regions", "Regions", columns, rows, note)
    return table.sorted_by("mean", reverse=True)


def _region(region: Dataset) -> dict[str, Any]:
    lost = region["lost"].values.astype(bool)

    def values_known(name: str) -> NDArray[np.float64]:
        values = region[name].values[~lost]
        known: NDArray[np.float64] = values[np.isfinite(values)]
        return known if known.size else np.array([np.nan])

    saturated = "saturated" in region and bool((region["saturated"].values > SATURATED_SHARE).any())
    return {
        "region": str(region["region"].values),
        "mean": float(values_known("mean").mean()),
        "mean_bound": ">" if saturated else "",
        "snr": float(values_known("snr").mean()),
        "mean_quality": float(values_known("quality").mean()),
        "lowest_quality": float(values_known("quality").min()),
        "n_lost": int(lost.sum()),
        "lost_share": float(lost.mean()),
    }


def _json(dataset: Dataset, name: str, default: Any) -> Any:
    """Return an attribute that holds JSON; a default if it is missing or no JSON."""
    try:
        values = parse_json(str(dataset.attrs[name]), allow_nan=True)
    except (KeyError, ValueError):
        return default
    return values if isinstance(values, type(default)) else default
