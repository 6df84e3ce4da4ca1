"""Scenes: drawn ones whose map, regions, levels and pairs agree, and images from files."""

import re

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import Checkerboard, Flat, ImageScene, Patch, PatchScene, StepChart, luminance_map, with_patches
from labcdp.core.errors import InputError

sides = st.integers(1, 23)
luminances = st.floats(0, 1e6)


@st.composite
def patches_inside(draw, width, height):
    x, y = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
    return Patch(x, y, draw(st.integers(1, width - x)), draw(st.integers(1, height - y)), draw(luminances))


@st.composite
def scenes(draw):
    """Any scene of any size, sizes that are no multiple of the squares or stripes among them."""
    kind = draw(st.sampled_from(["flat", "checkerboard", "step chart", "patches"]))
    width, height = draw(sides), draw(sides)
    if kind == "flat":
        return Flat(width, height, draw(luminances))
    if kind == "step chart":
        return StepChart(width, height, tuple(draw(st.lists(luminances, min_size=1, max_size=width))))
    if kind == "patches":
        patches = draw(st.lists(patches_inside(width, height), max_size=4))
        return PatchScene(width, height, draw(luminances), tuple(patches))
    width, square = max(width, 2), draw(st.integers(1, max(width, height, 2) - 1))
    return Checkerboard(width, height, draw(luminances), draw(st.floats(1e-3, 99)), square)


@given(scene=scenes())
def test_map_regions_levels_and_pairs_agree(scene):
    image, regions = scene.luminance_map(), scene.regions()
    assert image.dtype == np.float32
    assert {image.shape} | {mask.shape for mask in regions.values()} == {scene.shape}
    assert (sum(mask.astype(int) for mask in regions.values()) == 1).all()
    levels = {level.name: level for level in scene.levels()}
    assert list(levels) == list(regions)
    for name, level in levels.items():
        np.testing.assert_array_equal(image[regions[name]], np.float32(level.luminance_cd_m2))
        assert level.share == pytest.approx(regions[name].mean(), rel=1e-12)
    assert all(levels[dark].luminance_cd_m2 < levels[bright].luminance_cd_m2 for dark, bright in scene.pairs())


def test_drawn_maps_are_those_described():
    board = Checkerboard(width=5, height=3, luminance_cd_m2=10.0, contrast=0.5, square_px=2)
    expected = [[10, 10, 15, 15, 10], [10, 10, 15, 15, 10], [15, 15, 10, 10, 15]]
    np.testing.assert_array_equal(board.luminance_map(), expected)
    assert board.pairs() == (("dark", "bright"),)
    chart = StepChart(width=8, height=2, luminances_cd_m2=(1.0, 4.0, 2.0))
    np.testing.assert_array_equal(chart.luminance_map(), [[1, 1, 1, 4, 4, 4, 2, 2]] * 2)
    # Neighbours in place that differ.
    assert StepChart(8, 1, (1.0, 4.0, 4.0, 2.0)).pairs() == (("step 1", "step 2"), ("step 4", "step 3"))
    background = np.arange(6, dtype=np.float32).reshape(2, 3)
    np.testing.assert_array_equal(with_patches(background, [Patch(0, 0, 1, 1, 9.0)]), [[9, 1, 2], [3, 4, 5]])


def test_pairs_of_patches_are_with_the_background_if_there_is_but_one_and_never_hidden():
    assert PatchScene(4, 4, 5.0, (Patch(0, 0, 1, 1, 2.0),)).pairs() == (("patch 1", "background"),)
    several = tuple(Patch(x, 0, 1, 1, luminance) for x, luminance in enumerate([30.0, 10.0, 20.0, 20.0]))
    assert PatchScene(6, 2, 1.0, several).pairs() == (("patch 2", "patch 3"), ("patch 4", "patch 1"))
    hidden = PatchScene(3, 3, 1.0, (Patch(1, 1, 1, 1, 7.0), Patch(1, 1, 2, 2, 9.0)))
    assert hidden.pairs() == (("background", "patch 2"),)


