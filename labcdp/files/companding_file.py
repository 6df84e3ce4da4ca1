"""Curves of companded data in TOML files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from ..core.companding import Companding, shipped_curve, shipped_curves
from ..core.disk import read_toml
from ..core.disk.files import shown
from ..core.errors import ConfigurationError, InputError
from ..session.tables import ConfigurationTable, Format, Number, Text, Whole
from ..session.validation import validated

_Knees = Annotated[tuple[Number, ...], Field(min_length=2, max_length=65536)]


class _CurveFile(ConfigurationTable):
    """Keys of the file, as of `Companding`."""

    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp")
    name: Text = Field(description="a name as text")
    bits: Annotated[int, Field(strict=True, ge=1, le=16)] = Field(description="the bits of a code, 1 to 16")
    codes: _Knees = Field(description="the codes of the knees, rising from 0")
    values: _Knees = Field(description="the linear values of the knees, rising")
    black_value: Number = Field(0.0, description="the linear value without light")
    black_code: Annotated[Number, Field(ge=0)] = Field(0.0, description="a code of at least 0")
    shift: Annotated[int, Field(strict=True, ge=0, le=15)] = Field(0, description="a shift of 0 to 15 bits")
    embedded_rows: tuple[Whole, Whole] = Field((0, 0), description="rows above and below the image, [0, 0] for none")


def load_curve(path: Path) -> Companding:
    """Read a curve from TOML: name, bits, codes, values, and what else differs from its default.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or is no curve.
    """
    content = validated(_CurveFile, read_toml(path, "a curve of companded data"), str(path)).model_dump(
        exclude={"format"}
    )
    try:
        return Companding(**content)
    except InputError as error:
        raise ConfigurationError(f"{path}: {error}") from error


def curve_called(name: str) -> Companding:
    """Return the curve of that name that ships with labcdp, or of that file in TOML.

    Raises
    ------
    InputError
        If there is none.
    """
    if name.lower().endswith(".toml"):
        return load_curve(Path(name))
    if name.upper() in shipped_curves():
        return shipped_curve(name)
    raise InputError(
        f"encoding is {shown(name)}: give linear, srgb, a curve ({', '.join(shipped_curves())}), or a file in TOML "
        "with one"
    )
