"""Chart files in TOML: patches with their places and stated values."""

from __future__ import annotations

from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from ...core.disk import read_csv, read_toml
from ...core.disk.files import quoted, shortened, suggestion
from ...core.errors import InputError, naming
from ...core.quantity import Z_95, Quantity
from ...core.result import InputFile
from ...regions.chart import MARGIN, Chart, ChartMark, ChartPatch
from ...regions.shapes import EllipseShape, RectangleShape
from ...session.tables import ConfigurationTable, Format, NotNegative, Number, Positive, Text
from ...session.validation import validated

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
    number: int = Field(ge=0, le=49, description="a number of the dictionary ArUco 4x4_50, 0 to 49")
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
    table = read_csv(path, "a file with the columns patch, value and U")
    names = [name.lower() for name in table.header]
    value = next((name for name in (quantity, "value") if name in names), None)
    if "patch" not in names or value is None:
        raise InputError(f"the columns are {shortened(', '.join(table.header))}: give patch, value and U")
    values: dict[str, tuple[float, float]] = {}
    for row in table.rows:
        cells = dict(zip(names, row.cells, strict=True))
        if cells["patch"] in values:
            raise InputError(f"line {row.line}: patch {quoted(cells['patch'])} is there already: keep one")
        numbers = []
        for name in (value, "u"):
            text = cells.get(name, "")
            try:
                numbers.append(
                    float(text.replace(",", ".") if table.separator != "," else text) if text else float("nan")
                )
            except ValueError:
                raise InputError(f"line {row.line}: {quoted(text)} is no number: correct it") from None
        if numbers[0] != numbers[0]:
            raise InputError(f"line {row.line}: patch {quoted(cells['patch'])} has no value: give one")
        values[cells["patch"]] = numbers[0], numbers[1] / Z_95
    return values


def chart_names() -> list[str]:
    """Return the names of the charts that ship with labcdp."""
    return sorted(file.name.removesuffix(".toml") for file in files("labcdp").joinpath("data/charts").iterdir())


def chart_template(name: str) -> str:
    """Return the text of a chart that ships with labcdp; raises InputError for another name."""
    if name not in chart_names():
        raise InputError(f"there is no chart {quoted(name)}: {suggestion(name, chart_names())}")
    return files("labcdp").joinpath(f"data/charts/{name}.toml").read_text(encoding="utf-8")
