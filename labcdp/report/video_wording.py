"""What the results of a video say, in plain words."""

from __future__ import annotations

import json
from importlib.metadata import version
from math import isfinite
from pathlib import PurePath
from typing import TYPE_CHECKING

from .digits import fixed, percent, printable, share_percent, significant
from .facts import Fact
from .video_summary import SEEN_CDP, ContrastSummary, LostStretch, VideoSummary

if TYPE_CHECKING:
    from xarray import Dataset

#: How regions are followed, by the method's name.
METHODS = {
    "kcf": "kernelised correlation filters (KCF)",
    "csrt": "correlation filters with channel and spatial reliability (CSRT)",
    "flow": "optical flow",
    "homography": "the homography of a plane target",
    "fixed": "fixed regions, which do not move",
}


def title(dataset: Dataset) -> str:
    """Name of the video."""
    return printable(PurePath(str(dataset.attrs.get("file", ""))).name) or "video"


def unit_text(dataset: Dataset) -> str:
    """Return the unit of the means."""
    unit = str(dataset.attrs.get("unit", ""))
    return {"cd/m^2": "cd/m²", "relative": "relative units"}.get(unit, unit)


def of_neighbours(dataset: Dataset) -> bool:
    """Whether pixels were compared with their neighbours, and not two regions."""
    return str(dataset.attrs.get("mode", "regions")) == "neighbours"


def tolerance_percent(dataset: Dataset) -> str:
    """Write the tolerance of the contrast; one that is not a number as it stands."""
    epsilon = dataset.attrs.get("epsilon", "")
    return printable(epsilon) if isinstance(epsilon, str) else percent(float(epsilon))


def measured(dataset: Dataset, summary: VideoSummary) -> str:
    """Say what was measured."""
    if of_neighbours(dataset):
        what = "between each pixel and its right and its lower neighbour"
        how = ""
    else:
        names = " and ".join(f"“{printable(one.name)}”" for one in summary.regions)
        what = f"between the regions {names}"
        method = str(dataset.attrs.get("method", ""))
        how = f", followed from frame to frame by {METHODS.get(method, method)}" if method != "fixed" else ", at rest"
    frames = f"{summary.n_frames} {'frame' if summary.n_frames == 1 else 'frames'}, {frame_range(summary)}"
    tolerance = tolerance_percent(dataset)
    counted = (
        f" A pair of pixels counts as detected if its contrast is within {tolerance} of the one asked for."
        if tolerance
        else ""
    )
    return f"Contrast detection probability (CDP) {what}{how}: {frames}.{counted}"


def frame_range(summary: VideoSummary) -> str:
    """Write the first and the last frame, with their times."""
    if summary.first == summary.last:
        return f"number {summary.first}"
    frames = f"number {summary.first} to {summary.last}"
    if isfinite(summary.start_s) and isfinite(summary.end_s):
        return f"{frames} ({seconds(summary.start_s)} to {seconds(summary.end_s)})"
    return frames


def results(dataset: Dataset, summary: VideoSummary) -> list[str]:
    """Say how often the contrast was seen, and where regions were lost."""
    lines = [_seen(one, summary, is_reference) for one, is_reference in _main(summary)]
    if summary.regions:
        lines += [_lost(region.name, region.n_lost, summary) for region in summary.regions]
    return lines


def _main(summary: VideoSummary) -> list[tuple[ContrastSummary, bool]]:
    """Return the reference, or else the contrasts at both ends."""
    if summary.reference is not None:
        return [(summary.reference, True)]
    ends = dict.fromkeys((summary.contrasts[0], summary.contrasts[-1]))
    return [(one, False) for one in ends]


def contrast_name(one: ContrastSummary, is_reference: bool) -> str:
    """Name a contrast: "reference contrast 1000 %"."""
    if one.contrast is None:
        return "reference contrast of each frame"
    # A reference may have been measured, and then has as many digits as a float.
    return f"reference contrast {100 * one.contrast:.4g} %" if is_reference else f"contrast {percent(one.contrast)}"


def _seen(one: ContrastSummary, summary: VideoSummary, is_reference: bool) -> str:
    name = contrast_name(one, is_reference)
    if not one.n_evaluated:
        return f"No frame has a CDP of the {name}."
    text = (
        f"The {name} has a CDP of {SEEN_CDP:g} or more in {share_percent(one.seen_share)} of the frames "
        f"({one.n_seen} of {summary.n_frames})."
    )
    missing = summary.n_frames - one.n_evaluated
    if missing:
        of_known = share_percent(one.n_seen / one.n_evaluated)
        text += (
            f" {missing} {'frame' if missing == 1 else 'frames'} could not be evaluated and "
            f"{'counts' if missing == 1 else 'count'} as not seen; of the others it is {of_known}."
        )
    return f"{text} The lowest CDP is {fixed(one.lowest, 3)}, in frame {one.lowest_frame}."


