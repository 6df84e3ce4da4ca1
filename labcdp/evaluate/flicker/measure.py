"""Flicker of regions by their light in each frame of a video."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.clock import exposure_text
from ...core.quantity import Quantity
from ...core.result import Finding, info, warning
from ...metrics.modulation import FEWEST_PHASES, Flicker, flicker
from ...metrics.region import SATURATED_SHARE
from .settings import off_frames_error

if TYPE_CHECKING:
    from xarray import Dataset

_Array = NDArray[np.float64]
#: Drift of the light over the recording from which on it is named.
_NAMED_DRIFT = 0.02
#: Regions that a finding names at most.
_MOST_NAMED = 5


@dataclass(frozen=True, eq=False)
class RegionFlicker:
    """Flicker of a region of a video, or of a patch of a session.

    Parameters
    ----------
    region : str
        Its name.
    flicker : Flicker
        Its indices.
    off : Quantity or None
        Light with the lamp off, with its standard uncertainty; None if there are no such frames.
    times_s, values : ndarray of float, shape (n,)
        Times of the frames that count, and the mean of the region in them; nan where it has no value.
    n_lost, n_saturated, n_black, n_other : int
        Frames without a value by reason: a region that was lost, is saturated or has no light, or a broken frame.
    exposure_s : float
        Exposure time of the frames, in sessions, where each has a signal of its own; nan in videos.
    """

    region: str
    flicker: Flicker
    off: Quantity | None
    times_s: _Array
    values: _Array
    n_lost: int
    n_saturated: int
    n_black: int
    n_other: int
    exposure_s: float = nan

    @property
    def title(self) -> str:
        """Its name, with the exposure time where that is known."""
        return f"{self.region} at {exposure_text(self.exposure_s)}" if isfinite(self.exposure_s) else self.region


def measure_flicker(dataset: Dataset, settings: Mapping[str, Any]) -> list[RegionFlicker]:
    """Return the flicker of each region.

    Parameters
    ----------
    dataset : xarray.Dataset
        As of `labcdp.evaluate.flicker.record.record_regions`.
    settings : mapping
        ``off_frames``, ``threshold``, ``tolerance`` and ``frequency_hz`` of `FlickerSettings`.

    Raises
    ------
    InputError
        If no frame is left beside those with the lamp off, or there are none of those.
    """
    numbers, times = dataset["frame"].values, dataset["time_s"].values.astype(np.float64)
    off_frames = np.zeros(numbers.size, dtype=bool)
    if settings.get("off_frames") is not None:
        first, stop = settings["off_frames"]
        off_frames = (numbers >= first) & (numbers < stop)
        if not off_frames.any() or off_frames.all():
            raise off_frames_error(first, stop, int(numbers[0]), int(numbers[-1]))
    return [
        _region(dataset.isel(region=index), off_frames, times, settings) for index in range(dataset.sizes["region"])
    ]


def _region(
    region: Dataset, off_frames: NDArray[np.bool_], times: _Array, settings: Mapping[str, Any]
) -> RegionFlicker:
    name, values = str(region["region"].values), region["mean"].values.astype(np.float64)
    off = None
    if off_frames.any():
        dark = values[off_frames & np.isfinite(values)]
        if dark.size:  # a dark room leaves none: the FDI has no value, the other indices have
            u = float(dark.std(ddof=1)) / sqrt(dark.size) if dark.size > 1 else 0.0
            off = Quantity(float(dark.mean()), u)
    counted = ~off_frames
    lost, black = (region[key].values.astype(bool)[counted] for key in ("lost", "black"))
    saturated = region["saturated"].values[counted] > SATURATED_SHARE
    return region_flicker(
        name, values[counted], times[counted], off, settings, saturated=saturated, black=black, n_lost=int(lost.sum())
    )


def region_flicker(
    name: str,
    values: _Array,
    times_s: _Array,
    off: Quantity | None,
    limits: Mapping[str, Any],
    *,
    saturated: NDArray[np.bool_],
    black: NDArray[np.bool_],
    n_lost: int = 0,
    exposure_s: float = nan,
) -> RegionFlicker:
    """Return the flicker of a region by its light in each frame.

    Parameters
    ----------
    name : str
        Of the region.
    values, times_s : ndarray of float, shape (n,)
        Mean of the region, nan in frames without one, and times of the frames; they count if they increase.
    off : Quantity or None
        Light with the lamp off.
    limits : mapping
        ``threshold``, ``tolerance`` and ``frequency_hz``, as of `labcdp.flicker`.
    saturated, black : ndarray of bool, shape (n,)
        Frames without a value as the region is saturated, or has no light.
    n_lost : int
        Frames in which it was lost.
    exposure_s : float
        Exposure time; nan if it does not matter.
    """
    regular = np.isfinite(times_s).all() and (np.diff(times_s) > 0).all()
    measured = flicker(
        values,
        0.0 if off is None else off,
        limits["threshold"],
        limits["tolerance"],
        times_s=times_s if regular else None,
        frequency_hz=limits.get("frequency_hz") if regular else None,
    )
    n_saturated, n_black = int(saturated.sum()), int((black & ~saturated).sum())
    n_other = int((~np.isfinite(values)).sum()) - n_lost - n_saturated - n_black
    return RegionFlicker(
        name, measured, off, times_s, values, n_lost, n_saturated, n_black, max(n_other, 0), exposure_s
    )


def flicker_findings(regions: Sequence[RegionFlicker]) -> list[Finding]:
    """Return what there is to know about the flicker of regions, one finding for each thing.

    Examples
    --------
    >>> import numpy as np
    >>> from labcdp.evaluate.flicker.measure import RegionFlicker, flicker_findings
    >>> from labcdp.metrics import flicker
    >>> values = np.ones(40)
    >>> region = RegionFlicker("lamp", flicker(values), None, np.arange(40.0), values, 0, 0, 0, 0)
    >>> [finding.code for finding in flicker_findings([region])]
    ['flicker-without-off', 'flicker-none']
    """
    findings = [
        _about(warning, "flicker-saturated", regions, lambda r: r.n_saturated > 0, count=_most("n_saturated", regions)),
        _about(warning, "flicker-black", regions, lambda r: r.n_black > 0, count=_most("n_black", regions)),
        _about(warning, "flicker-lost", regions, lambda r: r.n_lost > 0, count=_most("n_lost", regions)),
        _about(warning, "flicker-few-phases", regions, lambda r: r.flicker.flickers and r.flicker.few_phases,
               fewest=FEWEST_PHASES),
        _about(warning, "flicker-locked", regions, lambda r: not r.flicker.flickers and r.flicker.few_phases
               and r.flicker.wave is not None),
        _about(warning, "flicker-drift", regions, _drifts,
               largest=max((abs(r.flicker.drift.value) for r in regions if _drifts(r)), default=0.0)),
        _about(info, "flicker-without-off", regions, lambda r: r.off is None and r.flicker.n_evaluated > 0
               and not isfinite(r.exposure_s)),
        _about(info, "flicker-none", regions, lambda r: not r.flicker.flickers and r.flicker.n_evaluated > 0
               and not (r.flicker.few_phases and r.flicker.wave is not None)),
    ]  # fmt: skip
    return [finding for finding in findings if finding is not None]


def _drifts(region: RegionFlicker) -> bool:
    wave = region.flicker.wave
    return wave is not None and wave.has_drift and abs(wave.drift) > _NAMED_DRIFT and not region.flicker.few_phases


def _most(name: str, regions: Sequence[RegionFlicker]) -> int:
    return max((getattr(region, name) for region in regions), default=0)


def _about(
    make: Callable[..., Finding],
    code: str,
    regions: Sequence[RegionFlicker],
    applies: Callable[[RegionFlicker], bool],
    **values: float,
) -> Finding | None:
    """Return a finding with the names of the regions that it applies to; None for none."""
    names = [region.title for region in regions if applies(region)]
    if not names:
        return None
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    shown = ", ".join(names[:_MOST_NAMED]) + more
    return make(code, regions=shown, n_regions=len(names), **values)
