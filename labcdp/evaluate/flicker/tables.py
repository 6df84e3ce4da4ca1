"""Tables of the flicker of a video, and its Dataset with the indices of each region."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from math import isfinite
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from ...core.result import InputFile, Result, unique
from ...core.table import Column, Table, uncertain, variables_of, with_interval
from ..video.dataset import NOTE, TIME, as_json, recorded, restored
from ..video.findings import frame_tables
from .measure import RegionFlicker, flicker_findings
from .record import FRAME_COLUMNS

if TYPE_CHECKING:
    from xarray import Dataset

_NOTE = (
    "Values are what the definitions give for the frames, noise included; intervals (95 %) are for the lamp over all "
    "its phases, FMI without noise. The definitions follow public documentation of IEEE 2020; no compliance is claimed."
)


#: Exposure time of a patch of a session.
EXPOSURE = Column("exposure_s", "exposure", "s", "Exposure time of the frames.", digits=0, time=True)


def _index(name: str, label: str, meaning: str) -> tuple[Column, ...]:
    """Return the columns of an index: its value with its interval, and u."""
    column = Column(name, label, "", meaning, decimals=4, value=f"flicker.{name}.value")
    u = Column(f"u_{name}", f"u of {label}", "", "Standard uncertainty.", 2, shown=False, value=f"flicker.{name}.u")
    return *with_interval(column, f"flicker.{name}.interval"), u


def region_columns(unit: str) -> tuple[Column, ...]:
    """Return the columns of the table of regions, in the unit of the light."""
    return (
        Column("region", "region"),
        *_index("fmi", "FMI", "Flicker modulation index: (maximum - minimum) / (maximum + minimum)."),
        *_index("mmp", "MMP", "Modulation mitigation probability: share of the frames near the mean."),
        *_index("fdi", "FDI", "Flicker detection index: share of the frames above the light with the lamp off."),
        Column("mean", "mean", unit, "Mean of the frames.", value="flicker.mean"),
        Column("maximum", "maximum", unit, "Largest of them.", shown=False, value="flicker.maximum"),
        Column("minimum", "minimum", unit, "Smallest of them.", shown=False, value="flicker.minimum"),
        *uncertain(
            Column("off", "lamp off", unit, "Mean of the frames with the lamp off.", value="off.value"), u="off.u"
        ),
        Column("n_evaluated", "frames", "", "Frames that have a value.", decimals=0, value="flicker.n_evaluated"),
        Column("n_lost", "lost", "", "Frames in which the region was lost.", decimals=0),
        Column("n_saturated", "saturated", "", "Frames in which it is saturated.", decimals=0),
        Column("n_black", "black", "", "Frames in which it has no light.", decimals=0),
        Column("n_other", "others without", "", "Frames without a value for another reason.", decimals=0),
        Column("n_phases", "phases", "", "Equivalent number of phases of the lamp that were seen.", 2,
               value="flicker.n_phases"),
        Column("few_phases", "too few phases", "", "Whether these are too few: 1 or 0.", decimals=0, shown=False,
               value=lambda region: region and int(region.flicker.few_phases)),
        Column("beat_hz", "beat", "Hz", "Frequency at which the lamp beats with the frame rate.", 4,
               value="flicker.beat_hz"),
        *uncertain(
            Column("drift", "drift", "%", "Change of the light over the recording, apart from the beat.", 2,
                   value="flicker.drift.value"),
            u="flicker.drift.u",
        ),
    )  # fmt: skip


def index_columns(unit: str) -> list[Column]:
    """Return the columns that are variables of a Dataset."""
    columns = region_columns(unit)
    return [column for column in columns if column.name != "region" and not column.name.startswith("expanded_")]


def unit_of(dataset: Dataset) -> str:
    """Return the unit of the light, empty for relative light."""
    return "cd/m²" if dataset.attrs.get("unit") == "cd/m^2" else ""


def flicker_dataset(dataset: Dataset, regions: Sequence[RegionFlicker]) -> Dataset:
    """Return the Dataset of the frames with the indices of each region, and the findings about them."""
    columns = [column for column in index_columns(unit_of(dataset)) if column.name != "mean"]
    variables = variables_of(columns, ("region",), regions)
    findings = [*restored(json.loads(dataset.attrs["findings"])), *flicker_findings(regions)]
    with_indices = dataset.assign(variables)
    return with_indices.assign_attrs(findings=as_json(recorded(unique(findings))))


def flicker_table(regions: Sequence[RegionFlicker], unit: str, title: str = "Flicker of the regions") -> Table:
    """Return the table of the regions of a video, or of the patches of a session."""
    empty = {
        name for name in ("n_lost", "n_saturated", "n_black", "n_other")
        if not any(getattr(region, name) for region in regions)
    }  # fmt: skip
    if all(region.off is None for region in regions):
        empty |= {"off", "fdi"}
    columns = [replace(column, shown=column.shown and column.name not in empty) for column in region_columns(unit)]
    if all(isfinite(region.exposure_s) for region in regions):
        columns.insert(1, EXPOSURE)
    return Table.of_items("flicker", title, columns, regions, _NOTE)


def flicker_result(dataset: Dataset, regions: Sequence[RegionFlicker]) -> Result:
    """Return the tables and findings of the flicker of a video, by its `flicker_dataset`."""
    tables = [flicker_table(regions, unit_of(dataset)), *frame_tables(dataset)]
    inputs = [InputFile(**file) for file in json.loads(dataset.attrs["inputs"])]
    name = str(dataset.attrs["file"])
    return Result(
        "video",
        PurePath(name).name or "video",
        tuple(tables),
        restored(json.loads(dataset.attrs["findings"])),
        (InputFile("video", name, str(dataset.attrs["sha256"])), *inputs),
        {
            **json.loads(dataset.attrs["configuration"]),
            "mode": "flicker",
            **{key: dataset.attrs[key] for key in ("method", "unit", "conversion")},
        },
    )


def frame_sheet(dataset: Dataset) -> Table:
    """Return the light of all regions, one row per frame."""
    frame = Column("frame", "frame", meaning="Number in the video, from 0.", decimals=0)
    columns: list[Column] = [frame, TIME]
    data: dict[str, Any] = {"frame": dataset["frame"].values, TIME.name: dataset["time_s"].values}
    for index, name in enumerate(map(str, dataset["region"].values)):
        for column in FRAME_COLUMNS:
            unit = unit_of(dataset) if column.name == "mean" else column.unit
            named = replace(column, name=f"{column.name}[{name}]", label=f"{name}: {column.label}", unit=unit, value="")
            columns.append(named)
            data[named.name] = dataset[column.name].values[:, index].astype(float)
    columns.append(NOTE)
    data[NOTE.name] = dataset[NOTE.name].values
    return Table("Frames", "All numbers, one row per frame", tuple(columns), data)


def settings_of(dataset: Dataset) -> dict[str, Any]:
    """Return the settings of the flicker from the attributes of a Dataset."""
    configuration = json.loads(dataset.attrs["configuration"])
    return {name: configuration[name] for name in ("off_frames", "threshold", "tolerance", "frequency_hz")}
