"""Findings about the frames of a video: those about all frames, stretches without a region, and notes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.result import Finding, FindingValue, info, warning
from ...core.table import Column, Table
from ...files.doubts import MOSAIC, Doubts, contrast_matters
from ...metrics.region import SATURATED_SHARE
from ...report.text import span
from ..picture.converter import Converter
from .dataset import frame_findings, is_lost, note_text, reason_text

if TYPE_CHECKING:
    from xarray import Dataset

#: Frames and beats from which light that beats with the frames is named, and the least modulation of it.
_FEWEST_FOR_BEAT, _FEWEST_BEATS, _NAMED_FMI = 24, 5.0, 0.02
#: Light that varies without a period is named from this standard deviation, and this multiple of that of its noise.
_NAMED_VARIATION, _NAMED_OVER_NOISE = 0.01, 3.0
#: Standard deviation of a normal distribution over the median of its absolute values.
_SD_OF_MEDIAN = 1.4826
#: Most ranges of frames listed.
_MOST_STRETCHES = 5
#: Code under which a finding about a frame is counted in the findings about the video.
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


def _counted_as(finding: Finding) -> str:
    return "frames-lost" if is_lost(finding) else _COUNTED.get(finding.code, "")


def first_measured(columns: Mapping[str, NDArray[Any]]) -> int | None:
    """Return the number of the first frame that has a CDP, or whose regions were measured; None if none has."""
    has_cdp = np.isfinite(columns["cdp"]).any(axis=1)
    measured = np.flatnonzero(has_cdp if has_cdp.any() else _saturated_frames(columns))
    return int(columns["frame"][measured[0]]) if measured.size else None


def _saturated_frames(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Return which frames have no CDP only because a region is saturated."""
    if "saturated" not in columns:
        return np.zeros(columns["frame"].size, np.bool_)
    return np.asarray((columns["saturated"] > SATURATED_SHARE).any(axis=1))


def first_finding(columns: Mapping[str, NDArray[Any]]) -> tuple[int, Finding] | None:
    """Return number and finding of the first frame that has one."""
    for frame, findings in zip(columns["frame"].tolist(), columns["findings"], strict=True):
        if findings:
            return frame, findings[0]
    return None


def second_is_brighter(columns: Mapping[str, NDArray[Any]]) -> NDArray[np.bool_]:
    """Whether the second region is the brighter one, in each frame in which both were measured."""
    if "mean" not in columns:
        return np.zeros(0, dtype=np.bool_)
    first, second = columns["mean"].T
    brighter: NDArray[np.bool_] = (second > first)[~(np.isnan(first) | np.isnan(second))]
    return brighter


def video_findings(columns: Mapping[str, NDArray[Any]], regions: Sequence[str]) -> list[Finding]:
    """Return findings about all frames, one for each thing.

    Parameters
    ----------
    columns : mapping of str to ndarray
        As of `dataset.frame_columns`.
    regions : sequence of str
        Names of the regions; none for nearest neighbours.
    """
    n_frames = columns["frame"].size
    findings = [*_counted_findings(columns, n_frames), *_invalid_findings(columns, regions, n_frames)]
    if regions:
        full = columns["saturated"] > SATURATED_SHARE
        # The region that is saturated first comes first.
        for region in sorted(range(len(regions)), key=lambda region: (int(full[:, region].argmax()), region)):
            if full[:, region].any():
                findings.append(_saturated_finding(regions[region], full[:, region], columns["frame"]))
    brighter = second_is_brighter(columns)
    n_second = int(np.count_nonzero(brighter))
    if 0 < n_second < brighter.size:
        findings.append(warning("brighter-region-changes", count=min(n_second, brighter.size - n_second)))
    return findings


