"""Step charts in pictures of known ones."""

import numpy as np
import pytest

from labcdp.chain import Checkerboard
from labcdp.core.errors import InputError
from labcdp.regions import detect_checkerboard, detect_step_chart, rois_of
from labcdp.session import Session, example_session

from .scenes import on_target, picture, seen_from, steps

RNG = np.random.default_rng(7)
SHUFFLED = np.random.default_rng(1).permutation(200 * 1.3 ** -np.arange(12.0)).reshape(3, 4)
FINE = 200 * 1.1 ** -np.arange(7.0)[None]
#: Its third patch is as light as what is around, and is found by its place.
HIDDEN = 200 * 1.35 ** -np.arange(8.0).reshape(2, 4)
CHARTS = {
    "turned": (SHUFFLED, 260, 0.25, {"turn_deg": 25}, {}),
    "in perspective": (SHUFFLED, 260, 0.25, {"perspective": 0.3, "turn_deg": -5}, {}),
    "in perspective, without gaps": (SHUFFLED, 260, 0.0, {"perspective": 0.3, "turn_deg": -5}, {}),
    "steps of 10 % in noise of 5 %, without gaps": (FINE, 250, 0.0, {}, {"noise": 6}),
    "one like its surroundings": (HIDDEN, HIDDEN[0, 2], 0.25, {}, {"noise": 0.5}),
}


@pytest.mark.parametrize("name", CHARTS)
def test_patches_are_found_in_order_each_within_its_own(name):
    levels, around, gap, view, light = CHARTS[name]
    rng, (rows, columns) = np.random.default_rng(2), levels.shape
    side_px = 48 if levels is FINE and not gap else 40
    matrix = seen_from(rng, rows * (1 + gap) - gap, columns * (1 + gap) - gap, side_px, **view)
    shapes = detect_step_chart(picture(matrix, steps(levels, around, gap), rng, **light))
    digits = len(str(levels.size))
    assert [shape.name for shape in shapes] == [f"step{number + 1:0{digits}d}" for number in range(levels.size)]
    for shape, (row, column) in zip(shapes, np.ndindex(rows, columns), strict=True):
        u, v = on_target(matrix, *np.array(shape.corners).T)
        u, v = u - column * (1 + gap), v - row * (1 + gap)
        assert 0 <= min(u.min(), v.min()) < max(u.max(), v.max()) <= 1
        # At least a third of the patch.
        assert abs(u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2 > 0.3


def test_the_recorded_target_is_found_in_each_exposure():
    with Session.open(example_session()) as session:
        patches = [patch.region() for patch in session.configuration.target.patches]
        by_place = sorted(patches, key=lambda roi: (roi.bounds[1], roi.bounds[0]))
        for record in session.frames("light")[::2]:
            found = rois_of(detect_step_chart(session.load(record).dn))
            for roi, patch in zip(found, by_place, strict=True):
                # The simulated target draws each patch 15 % larger on each side than its region.
                assert roi.bounds == pytest.approx(patch.bounds, abs=9)


STRIPES = picture(seen_from(RNG, 6, 8, 30, turn_deg=3), lambda u, v: np.where(np.floor(u) % 2 == 0, 200.0, 50.0), RNG)
NEITHER = {
    "flat": np.zeros((300, 400)),
    "noise": np.random.default_rng(6).normal(100, 20, (300, 400)),
    "ramp": np.tile(np.linspace(10, 200, 400), (300, 1)),
    "squares of a pixel": Checkerboard(400, 300, 20.0, 1.0, 1).luminance_map(),
}


@pytest.mark.parametrize(
    ("detect", "image"),
    [
        *((detect, image) for detect in (detect_checkerboard, detect_step_chart) for image in NEITHER.values()),
        (detect_checkerboard, STRIPES),
        (detect_step_chart, Checkerboard(400, 300, 20.0, 1.0, 50).luminance_map()),
    ],
)
def test_nothing_is_found_in_images_without_a_board_or_chart(detect, image):
    with pytest.raises(InputError, match=r"was found in the image of 400 x 300 pixels"):
        detect(image)
