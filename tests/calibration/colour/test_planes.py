"""Splitting Bayer frames: exact pixels for all patterns and sizes."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.calibration import observe_patches
from labcdp.calibration.frames.measure import plane_region, split
from labcdp.core.frame import PLANES
from labcdp.core.roi import Roi

from ..conftest import make_frame

#: Colours of the upper left 2 x 2 pixels, rows after one another.
GROUPS = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}


@given(
    dn=arrays(np.uint16, st.tuples(st.integers(2, 9), st.integers(2, 9)), elements=st.integers(0, 4095)),
    pattern=st.sampled_from(sorted(GROUPS)),
)
def test_planes_hold_the_pixels_of_their_colour(dn, pattern):
    """Pixel by pixel: a green pixel is named after the colour it shares its row with."""
    frame = make_frame(np.zeros((2, 2)), dn=dn, colour_filter=pattern, plane_black_levels_dn=(64, 65, 66, 67))
    planes, group = split(frame), GROUPS[pattern]
    for y in range(2 * (dn.shape[0] // 2)):
        for x in range(2 * (dn.shape[1] // 2)):
            colour, neighbour = group[2 * (y % 2) + x % 2], group[2 * (y % 2) + (x + 1) % 2]
            assert planes[colour if colour != "G" else f"G{neighbour.lower()}"].dn[y // 2, x // 2] == dn[y, x]
    for name, black_level_dn in zip(PLANES, (64, 65, 66, 67), strict=True):
        one = planes[name]
        assert one.dn.shape == (dn.shape[0] // 2, dn.shape[1] // 2)
        expected = (name, None, frame.exposure_s, black_level_dn)
        assert (one.plane, one.colour_filter, one.exposure_s, one.black_level_dn) == expected


def test_a_region_of_a_plane_shows_the_same_light():
    # Red pixels of the patch have 1000 DN, all others differ.
    dn = np.full((40, 60), 300.0)
    dn[10:30, 20:50] = 700
    dn[10:30:2, 20:50:2] = 1000
    frame = replace(make_frame(dn), colour_filter="RG")
    region = plane_region(Roi.rectangle("patch", 20, 10, 30, 20))
    reds = [split(frame)["R"], split(replace(frame, frame_id=1))["R"]]
    (observed,) = observe_patches(reds, [region])
    assert (observed.mean_dn, observed.n_pixels) == (1000, 150)