def varying_light_findings(
    columns: Mapping[str, NDArray[Any]], regions: Mapping[str, int], interval_s: float
) -> list[Finding]:
    """Return a warning for each region whose light varies from frame to frame by more than its noise.

    Light that beats with the frames, as of a pulsed lamp, is named with its period.

    Parameters
    ----------
    columns : mapping of str to ndarray
        As of `dataset.frame_columns`.
    regions : mapping of str to int
        Pixels of the regions, by their names; none for nearest neighbours.
    interval_s : float
        Usual distance of the frames; nan where it is not known.
    """
    if not regions or columns["frame"].size < _FEWEST_FOR_BEAT:
        return []
    from ...metrics.beat import find_wave
    from ...metrics.modulation import modulation

    findings: list[Finding] = []
    numbers = columns["frame"].astype(np.float64)
    step = float(np.median(np.diff(numbers)))
    for (region, n_pixels), values, snr in zip(regions.items(), columns["mean"].T, columns["snr"].T, strict=True):
        known = np.isfinite(values)
        if np.count_nonzero(known) < _FEWEST_FOR_BEAT or not modulation(values[known]) > _NAMED_FMI:
            continue
        wave = find_wave((numbers[known] - numbers[0]) / step, values[known])
        # Slow changes are those of a scene.
        if wave is None or wave.rate * wave.length < _FEWEST_BEATS or float(modulation(wave.smooth)) < _NAMED_FMI:
            findings += _irregular_light_findings(region, values[known], snr[known] * n_pixels**0.5)
            continue
        about = {"fmi": float(modulation(values[known])), "period_frames": step / wave.rate}
        if isfinite(interval_s):
            findings.append(warning("region-light-pulsed", region, **about, beat_hz=wave.rate / interval_s))
        else:
            findings.append(warning("region-light-pulsed-without-times", region, **about))
    return findings


def _irregular_light_findings(
    region: str, means: NDArray[np.float64], snr_of_means: NDArray[np.float64]
) -> Iterator[Finding]:
    """Yield a warning if the means of a region differ from frame to frame by more than their noise, without a period.

    Second differences of successive frames leave out slow changes, and their median single jumps, which are those of a
    scene. Of independent values they have 6 times the variance.
    """
    mean = float(np.mean(means))
    if not mean > 0:
        return
    variation_rel = _SD_OF_MEDIAN * float(np.median(np.abs(np.diff(means, 2)))) / 6**0.5 / mean
    positive = snr_of_means[snr_of_means > 0]
    noise_rel = 1 / float(np.median(positive)) if positive.size else 0.0
    if variation_rel > max(_NAMED_VARIATION, _NAMED_OVER_NOISE * noise_rel):
        yield warning("region-light-varies", region, variation_rel=variation_rel, noise_rel=noise_rel)


def _counted_findings(columns: Mapping[str, NDArray[Any]], n_frames: int) -> Iterator[Finding]:
    """Yield for each code a finding with the number of its frames, and the first of them."""
    #: For each code how many frames have it, and the number and the finding of the first of them.
    counts: dict[str, tuple[int, int, Finding]] = {}
    for frame, findings in zip(columns["frame"].tolist(), columns["findings"], strict=True):
        # Of several with one code the first one counts.
        for code, finding in {_counted_as(finding): finding for finding in reversed(findings)}.items():
            if code:
                count, *first = counts.get(code, (0, frame, finding))
                counts[code] = (count + 1, *first)
    for code, (count, frame, finding) in counts.items():
        more = {"reason": str(finding.values["reason"])} if code == "frames-not-evaluated" else {}
        yield warning(code, count=count, n_frames=n_frames, first=frame, **more)


def _invalid_findings(columns: Mapping[str, NDArray[Any]], regions: Sequence[str], n_frames: int) -> Iterator[Finding]:
    """Yield for each reason a finding with the number of frames with invalid pixels, and their largest share."""
    largest: dict[tuple[str, str], list[float]] = {}
    for shares_of_regions in columns["invalid"]:
        for region, shares in zip(regions, shares_of_regions or (), strict=False):
            for reason, share in shares.items():
                largest.setdefault((region, reason), []).append(share)
    for (region, reason), shares in largest.items():
        # Too many saturated pixels are a warning of their own.
        make = info if reason == "saturated" else warning
        values = {"count": len(shares), "n_frames": n_frames, "largest_share": max(shares)}
        yield make("frames-region-invalid", region, reason=reason.replace("_", " "), **values)


def _saturated_finding(region: str, saturated: NDArray[np.bool_], frames: NDArray[Any]) -> Finding:
    """Return a warning about the frames in which a region is saturated."""
    stretches = [span(str(frames[first]), str(frames[last])) for first, last in runs(saturated)]
    code, more = "frames-region-saturated", len(stretches) - _MOST_STRETCHES
    about: dict[str, FindingValue] = {"limit": SATURATED_SHARE, "count": int(np.count_nonzero(saturated))}
    about |= {"n_frames": saturated.size, "frames": stretches[:_MOST_STRETCHES]}
    if more > 0:
        code, about = f"{code}-often", {"more": more, **about}
    return warning(code, region, **about)


