"""Results of a video's frames as one Dataset, with the description of each variable."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from math import nan
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.disk import parse_json
from ...core.disk.journal import Row
from ...core.disk.text import json_values
from ...core.errors import InputError
from ...core.result import Finding
from ...core.roi import Roi
from ...core.table import Column, attributes_of
from ...report.text import finding_text
from ..columns import CDP, CONTRAST, CSNR, SHARES, TARGET, by_itself, invalid_share, region_columns

if TYPE_CHECKING:
    from xarray import Dataset


#: Stands for the unit of the video's means: cd/m² or none.
LIGHT = "light"
#: Over frame and contrast; taken from a `Cdp`.
CONTRAST_COLUMNS = by_itself(*CDP, *SHARES)
#: Over frame; taken from a `Pair`.
PAIR_COLUMNS = by_itself(*CONTRAST, *CSNR)
#: Over frame; taken from the `Cdp` of the reference contrast.
REFERENCE_COLUMNS = tuple(
    replace(column, name=f"reference_{column.name}", label=column.label.replace("CDP", "CDP of reference"))
    for column in by_itself(
        replace(TARGET, label="reference contrast", meaning="Contrast the frame is compared with."), *CDP
    )
    if column.name != "u_cdp"
)
FRAME_COLUMNS = (*PAIR_COLUMNS, *REFERENCE_COLUMNS)
#: Over frame, where colours were asked for; taken from a `ColourSeparation`.
COLOUR_COLUMNS = tuple(
    column
    for name, path, label, meaning in (
        ("colour_distance", "distance", "colour distance", "Mahalanobis distance of the colours, pooled covariance."),
        ("csp", "csp", "CSP", "Colour separation probability, pooled covariance."),
        ("colours_detected", "detected", "pairs with their colours",
         "Share of the pairs of pixels that keep the difference of chromaticity."),
    )
    for column in (
        Column(name, label, "", meaning, decimals=4, value=f"{path}.value"),
        Column(f"{name}_low", f"{label}, low", "", "Lower end of the 95 % interval.", decimals=5,
               value=f"{path}.interval.low"),
        Column(f"{name}_high", f"{label}, high", "", "Upper end of the 95 % interval.", decimals=5,
               value=f"{path}.interval.high"),
    )
)  # fmt: skip
#: Over frame and region; taken from a `RegionLight`.
LIGHT_COLUMNS = tuple(
    column
    for column in by_itself(*region_columns(LIGHT), invalid_share("saturated"))
    if column.name in ("mean", "u_mean", "snr", "u_snr", "saturated")
)
#: Over frame and region; taken from a `TrackedRoi`.
TRACKING_COLUMNS = (
    Column("quality", "tracking quality", "", "Quality of the tracking, 0 to 1.", decimals=3,
           value=lambda tracked: float(tracked.quality)),
    Column("lost", "lost", "", "Whether the region was lost: 1 or 0.", decimals=0,
           value=lambda tracked: bool(tracked.lost)),
    Column("centre_x", "centre x", "pixel", "Centre of the region, to the right.", decimals=2, value="roi.centre.0"),
    Column("centre_y", "centre y", "pixel", "Centre of the region, down.", decimals=2, value="roi.centre.1"),
)  # fmt: skip
REGION_COLUMNS = (*LIGHT_COLUMNS, *TRACKING_COLUMNS)
#: Over frame, region and corner; taken from a `TrackedRoi`.
CORNER_COLUMNS = (
    Column("corner_x", "x", "pixel", "Corners of the region, to the right.", decimals=2,
           value=lambda tracked: [x for x, _ in tracked.roi.corners]),
    Column("corner_y", "y", "pixel", "Corners of the region, down.", decimals=2,
           value=lambda tracked: [y for _, y in tracked.roi.corners]),
)  # fmt: skip
TIME = Column("time_s", "time", "s", "Time since the first frame.", decimals=3)
NOTE = Column("note", "note", meaning="Why a value is missing, or a warning about it.")
FINDINGS = Column("findings", "findings", meaning="The notes with code, subject and values, as JSON.")


def names(columns: tuple[Column, ...]) -> tuple[str, ...]:
    """Return the names of columns."""
    return tuple(column.name for column in columns)


def as_json(values: Any) -> str:
    """Attribute of a dataset that holds more than a text or a number."""
    return json.dumps(json_values(values), ensure_ascii=False, sort_keys=True)


def recorded(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Return findings as values JSON can hold."""
    return [
        {"code": finding.code, "severity": finding.severity, "subject": finding.subject, "values": dict(finding.values)}
        for finding in findings
    ]


def restored(values: Iterable[Mapping[str, Any]]) -> tuple[Finding, ...]:
    """Return findings as they were before `recorded`."""
    return tuple(Finding(**finding) for finding in values)


#: Shown as "frame" and "contrast" in the Dataset.
_AXES = ("frame", "contrast")


