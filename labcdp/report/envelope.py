"""Results as JSON: one envelope for all commands, described by ``labcdp/data/schema/result.schema.json``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.metadata import version
from importlib.resources import files
from math import isfinite
from typing import Any

from ..core.result import Result
from ..core.table import Table
from .findings import finding_text

#: Name and version of the envelope.
SCHEMA, SCHEMA_VERSION = "labcdp-result", 1
#: Packages whose versions a result depends on.
_PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "numba")


def envelope(result: Result) -> dict[str, Any]:
    """Return a result as JSON-compatible values.

    Parameters
    ----------
    result : Result
        What to write. Fractions stay fractions, with unit ``1``; unknown and infinite values are null.
    """
    return {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "kind": result.kind,
        "title": result.title,
        "versions": {"labcdp": version("labcdp"), **{name: version(name) for name in _PACKAGES}},
        "simulated": result.simulated,
        "seed": result.seed,
        "inputs": [{"role": one.role, "path": one.path, "sha256": one.sha256} for one in result.inputs],
        "configuration": _plain(result.configuration),
        "findings": [
            {
                "code": finding.code,
                "severity": finding.severity,
                "subject": finding.subject,
                "values": _plain(finding.values),
                "text": finding_text(finding),
            }
            for finding in result.findings
        ],
        "tables": {table.name: _table(table) for table in result.tables},
    }


def envelope_json(result: Result) -> str:
    """Return a result as JSON text."""
    return json.dumps(envelope(result), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of the envelope."""
    text = files("labcdp").joinpath("data/schema/result.schema.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


def _table(table: Table) -> dict[str, Any]:
    return {
        "title": table.title,
        "columns": [
            {
                "name": column.name,
                "label": column.label,
                "unit": "1" if column.unit == "%" else column.unit,
                "meaning": column.meaning,
            }
            for column in table.columns
        ],
        "rows": [_row(table, row) for row in table.rows()],
    }


def _row(table: Table, row: dict[str, Any]) -> dict[str, Any]:
    units = {column.unit_of for column in table.columns if column.unit_of}
    return {name: "1" if name in units and value == "%" else _plain(value) for name, value in row.items()}


def _plain(value: Any) -> Any:
    """Return JSON-compatible values: no NumPy types, no nan and no infinity."""
    if isinstance(value, Mapping):
        return {str(key): _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not isfinite(value):
        return None
    return value if isinstance(value, str | int | float | bool) or value is None else str(value)
