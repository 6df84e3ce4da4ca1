"""Splitting Bayer frames: exact pixels for all patterns and sizes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.calibration import CameraState, observe_patches
from labcdp.calibration.frames.measure import plane_region, split
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import PLANES
from labcdp.core.roi import Roi

#: Colours of the upper left 2 x 2 pixels, rows after one another.
GROUPS = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}


def planes_by_hand(dn, pattern):
    """Pixel by pixel: a green pixel is named after the colour it shares its row with."""
    height, width = dn.shape[0] // 2, dn.shape[1] // 2
    result = {plane: np.zeros((height, width), dtype=dn.dtype) for plane in PLANES}
    group = GROUPS[pattern]
    for y in range(2 * height):
        for x in range(2 * width):
            colour, neighbour = group[2 * (y % 2) + x % 2], group[2 * (y % 2) + (x + 1) % 2]
            name = colour if colour != "G" else f"G{neighbour.lower()}"
            result[name][y // 2, x // 2] = dn[y, x]
    return result


@given(
    dn=arrays(np.uint16, st.tuples(st.integers(2, 9), st.integers(2, 9)), elements=st.integers(0, 4095)),
    pattern=st.sampled_from(sorted(GROUPS)),
)
def test_planes_hold_the_pixels_of_their_colour(new_frame, dn, pattern):
    frame = replace(new_frame(np.zeros((2, 2))), dn=dn, colour_filter=pattern)
    for plane, expected in planes_by_hand(dn, pattern).items():
        found = split(frame)[plane]
        assert np.array_equal(found.dn, expected)
        assert (found.plane, found.colour_filter, found.exposure_s) == (plane, None, frame.exposure_s)


def test_planes_have_their_own_black_levels(new_frame):
    frame = replace(
        new_frame(np.zeros((4, 4))), colour_filter="GB", black_level_dn=65.5, plane_black_levels_dn=(64, 65, 66, 67)
    )
    assert [split(frame)[plane].black_level_dn for plane in PLANES] == [64, 65, 66, 67]


@pytest.mark.parametrize("name", [None, "R"])
def test_frames_without_planes_are_refused(new_frame, name):
    frame = replace(new_frame(np.zeros((4, 4))), plane=name)
    with pytest.raises(CalibrationError, match=r"it has no colour planes: use it as it is"):
        split(frame)


def test_a_region_of_a_plane_shows_the_same_light(new_frame):
    # Red pixels of the patch have 1000 DN, all others differ.
    dn = np.full((40, 60), 300.0)
    dn[10:30, 20:50] = 700
    dn[10:30:2, 20:50:2] = 1000
    frame = replace(new_frame(dn), colour_filter="RG")
    region = plane_region(Roi.rectangle("patch", 20, 10, 30, 20))
    reds = [split(frame)["R"], split(replace(frame, frame_id=1))["R"]]
    (observed,) = observe_patches(reds, [region])
    assert (observed.signal_dn, observed.n_pixels) == (1000, 150)
    assert observed.state == CameraState.of(reds[0])
    assert observed.state.plane == "R"
