"""Findings about the frames of a video: what the frames have in common, stretches without a region, and notes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.result import Finding, FindingValue, info, warning
from ...core.table import Column, Table
from ...metrics.region import SATURATED_SHARE
from ...report.text import finding_text, span
from .dataset import blocks_of, findings_of, restored

if TYPE_CHECKING:
    from xarray import Dataset

#: Most ranges of frames listed.
_MOST_STRETCHES = 5
#: What a finding about a frame counts as in the findings about the video.
_COUNTED = {
    "frame-not-decoded": "frames-broken",
    "frame-builds-on-broken": "frames-broken",
    "frame-damaged": "frames-broken",
    "frame-interlaced": "frames-broken",
    "frame-size-differs": "frames-broken",
    "frame-broken": "frames-broken",
    "frame-not-evaluated": "frames-not-evaluated",
    "frame-repeated": "frames-repeated",
    "frame-without-contrast": "frames-without-contrast",
    "reference-without-frame": "frames-without-reference",
    "reference-without-time": "frames-without-reference",
    "reference-without-contrast": "frames-without-reference",
}
#: Codes of the reasons why a region is lost begin so.
_LOST = "tracking-"


def note_of(findings: Iterable[Finding]) -> str:
    """Return the findings about a frame as text."""
    return "; ".join(f"{one.subject}: {reason_of(one)}" if is_lost(one) else finding_text(one) for one in findings)


def _counted_as(finding: Finding) -> str:
    return "frames-lost" if is_lost(finding) else _COUNTED.get(finding.code, "")


def reason_of(finding: Finding) -> str:
    """Return why a region is lost, as text without its name."""
    return finding_text(replace(finding, subject=""))


def is_lost(finding: Finding) -> bool:
    """Whether a finding about a frame says that a region is lost, and why."""
    return finding.code.startswith(_LOST)


class VideoFindings:
    """Findings about all frames of a video, gathered row by row.

    Parameters
    ----------
    regions : sequence of str
        Names of the regions; none for nearest neighbours.
    """

    def __init__(self, regions: Sequence[str]) -> None:
        self._regions = regions
        self._n = 0
        #: For each code how many frames have it, and the number and the finding of the first of them.
        self._counts: dict[str, tuple[int, int, Finding]] = {}
        self._invalid: dict[tuple[str, str], tuple[int, float]] = {}
        self._brighter: Counter[int] = Counter()
        self._saturated: dict[str, list[_Stretch]] = {}
        #: Number of the first frame that has a CDP.
        self.first_measured: int | None = None
        #: Places of the regions, the one that is brighter in the first frame that was measured before the other.
        self.order = tuple(range(len(regions)))
        #: Number and finding of the first frame that has one.
        self.first: tuple[int, Finding] | None = None

    def add(self, row: Mapping[str, Any]) -> None:
        """Take note of a row."""
        self._n += 1
        if not all(map(isnan, row["cdp"])):
            self.first_measured = row["frame"] if self.first_measured is None else self.first_measured
        found = restored(row["findings"])
        if found and self.first is None:
            self.first = row["frame"], found[0]
        # Of several with one code the first one counts.
        for code, finding in {_counted_as(one): one for one in reversed(found)}.items():
            if code:
                count, *first = self._counts.get(code, (0, row["frame"], finding))
                self._counts[code] = (count + 1, *first)
        for region, shares in zip(self._regions, row.get("invalid") or [], strict=False):
            for reason, share in shares.items():
                count, largest = self._invalid.get((region, reason), (0, 0.0))
                self._invalid[region, reason] = count + 1, max(largest, share)
        for region, share in zip(self._regions, row.get("saturated") or [], strict=False):
            if share > SATURATED_SHARE:
                stretches = self._saturated.setdefault(region, [])
                if stretches and stretches[-1].place == self._n - 1:
                    last = stretches[-1]
                    stretches[-1] = _Stretch(last.first, row["frame"], self._n, last.count + 1)
                else:
                    stretches.append(_Stretch(row["frame"], row["frame"], self._n))
        if self._regions and not any(isnan(mean) for mean in row["mean"]):
            second_is_brighter = row["mean"][1] > row["mean"][0]
            if second_is_brighter and not self._brighter:
                self.order = (1, 0)
            self._brighter[int(second_is_brighter)] += 1

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One finding for each thing."""
        found = []
        for code, (count, frame, first) in self._counts.items():
            more = {"reason": str(first.values["reason"])} if code == "frames-not-evaluated" else {}
            found.append(warning(code, count=count, n_frames=self._n, first=frame, **more))
        for (region, reason), (count, largest) in self._invalid.items():
            # Too many saturated pixels are a warning of their own.
            make = info if reason == "saturated" else warning
            values = {"count": count, "n_frames": self._n, "largest_share": largest}
            found.append(make("frames-region-invalid", region, reason=reason.replace("_", " "), **values))
        for region, stretches in self._saturated.items():
            code, more_of_them = "frames-region-saturated", len(stretches) - _MOST_STRETCHES
            frames = [span(str(one.first), str(one.last)) for one in stretches]
            about: dict[str, FindingValue] = {"limit": SATURATED_SHARE, "count": sum(one.count for one in stretches)}
            about |= {"n_frames": self._n, "frames": frames[:_MOST_STRETCHES]}
            if more_of_them > 0:
                code, about = f"{code}-often", {"more": more_of_them, **about}
            found.append(warning(code, region, **about))
        if len(self._brighter) > 1:
            found.append(warning("brighter-region-changes", count=min(self._brighter.values())))
        return tuple(found)


