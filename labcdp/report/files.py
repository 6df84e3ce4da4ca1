"""The common files of all results: JSON in one envelope, page, spreadsheet and figures; datasets as NetCDF."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.disk import read_bytes, reason, validated_as
from ..core.disk.text import json_values, results_json
from ..core.disk.tiff import read_in_child
from ..core.errors import InputError, encodable
from ..core.result import InputFile, Result
from ..core.table import Table
from .html import render_page
from .layout import Page, ReportFigure
from .sheets import result_workbook
from .text import finding_text

if TYPE_CHECKING:
    from xarray import Dataset


#: Name and version of the envelope.
SCHEMA, SCHEMA_VERSION = "labcdp-result", 1
#: Packages whose versions a result depends on.
_PACKAGES = ("labcdp", "numpy", "scipy", "opencv-contrib-python-headless", "numba")


def envelope(result: Result) -> dict[str, Any]:
    """Return a result as JSON-compatible values.

    Parameters
    ----------
    result : Result
        What to write. Fractions stay fractions, with unit ``1``; unknown and infinite values are null.
    """
    content: dict[str, Any] = json_values(
        {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "kind": result.kind,
            "title": result.title,
            "versions": {name: version(name) for name in _PACKAGES},
            "simulated": result.simulated,
            "seed": result.seed,
            "inputs": [asdict(file) for file in result.inputs],
            "configuration": result.configuration,
            "findings": [asdict(finding) | {"text": finding_text(finding)} for finding in result.findings],
            "tables": {table.name: _table(table) for table in result.tables},
        }
    )
    return content


def envelope_json(result: Result) -> str:
    """Return a result as JSON text."""
    return results_json(envelope(result))


@dataclass(frozen=True)
class _WrittenTable:
    title: str
    columns: list[dict[str, str]]
    rows: list[dict[str, Any]]


@dataclass(frozen=True)
class WrittenResult:
    """A result as it is read from a file that `envelope` wrote; parameters are the keys."""

    kind: str
    title: str
    tables: dict[str, _WrittenTable]
    inputs: list[InputFile]
    findings: list[dict[str, Any]]
    configuration: dict[str, Any]


def whole_result(path: Path, content: Any) -> WrittenResult:
    """Return the result in the JSON content of a file; raises InputError if it is incomplete or damaged."""
    try:
        result = validated_as(WrittenResult, content)
        for name, table in result.tables.items():
            names = {column.get("name") for column in table.columns}
            if any(set(row) != names for row in table.rows):
                raise InputError(f"table {name!r} has rows that do not fit its columns")
    except InputError as error:
        raise InputError(
            f"{path} is not as labcdp writes results ({error}): restore it from a copy, or evaluate again"
        ) from error
    return result


def _table(table: Table) -> dict[str, Any]:
    unit_columns = {column.unit_of for column in table.columns}
    return {
        "title": table.title,
        "columns": [
            {"name": column.name, "label": column.label, "unit": _unit(column.unit), "meaning": column.meaning}
            for column in table.columns
        ],
        "rows": [
            {name: _unit(value) if name in unit_columns else value for name, value in row.items()}
            for row in table.rows()
        ],
    }


def _unit(unit: Any) -> Any:
    """Return the unit of a stored value: 1 for fractions that are shown in percent."""
    return "1" if unit == "%" else unit


def result_files(
    result: Result, page: Page, figures: Iterable[ReportFigure] | None = None, time: datetime | None = None
) -> dict[str, bytes]:
    """Return results.json, report.html, results.xlsx and figures/*.png by their names.

    Parameters
    ----------
    result : Result
        The numbers.
    page : Page
        The page.
    figures : iterable of ReportFigure or None
        Figures that are also written as files; None for all of the page.
    time : datetime or None
        Time of the content, for the properties of the spreadsheet; None for the current time.
    """
    if figures is None:
        figures = [block for block in page.blocks if isinstance(block, ReportFigure)]
    return {
        "results.json": envelope_json(result).encode(),
        "report.html": render_page(page).encode(),
        "results.xlsx": result_workbook(result, time or datetime.now(UTC)),
        **{f"figures/{figure.file_name}": figure.png for figure in figures},
    }


#: Largest size of a file, and signatures of HDF5 and classic NetCDF.
_MOST_BYTES = 2**31
_SIGNATURES = (b"\x89HDF\r\n\x1a\n", b"CDF")
#: Compressed by zlib, with a checksum that detects damage.
_NUMBERS = {"zlib": True, "complevel": 4, "shuffle": True, "fletcher32": True}


def dataset_bytes(dataset: Dataset, what: str) -> bytes:
    """Return a labelled result as content of a NetCDF-4 file; equal results differ in the time of writing at most.

    Parameters
    ----------
    dataset : xarray.Dataset
        Dataset whose attributes are texts and numbers.
    what : str
        Name of the result in messages.

    Raises
    ------
    InputError
        If it holds values that NetCDF cannot store.
    """
    encoding = {
        name: _NUMBERS for name, variable in dataset.data_vars.items() if variable.ndim and variable.dtype.kind in "iuf"
    }
    dataset = _encodable(dataset)
    try:
        return bytes(dataset.to_netcdf(engine="netcdf4", format="NETCDF4", encoding=encoding))
    except (TypeError, ValueError, AttributeError, RuntimeError) as error:
        raise InputError(
            f"the {what} contains something NetCDF cannot store ({reason(error)}): give attributes that are texts "
            "or numbers"
        ) from error


def _encodable(dataset: Dataset) -> Dataset:
    """Dataset with what UTF-8 cannot encode in its texts escaped."""
    texts = {}
    for name, variable in dataset.variables.items():
        values = variable.values.ravel() if variable.dtype.kind in "OU" else ()
        if any(isinstance(text, str) and encodable(text) != text for text in values):
            escaped = np.array([encodable(text) if isinstance(text, str) else text for text in values], dtype=object)
            texts[name] = variable.copy(data=escaped.reshape(variable.shape))
    made = dataset.assign(texts)
    made.attrs = {key: encodable(value) if isinstance(value, str) else value for key, value in dataset.attrs.items()}
    return made


def read_dataset(path: Path, what: str) -> Dataset:
    """Read a labelled result into memory and close the file; `what` names it in messages.

    Raises
    ------
    InputError
        If the file is missing, cannot be read or is damaged.
    """
    data = read_bytes(path, f"the path of a {what} (.nc)", _MOST_BYTES)
    if not data.startswith(_SIGNATURES):
        raise InputError(f"{path} is not a NetCDF file: give the path of a {what} (.nc)")
    try:
        # A single damaged byte can make HDF5 loop forever.
        dataset: Dataset = read_in_child(f"{__name__}:_load", data)
    except InputError as error:
        raise InputError(
            f"{path} cannot be read as NetCDF ({error}): restore it from a copy, or make the {what} again"
        ) from error
    return dataset


def _load(data: bytes) -> Dataset:
    import xarray as xr

    return xr.load_dataset(data, engine="netcdf4")
