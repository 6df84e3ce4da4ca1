"""What the findings about a video's frames add up to: stretches in which regions were lost, and notes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...core.result import Finding
from ...core.table import Column, Table
from .dataset import blocks_of, findings_of
from .findings import is_lost, note_of, reason_of

if TYPE_CHECKING:
    from xarray import Dataset

LOST = (
    Column("region", "region"),
    Column("first_frame", "first frame", decimals=0, meaning="First frame in which it was lost."),
    Column("last_frame", "last frame", decimals=0, meaning="Last frame in which it was lost."),
    Column("n_frames", "frames", decimals=0, meaning="Evaluated frames from the first to the last."),
    Column("start_s", "from", "s", "Time of the first frame.", time=True),
    Column("duration_s", "for", "s", "Time until the region was there again.", time=True),
    Column("reason", "reason", meaning="Why it was lost in the first of these frames."),
    Column("code", "code", meaning="Code of the reason.", shown=False),
)
NOTES = (
    Column("note", "note", meaning="As in the first frame that has it."),
    Column("code", "code", meaning="Code and values of the finding.", shown=False),
    Column("subject", "subject", meaning="Region it is about.", shown=False),
    Column("n_frames", "frames", decimals=0, meaning="Frames that have it."),
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


@dataclass
class _Count:
    """A note, and how many frames have it."""

    first: Finding
    frame: int
    n: int = 0


class FrameFindings:
    """Findings about the frames, gathered block by block."""

    def __init__(self, dataset: Dataset) -> None:
        self.counts: dict[tuple[str, str], _Count] = {}
        self.stretches: list[tuple[str, int, int]] = []
        for region in range(dataset.sizes.get("region", 0)):
            one = dataset["lost"].isel(region=region)
            name = str(dataset["region"].values[region])
            self.stretches += [(name, *run) for run in runs(one.values.astype(bool))]
        begins = {(name, first) for name, first, _ in self.stretches}
        self._reasons: dict[tuple[str, int], list[Finding]] = {}
        place = 0
        for block in blocks_of(dataset[["findings"]]) if "findings" in dataset else ():
            for frame, found in zip(block["frame"].values.tolist(), findings_of(block), strict=True):
                for finding in found:
                    count = self.counts.setdefault((finding.code, finding.subject), _Count(finding, frame))
                    count.n += 1
                    if is_lost(finding) and (finding.subject, place) in begins:
                        self._reasons.setdefault((finding.subject, place), []).append(finding)
                place += 1

    def lost(self, dataset: Dataset) -> Table:
        """Return where regions were lost, and for how long."""
        frames, times = dataset["frame"].values, times_s(dataset)
        period = period_s(times)
        rows = []
        for name, first, last in self.stretches:
            reasons = self._reasons.get((name, first), [])
            end = times[last + 1] if last + 1 < len(times) else times[last] + period
            rows.append(
                {
                    "region": name,
                    "first_frame": int(frames[first]),
                    "last_frame": int(frames[last]),
                    "n_frames": last - first + 1,
                    "start_s": float(times[first]),
                    "duration_s": float(end - times[first]),
                    # The region is in a separate column.
                    "reason": "; ".join(map(reason_of, reasons)),
                    "code": " ".join(one.code for one in reasons),
                }
            )
        return Table.of_rows("lost", "Stretches in which a region was lost", LOST, rows)

    def notes(self) -> Table:
        """Return how many frames have which note, the most frequent first."""
        rows = [
            {
                "note": note_of([count.first]),
                "code": count.first.code,
                "subject": count.first.subject,
                "n_frames": count.n,
                "first_frame": count.frame,
            }
            for count in sorted(self.counts.values(), key=lambda count: -count.n)
        ]
        return Table.of_rows("notes", "Notes on frames", NOTES, rows, detail=True)