@pytest.mark.parametrize(
    "values", [[1.0, 2.0], np.empty((0, 3)), [[1.0, -2.0]], [[1.0, np.nan]], [[1.0, 1e39]], [[1.0, 2e12]]]
)
def test_what_is_not_a_scene_is_refused(values):
    with pytest.raises(InputError, match=r"non-empty 2-D map of luminance|give numbers from 0 to"):
        luminance_map(values)


IMAGE = np.arange(12, dtype=np.float32).reshape(3, 4)


def saved(path, image=IMAGE):
    if path.suffix == ".npy":
        np.save(path, image)
    else:
        tifffile.imwrite(path, image)
    return path


@pytest.mark.parametrize("dtype", ["uint8", ">u2", "int32", "float16", "float64"])
def test_values_of_an_image_times_the_factor_are_the_luminance(tmp_path, dtype):
    for name in ("a.npy", "a.TIFF"):
        scene = ImageScene(saved(tmp_path / name, IMAGE.astype(dtype)), cd_m2_per_value=2.5)
        np.testing.assert_array_equal(scene.luminance_map(), IMAGE * 2.5)


def test_regions_of_an_image_are_rectangles_and_pairs_neighbours_in_mean_luminance(tmp_path):
    regions = {"high": (2, 2, 2, 1), "low": (0, 0, 2, 2), "low again": (0, 0, 2, 2)}
    scene = ImageScene(saved(tmp_path / "a.npy"), regions_xywh=regions)
    np.testing.assert_array_equal(scene.regions()["high"], IMAGE >= 10)
    assert scene.luminance_map()[scene.regions()["low"]].tolist() == [0, 1, 4, 5]
    assert scene.pairs() == (("low again", "high"),)


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
@pytest.mark.parametrize("image", [np.ones((5, 6, 3), np.uint8), np.full((2, 2), 1e300)])
def test_values_that_are_no_luminance_are_refused(tmp_path, name, image):
    with pytest.raises(InputError, match=rf"^path is '.*{name}'.*(2-D grey image|luminance from inf)"):
        ImageScene(saved(tmp_path / name, image)).luminance_map()


def test_regions_have_the_names_that_are_given_and_the_pairs_that_are_chosen():
    patches = (Patch(0, 0, 1, 1, 2.0, "P1"), Patch(1, 0, 1, 1, 8.0), Patch(2, 0, 1, 1, 4.0, "P 3"))
    scene = PatchScene(6, 2, 1.0, patches, [["patch 2", "P1"], ("P 3", "patch 2"), ("P 3", "background")])
    assert [level.name for level in scene.levels()] == ["background", "P1", "patch 2", "P 3"]
    # Whichever is named first, the darker one comes first.
    assert scene.pairs() == (("P1", "patch 2"), ("P 3", "patch 2"), ("background", "P 3"))
    chart = StepChart(8, 1, (1.0, 4.0, 2.0), ("a", "b", "c"), [("a", "c")])
    assert (list(chart.regions()), chart.pairs()) == (["a", "b", "c"], (("a", "c"),))


@pytest.mark.parametrize(
    ("names", "contrasts", "word"),
    [
        (("a", "a"), (), "'a' names two"),
        (("a", 3), (), "3"),
        (("a",), (), "names is"),
        (("a", "b"), "ab", "contrasts is"),
        (("a", "b"), (("a", "c"),), "'c': choose from a, b"),
        (("a", "b"), (("a", "a"),), "two different names"),
    ],
)
def test_names_and_contrasts_that_cannot_be_are_refused(names, contrasts, word):
    with pytest.raises(InputError, match=re.escape(word)):
        StepChart(8, 1, (1.0, 4.0), names, contrasts)
    if len(names) == 2:
        patches = tuple(Patch(n, 0, 1, 1, 2.0 + n, name) for n, name in enumerate(names))
        with pytest.raises(InputError, match=re.escape(word.replace("from a", "from background, a"))):
            PatchScene(6, 2, 1.0, patches, contrasts)