def frame_columns(
    rows: Iterable[Row], n_frames: int, n_contrasts: int, rois: Sequence[Roi], *, colours: bool = False
) -> dict[str, NDArray[Any]]:
    """Return the rows of the journal as an array for each key; for corners, nan beyond those that a region has.

    Parameters
    ----------
    rows : iterable of dict
        One a frame, as the journal holds them.
    n_frames, n_contrasts : int
        Their number, and that of the contrasts.
    rois : sequence of Roi
        The regions; none for nearest neighbours.
    colours : bool
        Whether their colours were separated.

    Returns
    -------
    dict of str to ndarray
        Numbers by the names of the variables. ``findings`` are tuples of `Finding`, and ``invalid`` the shares of
        invalid pixels of each region by reason, None for a frame without them.
    """
    n_corners = max((len(roi.corners) for roi in rois), default=0)
    shapes: dict[str, tuple[int, ...]] = {"frame": (), TIME.name: ()}
    shapes |= dict.fromkeys(names(CONTRAST_COLUMNS), (n_contrasts,))
    if rois:
        shapes |= dict.fromkeys(names(FRAME_COLUMNS), ()) | dict.fromkeys(names(REGION_COLUMNS), (len(rois),))
        shapes |= dict.fromkeys(names(CORNER_COLUMNS), (len(rois), n_corners))
    shapes |= dict.fromkeys(names(COLOUR_COLUMNS), ()) if colours else {}
    columns: dict[str, NDArray[Any]] = {name: np.full((n_frames, *shape), nan) for name, shape in shapes.items()}
    columns["frame"] = np.zeros(n_frames, dtype=np.int64)
    texts: dict[str, NDArray[Any]] = {name: np.empty(n_frames, dtype=object) for name in ("findings", "invalid")}
    for frame, row in enumerate(rows):
        for name, array in columns.items():
            if array.ndim < 3:
                array[frame] = row[name]
                continue
            for region, corners in enumerate(row[name]):
                array[frame, region, : len(corners)] = corners
        texts["findings"][frame], texts["invalid"][frame] = restored(row["findings"]), row.get("invalid")
    return columns | texts


def video_dataset(
    columns: Mapping[str, NDArray[Any]],
    contrasts: Sequence[float],
    regions: Sequence[str],
    order: Sequence[int],
    unit: str,
    attributes: Mapping[str, Any],
) -> Dataset:
    """Return the results of a video's frames.

    Parameters
    ----------
    columns : mapping of str to ndarray
        As of `frame_columns`.
    contrasts : sequence of float
        Contrasts to be detected.
    regions : sequence of str
        Names of the regions; none for nearest neighbours.
    order : sequence of int
        Places of the regions in the Dataset.
    unit : str
        Unit of the means.
    attributes : mapping
        Attributes of the Dataset.
    """
    import xarray as xr

    variables: list[tuple[Column, tuple[str, ...], NDArray[Any]]] = [
        *((column, _AXES, columns[column.name]) for column in CONTRAST_COLUMNS),
        (TIME, ("frame",), columns[TIME.name]),
    ]
    coordinates: dict[str, Any] = {"frame": columns["frame"], "contrast": list(contrasts)}
    if regions:
        places = list(order)
        per_frame = [column for column in (*FRAME_COLUMNS, *COLOUR_COLUMNS) if column.name in columns]
        variables += [(column, ("frame",), columns[column.name]) for column in per_frame]
        variables += [(column, ("frame", "region"), columns[column.name][:, places]) for column in REGION_COLUMNS]
        variables += [
            (column, ("frame", "region", "corner"), columns[column.name][:, places]) for column in CORNER_COLUMNS
        ]
        coordinates["region"] = np.array([regions[index] for index in places], dtype=object)
    for column, text in ((NOTE, note_text), (FINDINGS, findings_text)):
        written = np.array([text(findings) for findings in columns["findings"]], dtype=object)
        variables.append((column, ("frame",), written))
    data = {}
    for column, axes, array in variables:
        values = array.astype(bool) if column.name == "lost" else array
        with_unit = replace(column, unit=unit) if column.unit == LIGHT else column
        data[column.name] = (axes, values, attributes_of(with_unit, values))
    return xr.Dataset(data, coordinates, dict(attributes)).set_coords(TIME.name)


def findings_text(findings: Sequence[Finding]) -> str:
    """Return the findings about a frame as JSON; empty for none."""
    return as_json(recorded(findings)) if findings else ""


def frame_findings(dataset: Dataset) -> list[tuple[Finding, ...]]:
    """Return the findings about each frame."""
    if FINDINGS.name not in dataset:
        return [()] * dataset.sizes["frame"]
    return [restored(parse_json(str(text), allow_nan=True)) if text else () for text in dataset[FINDINGS.name].values]


#: Codes of the reasons why a region is lost begin so.
_LOST = "tracking-"


def is_lost(finding: Finding) -> bool:
    """Whether a finding about a frame says that a region is lost, and why."""
    return finding.code.startswith(_LOST)


def reason_text(finding: Finding) -> str:
    """Return why a region is lost, as text without its name."""
    return finding_text(replace(finding, subject=""))


def note_text(findings: Iterable[Finding]) -> str:
    """Return the findings about a frame as text."""
    return "; ".join(
        f"{finding.subject}: {reason_text(finding)}" if is_lost(finding) else finding_text(finding)
        for finding in findings
    )


def check_video(dataset: Dataset) -> None:
    """Refuse a Dataset that is no result of a video.

    Raises
    ------
    InputError
        If a variable every video has is missing or has other axes, or there is no frame.
    """
    for name in names(CONTRAST_COLUMNS):
        if name not in dataset.data_vars or dataset[name].dims != _AXES:
            raise InputError(f"the results have no variable {name} over frame and contrast: give results of a video")
    for axis in _AXES:
        if axis not in dataset.coords:
            raise InputError(f"axis {axis} of the results has no coordinates: give results of a video")
        if dataset.sizes[axis] == 0:
            raise InputError(f"the results have no {axis}: evaluate at least one")
