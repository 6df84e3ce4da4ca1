"""Findings about the frames of a video: how they are recorded, and what the frames have in common."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import isnan
from typing import Any

from ...core.result import Finding, FindingValue, info, warning
from ...report.text import finding_text

#: Share of saturated pixels above which a contrast of a region is not to be trusted.
TOO_SATURATED = 0.01
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


def recorded(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Return findings as values JSON can hold."""
    return [
        {"code": one.code, "severity": one.severity, "subject": one.subject, "values": dict(one.values)}
        for one in findings
    ]


def restored(values: Iterable[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """Return findings as they were before `recorded`."""
    return tuple(Finding(one["code"], one["severity"], one["subject"], one["values"]) for one in values)


def note_of(findings: Iterable[Finding]) -> str:
    """Return the findings about a frame as text."""
    return "; ".join(f"{one.subject}: {reason_of(one)}" if is_lost(one) else finding_text(one) for one in findings)


def reason_of(finding: Finding) -> str:
    """Return why a region is lost, as text without its name."""
    return finding_text(replace(finding, subject=""))


def is_lost(finding: Finding) -> bool:
    """Whether a finding about a frame says that a region is lost, and why."""
    return finding.code.startswith(_LOST)


def saturation(regions: Sequence[str], shares: Sequence[float]) -> list[Finding]:
    """Return a finding for each region of a frame that is saturated too much."""
    return [
        warning("frame-region-saturated", name, share=share)
        for name, share in zip(regions, shares, strict=True)
        if share > TOO_SATURATED
    ]


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
        self._counts: Counter[str] = Counter()
        self._first: dict[str, tuple[int, Finding]] = {}
        self._invalid: dict[tuple[str, str], tuple[int, float]] = {}
        self._brighter: Counter[int] = Counter()
        self._saturated: dict[str, _Stretches] = {}
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
        for code, finding in {_code(one): one for one in reversed(found)}.items():
            if code:
                self._counts[code] += 1
                self._first.setdefault(code, (row["frame"], finding))
        for region, shares in zip(self._regions, row.get("invalid") or [], strict=False):
            for reason, share in shares.items():
                count, largest = self._invalid.get((region, reason), (0, 0.0))
                self._invalid[region, reason] = count + 1, max(largest, share)
        for region, share in zip(self._regions, row.get("saturated") or [], strict=False):
            if share > TOO_SATURATED:
                self._saturated.setdefault(region, _Stretches()).add(row["frame"], self._n)
        if self._regions and not any(isnan(mean) for mean in row["mean"]):
            second_is_brighter = row["mean"][1] > row["mean"][0]
            if second_is_brighter and not self._brighter:
                self.order = (1, 0)
            self._brighter[int(second_is_brighter)] += 1

    @property
    def findings(self) -> tuple[Finding, ...]:
        """One finding for each thing."""
        found = []
        for code, count in self._counts.items():
            frame, first = self._first[code]
            more = {"reason": str(first.values["reason"])} if code == "frames-not-evaluated" else {}
            found.append(warning(code, count=count, n_frames=self._n, first=frame, **more))
        for (region, reason), (count, largest) in self._invalid.items():
            # Too many saturated pixels are a warning of their own.
            make = info if reason == "saturated" else warning
            found.append(
                make("frames-region-invalid", region, reason=reason.replace("_", " "), count=count, n_frames=self._n,
                     largest_share=largest)
            )  # fmt: skip
        found += [stretches.finding(region, self._n) for region, stretches in self._saturated.items()]
        if len(self._brighter) > 1:
            found.append(warning("brighter-region-changes", count=min(self._brighter.values())))
        return tuple(found)


class _Stretches:
    """Frames one after the other."""

    def __init__(self) -> None:
        self._found: list[list[int]] = []
        self._last_place = -1
        self._n_frames = 0

    def add(self, frame: int, place: int) -> None:
        self._n_frames += 1
        if place == self._last_place + 1 and self._found:
            self._found[-1][1] = frame
        else:
            self._found.append([frame, frame])
        self._last_place = place

    def finding(self, region: str, n_frames: int) -> Finding:
        named = self._found[:_MOST_STRETCHES]
        values: dict[str, FindingValue] = {
            "limit": TOO_SATURATED,
            "count": self._n_frames,
            "n_frames": n_frames,
            "frames": [str(first) if first == last else f"{first} to {last}" for first, last in named],
        }
        more = len(self._found) - len(named)
        if more:
            return warning("frames-region-saturated-often", region, more=more, **values)
        return warning("frames-region-saturated", region, **values)


def _code(finding: Finding) -> str:
    return "frames-lost" if is_lost(finding) else _COUNTED.get(finding.code, "")
