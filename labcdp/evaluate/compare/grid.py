"""Differences of uncertain values, one by one and as curves or maps on the same axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...calibration import Calibration
from ...calibration.uncertainty import expanded_rel
from ...core.errors import InputError
from ...core.quantity import Z_95
from ..sweep.maps.axes import CdpMap, MapAxis
from .subject import Subject

if TYPE_CHECKING:
    from xarray import Dataset


#: Relative difference of values that are equal but for rounding.
_ROUNDING = 1e-9


#: Kind of a source of uncertainty, and what identifies it.
Source: TypeAlias = tuple[str, str]


@dataclass(frozen=True, eq=False)
class Uncertain:
    """A value, or an array of values, with its 95 % interval.

    Parameters
    ----------
    value : array_like of float
        The value.
    below, above : array_like of float
        Distance of the ends of the interval; nan if they are not known, 0 for an exact value.
    common : mapping of (str, str) to array_like of float
        Part of the uncertainty by each error that other values may have, too: its standard uncertainty over the whole,
        0 to 1, by the kind of the source and what identifies it, for example "meter" and the meter with its state.
    sources : tuple of (str, str)
        In place of `common` what the uncertainty is by, if the parts are not known.
    """

    value: ArrayLike
    below: ArrayLike = 0.0
    above: ArrayLike = 0.0
    common: Mapping[Source, ArrayLike] = field(default_factory=dict)
    sources: tuple[Source, ...] = ()

    @property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The value and the ends of its interval."""
        value, below, above = (np.asarray(array, dtype=np.float64) for array in (self.value, self.below, self.above))
        value, low, high = np.broadcast_arrays(value, value - below, value + above)
        return value, low, high

    def correlation(self, other: Uncertain) -> NDArray[np.float64]:
        """Return the correlation coefficient: the sum over common errors of the products of both parts.

        If the parts are not known, it is 1 if all sources are the same, 0 if none is, and nan otherwise.
        """
        if n_same := len({*self.sources} & {*other.sources}):
            return np.array(1.0 if n_same == len({*self.sources, *other.sources}) else np.nan)
        shared = [np.multiply(part, other.common[name]) for name, part in self.common.items() if name in other.common]
        total: NDArray[np.float64] = np.clip(np.sum(np.broadcast_arrays(0.0, *shared), axis=0), 0.0, 1.0)
        return total


