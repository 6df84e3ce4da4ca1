"""What a video's results say in a few numbers: how often a contrast was seen, and where regions were lost."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

if TYPE_CHECKING:
    from xarray import Dataset

#: CDP from which a contrast counts as seen in a frame.
SEEN_CDP = 0.9

_NUMBER = re.compile(r"\d+(\.\d+)?")

#: Variables that every video has, over frames and contrasts.
CONTRAST_VARIABLES = ("cdp", "cdp_low", "cdp_high", "cdp_standard_uncertainty", "below", "above")


@dataclass(frozen=True)
class ContrastSummary:
    """A contrast over all frames of a video.

    Parameters
    ----------
    contrast : float or None
        Weber contrast, a fraction; None for a reference that changes from frame to frame.
    n_evaluated : int
        Frames that have a CDP.
    n_seen : int
        Of these, frames with a CDP of at least `SEEN_CDP`.
    seen_share : float
        `n_seen` as share of all frames; those without a CDP count as not seen.
    mean, lowest : float
        CDP over the frames that have one; nan if none has.
    lowest_frame : int or None
        The first frame with the lowest CDP.
    """

    contrast: float | None
    n_evaluated: int
    n_seen: int
    seen_share: float
    mean: float
    lowest: float
    lowest_frame: int | None


@dataclass(frozen=True)
class LostStretch:
    """Frames one after the other in which a region was lost.

    Parameters
    ----------
    region : str
        Its name.
    first, last : int
        Numbers of the first and the last of the frames.
    n_frames : int
        How many of the evaluated frames.
    start_s, duration_s : float
        Time of the first frame, and up to the next frame in which the region was there; nan without times.
    reason : str
        What is noted first; may be empty.
    """

    region: str
    first: int
    last: int
    n_frames: int
    start_s: float
    duration_s: float
    reason: str


@dataclass(frozen=True)
class RegionSummary:
    """A region over all frames of a video.

    Parameters
    ----------
    name : str
        Its name.
    n_lost : int
        Frames in which it was lost.
    mean, mean_quality, lowest_quality : float
        Mean value in the video's unit, and quality of following it, over the frames in which it was not lost.
    mean_snr : float
        Mean over standard deviation, over the same frames.
    """

    name: str
    n_lost: int
    mean: float
    mean_snr: float
    mean_quality: float
    lowest_quality: float


@dataclass(frozen=True)
class VideoSummary:
    """A video in a few numbers.

    Parameters
    ----------
    n_frames : int
        Evaluated frames, those without a result included.
    first, last : int
        Numbers of the first and the last of them.
    start_s, end_s : float
        Their times; nan without times.
    reference : ContrastSummary or None
        CDP of the reference contrast; None if there was none.
    contrasts : tuple of ContrastSummary
        One for each contrast asked for.
    regions : tuple of RegionSummary
        Bright first; none from pixel to pixel.
    lost : tuple of LostStretch
        By region, then by time.
    notes : tuple of (str, int)
        Why frames have no result, or what to mind, and how many, the most frequent first. Of texts that differ in their
        numbers only, the first one.
    warnings : tuple of str
        Of the evaluation.
    """

    n_frames: int
    first: int
    last: int
    start_s: float
    end_s: float
    reference: ContrastSummary | None
    contrasts: tuple[ContrastSummary, ...]
    regions: tuple[RegionSummary, ...]
    lost: tuple[LostStretch, ...]
    notes: tuple[tuple[str, int], ...]
    warnings: tuple[str, ...]

    def values(self) -> dict[str, Any]:
        """Return all of it for JSON."""
        return {"seen_from_cdp": SEEN_CDP, **asdict(self)}


def check_video(dataset: Dataset) -> None:
    """Refuse a dataset that is no result of a video.

    Raises
    ------
    InputError
        If a variable every video has is missing or has other axes, or there is no frame.
    """
    for name in CONTRAST_VARIABLES:
        if name not in dataset.data_vars or dataset[name].dims != ("frame", "contrast"):
            raise InputError(f"the results have no variable {name} over frame and contrast: give results of a video")
    for axis in ("frame", "contrast"):
        if axis not in dataset.coords:
            raise InputError(f"axis {axis} of the results has no coordinates: give results of a video")
        if dataset.sizes[axis] == 0:
            raise InputError(f"the results have no {axis}: evaluate at least one")


def summarise(dataset: Dataset) -> VideoSummary:
    """Sum a video up.

    Parameters
    ----------
    dataset : xarray.Dataset
        Results of a video.

    Raises
    ------
    InputError
        If the dataset is no result of a video.
    """
    check_video(dataset)
    frames, times = dataset["frame"].values, times_s(dataset)
    cdp = dataset["cdp"].values
    contrasts = [
        _contrast(float(contrast), cdp[:, column], frames) for column, contrast in enumerate(dataset["contrast"].values)
    ]
    return VideoSummary(
        n_frames=len(frames),
        first=int(frames[0]),
        last=int(frames[-1]),
        start_s=float(times[0]),
        end_s=float(times[-1]),
        reference=_reference(dataset),
        contrasts=tuple(contrasts),
        regions=tuple(_regions(dataset)),
        lost=tuple(_lost(dataset)),
        notes=tuple(_reasons(note for note in notes_of(dataset) if note)),
        warnings=warnings_of(dataset),
    )


def times_s(dataset: Dataset) -> NDArray[np.float64]:
    """Time of each frame in seconds, shape (frames,); nan where it is not known."""
    if "time_s" not in dataset.coords and "time_s" not in dataset.data_vars:
        return np.full(dataset.sizes["frame"], np.nan)
    return np.asarray(dataset["time_s"].values, dtype=np.float64)


def notes_of(dataset: Dataset) -> list[str]:
    """Why a frame has no result, for each frame; empty where it has one."""
    return [str(note) for note in dataset["note"].values] if "note" in dataset else [""] * dataset.sizes["frame"]


def warnings_of(dataset: Dataset) -> tuple[str, ...]:
    """Warnings of the evaluation, which the file holds as a JSON list."""
    text = str(dataset.attrs.get("warnings", "") or "[]")
    try:
        return tuple(map(str, json.loads(text)))
    except (ValueError, TypeError):
        return (text,)


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last place, both included, of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(stop) - 1) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def period_s(times: NDArray[np.float64]) -> float:
    """Time from an evaluated frame to the next, of most frames; nan where it is not known."""
    steps = np.diff(times)
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if steps.size else float("nan")


def _contrast(contrast: float | None, cdp: NDArray[np.float64], frames: NDArray[Any]) -> ContrastSummary:
    known = np.isfinite(cdp)
    n_seen = int((cdp[known] >= SEEN_CDP).sum())
    some = bool(known.any())
    place = int(np.nanargmin(cdp)) if some else None
    return ContrastSummary(
        contrast=contrast,
        n_evaluated=int(known.sum()),
        n_seen=n_seen,
        seen_share=n_seen / cdp.size,
        mean=float(cdp[known].mean()) if some else float("nan"),
        lowest=float("nan") if place is None else float(cdp[place]),
        lowest_frame=None if place is None else int(frames[place]),
    )


def _reference(dataset: Dataset) -> ContrastSummary | None:
    if "reference_cdp" not in dataset or not np.isfinite(dataset["reference_contrast"].values).any():
        return None
    contrasts = dataset["reference_contrast"].values
    given = np.unique(contrasts[np.isfinite(contrasts)])
    contrast = float(given[0]) if given.size == 1 else None
    return _contrast(contrast, dataset["reference_cdp"].values, dataset["frame"].values)


def _regions(dataset: Dataset) -> list[RegionSummary]:
    if "region" not in dataset.dims:
        return []
    return [_region(dataset.isel(region=number)) for number in range(dataset.sizes["region"])]


def _region(one: Dataset) -> RegionSummary:
    lost = one["lost"].values.astype(bool)

    def there(name: str) -> NDArray[np.float64]:
        values = one[name].values[~lost]
        known: NDArray[np.float64] = values[np.isfinite(values)]
        return known if known.size else np.array([np.nan])

    return RegionSummary(
        name=str(one["region"].values),
        n_lost=int(lost.sum()),
        mean=float(there("mean").mean()),
        mean_snr=float(there("snr").mean()),
        mean_quality=float(there("quality").mean()),
        lowest_quality=float(there("quality").min()),
    )


def _lost(dataset: Dataset) -> list[LostStretch]:
    if "lost" not in dataset:
        return []
    frames, times, notes = dataset["frame"].values, times_s(dataset), notes_of(dataset)
    stretches = []
    for column, name in enumerate(map(str, dataset["region"].values)):
        for first, last in runs(dataset["lost"].values[:, column].astype(bool)):
            end = times[last + 1] if last + 1 < len(times) else times[last] + period_s(times)
            reason = next((_of_region(note, name) for note in notes[first : last + 1] if note), "")
            stretches.append(
                LostStretch(
                    region=name,
                    first=int(frames[first]),
                    last=int(frames[last]),
                    n_frames=last - first + 1,
                    start_s=float(times[first]),
                    duration_s=float(end - times[first]),
                    reason=reason,
                )
            )
    return stretches


def _reasons(notes: Iterable[str]) -> list[tuple[str, int]]:
    """Count notes, the most frequent first; those that differ in their numbers only count as the first of them."""
    firsts: dict[str, str] = {}
    counts: Counter[str] = Counter()
    for note in notes:
        counts[firsts.setdefault(_NUMBER.sub("#", note), note)] += 1
    return counts.most_common()


def _of_region(note: str, name: str) -> str:
    """Return what a note says of one region; all of it if that cannot be told apart."""
    _, found, reason = note.partition(f"{name!r} is lost: ")
    return reason.partition("; ")[0] if found else note
