"""Step charts in pictures of known ones."""

import numpy as np
import pytest

from labcdp.chain import Checkerboard, StepChart
from labcdp.core.errors import InputError
from labcdp.regions import detect_step_chart, rois_of
from labcdp.session import Session, example_session

from .scenes import on_target, picture, seen_from, steps


def check_patches(shapes, rows, columns, matrix, gap=0.25):
    """All patches, in order, each within its own and covering a third of it at least."""
    assert [shape.name for shape in shapes] == [
        f"step{number:0{len(str(rows * columns))}d}" for number in range(1, rows * columns + 1)
    ]
    for shape, (row, column) in zip(shapes, np.ndindex(rows, columns), strict=True):
        u, v = on_target(matrix, *np.array(shape.corners).T)
        u, v = u - column * (1 + gap), v - row * (1 + gap)
        assert u.min() >= 0
        assert u.max() <= 1
        assert v.min() >= 0
        assert v.max() <= 1
        assert abs(u @ np.roll(v, -1) - v @ np.roll(u, -1)) / 2 > 0.3


def chart(rng, levels, around, *, side_px=40, gap=0.25, view=None, **light):
    rows, columns = np.shape(levels)
    size = rows * (1 + gap) - gap, columns * (1 + gap) - gap
    matrix = seen_from(rng, *size, side_px, **(view or {}))
    return matrix, picture(matrix, steps(levels, around, gap), rng, **light)


VIEWS = {"upright": {}, "turned": {"turn_deg": 25}, "in perspective": {"perspective": 0.3, "turn_deg": -5}}


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("gap", [0.0, 0.25])
def test_patches_of_a_grid_are_found_in_order(view, gap):
    rng = np.random.default_rng(1)
    levels = rng.permutation(200 * 1.3 ** -np.arange(12.0)).reshape(3, 4)
    matrix, image = chart(rng, levels, 260, gap=gap, view=VIEWS[view])
    check_patches(detect_step_chart(image), 3, 4, matrix, gap)


@pytest.mark.parametrize("gap", [0.0, 0.25])
def test_steps_of_10_percent_in_noise_of_5_percent(gap):
    rng = np.random.default_rng(2)
    levels = 200 * 1.1 ** -np.arange(7.0)[None]
    matrix, image = chart(rng, levels, 250, side_px=48 if gap == 0 else 40, gap=gap, noise=6)
    check_patches(detect_step_chart(image), 1, 7, matrix, gap)


def test_a_patch_as_light_as_its_surroundings_is_found_by_its_place():
    rng = np.random.default_rng(4)
    levels = 200 * 1.35 ** -np.arange(8.0).reshape(2, 4)
    matrix, image = chart(rng, levels, levels[0, 2], noise=0.5)
    check_patches(detect_step_chart(image), 2, 4, matrix)


def test_the_recorded_target_is_found_in_each_exposure():
    with Session.open(example_session()) as session:
        patches = [patch.region() for patch in session.configuration.target.patches]
        by_place = sorted(patches, key=lambda roi: (roi.bounds[1], roi.bounds[0]))
        for record in session.frames("light")[::2]:
            found = rois_of(detect_step_chart(session.load(record).dn))
            assert len(found) == len(by_place)
            for roi, patch in zip(found, by_place, strict=True):
                # The simulated target draws each patch 15 % larger on each side than its region.
                assert roi.bounds == pytest.approx(patch.bounds, abs=9)


def test_a_chart_that_fills_the_image():
    scene = StepChart(400, 120, (10.0, 20.0, 40.0, 80.0, 160.0))
    rois = rois_of(detect_step_chart(scene.luminance_map()))
    for roi, mask in zip(rois, scene.regions().values(), strict=True):
        assert mask[roi.window((120, 400))][roi.mask((120, 400))].all()


def scattered(rng):
    image = np.full((300, 400), 20.0)
    for level in range(12):
        x, y = rng.integers(0, 350), rng.integers(0, 250)
        image[y : y + rng.integers(20, 60), x : x + rng.integers(20, 60)] = 40 + 15 * level
    return image


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((300, 400)),
        np.random.default_rng(6).normal(100, 20, (300, 400)),
        np.tile(np.linspace(10, 200, 400), (300, 1)),
        Checkerboard(400, 300, 20.0, 1.0, 50).luminance_map(),
        scattered(np.random.default_rng(7)),
        scattered(np.random.default_rng(8)),
    ],
    ids=["flat", "noise", "ramp", "checkerboard", "scattered", "scattered otherwise"],
)
def test_an_image_without_a_chart(image):
    with pytest.raises(InputError, match=r"no step chart was found in the image of 400 x 300 pixels: show at least 3"):
        detect_step_chart(image)
