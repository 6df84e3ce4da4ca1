"""Chart files in TOML: patches with their places and stated values."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from math import isnan, nan
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from ...core.disk import read_toml
from ...core.disk.files import quoted, shortened, suggestion
from ...core.errors import InputError, naming
from ...core.quantity import Z_95, Quantity
from ...core.result import InputFile
from ...regions.chart import MARGIN, Chart, ChartMark, ChartPatch
from ...regions.shapes import EllipseShape, RectangleShape
from ...session.tables import ConfigurationTable, Format, NotNegative, Number, Positive, Text, Whole
from ...session.validation import validated

if TYPE_CHECKING:
    from ...core.disk.tables import WrittenRow

_Name = Annotated[Text, Field(description="the name of the patch as text")]


class _PatchTable(ConfigurationTable):
    name: _Name
    x: Number = Field(description="the left edge of the patch, in the unit of the chart")
    y: Number = Field(description="the upper edge of the patch, in the unit of the chart")
    width: Positive = Field(description="a width above 0, in the unit of the chart")
    height: Positive = Field(description="a height above 0, in the unit of the chart")
    round: bool = Field(False, description="true for an ellipse, false for a rectangle")
    value: Number | None = Field(None, description="the stated value of the patch, a number")
    U: NotNegative | None = Field(None, description="its expanded uncertainty (95 %), at least 0")
    black: bool = Field(False, description="true for a patch without light of its own")

    @property
    def patch(self) -> ChartPatch:
        """The patch."""
        shape = EllipseShape if self.round else RectangleShape
        (roi,) = shape(self.name, self.x, self.y, self.width, self.height).rois()
        # In a coarse unit an ellipse has few corners, all of them on it: it stays within the patch.
        return ChartPatch(roi, self.value, float("nan") if self.U is None else self.U / Z_95, self.black)


class _MarkTable(ConfigurationTable):
    number: Whole = Field(le=49, description="a number of the dictionary ArUco 4x4_50, 0 to 49")
    x: Number = Field(description="the left edge of the mark, in the unit of the chart")
    y: Number = Field(description="the upper edge of the mark, in the unit of the chart")
    side: Positive = Field(description="the length of its black square, above 0")


class _ChartTable(ConfigurationTable):
    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp")
    name: Text = Field(description="a name as text")
    width: Positive = Field(description="the width of the chart, above 0, in any unit")
    height: Positive = Field(description="the height of the chart, above 0, in the same unit")
    quantity: Literal["luminance_cd_m2", "density", "reflectance"] = Field(
        "luminance_cd_m2", description='"luminance_cd_m2", "density" or "reflectance"'
    )
    white_cd_m2: Positive | None = Field(None, description="the luminance of density 0 or reflectance 1, above 0 cd/m²")
    U_white_cd_m2: NotNegative = Field(0.0, description="its expanded uncertainty (95 %), at least 0 cd/m²")
    margin: NotNegative = Field(MARGIN, lt=0.5, description="a share of each patch of at least 0 and below 0.5")
    values: Text | None = Field(None, description="the name of a file with the columns patch, value and U")
    patches: tuple[_PatchTable, ...] = Field(min_length=2, description="two patches or more")
    marks: tuple[_MarkTable, ...] = Field((), description="marks of the chart")

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        if self.quantity == "luminance_cd_m2" and self.white_cd_m2 is not None:
            raise ValueError("has white_cd_m2, which is for densities and reflectances: leave it out")
        for patch in self.patches:
            if (
                min(patch.x, patch.y) < 0
                or patch.x + patch.width > self.width * (1 + 1e-9)
                or (patch.y + patch.height > self.height * (1 + 1e-9))
            ):
                raise ValueError(
                    f"has patch {patch.name!r} outside the chart of {self.width:g} x {self.height:g}: move it inside"
                )
        return self


def load_chart(path: str | PathLike[str]) -> tuple[Chart, list[InputFile]]:
    """Read a chart file, and that of its values, and return both with their records.

    Raises
    ------
    InputError
        Naming file, key, value and what to give, if one cannot be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> from labcdp.evaluate.chart.chart_file import chart_template, load_chart
    >>> written = Path("chart.toml").write_text(chart_template("grid-6x6"))
    >>> chart, files = load_chart("chart.toml")
    >>> len(chart.patches)
    36
    """
    path = Path(path)
    table = validated(_ChartTable, read_toml(path, "a chart"), str(path))
    white = None if table.white_cd_m2 is None else Quantity(table.white_cd_m2, table.U_white_cd_m2 / Z_95, "cd/m²")
    marks = tuple(ChartMark(mark.number, mark.x, mark.y, mark.side) for mark in table.marks)
    with naming(path):
        chart = Chart(
            table.name, table.width, table.height, tuple(patch.patch for patch in table.patches), table.quantity,
            white, marks, table.margin,
        )  # fmt: skip
    inputs = [InputFile.of("chart", path)]
    if table.values is not None:
        file = path.parent / table.values
        with naming(file):
            chart = chart.with_values(_values(file, table.quantity))
        inputs.append(InputFile.of("chart values", file))
    return chart, inputs


def _values(path: Path, quantity: str) -> dict[str, tuple[float, float]]:
    """Return the values of patches with their u, from the columns patch, value and, if there is one, U."""
    # Most charts have their values in them.
    from ...core.disk.tables import read_table

    def is_header(names: Sequence[str]) -> bool:
        return {"patch", quantity} <= {*map(str.lower, names)} or {"patch", "value"} <= {*map(str.lower, names)}

    table = read_table(path, f"a CSV file or .xlsx with the columns patch, {quantity} or value, and U", is_header)
    header = table.header.cells
    names = [name.lower() for name in header]
    if not is_header(names):
        raise InputError(f"the columns are {shortened(', '.join(header))}: give patch, value and U")
    patch_at, value_at = names.index("patch"), names.index(quantity if quantity in names else "value")
    expanded_at = names.index("u") if "u" in names else None
    values: dict[str, tuple[float, float]] = {}
    for row in table.rows:
        with naming(row.place(patch_at)):
            patch = row.text(patch_at)
            if patch in values:
                raise InputError(f"patch {quoted(patch)} is there already: keep one")
        value = _number(row, value_at, table.comma_is_decimal)
        expanded = nan if expanded_at is None else _number(row, expanded_at, table.comma_is_decimal)
        if isnan(value):
            raise InputError(f"{row.place(value_at)}: patch {quoted(patch)} has no value: give one")
        values[patch] = value, expanded / Z_95
    return values


def _number(row: WrittenRow, column: int, comma_is_decimal: bool) -> float:
    """Return a number of a row, nan if the cell is empty; raises InputError, naming the cell."""
    with naming(row.place(column)):
        text = row.number_text(column)
        try:
            return float(text.replace(",", ".") if comma_is_decimal else text) if text else nan
        except ValueError:
            raise InputError(f"{quoted(text)} is no number: correct it") from None


def chart_names() -> list[str]:
    """Return the names of the charts that ship with labcdp."""
    return sorted(file.name.removesuffix(".toml") for file in files("labcdp").joinpath("data/charts").iterdir())


def chart_template(name: str) -> str:
    """Return the text of a chart that ships with labcdp; raises InputError for another name."""
    if name not in chart_names():
        raise InputError(f"there is no chart {quoted(name)}: {suggestion(name, chart_names())}")
    return files("labcdp").joinpath(f"data/charts/{name}.toml").read_text(encoding="utf-8")
