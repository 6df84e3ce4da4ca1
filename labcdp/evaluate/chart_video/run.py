"""A chart in each frame of a video: where it is, its patches, all of them against all, and its dynamic ranges."""

from __future__ import annotations

from base64 import b64decode, b64encode
from collections.abc import Iterable, Mapping, Sequence
from math import hypot, isfinite, nan
from typing import Any
from zlib import compress, decompress

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.disk.journal import Row
from ...core.errors import InputError
from ...core.result import Finding, warning
from ...core.roi import Roi
from ...metrics.region import RegionPixels, is_saturated
from ...tracking import NotFollowedError, TrackedRoi
from ..chart.measure import MeasuredChart, measure_patches
from ..picture.converter import Converter
from ..video.dataset import recorded
from ..video.run import PartRun, TrackedFrame
from .settings import ChartVideoSettings

_Array = NDArray[np.float64]
#: Reasons for which a tracker cannot say where a patch is, which the other patches of a flat chart can; for all others
#: something may cover it.
_PLACE_UNKNOWN = frozenset(("tracking-places-alike", "tracking-region-jumped", "tracking-region-faint"))
#: Change of the light of such a patch, against that of the others, from which something covers it: as a share, and in
#: standard uncertainties.
_COVERED_SHARE, _COVERED_SIGMA = 0.25, 4.0
#: Pixels by which a corner of a patch may be off the perspective of the others, and the least share of the followed
#: patches that must agree.
_NEAR_PX, _AGREEING_SHARE = 2.0, 0.5
#: Findings of each frame that are about the chart, and said once.
_ABOUT_CHART = frozenset(("chart-not-stated", "chart-glare"))