def _lost(name: str, n_lost: int, summary: VideoSummary) -> str:
    region = f"Region “{printable(name)}”"
    if not n_lost:
        return f"{region} was found in every frame."
    stretches = [one for one in summary.lost if one.region == name]
    longest = max(stretches, key=lambda one: one.n_frames)
    times = {1: "once", 2: "twice"}.get(len(stretches), f"{len(stretches)} times")
    total = sum(one.duration_s for one in stretches)
    in_all = f" ({seconds(total)} in all)" if isfinite(total) else ""
    which = "namely" if len(stretches) == 1 else "longest"
    return (
        f"{region} was lost {times}, in {share_percent(n_lost / summary.n_frames)} of the frames{in_all}, "
        f"{which} {stretch_text(longest)}."
    )


def stretch_text(stretch: LostStretch) -> str:
    """Write where a region was lost: "in frames 30 to 49, from 1.0 s for 0.67 s"."""
    frames = f"frame {stretch.first}" if stretch.first == stretch.last else f"frames {stretch.first} to {stretch.last}"
    if not (isfinite(stretch.start_s) and isfinite(stretch.duration_s)):
        return f"in {frames}"
    return f"in {frames}, from {seconds(stretch.start_s)} for {seconds(stretch.duration_s)}"


def seconds(value: float) -> str:
    """Write a time; from two minutes on with minutes."""
    if not isfinite(value):
        return "unknown time"
    if value < 120:
        return f"{fixed(value, 2)} s"
    minutes, rest = divmod(round(value), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {rest:02d} s" if hours else f"{minutes} min {rest:02d} s"


def summary_facts(dataset: Dataset, summary: VideoSummary) -> list[Fact]:
    """Tell the results as facts with names, for the spreadsheet."""
    facts = [Fact("What was measured", measured(dataset, summary))]
    facts += [Fact("Result", line) for line in results(dataset, summary)]
    facts += [Fact("Mean of region " + printable(one.name), _mean(dataset, one.mean)) for one in summary.regions]
    facts += [Fact("Lost", f"region “{printable(one.region)}” {stretch_text(one)}") for one in summary.lost[:100]]
    if len(summary.lost) > 100:
        facts.append(Fact("Lost", f"and {len(summary.lost) - 100} times more: see the rows of the frames"))
    facts += [Fact("Frames with a note", f"{number}: {printable(note)}") for note, number in summary.notes[:20]]
    return facts + [Fact("Warning", printable(text)) for text in summary.warnings]


def _mean(dataset: Dataset, mean: float) -> str:
    return f"{significant(mean)} {unit_text(dataset)}"


def provenance(dataset: Dataset) -> list[Fact]:
    """Tell where the results come from."""
    attrs = {name: str(value) for name, value in dataset.attrs.items()}
    facts = [
        Fact("File", attrs.get("file", "")),
        Fact("SHA-256 of the file", attrs.get("sha256", "")),
        Fact("Conversion to luminance", attrs.get("conversion", "")),
        Fact("Unit of the means", "" if of_neighbours(dataset) else unit_text(dataset)),
        Fact("Tolerance of the contrast", tolerance_percent(dataset)),
        Fact("Followed by", "" if of_neighbours(dataset) else METHODS.get(attrs["method"], attrs["method"])),
        Fact("What was done to the pixels", "; ".join(_list(attrs.get("notes", "")))),
        Fact("Evaluated with", _pairs(attrs.get("versions", ""))),
        Fact("Report written by", f"labcdp {version('labcdp')}"),
    ]
    return [Fact(fact.name, printable(fact.value)) for fact in facts if fact.value]


def configuration(dataset: Dataset) -> str:
    """Write the settings of the evaluation, one a line."""
    text = str(dataset.attrs.get("configuration", ""))
    try:
        values = json.loads(text)
    except ValueError:
        return printable(text)
    if not isinstance(values, dict):
        return printable(text)
    return "\n".join(
        printable(f"{name}: {value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)}")
        for name, value in values.items()
        if value is not None
    )


def _pairs(text: str) -> str:
    """Write a JSON object as "name value, ..."; other text stays as it is."""
    try:
        values = json.loads(text)
    except ValueError:
        return text
    return ", ".join(f"{name} {value}" for name, value in values.items()) if isinstance(values, dict) else text


def _list(text: str) -> list[str]:
    try:
        values = json.loads(text or "[]")
    except ValueError:
        return [text]
    return list(map(str, values)) if isinstance(values, list) else [text]
