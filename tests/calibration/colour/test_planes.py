"""Splitting Bayer frames: exact pixels for all patterns and sizes."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.calibration import observe_patches
from labcdp.calibration.frames.measure import plane_region, split
from labcdp.core.frame import PLANES, BlackPattern, Frame
from labcdp.core.roi import Roi

from ..conftest import make_frame

#: Colours of the upper left 2 x 2 pixels, rows after one another.
GROUPS = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}


@given(
    dn=arrays(np.uint16, st.tuples(st.integers(2, 9), st.integers(2, 9)), elements=st.integers(0, 4095)),
    pattern=st.sampled_from(sorted(GROUPS)),
    levels=arrays(np.float64, st.tuples(st.integers(1, 5), st.integers(1, 5)), elements=st.integers(0, 99)),
    lines=st.booleans(),
)
def test_planes_hold_the_pixels_of_their_colour(dn, pattern, levels, lines):
    """Pixel by pixel, with their black level: a green pixel is named after the colour it shares its row with."""
    of_lines = [np.random.default_rng(size).normal(0, 9, size) if lines else None for size in dn.shape[::-1]]
    black_dn, black_pattern = BlackPattern.split(levels, *of_lines)
    black = {"black_level_dn": black_dn, "black_pattern": black_pattern}
    frame = make_frame(np.zeros((2, 2)), dn=dn, colour_filter=pattern, **black)
    frame = Frame.from_metadata(frame.dn, json.loads(json.dumps(frame.metadata())))
    expected_dn = np.tile(levels, (9, 9))[: dn.shape[0], : dn.shape[1]]
    if lines:
        expected_dn = expected_dn + of_lines[0] + of_lines[1][:, None]
    planes, group = split(frame), GROUPS[pattern]
    for y in range(2 * (dn.shape[0] // 2)):
        for x in range(2 * (dn.shape[1] // 2)):
            colour, neighbour = group[2 * (y % 2) + x % 2], group[2 * (y % 2) + (x + 1) % 2]
            plane = planes[colour if colour != "G" else f"G{neighbour.lower()}"]
            assert plane.dn[y // 2, x // 2] == dn[y, x]
            offsets = None if plane.black_pattern is None else plane.black_pattern.offsets_dn(plane.shape)
            pixel_dn = plane.black_level_dn + (0 if offsets is None else offsets[y // 2, x // 2])
            assert pixel_dn == pytest.approx(expected_dn[y, x], abs=1e-3)
    for name in PLANES:
        one = planes[name]
        assert one.dn.shape == (dn.shape[0] // 2, dn.shape[1] // 2)
        assert (one.plane, one.colour_filter, one.exposure_s) == (name, None, frame.exposure_s)


@pytest.mark.parametrize("pattern", sorted(GROUPS))
def test_black_levels_of_planes_in_older_files_are_those_of_the_planes(pattern):
    metadata = make_frame(np.zeros((4, 4)), colour_filter=pattern, black_level_dn=65.5).metadata()
    frame = Frame.from_metadata(np.zeros((4, 4), np.uint16), metadata | {"plane_black_levels_dn": [64, 65, 66, 67]})
    assert [one.black_level_dn for one in split(frame).values()] == [64, 65, 66, 67]


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