class ChartRun(PartRun):
    """Evaluates a chart in each frame.

    The patches are followed together, and a flat chart is where most of them agree: the perspective of these says where
    all are, also those that look like their neighbours or drown in noise. A patch that is covered has no value: its
    edges are gone, and its light has changed against that of the others.
    """

    settings: ChartVideoSettings

    def __init__(self, settings: ChartVideoSettings, converter: Converter, journal: Any) -> None:
        self._not_followed: set[str] = set()
        #: Mean and u of each patch in the first frame that is measured, and which ones are saturated there.
        self._first: Row | None = None
        super().__init__(settings, converter, None, journal, None)
        for row in journal.rows():
            self._note_first(row)

    @property
    def methods(self) -> dict[Roi, str]:
        """The patches that are followed, and how."""
        return {roi: method for roi, method in super().methods.items() if roi.name not in self._not_followed}

    def cannot_follow(self, error: NotFollowedError) -> None:
        """Leave a patch to the perspective of the others."""
        self._not_followed.add(error.region)
        if len(self.methods) < 2:
            self.failure = error

    def _note_first(self, row: Row) -> None:
        if self._first is None and row.get("cdp") is not None:
            self._first = {name: row[name] for name in ("mean", "u_mean", "full")}

    @property
    def _first_values(self) -> dict[str, float] | None:
        """Values whose contrasts are to be detected, where the chart states none: means in the first frame."""
        if self._first is None:
            return None
        measured = zip(self.settings.patches.names, self._first["mean"], self._first["full"], strict=True)
        return {name: mean for name, mean, full in measured if mean > 0 and not full}

    def _targets(self) -> Sequence[float] | Mapping[str, float] | None:
        settings = self.settings
        if settings.contrasts is not None or settings.patches.is_stated:
            return settings.contrasts
        return self._first_values

    def contrast_of_pairs(self) -> _Array | None:
        """Return the contrast to be detected of each pair of patches, shape (n, n); None if contrasts are given."""
        if self.settings.contrasts is not None:
            return None
        chart = self.settings.patches
        stated = {name: quantity.value for name, quantity in chart.luminances().items()}
        known = stated if chart.is_stated else self._first_values or {}
        values = np.array([known.get(name, nan) for name in chart.names])
        with np.errstate(invalid="ignore"):
            contrasts = np.maximum(values[:, None], values) / np.minimum(values[:, None], values) - 1
        return np.where(contrasts > 0, contrasts, nan)

    def _row(self, item: TrackedFrame, regions: Sequence[TrackedRoi]) -> Row:
        settings, frame = self.settings, item.frame
        chart, n = settings.patches, len(settings.rois)
        row: Row = {"frame": frame.number, "time_s": frame.time_s, "quality": nan, "lost": False}
        row |= {"centre_x": nan, "centre_y": nan, "full": [False] * n}
        row |= {name: [nan] * n for name in ("mean", "u_mean", "snr", "u_snr", "saturated")}
        row |= dict.fromkeys(("cdp", "cdp_low", "cdp_high", "ranges", "glare"))
        findings: list[Finding] = [] if frame.fault is None else [frame.fault]
        if frame.pixels is None or not item.regions:
            return row | {"findings": recorded(findings)}
        followed = [item.regions[roi] for roi in self.methods]
        patches, quality = self._located(followed)
        row["quality"] = quality
        if patches is None:
            row["lost"] = True
            n_agreeing = round(quality * len(followed))
            lost = warning("tracking-chart-lost", chart.name, agreeing=n_agreeing, patches=len(followed))
            return row | {"findings": recorded([*findings, lost])}
        row["centre_x"], row["centre_y"] = np.mean([roi.centre for roi in patches], axis=0).tolist()
        hidden: set[str] = set()
        pixels: dict[str, RegionPixels] = {}
        for roi in patches:
            try:
                pixels[roi.name] = item.light(roi)
            except InputError:
                hidden.add(roi.name)
        doubtful = {tracked.roi.name for tracked in followed if tracked.lost and not _place_unknown(tracked)}
        hidden |= self._covered(pixels, doubtful & pixels.keys())
        pixels = {name: region for name, region in pixels.items() if name not in hidden}
        if hidden:
            findings.append(
                warning("chart-patches-hidden", patches=[roi.name for roi in patches if roi.name in hidden])
            )
        try:
            if len(pixels) < 2:
                raise InputError("fewer than two patches are to be seen")
            measured = measure_patches(pixels, self._unit, chart, self._targets(), settings.epsilon, settings.cdp_limit)
        except InputError as error:
            findings.append(warning("frame-not-evaluated", reason=" ".join(str(error).split())))
            return row | {"findings": recorded(findings)}
        row |= _chart_row(measured, chart.names)
        self._note_first(row)
        findings += [finding for finding in measured.findings if finding.code not in _ABOUT_CHART]
        if item.repeats is not None:
            findings.append(warning("frame-repeated", of_frame=item.repeats))
        findings += [] if frame.note is None else [frame.note]
        return row | {"findings": recorded(findings)}

    def _covered(self, pixels: Mapping[str, RegionPixels], doubtful: set[str]) -> set[str]:
        """Return which of the patches whose edges are gone have another light than the rest lets expect."""
        chart = self.settings.patches
        expected: dict[str, tuple[float, float]] = {}
        first: dict[str, tuple[float, float]] = {}
        if self._first is not None:
            measured = zip(chart.names, *(self._first[name] for name in ("mean", "u_mean", "full")), strict=True)
            first = {name: (mean, u) for name, mean, u, full in measured if not full and isfinite(mean)}
        stated = chart.luminances() if chart.is_stated else {}
        # What is saturated in the first frame can only be told by the values of the chart.
        for values in ({name: (quantity.value, 0.0) for name, quantity in stated.items()}, first):
            sure = [
                pixels[name].mean / values[name][0]
                for name in (values.keys() & pixels.keys()) - doubtful
                if values[name][0] > 0 and not is_saturated(pixels[name].invalid_shares)
            ]
            if sure:
                factor = float(np.median(sure))
                expected |= {name: (factor * mean, factor * u) for name, (mean, u) in values.items()}

        def is_covered(name: str) -> bool:
            mean, u = expected.get(name, (nan, nan))
            most = _COVERED_SHARE * abs(mean) + _COVERED_SIGMA * hypot(pixels[name].random, u if isfinite(u) else 0.0)
            return not abs(pixels[name].mean - mean) <= most

        return {name for name in doubtful if is_covered(name)}

    @property
    def _unit(self) -> str:
        return "relative" if self._converter.unit == "relative" else "cd/m²"

    def _located(self, followed: Sequence[TrackedRoi]) -> tuple[list[Roi] | None, float]:
        """Return where all patches are, and the share of the followed ones that agree; None if these are too few."""
        rois = self.settings.rois
        if all(method == "fixed" for method in self.methods.values()):
            return list(rois), float(np.mean([tracked.quality for tracked in followed]))
        seen = [(first, tracked.roi) for first, tracked in zip(self.methods, followed, strict=True) if not tracked.lost]
        if len(seen) < 2:
            return None, len(seen) / len(followed)
        import cv2

        begin, now = (np.concatenate([roi.corners for roi in side]) for side in zip(*seen, strict=True))
        matrix, inside = cv2.findHomography(begin, now, cv2.RANSAC, _NEAR_PX)
        if matrix is None:
            return None, 0.0
        ends = np.cumsum([len(first.corners) for first, _ in seen])[:-1]
        agreeing = sum(bool(part.all()) for part in np.split(inside.ravel(), ends))
        share = agreeing / len(followed)
        # Two patches fix the perspective of all others poorly.
        if agreeing < 2 or share < _AGREEING_SHARE:
            return None, share
        return [_projected(roi, matrix) for roi in rois], share


