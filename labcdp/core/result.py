"""The one result object: tables and findings of an evaluation, and what they were made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .disk import file_sha256
from .finding import Finding
from .table import Table


@dataclass(frozen=True)
class InputFile:
    """A file or folder that a result was made from.

    Parameters
    ----------
    role : str
        What it was used as, for example ``session``, ``calibration``, ``picture``, ``regions`` or ``chain``.
    path : str
        Where it was.
    sha256 : str
        Hash of its content, in hexadecimal digits; of a session, that of its journal.
    """

    role: str
    path: str
    sha256: str

    @classmethod
    def of(cls, role: str, path: str | Path) -> InputFile:
        """Return the record of a file; raises InputError if it cannot be read."""
        return cls(role, str(path), file_sha256(path, "the path of a file"))


@dataclass(frozen=True, eq=False)
class Result:
    """What an evaluation returns; terminal, page, spreadsheet, JSON and NetCDF are renderings of it.

    Parameters
    ----------
    kind : str
        Name of the command, for example ``evaluate`` or ``image``.
    title : str
        What was evaluated, for example the name of a session or file.
    tables : tuple of Table
        The numbers.
    findings : tuple of Finding
        What the user should know.
    inputs : tuple of InputFile
        What it was made from.
    configuration : mapping
        Options and configuration; values JSON can hold.
    seed : int or None
        Of the random numbers; None if there are none.
    simulated : bool
        Whether any of the data is simulated.
    """

    kind: str
    title: str
    tables: tuple[Table, ...]
    findings: tuple[Finding, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    configuration: Mapping[str, Any] = field(default_factory=dict)
    seed: int | None = None
    simulated: bool = False

    def table(self, name: str) -> Table:
        """Return the table of a name."""
        return next(table for table in self.tables if table.name == name)
