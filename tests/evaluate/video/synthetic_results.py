"""Results of a video that was never taken, for the reports."""

from math import isnan, nan
from typing import Any

import numpy as np
from xarray import Dataset

from labcdp.core.result import Finding, info, warning
from labcdp.evaluate.video.dataset import OF_CONTRAST, OF_FRAME, OF_REGION, VideoRows, as_json, names, recorded
from labcdp.evaluate.video.rows import variables

#: Frames in which the region "dark" is lost, and in which there was nothing to evaluate, of the usual 120.
LOST, BROKEN = (*range(40, 60), 100), range(20, 25)


def synthetic_video(
    n_frames: int = 120,
    contrasts: tuple[float, ...] = (0.07, 1.0, 10.0),
    regions: tuple[str, ...] = ("bright", "dark"),
    reference: float = nan,
    fps: float = 25.0,
) -> Dataset:
    """CDP that falls from frame to frame; without regions, nearest-neighbour."""
    rng = np.random.default_rng(6)
    rows = []
    for frame in range(n_frames):
        share, lost = frame / (n_frames - 1), bool(regions) and frame in LOST
        findings = [warning("frame-broken", reason=f"byte {frame - 20} is <wrong>")] if frame in BROKEN else []
        findings += [warning("tracking-region-gone", "dark")] if lost else []
        cdp = None if findings else 1 - 0.2 * share - 0.1 * np.arange(len(contrasts)) * rng.random()
        row = _of_contrasts(cdp, len(contrasts)) | ({} if not regions else _of_regions(frame, share, lost, reference))
        if findings:
            row |= dict.fromkeys(names(OF_FRAME), nan) if regions else {}
            row |= {"reference_contrast": reference} if regions else {}
        rows.append(variables(row | {"frame": frame, "time_s": frame / fps, "findings": recorded(findings)}))
    attributes = {
        "unit": "cd/m^2",
        "epsilon": 0.5,
        "file": "/videos/rain & <fog>.mp4",
        "sha256": "ab" * 32,
        "method": "follow" if regions else "none",
        "conversion": "calibration of the camera",
        "mode": "regions" if regions else "neighbours",
        "findings": as_json(recorded(_about_all())),
        "versions": as_json({"labcdp": "0.1.0", "opencv": "4.10"}),
        "configuration": as_json({"contrasts": list(contrasts), "start": "0", "stop": None, "every": "1"}),
    }
    order = tuple(range(len(regions)))
    return VideoRows(lambda: iter(rows), contrasts, regions, order, 4, "cd/m^2", attributes).dataset()


def _about_all() -> list[Finding]:
    return [warning("video-transfer-unknown", code=8, encoding="linear"), info("relative-luminance")]


def _of_contrasts(cdp: Any, n: int) -> dict[str, Any]:
    if cdp is None:
        return {name: [nan] * n for name in names(OF_CONTRAST)}
    values = cdp, np.full(n, 0.01), (cdp - 0.02).clip(0, 1), (cdp + 0.02).clip(0, 1), (1 - cdp) / 3, 2 * (1 - cdp) / 3
    return {name: one.tolist() for name, one in zip(names(OF_CONTRAST), values, strict=True)}


def _of_regions(frame: int, share: float, lost: bool, reference: float) -> dict[str, Any]:
    cdp = 0.95 - 0.1 * share if not isnan(reference) else nan
    found = 9.5 + 0.01 * frame, 0.1, 21.0, 0.3, reference, cdp, cdp - 0.02, cdp + 0.02
    mean, x = np.array([400.0, nan if lost else 38.0]), np.array([50.0 + frame, 150.0 + frame])
    of_region = mean, 0.01 * mean, 0.1 * mean, 0.001 * mean, 0 * x, np.array([0.9, 0.1 if lost else 0.9])
    placed = *of_region, np.array([False, lost]), x, np.full(2, 40.0)
    corners = np.array([-10.0, 10, 10, -10])
    row = dict(zip(names(OF_FRAME), found, strict=True)) | dict(zip(names(OF_REGION), placed, strict=True))
    return row | {"corner_x": x[:, None] + corners, "corner_y": 40.0 + np.tile(corners, (2, 1))}