@dataclass(frozen=True, eq=False)
class Difference:
    """Second value minus first value.

    Parameters
    ----------
    value, low, high : ndarray of float
        The difference, and the ends of its 95 % interval.
    z : ndarray of float
        Difference over its standard uncertainty on the side of 0; infinite if exact values differ.
    """

    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    z: NDArray[np.float64]

    @property
    def ends(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The difference and the ends of its interval."""
        return self.value, self.low, self.high

    @property
    def significant(self) -> NDArray[np.bool_]:
        """Whether 0 lies outside the 95 % interval."""
        return np.abs(self.z) > Z_95


def difference(first: Uncertain, second: Uncertain) -> Difference:
    """Return the difference of two values with its 95 % interval and z.

    The ends of the interval lie sqrt(a^2 + b^2 - 2 r a b) from the difference, where a and b are the distances of the
    ends of the two intervals that move it there, and r is the correlation. For symmetric intervals that is the law of
    propagation (JCGM 100:2008, 5.2.2); for intervals of probabilities it is method 10 of R. G. Newcombe, Statistics in
    Medicine 17, 873 (1998), with the correlation after G. Y. Zou, Psychological Methods 12, 399 (2007), which holds at
    a probability of 0 or 1, too.

    Parameters
    ----------
    first, second : Uncertain
        Values of shapes that broadcast together.
    """
    correlation = first.correlation(second)
    a, b = np.asarray(first.value, dtype=np.float64), np.asarray(second.value, dtype=np.float64)
    d = np.where(np.abs(b - a) <= _ROUNDING * np.maximum(np.abs(a), np.abs(b)), 0.0, b - a)
    down = _joined(second.below, first.above, correlation)
    up = _joined(second.above, first.below, correlation)
    towards_zero = np.where(d > 0, down, up)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(d == 0, 0.0, Z_95 * d / towards_zero)
    return Difference(d, d - down, d + up, z)


def _joined(a: ArrayLike, b: ArrayLike, correlation: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    # A file may state uncertainties of which the square is infinite.
    with np.errstate(over="ignore", invalid="ignore"):
        variance: NDArray[np.float64] = (a - b) ** 2 + 2 * (1 - correlation) * a * b
    # Rounding may leave less than 0 of two equal errors.
    return np.sqrt(np.maximum(variance, 0.0))


#: Relative difference of coordinates that are equal but for rounding.
_EQUAL = 1e-9
#: Signals at which responsivities are compared.
_SIGNALS = 101


@dataclass(frozen=True, eq=False)
class Grid:
    """A quantity of all subjects at the same places.

    Parameters
    ----------
    quantity : str
        ``CDP`` or ``responsivity R``.
    axes : tuple of MapAxis
        The last one is drawn across, the one before up if it has numbers.
    values : tuple of Uncertain
        Of each subject, of the shape of the axes.
    differences : tuple of Difference
        Of each other subject from the first, of the same shape.
    relative : bool
        Whether the differences are relative to the first.
    """

    quantity: str
    axes: tuple[MapAxis, ...]
    values: tuple[Uncertain, ...]
    differences: tuple[Difference, ...]
    relative: bool

    @property
    def spanned(self) -> int:
        """Number of axes a figure spans: 2 for maps, 1 for curves."""
        *_, y, _x = (None, *self.axes)
        return 2 if y is not None and y.drawn_up and y.values.size > 1 else 1


def map_grid(subjects: Sequence[Subject], maps: Sequence[Dataset]) -> Grid:
    """Return CDP over the axes that all maps have.

    Raises
    ------
    InputError
        If the maps have other axes, or other values on them.
    """
    cdp_maps = [CdpMap.of(dataset) for dataset in maps]
    first = cdp_maps[0]
    # Axes of one value come first, those of the picture last.
    others = sorted(
        (name for name in first.axes if name not in first.spanned), key=lambda name: first.axes[name].values.size > 1
    )
    names = [*others, *first.spanned]
    for subject, other in zip(subjects, cdp_maps, strict=True):
        _require_axes(subjects[0].name, first, subject.name, other)
    values = tuple(_cdp(cdp_map, names) for cdp_map in cdp_maps)
    differences = tuple(difference(values[0], other) for other in values[1:])
    return Grid("CDP", tuple(first.axes[name] for name in names), values, differences, relative=False)


def _cdp(cdp_map: CdpMap, names: list[str]) -> Uncertain:
    (_, ordered), *_ = cdp_map.sections(*names)
    expanded: Any = 0.0
    if cdp_map.dataset.attrs.get("method") != "exact":
        known = "standard_error" in ordered
        expanded = Z_95 * ordered["standard_error"].values if known else np.full(ordered["cdp"].shape, np.nan)
    return Uncertain(ordered["cdp"].values, expanded, expanded)


def _require_axes(first: str, ours: CdpMap, other: str, theirs: CdpMap) -> None:
    def text(cdp_map: CdpMap) -> str:
        values = {name: axis.values for name, axis in cdp_map.axes.items()}
        return ", ".join(f"{name} ({of.size} from {of[0]} to {of[-1]})" for name, of in values.items())

    same = set(ours.axes) == set(theirs.axes)
    if not same or not all(_alike(axis, theirs.axes[name]) for name, axis in ours.axes.items()):
        raise InputError(
            f"the maps have different axes, {first}: {text(ours)}; {other}: {text(theirs)}: sweep both over the "
            "same values"
        )


def _alike(a: MapAxis, b: MapAxis) -> bool:
    if a.numeric != b.numeric or a.values.shape != b.values.shape:
        return False
    return bool(np.allclose(a.values, b.values, rtol=_EQUAL, atol=0) if a.numeric else (a.values == b.values).all())


def responsivity_grid(subjects: Sequence[Subject]) -> Grid:
    """Return R(n) = n / (L t) over the DN n above dark that all calibrations cover, by plane if they have planes.

    Raises
    ------
    InputError
        If some are of planes and some are not, or their signals do not overlap.
    """
    cameras: list[tuple[Calibration, ...]] = [subject.content.planes for subject in subjects]
    names = [plane.state.plane for plane in cameras[0]]
    for subject, planes in zip(subjects, cameras, strict=True):
        if [plane.state.plane for plane in planes] != names:
            raise InputError(
                f"{subjects[0].name} and {subject.name} have different colour planes: compare sensors of the same kind"
            )
    ranges = [plane.range_net_dn for planes in cameras for plane in planes]
    low, high = max(low for low, _ in ranges), min(high for _, high in ranges)
    if low >= high:
        raise InputError(
            "the calibrations have no signal range in common: compare calibrations over the same range of DN"
        )
    net_dn = np.linspace(low, high, _SIGNALS)
    logs = [_log_responsivity(planes, net_dn) for planes in cameras]
    relative = tuple(_exponential(difference(logs[0], log_values)) for log_values in logs[1:])
    values = tuple(_scaled(log) for log in logs)
    axes = (MapAxis("plane", np.array(names, dtype=str), "", "plane", False),) if names != [None] else ()
    signal = MapAxis("net_dn", net_dn, "DN", "signal above dark", True)
    return Grid("responsivity R", (*axes, signal), values, relative, relative=True)


def _log_responsivity(planes: Sequence[Calibration], net_dn: NDArray[np.float64]) -> Uncertain:
    """Return ln R with U of the fit and the meter; the errors of the fit are independent of each other."""
    logs, expanded, by_meter = [], [], []
    for plane in planes:
        logs.append(np.log(net_dn / plane.luminance_cd_m2(net_dn, 1.0)))
        errors = [np.interp(net_dn, error.net_dn, error.relative) for error in plane.fit_errors]
        u_fit = np.sqrt(np.sum(np.square(errors), axis=0)) if errors else np.zeros_like(net_dn)
        expanded.append([expanded_rel((plane.meter_scale,), float(u)) for u in u_fit])
        by_meter.append(plane.meter_scale.common_rel / np.hypot(plane.meter_scale.common_rel, np.maximum(u_fit, 1e-12)))
    shape = (len(planes), net_dn.size) if planes[0].state.plane else net_dn.shape
    share, sides = np.reshape(by_meter, shape), np.reshape(expanded, shape)
    data, meter = planes[0].provenance.input_sha256, planes[0].meter_scale
    common = {("meter", f"{meter}"): share, ("data", data): np.sqrt(1 - share**2)}
    return Uncertain(np.reshape(logs, shape), sides, sides, common)


def _scaled(log: Uncertain) -> Uncertain:
    value = np.exp(np.asarray(log.value))
    return Uncertain(value, value * np.asarray(log.below), value * np.asarray(log.above))


def _exponential(log: Difference) -> Difference:
    return Difference(np.expm1(log.value), np.expm1(log.low), np.expm1(log.high), log.z)
