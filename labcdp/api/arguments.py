"""Arguments of the API, checked before any work: paths, regions, pairs and contrasts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..core.disk.files import shown
from ..core.errors import InputError
from ..core.percent import plain_fraction
from ..core.roi import Roi
from ..evaluate.picture.settings import ImageSettings
from ..metrics import Epsilon
from ..metrics.contrast import TargetContrasts
from ..metrics.result import target_contrasts
from ..regions import PolygonShape, Shape, load_regions, rois_of

if TYPE_CHECKING:
    from ..regions.chart import Chart, Corners

#: A path as users write it.
PathArgument: TypeAlias = str | PathLike[str]
#: Contrasts as fractions, or as percentages such as "50%": one, or several.
Contrasts: TypeAlias = float | str | Sequence[float | str] | NDArray[Any]
#: Tolerance of a contrast: a fraction, a percentage such as "50%", or an interval.
Tolerance: TypeAlias = Epsilon | str
#: Regions: a region file; regions; or by name four numbers x, y, width, height, or the corners.
Regions: TypeAlias = PathArgument | Roi | Iterable[Roi | Shape] | Mapping[str, ArrayLike]
#: Pairs of regions by name, the brighter one first; or a single one.
Pairs: TypeAlias = tuple[str, str] | Sequence[tuple[str, str]]

_HOW = "give a region file, a list of Roi, or a dict of names with (x, y, width, height) or corners"


def as_path(value: PathArgument, what: str) -> Path:
    """Return a path; raises InputError for anything else."""
    text = fspath(value) if isinstance(value, str | PathLike) else None
    if not isinstance(text, str) or not text:
        also = "; labcdp.cdp takes arrays" if isinstance(value, np.ndarray) else ""
        raise InputError(f"{what} is {shown(value)}: give the path of a file{also}")
    return Path(text)


def as_number(value: Any, name: str) -> float:
    """Return a number, a fraction or a percentage with its sign; raises InputError for anything else."""
    value = plain_fraction(value)
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        raise InputError(f"{name} is {shown(value)}: give a fraction, or a percentage such as '50%'")
    return float(value)


def as_text(value: Any, name: str) -> str:
    """Return a name; raises InputError for anything else."""
    if not isinstance(value, str):
        raise InputError(f"{name} is {shown(value)}: give a name, as text")
    return value


def as_list(value: Any, name: str, what: str) -> list[Any]:
    """Return what is in a list, tuple or array; raises InputError for anything else, text among it."""
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable) or np.ndim(value) == 0:  # type: ignore[arg-type]
        raise InputError(f"{name} is {shown(value)}: give {what}")
    return list(value)


def as_names(value: Any, name: str) -> list[str]:
    """Return names of patches; raises InputError for anything else."""
    return [as_text(item, name) for item in as_list(value, name, "a list of names of patches")]


def as_pair_names(pairs: Any, what: str) -> list[tuple[str, str]]:
    """Return pairs of names, of one pair or of several; raises InputError for anything else."""
    listed = as_list(pairs, "pairs", f"pairs of names of {what}, the brighter one first")
    names_of_pairs = []
    for pair in [listed] if len(listed) == 2 and all(isinstance(name, str) for name in listed) else listed:
        names = pair if isinstance(pair, list | tuple) else ()
        if len(names) != 2 or not all(isinstance(name, str) for name in names):
            raise InputError(f"pairs has {shown(pair)}: give two names of {what}, the brighter one first")
        names_of_pairs.append((names[0], names[1]))
    return names_of_pairs


def as_rois(regions: Regions, size: tuple[int, int]) -> tuple[Roi, ...]:
    """Return regions that lie inside an image.

    Parameters
    ----------
    regions : Regions
        As a user gives them.
    size : (int, int)
        Width and height of the image in pixels.

    Raises
    ------
    InputError
        If they are no regions, two have one name, or one lies outside the image.
    """
    if isinstance(regions, str | PathLike):
        return rois_of(load_regions(as_path(regions, "regions"), size))
    rois = rois_of(_shapes(regions))
    for roi in rois:
        roi.window((size[1], size[0]))
    return rois


def as_patches(
    chart: Chart, corners: Corners | None, regions: Regions | None, size: tuple[int, int]
) -> tuple[Roi, ...]:
    """Return the patches of a chart in an image, by its corners or by regions; none if neither is given.

    Raises
    ------
    InputError
        If both are given, a patch has no region, or one lies outside the image.
    """
    if regions is None:
        return () if corners is None else chart.regions(corners)
    named = {roi.name: roi for roi in as_rois(regions, size)}
    missing = [name for name in chart.names if name not in named]
    if missing or corners is not None:
        reason = f"have no {shown(missing[0])}" if missing else "are given beside corners"
        raise InputError(f"regions {reason}: give one for each patch of the chart, or its corners")
    return tuple(named[name] for name in chart.names)


def as_pairs(rois: tuple[Roi, ...], pairs: Pairs | None) -> tuple[tuple[str, str], ...]:
    """Return the pairs that are evaluated: those given, or all of up to six regions; raises InputError."""
    given = None if pairs is None else tuple(as_pair_names(pairs, "regions"))
    return ImageSettings((), 0.5, rois, given).chosen_pairs


@dataclass(frozen=True)
class ContrastRequest:
    """Contrasts to be detected.

    Parameters
    ----------
    values : tuple of float or None
        Fractions, each once; None for the measured contrast of each pair.
    scalar : bool
        Whether one number was given, so that the result has no dimension of contrasts.
    epsilon : float or DetectionInterval
        Their tolerance.
    """

    values: tuple[float, ...] | None
    scalar: bool
    epsilon: Epsilon

    @property
    def targets(self) -> TargetContrasts:
        """Target contrasts as evaluations take them: a float if one number was given, a tuple, or None."""
        return self.values[0] if self.scalar and self.values else self.values


def as_contrasts(contrasts: Contrasts | None, tolerance: Tolerance) -> ContrastRequest:
    """Return the target contrasts with their tolerance; raises InputError."""
    # Without contrasts the tolerance is checked as with any.
    values, epsilon, shape = target_contrasts(1.0 if contrasts is None else contrasts, tolerance, "weber")
    if contrasts is None:
        return ContrastRequest(None, False, epsilon)
    if len(shape) > 1 or not values:
        raise InputError(f"contrasts have the shape {shape}: give a number, or a list of at least one")
    if len(set(values)) < len(values):
        raise InputError("a contrast is given twice: give each once")
    return ContrastRequest(tuple(values), shape == (), epsilon)


def _shapes(regions: Roi | Iterable[Roi | Shape] | Mapping[str, ArrayLike]) -> list[Shape]:
    if isinstance(regions, Mapping):
        return [_named(name, value) for name, value in regions.items()]
    if not isinstance(regions, Roi | Iterable):
        raise InputError(f"regions is {shown(regions)}: {_HOW}")
    listed: list[Any] = [regions] if isinstance(regions, Roi) else list(regions)
    for shape in listed:
        if not isinstance(shape, Roi | Shape):
            raise InputError(f"regions has {shown(shape)}: {_HOW}")
    return [PolygonShape(shape.name, shape.corners) if isinstance(shape, Roi) else shape for shape in listed]


def _named(name: str, value: Any) -> PolygonShape:
    if isinstance(value, Roi):
        return PolygonShape(name, value.corners)
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape == (4,):
        return PolygonShape(name, Roi.rectangle(name, *numbers.tolist()).corners)
    if numbers.ndim == 2 and numbers.shape[1] == 2:
        return PolygonShape(name, tuple((x, y) for x, y in numbers.tolist()))
    raise InputError(f"region {name!r} is {shown(value)}: give (x, y, width, height), or at least three (x, y) corners")
