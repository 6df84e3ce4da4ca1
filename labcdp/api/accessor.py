"""The accessor ``labcdp`` of xarray datasets: usable ranges, isolines and plots of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from ..core.errors import InputError
from ..evaluate.judgement import Judgement, judged_pairs
from ..evaluate.requirement import Requirement
from ..evaluate.sweep.maps.axes import CdpMap
from ..evaluate.sweep.maps.dips import SnrDip
from ..evaluate.sweep.maps.map import MapAnalysis, analyse_map
from ..evaluate.sweep.maps.ranges import LEVELS, Isoline, UsableRange, isolines
from ..output import write_file
from ..report.files import dataset_bytes
from ..report.files import read_dataset as read_netcdf
from .arguments import PathArgument, as_list, as_number, as_path, as_text
from .figure import draw_pairs
from .seen import seen_in

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def read_dataset(path: PathArgument) -> xr.Dataset:
    """Read a dataset that labcdp saved as NetCDF: a map of a sweep, or results of pictures, videos or sessions.

    Raises
    ------
    InputError
        If the file is missing, cannot be read or is damaged.

    Examples
    --------
    >>> import labcdp
    >>> chain = labcdp.Chain.load("manta-g505")
    >>> sweep = chain.sweep(exact=True, scene__luminance_cd_m2=[1.0, 10.0])
    >>> written = sweep.to_netcdf("sweep.nc")
    >>> labcdp.read_dataset("sweep.nc")["cdp"].dims
    ('scene.luminance_cd_m2',)
    """
    return read_netcdf(as_path(path, "the dataset"), "dataset")


@xr.register_dataset_accessor("labcdp")  # type: ignore[no-untyped-call]
class LabcdpAccessor:
    """Usable ranges, isolines and plots of a sweep; ``dataset.labcdp`` of any dataset once labcdp has made one.

    Parameters
    ----------
    dataset : xarray.Dataset
        With CDP as `cdp`.
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def analysis(self, level: float = 0.9, expected: Sequence[float] = ()) -> MapAnalysis:
        """Return usable ranges, isolines and dips of a sweep.

        Parameters
        ----------
        level : float
            CDP that is high enough, above 0, up to 1.
        expected : sequence of float
            Luminances at which the sensor changes exposure.

        Raises
        ------
        InputError
            If the dataset is no map of a sweep, or the level is out of range.
        """
        return analyse_map(
            self._dataset, as_number(level, "level"), as_list(expected, "expected", "a list of luminances")
        )

    def usable_range(self, level: float = 0.9) -> xr.Dataset:
        """Find where CDP is high enough, along the luminance or else the first axis of numbers.

        Parameters
        ----------
        level : float
            CDP that is high enough, above 0, up to 1.

        Returns
        -------
        xarray.Dataset
            Over the other axes: `low` and `high`, the ends of the widest interval, nan where there is none; `decades`
            and `range_db`; `intervals`, how many there are; `open_low` and `open_high`, whether the range may continue
            beyond the map.

        Raises
        ------
        InputError
            If the dataset is no map of a sweep, or the level is out of range.
        """
        level = as_number(level, "level")
        ranges = self.analysis(level).usable_ranges
        axis = ranges[0].axis if ranges else ""
        others = [str(name) for name in self._dataset["cdp"].dims if name != axis]
        shape = tuple(self._dataset.sizes[name] for name in others)
        result = xr.Dataset(coords={name: self._dataset[name] for name in others}, attrs={"axis": axis, "level": level})
        unit = str(self._dataset[axis].attrs.get("unit", "")) if axis else ""
        units = {"low": unit, "high": unit, "range_db": "dB"}
        rows = [_widest(usable) for usable in ranges]
        for number, name in enumerate(("low", "high", "decades", "range_db", "intervals", "open_low", "open_high")):
            values = xr.DataArray(np.full(shape, np.nan), result.coords, others)
            for usable, row in zip(ranges, rows, strict=True):
                values.loc[{other: usable.at[other] for other in others}] = row[number]
            typed = values.astype(int if name == "intervals" else bool if "open" in name else float)
            result[name] = typed.assign_attrs(units=units.get(name, "1"))
        return result

    def isolines(
        self, x: str | None = None, y: str | None = None, levels: Sequence[float] = LEVELS, variable: str = "cdp"
    ) -> tuple[Isoline, ...]:
        """Find the lines along which a variable of a sweep over two axes has given values.

        Parameters
        ----------
        x, y : str or None
            Axes; None for those of the plot.
        levels : sequence of float
            Values of the variable.
        variable : str
            Name of the variable.

        Raises
        ------
        InputError
            If the dataset has not two such axes, or no such variable.
        """
        if x is None or y is None:
            analysis = self.analysis()
            x, y = x or analysis.x, y or analysis.y
        axes, lines = (as_text(x, "x"), as_text(y, "y")), as_list(levels, "levels", "a list")
        return isolines(CdpMap.of(self._dataset), *axes, lines, as_text(variable, "variable"))

    def dips(self, expected: Sequence[float] = ()) -> tuple[SnrDip, ...]:
        """Find where SNR or CDP falls although there is more light, as at the transitions of a merge."""
        return self.analysis(expected=expected).dips

    def to_dataframe(self) -> Any:
        """Return a table with one row for each pair, and of each for every frame and contrast there are.

        Variables of regions become columns for the bright and the dark one: ``mean_bright``, ``mean_dark``.

        Returns
        -------
        pandas.DataFrame
            Indexed by frame, pair and contrast.

        Raises
        ------
        InputError
            If the dataset has no pairs: ``to_dataframe()`` of the dataset itself is then the table.
        """
        dataset = self._dataset
        if "pair" not in dataset.dims:
            raise InputError("the dataset has no pairs of regions: use its own to_dataframe()")
        rows = [name for name in ("frame", "pair", "contrast") if name in dataset.dims]
        flat = dataset.reset_coords([name for name in dataset.coords if name not in dataset.dims])
        columns: dict[str, xr.DataArray] = {}
        for name, values in flat.data_vars.items():
            sides = dataset["side"].values if "side" in values.dims else ()
            columns |= {f"{name}_{side}": values.sel(side=side, drop=True) for side in sides} or {str(name): values}
        table = xr.Dataset({name: column for name, column in columns.items() if set(column.dims) <= set(rows)})
        return table.to_dataframe(dim_order=rows)

    def plot(self, level: float = 0.9) -> Figure:
        """Draw the map of a sweep as ``labcdp sweep`` does: heat maps with isolines, or curves.

        Of pictures, videos and sessions, draw the CDP of each pair with its 95 % interval: over the frames, over the
        contrasts, or, of one contrast, side by side.

        Returns
        -------
        matplotlib.figure.Figure
            Save it with ``savefig``; a notebook shows it.

        Raises
        ------
        InputError
            If there is nothing to draw, or the level is out of range.
        """
        if {"pair", "frame"} & set(self._dataset.dims) and "cdp" in self._dataset:
            return draw_pairs(self._dataset)
        from ..evaluate.sweep.maps.static import draw_map
        from ..evaluate.sweep.maps.view import MapView

        return draw_map(MapView.of(self._dataset, self.analysis(level)))

    def judged(self, requirement: Requirement | PathArgument) -> Judgement:
        """Judge pictures, videos and sessions by a requirement, as ``labcdp image --require`` does.

        Parameters
        ----------
        requirement : Requirement or path
            Its contrast and tolerance must be among those of the dataset.

        Returns
        -------
        Judgement
            Its `verdict` is "met", "not met" or "undecided"; `pairs` has that on each pair, `findings` what the
            requirement asks and nobody could see.

        Raises
        ------
        InputError
            If the dataset has no pairs, or another contrast or tolerance.
        """
        if not isinstance(requirement, Requirement):
            requirement = Requirement.load(as_path(requirement, "requirement"))
        return judged_pairs(requirement, seen_in(self._dataset, requirement))

    def save(self, path: PathArgument, *, force: bool = False) -> Path:
        """Write the dataset as NetCDF; with `force` an existing file is replaced.

        Files of equal datasets differ in the time of writing at most.

        Raises
        ------
        InputError
            If the file exists or cannot be written, or NetCDF cannot hold the dataset.
        """
        file = as_path(path, "the file")
        write_file(file, dataset_bytes(self._dataset, "dataset"), force=force)
        return file


def _widest(usable: UsableRange) -> tuple[float, ...]:
    """Return the ends of the widest interval, decades, dB, number of intervals and open ends."""
    widest = usable.widest
    if widest is None:
        return (np.nan, np.nan, np.nan, np.nan, 0, 0, 0)
    numbers = (widest.low, widest.high, widest.decades, widest.range_db)
    return (*numbers, len(usable.intervals), *(end.is_open for end in widest.ends))
