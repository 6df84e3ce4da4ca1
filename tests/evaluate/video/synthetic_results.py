"""Results of a video that was never taken, for the reports."""

import json
from typing import Any

import numpy as np
from xarray import Dataset

from labcdp.core.result import Finding, info, warning
from labcdp.evaluate.video.dataset import as_json, recorded
from labcdp.evaluate.video.findings import note_of

#: Frames in which the region "dark" is lost, and in which there was nothing to evaluate, of the usual 120.
LOST, BROKEN = [(40, 60), (100, 101)], (20, 25)

_OF_CONTRAST, _OF_REGION = ("frame", "contrast"), ("frame", "region")


def synthetic_video(
    n_frames: int = 120,
    contrasts: tuple[float, ...] = (0.07, 1.0, 10.0),
    regions: tuple[str, ...] = ("bright", "dark"),
    reference: float = np.nan,
    fps: float = 25.0,
) -> Dataset:
    """CDP that falls from frame to frame; without regions, nearest-neighbour."""
    rng = np.random.default_rng(6)
    frames = np.arange(n_frames)
    lost = np.zeros((n_frames, len(regions)), bool)
    missing = np.zeros(n_frames, bool)
    found: list[list[Finding]] = [[] for _ in frames]
    for start, stop in LOST if regions else ():
        lost[start:stop, 1] = missing[start:stop] = True
        found[start:stop] = [[warning("tracking-region-gone", "dark")] for _ in frames[start:stop]]
    missing[slice(*BROKEN)] = True
    for number, frame in enumerate(frames[slice(*BROKEN)].tolist()):
        found[frame] = [warning("frame-broken", reason=f"byte {number} is <wrong>")]

    def known(values: Any) -> Any:
        values = np.array(values, dtype=float)
        values[missing] = np.nan
        return values

    cdp = np.linspace(1.0, 0.8, n_frames)[:, None] - 0.1 * np.arange(len(contrasts)) * rng.random((n_frames, 1))
    below = (1 - cdp) / 3
    variables = {
        "cdp": cdp,
        "cdp_standard_uncertainty": np.full_like(cdp, 0.01),
        "cdp_low": np.clip(cdp - 0.02, 0, 1),
        "cdp_high": np.clip(cdp + 0.02, 0, 1),
        "below": below,
        "above": 1 - cdp - below,
    }
    data: dict[str, Any] = {name: (_OF_CONTRAST, known(values)) for name, values in variables.items()}
    data["note"] = ("frame", np.array([note_of(one) for one in found], dtype=object))
    texts = [as_json(recorded(one)) if one else "" for one in found]
    data["findings"] = ("frame", np.array(texts, dtype=object))
    coordinates: dict[str, Any] = {"frame": frames, "contrast": list(contrasts), "time_s": ("frame", frames / fps)}
    if regions:
        _add_regions(data, lost, known, frames, reference)
        coordinates["region"] = list(regions)
    attributes = {
        "unit": "cd/m^2",
        "epsilon": 0.5,
        "file": "/videos/rain & <fog>.mp4",
        "sha256": "ab" * 32,
        "method": "follow" if regions else "none",
        "conversion": "calibration of the camera",
        "mode": "regions" if regions else "neighbours",
        "findings": as_json(
            recorded([warning("video-transfer-unknown", code=8, encoding="linear"), info("relative-luminance")])
        ),
        "versions": json.dumps({"labcdp": "0.1.0", "opencv": "4.10"}),
        "configuration": json.dumps({"contrasts": list(contrasts), "start": "0", "stop": None, "every": "1"}),
    }
    dataset = Dataset(data, coordinates, attributes)
    dataset["time_s"].attrs["units"] = "s"
    return dataset


def _add_regions(data: dict[str, Any], lost: Any, known: Any, frames: Any, reference: float) -> None:
    n_frames = len(frames)
    data["measured_contrast"] = ("frame", known(9.5 + 0.01 * frames))
    data["measured_contrast_standard_uncertainty"] = ("frame", known(np.full(n_frames, 0.1)))
    data["csnr"] = ("frame", known(np.full(n_frames, 21.0)))
    data["csnr_standard_uncertainty"] = ("frame", known(np.full(n_frames, 0.3)))
    data["reference_contrast"] = ("frame", np.full(n_frames, reference))
    for name, shift in (("reference_cdp", 0.0), ("reference_cdp_low", -0.02), ("reference_cdp_high", 0.02)):
        data[name] = ("frame", known(np.linspace(0.95, 0.85, n_frames) + shift) + 0 * reference)
    means = np.where(lost, np.nan, [400.0, 38.0])
    data |= {
        "mean": (_OF_REGION, means),
        "mean_standard_uncertainty": (_OF_REGION, 0.01 * means),
        "snr": (_OF_REGION, 0.1 * means),
        "snr_standard_uncertainty": (_OF_REGION, 0.001 * means),
        "quality": (_OF_REGION, np.where(lost, 0.1, 0.9)),
        "lost": (_OF_REGION, lost),
        "centre_x": (_OF_REGION, np.stack([50.0 + frames, 150.0 + frames], 1)),
        "centre_y": (_OF_REGION, np.full((n_frames, 2), 40.0)),
    }
    corners = np.array([-10.0, 10, 10, -10])
    for axis in "xy":
        centres = data[f"centre_{axis}"][1]
        data[f"corner_{axis}"] = ((*_OF_REGION, "corner"), centres[..., None] + corners)
