"""Results of one frame, as a row of the journal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache
from math import isnan, nan
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.disk.journal import Row
from ...core.errors import InputError
from ...core.frame import Frame
from ...core.result import Finding, warning
from ...core.roi import Roi
from ...files.video.source import VideoFrame
from ...metrics import Epsilon, cdp_neighbours_range
from ...metrics.pair import PairResult, evaluate_regions, require_apart
from ...metrics.region import RegionPixels
from ...tracking import TrackedRoi
from ..picture.conversion import PictureConversion
from ..picture.neighbours import neighbour_contrast
from .dataset import FINDINGS, NOTE, OF_CONTRAST, OF_FRAME, OF_REGION, as_json, names
from .findings import note_of, recorded, restored, saturation
from .neighbours import NeighbourTables, light_by_dn
from .settings import ReferenceContrast, VideoSettings

#: Keys of a row that are no variables.
_FINDINGS, _INVALID = "findings", "invalid"
#: Key of the contrast that is measured in a frame; for nearest neighbours in the first one only, if none was given.
MEASURED = "measured_contrast"


class _Asked(NamedTuple):
    """Contrasts to be detected in a frame, its reference contrast, and why there is none."""

    contrasts: tuple[float, ...]
    reference: float | None
    findings: tuple[Finding, ...]


class FrameRows:
    """Evaluates frames; what the first one measures may be what is to be detected in the others.

    Parameters
    ----------
    settings : VideoSettings
        What is to be evaluated.
    conversion : PictureConversion
        Of frames to light.
    reference : ReferenceContrast or None
        What each frame is compared with.
    """

    def __init__(
        self, settings: VideoSettings, conversion: PictureConversion, reference: ReferenceContrast | None
    ) -> None:
        self._settings, self._conversion, self._reference = settings, conversion, reference
        #: The contrast to be detected if none is given: that of the first frame that is measured.
        self._measured = ReferenceContrast(None) if settings.contrasts is None else None
        self._tables: NeighbourTables | None = None
        self._setting: tuple[float | None, ...] | None = None
        self._lock = Lock()

    @property
    def contrasts(self) -> tuple[float, ...]:
        """Contrasts that were to be detected; a measured one is nan if no frame could be measured."""
        if self._measured is None:
            return self._settings.contrasts or ()
        contrast, _ = self._measured.of(0, 0.0)
        return (nan if contrast is None else contrast,)

    def learn(self, contrast: float) -> None:
        """Take note of the contrast that was measured in a frame."""
        for one in (self._measured, self._reference):
            if one is not None:
                one.learn(contrast)

    def row(self, frame: VideoFrame, regions: Sequence[TrackedRoi], repeats: int | None) -> Row:
        """Evaluate a frame with its regions; `repeats` is the number of the frame before if it has the same pixels."""
        settings = self._settings
        tables = None
        if not settings.rois and frame.frame is not None and not isnan(self.contrasts[0]):
            # What is wrong with these is wrong with every frame.
            tables = self._neighbour_tables(frame.frame)
        row: Row = {"frame": frame.number, "time_s": frame.time_s, _FINDINGS: []}
        row |= {name: [nan] * settings.n_contrasts for name in names(OF_CONTRAST)}
        if settings.rois:
            row |= _of_regions(regions, settings.rois, frame.frame is not None)
        if frame.frame is None:
            return row | _found([frame.fault] if frame.fault is not None else [])
        noted = [] if repeats is None else [warning("frame-repeated", of_frame=repeats)]
        noted += [] if frame.note is None else [frame.note]
        try:
            if not settings.rois:
                values = self._of_neighbours(frame.frame, tables)
                without = [] if "cdp" in values else [warning("frame-without-contrast")]
                return row | values | _found([*without, *noted])
            reasons = [reason for one in regions if one.lost for reason in one.reasons]
            if any(one.lost for one in regions):
                return row | _found(reasons)
            values, findings = self._of_pair(frame, frame.frame, regions)
            return row | values | _found([*findings, *noted])
        except InputError as error:
            return row | _found([warning("frame-not-evaluated", reason=" ".join(str(error).split()))])

    def _of_pair(self, frame: VideoFrame, pixels: Frame, regions: Sequence[TrackedRoi]) -> tuple[Row, list[Finding]]:
        rois = [one.roi for one in regions]
        asked = self._asked(frame)
        found = self._pair(pixels, rois, asked)
        # The first frame that is measured gives what was not given.
        self.learn(found.contrast.value)
        if self._asked(frame) != asked:
            asked = self._asked(frame)
            found = self._pair(pixels, rois, asked)
        n, reference, findings = len(asked.contrasts), asked.reference, list(asked.findings)
        both = (found.a, found.b)
        row: Row = {
            "measured_contrast": found.contrast.value,
            "measured_contrast_standard_uncertainty": found.contrast.standard_error,
            "csnr": found.csnr.value,
            "csnr_standard_uncertainty": found.csnr.standard_error,
            "mean": [region.mean for region in both],
            "mean_standard_uncertainty": [region.standard_uncertainty for region in both],
            "snr": [region.snr.value for region in both],
            "snr_standard_uncertainty": [region.snr.standard_error for region in both],
            "saturated": [region.invalid_shares.get("saturated", 0.0) for region in both],
            _INVALID: [region.invalid_shares for region in both],
        }
        if n:
            results = found.results[:n]
            row |= {
                "cdp": [one.result.cdp for one in results],
                "cdp_standard_uncertainty": [one.standard_uncertainty for one in results],
                "cdp_low": [one.confidence_interval[0] for one in results],
                "cdp_high": [one.confidence_interval[1] for one in results],
                "below": [one.result.below for one in results],
                "above": [one.result.above for one in results],
            }
        else:
            findings.append(warning("frame-without-contrast"))
        if reference is not None:
            result = found.results[n]
            row |= {
                "reference_contrast": reference,
                "reference_cdp": result.result.cdp,
                "reference_cdp_low": result.confidence_interval[0],
                "reference_cdp_high": result.confidence_interval[1],
            }
        return row, [*findings, *saturation([roi.name for roi in rois], row["saturated"])]

    def _pair(self, pixels: Frame, rois: Sequence[Roi], asked: _Asked) -> PairResult:
        contrasts = [*asked.contrasts, *([] if asked.reference is None else [asked.reference])]
        return evaluate_frame_pair(pixels, self._conversion, rois, contrasts, self._settings.epsilon)

    def _asked(self, frame: VideoFrame) -> _Asked:
        contrasts = tuple(contrast for contrast in self.contrasts if not isnan(contrast))
        if self._reference is None:
            return _Asked(contrasts, None, ())
        reference, why = self._reference.of(frame.number, frame.time_s)
        return _Asked(contrasts, reference, () if why is None else (why,))

    def _of_neighbours(self, frame: Frame, tables: NeighbourTables | None) -> Row:
        measured: Row = {}
        if tables is not None and frame.dn.dtype == np.uint8:
            found = tables.evaluate(frame.dn)
        else:
            light = self._conversion.convert(frame).luminance_cd_m2.astype(np.float64)
            if isnan(self.contrasts[0]):
                measured = {MEASURED: neighbour_contrast(light)}
                self.learn(measured[MEASURED])
                if isnan(self.contrasts[0]):
                    return measured
            found = cdp_neighbours_range(light, self.contrasts, self._settings.epsilon)
        return measured | {
            "cdp": [one.cdp for one in found],
            "cdp_standard_uncertainty": [one.standard_error for one in found],
            "cdp_low": [one.confidence_interval[0] for one in found],
            "cdp_high": [one.confidence_interval[1] for one in found],
            "below": [one.below for one in found],
            "above": [one.above for one in found],
        }

    def _neighbour_tables(self, frame: Frame) -> NeighbourTables | None:
        """Tables for frames of this setting, made once for each; None if more than the DN decides."""
        setting = (frame.exposure_s, frame.gain_db, frame.nominal_black_dn, frame.saturation_dn, frame.temperature_c)
        with self._lock:
            if setting != self._setting:
                light = light_by_dn(frame, self._conversion)
                settings = self._settings
                self._tables = None if light is None else NeighbourTables(light, self.contrasts, settings.epsilon)
                self._setting = setting
            return self._tables


def _of_regions(regions: Sequence[TrackedRoi], rois: Sequence[Roi], seen: bool) -> Row:
    """Where the regions are; nan in a damaged frame."""
    row: Row = dict.fromkeys(names(OF_FRAME), nan) | {name: [nan, nan] for name in names(OF_REGION)}
    if not seen or not regions:
        nothing = [[nan] * len(roi.corners) for roi in rois]
        return row | {"lost": [False, False], "corner_x": nothing, "corner_y": nothing}
    return row | {
        "quality": [float(one.quality) for one in regions],
        "lost": [bool(one.lost) for one in regions],
        "centre_x": [one.roi.centre[0] for one in regions],
        "centre_y": [one.roi.centre[1] for one in regions],
        "corner_x": [[x for x, _ in one.roi.corners] for one in regions],
        "corner_y": [[y for _, y in one.roi.corners] for one in regions],
    }


def _found(findings: Iterable[Finding]) -> Row:
    return {_FINDINGS: recorded(findings)}


def is_end(row: Row) -> bool:
    """Whether a row of the journal marks the end of the video instead of a frame."""
    return "end" in row


def variables(row: Row) -> Row:
    """Return what of a row are variables of the Dataset."""
    values = {name: value for name, value in row.items() if name not in (_FINDINGS, _INVALID)}
    found = row[_FINDINGS]
    return {**values, NOTE.name: note_of(restored(found)), FINDINGS.name: as_json(found) if found else ""}


def evaluate_frame_pair(
    frame: Frame, conversion: PictureConversion, rois: Sequence[Roi], contrasts: Sequence[float], epsilon: Epsilon
) -> PairResult:
    """Evaluate two regions of a frame as `labcdp.metrics.pair.evaluate_pair` does.

    Parameters
    ----------
    frame : Frame
        The frame.
    conversion : PictureConversion
        To light.
    rois : sequence of two Roi
        The regions, in any order.
    contrasts : sequence of float
        Contrasts to be detected.
    epsilon : float or DetectionInterval
        Their tolerance.

    Raises
    ------
    InputError
        If a region lies outside the frame or holds no pixel, the regions have pixels in common, or neither has a pixel
        above 0.
    CalibrationError
        If the conversion is not for such frames.
    """
    first, second = (_region(frame, conversion, roi) for roi in rois)
    require_apart(first.placed, second.placed)
    return evaluate_regions(first, second, contrasts, epsilon)


def _region(frame: Frame, conversion: PictureConversion, roi: Roi) -> RegionPixels:
    # A pixel of the map stands for a group of the colour filter.
    group = 1 if frame.colour_filter is None else 2
    shape = (frame.shape[0] // group, frame.shape[1] // group)
    region = roi if group == 1 else Roi(roi.name, tuple((x / group, y / group) for x, y in roi.corners))
    window, mask = region.window(shape), _mask(region, shape)
    by_dn = group == 1 and frame.dn.dtype == np.uint8
    light = conversion.convert(frame, window)
    return RegionPixels.of_part(light, roi, window, mask, dn=frame.dn[window] if by_dn else None)


@lru_cache(maxsize=16)
def _mask(roi: Roi, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Mask of a region; that of one that stays is kept."""
    mask = roi.mask(shape)
    mask.flags.writeable = False
    return mask
