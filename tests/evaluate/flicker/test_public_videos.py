"""Flicker of public videos of a chart of pulsed lamps, beside the definitions on what another decoder gives."""

import os
from hashlib import sha256
from pathlib import Path

import av
import numpy as np
import pytest

import labcdp
from labcdp import Roi

#: Videos of github.com/CARpublic/P2020-flicker (MIT licence), by the name in its folder videos.
FOLDER = Path(os.environ.get("LABCDP_FLICKER_VIDEOS", "videos"))
VIDEOS = {
    "test_vid1.mp4": "65e8c9ed6d9d228cda9405c3c4fb18dd4a893792b979a355912d6491b1e145a0",
    "test_vid2.mp4": "acab65349b4f819b1dc44f8b4085e3f090d390a682e75ed2c80cd0c243c5193a",
    "test_vid3.mp4": "202ba7b3244f6f0c11fcf88cc1ed15029c1ce5d0035566c8a468b4927d24a6f3",
}
#: Lamps from the brightest to a dim one, the baseline without light, and the first frame that counts.
LAMPS = [Roi.rectangle(f"{x},{y}", x, y, 20, 2) for x, y in ((457, 247), (525, 246), (451, 376))]
OFF_FRAMES, START = (0, 25), 100


def means_of_luma(path):
    """Mean of Y' of the lamps in each frame, stretched from limited range, shape (frames, lamps)."""
    means = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            luma = frame.to_ndarray()[: frame.height].astype(float)
            full = np.clip((luma - 16) * 255 / 219, 0, 255)
            means.append([full[lamp.window(full.shape)].mean() for lamp in LAMPS])
    return np.array(means)


@pytest.mark.parametrize("name", VIDEOS)
def test_indices_are_those_of_the_definitions(name):
    path = FOLDER / name
    if not path.is_file():
        pytest.skip(f"{name} is not here: put it into the folder LABCDP_FLICKER_VIDEOS")
    assert sha256(path.read_bytes()).hexdigest() == VIDEOS[name], f"{path} is another file"
    light = means_of_luma(path)[START:]

    measured = labcdp.open_video(path, encoding="linear").flicker(LAMPS, "fixed", start=START, off_frames=OFF_FRAMES)
    # Light of grey, which the second and third are, is in parts of 256 and stretched to whole numbers.
    coloured = name == "test_vid1.mp4"
    values = measured["mean"].values[OFF_FRAMES[1] :] * (255 if coloured else 256)
    seen = np.isfinite(values)
    assert np.abs(values - light)[seen].max() < (0.03 if coloured else 0.5)
    assert (light[~seen] < 1).all()  # frames without light are left out, and said to be
    light = np.where(seen, light, np.nan)
    mean, high, low = np.nanmean(light, axis=0), np.nanmax(light, axis=0), np.nanmin(light, axis=0)
    assert measured["fmi"].values == pytest.approx((high - low) / (high + low), abs=1e-4 if coloured else 2e-3)
    near = (np.abs(light - mean) < 0.1 * mean).sum(axis=0) / seen.sum(axis=0)
    assert measured["mmp"].values == pytest.approx(near, abs=0.01)
