import numpy as np
import pytest

from labcdp.chain import Patch, PatchScene, luminance_map, with_patches
from labcdp.errors import InputError


def test_without_patches_the_scene_is_flat() -> None:
    scene = PatchScene(width=4, height=3, background_cd_m2=2.5).luminance_cd_m2()
    np.testing.assert_array_equal(scene, np.full((3, 4), 2.5))


def test_patch_covers_its_pixels_and_no_other() -> None:
    scene = PatchScene(5, 4, 1.0, (Patch(x=2, y=1, width=3, height=2, luminance_cd_m2=7.0),)).luminance_cd_m2()
    expected = [[1, 1, 1, 1, 1], [1, 1, 7, 7, 7], [1, 1, 7, 7, 7], [1, 1, 1, 1, 1]]
    np.testing.assert_array_equal(scene, expected)


def test_later_patch_covers_an_earlier_one() -> None:
    scene = with_patches(np.ones((1, 3)), [Patch(0, 0, 2, 1, 5.0), Patch(1, 0, 1, 1, 9.0)])
    np.testing.assert_array_equal(scene, [[5, 9, 1]])


def test_patches_lie_over_any_map_and_leave_it_unchanged() -> None:
    background = np.arange(6, dtype=np.float32).reshape(2, 3)
    scene = with_patches(background, [Patch(0, 0, 1, 1, 9.0)])
    np.testing.assert_array_equal(scene, [[9, 1, 2], [3, 4, 5]])
    assert background[0, 0] == 0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ([1.0, 2.0], r"non-empty 2-D map of luminance in cd/m\^2, got the shape \(2,\)"),
        (np.empty((0, 3)), r"got the shape \(0, 3\)"),
        ([[1.0, -2.0]], r"luminance from -2 to 1 cd/m\^2: give finite numbers of at least 0"),
        ([[1.0, np.nan]], r"luminance from nan to nan cd/m\^2"),
        ([[1.0, np.inf]], r"luminance from 1 to inf cd/m\^2"),
    ],
)
def test_what_is_no_scene_is_refused(values: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        luminance_map(values)  # type: ignore[arg-type]


def test_patch_outside_the_scene_is_refused() -> None:
    scene = PatchScene(10, 8, 1.0, (Patch(x=6, y=2, width=5, height=2, luminance_cd_m2=3.0),))
    with pytest.raises(InputError, match=r"a patch spans x 6 to 11, y 2 to 4, but the scene is 10 x 8 pixels"):
        scene.luminance_cd_m2()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"x": -1}, r"x is -1: give a number of at least 0 pixels"),
        ({"y": 1.5}, r"y is 1.5: give a whole number of pixels"),
        ({"width": 0}, r"width is 0: give a number of at least 1 pixels"),
        ({"luminance_cd_m2": -1.0}, r"luminance_cd_m2 is -1.0: give a number of at least 0 cd/m\^2"),
    ],
)
def test_patch_out_of_range_is_refused(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Patch(**({"x": 0, "y": 0, "width": 1, "height": 1, "luminance_cd_m2": 1.0} | change))  # type: ignore[arg-type]
