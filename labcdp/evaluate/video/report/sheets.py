"""Tables of all frames for spreadsheets: a column a frame as in the 2018 thesis, and a row a frame and contrast."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ....core.table import Column, LongTable
from ....report.sheets import MOST_COLUMNS
from ..dataset import blocks_of
from ..result import unit_of
from ..variables import LIGHT, NOTE, OF_CONTRAST, OF_CORNER, OF_FRAME, OF_REGION, TIME

if TYPE_CHECKING:
    from xarray import Dataset

_FRAME = Column("frame", "frame", meaning="Number in the video, from 0.", decimals=0)
_CONTRAST = Column("contrast", "contrast", "%", "Weber contrast to be detected.", decimals=2)


def long_tables(dataset: Dataset) -> list[LongTable]:
    """Return the tables of all frames; what exceeds the columns of a sheet continues in a further one."""
    n, most = dataset.sizes["frame"], MOST_COLUMNS - 1
    return [
        *(_frame_columns(dataset, range(start, min(start + most, n))) for start in range(0, n, most)),
        _frame_rows(dataset),
    ]


def _frame_columns(dataset: Dataset, frames: range) -> LongTable:
    """CDP of each contrast, a column a frame."""
    part = slice(frames.start, frames.stop)
    numbers = dataset["frame"].values[part].tolist()
    columns = [Column(f"frame_{number}", f"Frame number {number}", "", "CDP.", decimals=4) for number in numbers]

    def rows() -> Iterator[dict[str, Any]]:
        for place, contrast in enumerate(dataset["contrast"].values.tolist()):
            cdp = dataset["cdp"].isel(contrast=place, frame=part).values.tolist()
            yield {"contrast": contrast, **{column.name: value for column, value in zip(columns, cdp, strict=True)}}

    heads = (replace(_CONTRAST, label="Contrasts"), *columns)
    return LongTable("CDP", "CDP of each contrast, a column a frame", heads, rows, matrix=True)


def _frame_rows(dataset: Dataset) -> LongTable:
    """All numbers, a row for each frame and contrast; the contrast changes fastest."""
    own = {column.name: column for column in (_FRAME, TIME, *OF_FRAME, NOTE) if column.name in dataset.variables}
    of_regions = _region_columns(dataset)
    first, last = [own.pop(name) for name in ("frame", "time_s") if name in own], own.pop("note", None)
    columns = (
        *(*first, _CONTRAST, *OF_CONTRAST, *own.values()),
        *(column for column, _, _ in of_regions),
        *([] if last is None else [last]),
    )

    def rows() -> Iterator[dict[str, Any]]:
        contrasts = dataset["contrast"].values.tolist()
        for block in blocks_of(dataset):
            frames = {name: block[name].values.tolist() for name in (*own, *(one.name for one in first))}
            frames |= {column.name: block[name].isel(index).values.astype(float).tolist()
                       for column, name, index in of_regions}  # fmt: skip
            if last is not None:
                frames[last.name] = block[last.name].values.tolist()
            of_contrast = {column.name: block[column.name].values.tolist() for column in OF_CONTRAST}
            for place in range(block.sizes["frame"]):
                row = {name: values[place] for name, values in frames.items()}
                for number, contrast in enumerate(contrasts):
                    values = {name: of_frame[place][number] for name, of_frame in of_contrast.items()}
                    yield {**row, "contrast": contrast, **values}

    return LongTable("Frames", "All numbers, a row for each frame and contrast", columns, rows)


def _region_columns(dataset: Dataset) -> list[tuple[Column, str, dict[str, int]]]:
    """Columns of the regions, each with its variable and its place in that."""
    found = []
    for region in range(dataset.sizes.get("region", 0)):
        name = str(dataset["region"].values[region])
        for column in OF_REGION:
            if column.name in dataset:
                unit = unit_of(dataset) if column.unit == LIGHT else column.unit
                own = replace(column, name=f"{column.name}[{name}]", label=f"{name}: {column.label}", unit=unit)
                found.append((own, column.name, {"region": region}))
        for corner in range(dataset.sizes.get("corner", 0)):
            for column in OF_CORNER:
                label = f"{name}: corner {corner + 1} {column.label}"
                own = replace(column, name=f"{column.name}[{name}, {corner}]", label=label)
                found.append((own, column.name, {"region": region, "corner": corner}))
    return found