def reading_findings(
    columns: Mapping[str, NDArray[Any]], regions: Sequence[str], converter: Converter, doubts: Doubts
) -> Iterator[Finding]:
    """Yield a warning for each other encoding or black level by which the contrast of two regions would differ.

    The contrasts follow from the means of the regions, as if each were of one value.
    """
    means = zip(columns["frame"].tolist(), columns["mean"].tolist(), strict=True)
    known = [(frame, *sorted(zip(mean, regions, strict=True))) for frame, mean in means if all(map(isfinite, mean))]
    for code in converter.doubt_codes(doubts):
        matters: list[tuple[float, int, str, float, float]] = []
        for frame, (dark, dark_name), (bright, bright_name) in known if code != MOSAIC else ():
            low, high = doubts.light(dark, code), doubts.light(bright, code)
            if dark <= 0 or low <= 0:
                continue
            taken, otherwise = bright / dark - 1, high / low - 1
            if contrast_matters(taken, otherwise):
                change = abs(otherwise - taken) / (1 + taken)
                matters.append((change, frame, f"{bright_name} / {dark_name}", taken, otherwise))
        if matters:
            _, frame, pair, taken, otherwise = max(matters, key=lambda match: match[0])
            about = {"count": len(matters), "n_frames": columns["frame"].size, "frame": frame}
            yield doubts.finding(code, taken, otherwise, pair, **about)


LOST = (
    Column("region", "region"),
    Column("first_frame", "first frame", decimals=0, meaning="First frame in which it was lost."),
    Column("last_frame", "last frame", decimals=0, meaning="Last frame in which it was lost."),
    Column("n_frames", "frames", decimals=0, meaning="Evaluated frames from the first to the last."),
    Column("start_s", "from", "s", "Time of the first frame.", time=True),
    Column("duration_s", "for", "s", "Time until the region was found again.", time=True),
    # The region is in a separate column.
    Column("reason", "reason", "", "Why it was lost in the first of these frames."),
    Column("code", "code", "", "Code of the reason.", shown=False),
)
NOTES = (
    Column("note", "note", meaning="As in the first affected frame."),
    Column("code", "code", meaning="Code and values of the finding.", shown=False),
    Column("subject", "subject", meaning="Region it is about.", shown=False),
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
    findings = frame_findings(dataset)
    tables = (
        Table.of_items("lost", "Stretches in which a region was lost", LOST, _lost_rows(dataset, findings)),
        Table.of_items("notes", "Notes on frames", NOTES, _note_rows(dataset, findings), detail=True),
    )
    return [table for table in tables if len(table)]


def _lost_rows(dataset: Dataset, findings: Sequence[Sequence[Finding]]) -> Iterator[dict[str, Any]]:
    """Yield the frames one after the other in which a region is lost, as a row."""
    frames, times = dataset["frame"].values.tolist(), times_s(dataset)
    # The last stretch may last until the frame after the last one.
    ends = [*times[1:].tolist(), float(times[-1] + period_s(times))]
    for region, name in enumerate(dataset["region"].values if "region" in dataset.dims else ()):
        for first, last in runs(dataset["lost"].isel(region=region).values.astype(bool)):
            reasons = [finding for finding in findings[first] if is_lost(finding) and finding.subject == str(name)]
            yield {
                "region": str(name),
                "first_frame": frames[first],
                "last_frame": frames[last],
                "n_frames": last - first + 1,
                "start_s": float(times[first]),
                "duration_s": ends[last] - float(times[first]),
                "reason": "; ".join(map(reason_text, reasons)),
                "code": " ".join(reason.code for reason in reasons),
            }


def _note_rows(dataset: Dataset, findings: Sequence[Sequence[Finding]]) -> list[dict[str, Any]]:
    """Return each finding about frames, with the first frame that has it, and how many do."""
    rows: dict[tuple[str, str], dict[str, Any]] = {}
    for frame, findings_here in zip(dataset["frame"].values.tolist(), findings, strict=True):
        for finding in findings_here:
            row = rows.setdefault(
                (finding.code, finding.subject),
                {
                    "note": note_text([finding]),
                    "code": finding.code,
                    "subject": finding.subject,
                    "n_frames": 0,
                    "first_frame": frame,
                },
            )
            row["n_frames"] += 1
    return sorted(rows.values(), key=lambda row: -row["n_frames"])