@dataclass(frozen=True)
class _Stretch:
    """Frames one after the other: the numbers of the first and the last one, the place of that, and how many."""

    first: int
    last: int
    place: int
    count: int = 1


class _Lost(NamedTuple):
    """Frames one after the other in which a region is lost."""

    region: str
    first_frame: int
    last_frame: int
    n_frames: int
    start_s: float
    duration_s: float
    reasons: list[Finding]


LOST = (
    Column("region", "region"),
    Column("first_frame", "first frame", decimals=0, meaning="First frame in which it was lost."),
    Column("last_frame", "last frame", decimals=0, meaning="Last frame in which it was lost."),
    Column("n_frames", "frames", decimals=0, meaning="Evaluated frames from the first to the last."),
    Column("start_s", "from", "s", "Time of the first frame.", time=True),
    Column("duration_s", "for", "s", "Time until the region was found again.", time=True),
    # The region is in a separate column.
    Column("reason", "reason", "", "Why it was lost in the first of these frames.",
           value=lambda one: "; ".join(map(reason_of, one.reasons))),
    Column("code", "code", "", "Code of the reason.", shown=False,
           value=lambda one: " ".join(reason.code for reason in one.reasons)),
)  # fmt: skip


class _Note(NamedTuple):
    """A finding, the first frame that has it, and how many do."""

    finding: Finding
    first_frame: int
    n_frames: int


NOTES = (
    Column("note", "note", meaning="As in the first affected frame.", value=lambda one: note_of([one.finding])),
    Column("code", "code", meaning="Code and values of the finding.", shown=False, value="finding.code"),
    Column("subject", "subject", meaning="Region it is about.", shown=False, value="finding.subject"),
    Column("n_frames", "frames", decimals=0, meaning="Number of affected frames."),
    Column("first_frame", "first frame", decimals=0, meaning="First of them."),
)


def times_s(dataset: Dataset) -> NDArray[np.float64]:
    """Return the time of each frame in seconds, shape (frames,); nan where it is not known."""
    if "time_s" not in dataset.variables:
        return np.full(dataset.sizes["frame"], np.nan)
    return np.asarray(dataset["time_s"].values, dtype=np.float64)


def period_s(times: NDArray[np.float64]) -> float:
    """Return the time from an evaluated frame to the next, of most frames; nan where it is not known."""
    steps = np.diff(times)
    steps = steps[np.isfinite(steps)]
    return float(np.median(steps)) if steps.size else float("nan")


def runs(mask: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last place, both included, of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(stop) - 1) for start, stop in zip(edges[::2], edges[1::2], strict=True)]


def frame_tables(dataset: Dataset) -> list[Table]:
    """Return where regions were lost, and for how long; and how many frames have which note, the most frequent first.

    A table without rows is left out.
    """
    found: dict[tuple[str, str], _Note] = {}
    runs_of = {
        str(name): runs(dataset["lost"].isel(region=region).values.astype(bool))
        for region, name in enumerate(dataset["region"].values if "region" in dataset.dims else ())
    }
    reasons: dict[tuple[str, int], list[Finding]] = {
        (name, first): [] for name, stretches in runs_of.items() for first, _ in stretches
    }
    place = 0
    for block in blocks_of(dataset[["findings"]]) if "findings" in dataset else ():
        for frame, findings in zip(block["frame"].values.tolist(), findings_of(block), strict=True):
            for one in findings:
                note = found.get((one.code, one.subject), _Note(one, frame, 0))
                found[one.code, one.subject] = note._replace(n_frames=note.n_frames + 1)
                if is_lost(one) and (one.subject, place) in reasons:
                    reasons[one.subject, place].append(one)
            place += 1
    frames, times = dataset["frame"].values.tolist(), times_s(dataset)
    # The last stretch may last until the frame after the last one.
    ends = [*times[1:].tolist(), float(times[-1] + period_s(times))]
    lost = [
        _Lost(
            *(
                name,
                frames[first],
                frames[last],
                last - first + 1,
                float(times[first]),
                ends[last] - float(times[first]),
            ),
            reasons[name, first],
        )
        for name, stretches in runs_of.items()
        for first, last in stretches
    ]
    notes = sorted(found.values(), key=lambda note: -note.n_frames)
    tables = (
        Table.of_items("lost", "Stretches in which a region was lost", LOST, lost),
        Table.of_items("notes", "Notes on frames", NOTES, notes, detail=True),
    )
    return [table for table in tables if len(table)]
