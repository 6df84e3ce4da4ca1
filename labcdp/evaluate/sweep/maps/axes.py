"""The axes of a map of CDP: which are numbers, which are logarithmic, and which of them span the picture."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ....core.errors import InputError
from ....core.table import Column
from ....report.text import printable

if TYPE_CHECKING:
    from xarray import DataArray, Dataset


#: Values of the parameters that are fixed in a section of a map, by name.
At: TypeAlias = dict[str, float | str]

#: Axis of the target contrasts, and up to how many of them a curve or map is drawn for each, not an axis of the map.
TO_DETECT, _FEW_CONTRASTS = "contrast", 8
#: Units by the end of a parameter's name, as files have them.
UNITS = {"_cd_m2": "cd/m^2", "_s": "s", "_c": "degC", "_m": "m", "_db": "dB", "_e": "e-", "_e_s": "e-/s", "_dn": "DN"}

#: Parts of units in files, and as they are printed.
_PRINTED = {"cd m-2": "cd/m²", "^2": "²", "^3": "³", "m2": "m²", "degC": "°C"}

#: Units of scales whose 0 has no special meaning.
_SCALE_UNITS = ("°C", "dB")


@dataclass(frozen=True, eq=False)
class MapAxis:
    """An axis of a map.

    Parameters
    ----------
    name : str
        The parameter as a user types it.
    values : ndarray of float or str, shape (n,)
        Its coordinates; numbers rise.
    unit, long_name : str
        For labels; empty if unknown, the unit as it is printed, also without one.
    numeric : bool
        Whether the coordinates are numbers.
    """

    name: str
    values: NDArray[Any]
    unit: str
    long_name: str
    numeric: bool

    @property
    def log(self) -> bool:
        """Whether the steps of the logarithms are more even than those of the values."""
        if not self.numeric or self.values.size < 3 or self.values[0] <= 0:
            return False
        steps, ratios = np.diff(self.values), np.diff(np.log(self.values))
        return bool(np.std(ratios) / np.mean(ratios) < np.std(steps) / np.mean(steps))

    @property
    def is_luminance(self) -> bool:
        """Whether the values are luminances."""
        return self.numeric and self.unit == "cd/m²"

    @property
    def is_contrast(self) -> bool:
        """Whether the values are Weber contrasts (fractions)."""
        return self.numeric and self.name.rpartition(".")[2] == "contrast"

    @property
    def drawn_up(self) -> bool:
        """Whether it may be the second axis of a picture."""
        return self.numeric and (self.name != TO_DETECT or self.values.size > _FEW_CONTRASTS)

    @property
    def is_whole(self) -> bool:
        """Whether the values are whole numbers without a unit, as bits are, so that nothing lies between them."""
        plain = self.numeric and not self.unit and not self.is_contrast
        return plain and bool((self.values == np.rint(self.values)).all())

    @property
    def of_ratios(self) -> bool:
        """Whether a ratio of two values is meaningful: of luminances, and of quantities varied by ratios."""
        named = self.is_contrast or self.unit not in ("", *_SCALE_UNITS)
        return self.is_luminance or (self.log and named)

    @property
    def never_negative(self) -> bool:
        """Whether values below 0 make no sense: of all but temperatures and levels in dB, unless the map has some."""
        return self.numeric and self.unit not in _SCALE_UNITS and bool(self.values[0] >= 0)

    def scaled(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the scale on which the axis is even: log10 of the values on a logarithmic axis."""
        return np.log10(values) if self.log else np.asarray(values, dtype=np.float64)

    def unscaled(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Undo `scaled`."""
        return np.power(10.0, values) if self.log else np.asarray(values, dtype=np.float64)


@dataclass(frozen=True, eq=False)
class CdpMap:
    """A map of CDP with its axes.

    Parameters
    ----------
    dataset : xarray.Dataset
        The map; all variables have the axes of CDP, numbers rise.
    axes : dict of str to MapAxis
        Its axes by name.
    x : MapAxis
        Across the picture: the luminance if it is varied, else the first axis of numbers, else the first axis.
    y : MapAxis or None
        Up: the next axis of numbers; None if there is only one, or only up to eight contrasts to be detected.
    """

    dataset: Dataset
    axes: dict[str, MapAxis]
    x: MapAxis
    y: MapAxis | None

    @classmethod
    def of(cls, dataset: Dataset) -> CdpMap:
        """Describe the axes of a map; axes of one value do not span its picture, unless there is no other.

        Raises
        ------
        InputError
            If the dataset is no map (see `check_map`), or the numbers of an axis are not finite or not distinct.
        """
        check_map(dataset)
        axes = {str(name): _described(dataset.coords[name]) for name in dataset["cdp"].dims}
        varied = [axis for axis in axes.values() if axis.values.size > 1] or list(axes.values())[:1]
        x, *rest = sorted(varied, key=lambda axis: (not axis.is_luminance, not axis.numeric))
        ordered = dataset.broadcast_like(dataset["cdp"]).sortby([name for name, axis in axes.items() if axis.numeric])
        return cls(ordered, axes, x, rest[0] if rest and rest[0].drawn_up else None)

    @property
    def spanned(self) -> tuple[str, ...]:
        """Names of the axes that span the picture."""
        return (self.x.name,) if self.y is None else (self.y.name, self.x.name)

    def numbers(self, name: str, what: str, least: int = 1) -> MapAxis:
        """Return an axis of at least some numbers, along which there is something; raises InputError."""
        self._require(name)
        axis = self.axes[name]
        if not axis.numeric or axis.values.size < least:
            how = "an axis of numbers" if least == 1 else "an axis of at least two numbers"
            raise InputError(f"axis {name} has no {what}: choose {how}")
        return axis

    def sections(self, *keep: str, variable: str = "cdp") -> Iterator[tuple[At, Dataset]]:
        """Go through the sections of the map over some of its axes.

        Parameters
        ----------
        *keep : str
            Axes the sections have.
        variable : str
            A variable that the map must have.

        Yields
        ------
        at : dict of str to (float or str)
            Values of all other axes in the section.
        section : xarray.Dataset
            The part of the map there; its variables have the axes `keep` in that order.
        """
        self._require(*keep)
        if variable not in self.dataset.data_vars:
            known = sorted(map(str, self.dataset.data_vars))
            raise InputError(f"the map has no variable {variable!r}: choose one of {known}")
        others = [name for name in self.axes if name not in keep]
        for places in product(*(range(self.dataset.sizes[name]) for name in others)):
            section = self.dataset.isel(dict(zip(others, places, strict=True)))
            at = {name: self.axes[name].values[index].item() for name, index in zip(others, places, strict=True)}
            yield at, section.transpose(*keep)

    def _require(self, *names: str) -> None:
        for name in names:
            if name not in self.axes:
                raise InputError(f"the map has no axis {name!r}: choose one of {', '.join(self.axes)}")


def check_map(dataset: Dataset) -> None:
    """Refuse a dataset that is no map of CDP.

    Raises
    ------
    InputError
        If it has no variable `cdp`, no axis, an empty axis, an axis without coordinates, or a variable that is not of
        numbers or has an axis that CDP does not have.
    """
    if "cdp" not in dataset.data_vars:
        raise InputError(f"the map has no variable cdp, only {sorted(map(str, dataset.data_vars))}: give a map of CDP")
    if not dataset["cdp"].dims:
        raise InputError("the map has no axis: vary at least one parameter")
    for name in map(str, dataset["cdp"].dims):
        if name not in dataset.coords:
            raise InputError(f"axis {name} of the map has no coordinates: give its values")
        if dataset.sizes[name] == 0:
            raise InputError(f"axis {name} of the map is empty: give at least one value")
    for variable in dataset.data_vars.values():
        if variable.dtype.kind not in "iuf" or not set(variable.dims) <= set(dataset["cdp"].dims):
            raise InputError(
                f"variable {variable.name} of the map is of type {variable.dtype} over {list(map(str, variable.dims))}"
                ": give numbers over the axes of CDP"
            )


def _described(coordinate: DataArray) -> MapAxis:
    name, numeric = str(coordinate.name), coordinate.dtype.kind in "iuf"
    values = coordinate.values
    if numeric:
        values = np.sort(values.astype(np.float64))
        if not np.isfinite(values).all() or (np.diff(values) == 0).any():
            raise InputError(f"the values of axis {name} are not finite or not distinct: give each value once")
    else:
        values = np.array([str(value) for value in values])
    return MapAxis(name, values, unit_of(coordinate), str(coordinate.attrs.get("long_name", "")), numeric)


def unit_of(variable: DataArray) -> str:
    """Return the unit of a variable of a map as in print; a plain ratio has none."""
    unit = str(variable.attrs.get("unit", ""))
    printed = "" if unit == "1" else printable(unit)
    for typed, written in _PRINTED.items():
        printed = printed.replace(typed, written)
    return printed


#: Variables of a sweep.
VARIABLES = {
    column.name: column
    for column in (
        Column("cdp", "CDP", "", "Contrast detection probability."),
        Column("standard_error", "u of CDP", "", "Standard error of the CDP.", shown=False),
        Column("below", "below", "%", "Share of pairs with a lower contrast."),
        Column("above", "above", "%", "Share of pairs with a higher contrast."),
        Column("mean_contrast", "mean contrast", "%", "Mean contrast of the pairs with a dark value above 0."),
        Column("csnr", "CSNR", "", "Mean over standard deviation of the contrast."),
        *(
            Column(f"snr_{region}", f"spatial SNR, {region} region", "",
                   f"Mean over standard deviation of the {region} region's luminance.")
            for region in ("dark", "bright")
        ),
        *(
            Column(f"snr_{region}_standard_error", f"u of spatial SNR, {region} region", "",
                   f"Standard error of the SNR of the {region} region.", shown=False)
            for region in ("dark", "bright")
        ),
        Column("saturated_share", "saturated, bright region", "%", "Saturated share of the bright region."),
    )
}  # fmt: skip

#: Variables of a map that are ratios of mean to standard deviation.
SNR_VARIABLES = ("snr_dark", "snr_bright", "csnr")

#: SNR above which the noise is only rounding, as where all pixels are saturated: shot noise would need a full well of
#: 1e12 electrons.
LARGEST_SNR = 1e6


def known_values(name: str, values: NDArray[Any]) -> NDArray[np.float64]:
    """Return the values of a variable, with nan for an SNR that is infinite or due to missing noise.

    Parameters
    ----------
    name : str
        Name of the variable; all but `SNR_VARIABLES` are unchanged.
    values : ndarray of numbers, any shape
        Its values.
    """
    known = np.asarray(values, dtype=np.float64)
    return np.where(np.abs(known) <= LARGEST_SNR, known, np.nan) if name in SNR_VARIABLES else known