def _place_unknown(tracked: TrackedRoi) -> bool:
    return all(finding.code in _PLACE_UNKNOWN for finding in tracked.reasons)


def _projected(roi: Roi, matrix: NDArray[Any]) -> Roi:
    x, y, w = matrix @ np.vstack([np.array(roi.corners).T, np.ones(len(roi.corners))])
    return Roi(roi.name, tuple(zip((x / w).tolist(), (y / w).tolist(), strict=True)))


def _chart_row(measured: MeasuredChart, names: Sequence[str]) -> Row:
    """Return the values of a measured chart, nan of patches that it lacks."""
    at = [names.index(region.roi.name) for region in measured.regions]

    def over_patches(values: Iterable[float]) -> list[float]:
        filled = np.full(len(names), nan)
        filled[at] = list(values)
        numbers: list[float] = filled.tolist()
        return numbers

    regions = measured.regions
    full = np.zeros(len(names), dtype=np.bool_)
    full[at] = measured.saturated
    return {
        "mean": over_patches(region.mean for region in regions),
        "u_mean": over_patches(region.u for region in regions),
        "snr": over_patches(region.snr.value for region in regions),
        "u_snr": over_patches(region.snr.u for region in regions),
        "saturated": over_patches(region.invalid_shares.get("saturated", 0.0) for region in regions),
        "full": full.tolist(),
        **{name: packed(_pairs(measured.matrix[name].values, at, len(names))) for name in CDP_NAMES},
        "ranges": [
            [item.name, item.range.limit, item.range.low, *item.range.low_interval,
             item.range.low_end, item.range.high, *item.range.high_interval, item.range.high_end, item.range.stops,
             item.range.u_stops, item.range.bound]
            for item in measured.ranges
        ],
        "glare": None if measured.glare is None else [measured.glare.value, measured.glare.u],
    }  # fmt: skip


#: CDP of each pair and the ends of its interval, in a row of the journal.
CDP_NAMES = ("cdp", "cdp_low", "cdp_high")


def _pairs(matrix: _Array, at: Sequence[int], n: int) -> _Array:
    """Return the values of each pair of patches, shape (contrasts, pairs), of a matrix of some of them."""
    matrix = matrix if matrix.ndim == 3 else matrix[..., None]
    whole = np.full((n, n, matrix.shape[2]), nan)
    whole[np.ix_(at, at)] = matrix
    values: _Array = np.ascontiguousarray(whole[np.triu_indices(n, 1)].T)
    return values


def packed(values: ArrayLike) -> str:
    """Return numbers as a short text, to the last bit."""
    return b64encode(compress(np.asarray(values, dtype="<f8").tobytes(), 1)).decode()


def unpacked(text: str, shape: tuple[int, ...]) -> _Array:
    """Return numbers as they were before `packed`."""
    return np.frombuffer(decompress(b64decode(text)), dtype="<f8").reshape(shape)
