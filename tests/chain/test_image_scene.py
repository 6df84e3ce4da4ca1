from pathlib import Path

import numpy as np
import pytest
import tifffile

from labcdp.chain import Chain, ImageScene
from labcdp.core.errors import ConfigurationError, InputError

IMAGE = np.arange(12, dtype=np.float32).reshape(3, 4)


def saved(path: Path, image: np.ndarray = IMAGE) -> Path:
    if path.suffix == ".npy":
        np.save(path, image)
    else:
        tifffile.imwrite(path, image)
    return path


@pytest.mark.parametrize("name", ["a.npy", "a.tif", "a.TIFF"])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", ">u2", "int32", "float16", "float32", "float64"])
def test_values_times_the_factor_are_the_luminance(tmp_path: Path, name: str, dtype: str) -> None:
    scene = ImageScene(saved(tmp_path / name, IMAGE.astype(dtype)), cd_m2_per_value=2.5)
    np.testing.assert_array_equal(scene.luminance_map(), IMAGE * 2.5)
    assert scene.luminance_map().dtype == np.float32
    assert scene.shape == (3, 4)


def test_regions_are_rectangles_and_pairs_neighbours_in_mean_luminance(tmp_path: Path) -> None:
    regions = {"high": (2, 2, 2, 1), "low": (0, 0, 2, 2), "low again": (0, 0, 2, 2)}
    scene = ImageScene(saved(tmp_path / "a.npy"), regions_xywh=regions)
    np.testing.assert_array_equal(scene.regions()["high"], IMAGE >= 10)
    assert scene.luminance_map()[scene.regions()["low"]].tolist() == [0, 1, 4, 5]
    assert scene.pairs() == (("low again", "high"),)


CHAIN = """
[scene]
type = "image"
path = "images/a.npy"
regions_xywh = { left = [0, 0, 1, 3], right = [3, 0, 1, 3] }
"""


def test_path_in_a_chain_file_is_relative_to_its_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "images").mkdir()
    saved(tmp_path / "images" / "a.npy")
    monkeypatch.chdir("/")
    chain = Chain.from_toml(CHAIN, "mine.toml", tmp_path)
    np.testing.assert_array_equal(chain.run()["scene"].values, IMAGE)
    brighter = chain.with_(**{"scene.cd_m2_per_value": 3.0})
    np.testing.assert_array_equal(brighter.run()["scene"].values, IMAGE * 3)
    assert brighter.scene.pairs() == (("left", "right"),)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "a.npy",
            "b.npy",
            r"scene\.path is '.*b\.npy': cannot be read \(No such file or directory\)",
        ),
        ("a.npy", "a.png", r"scene\.path is '.*a\.png': give a \.npy, \.tif or \.tiff file of luminance$"),
        ('"images/a.npy"', "3", r"scene\.path is 3: give the name of a file in quotes$"),
        ('path = "images/a.npy"', "", r"scene\.path is missing: add it to the table \[scene\]$"),
        ("[0, 0, 1, 3]", '"0013"', r"scene\.regions_xywh\.left is '0013': give a list of x, y, width and height"),
        ("[0, 0, 1, 3]", "[-1, 0, 1, 3]", r"scene\.regions_xywh\.left: x is -1: give a number of at least 0 pixels$"),
        (
            "[0, 0, 1, 3]",
            "[0, 0, 1, 4]",
            r"scene\.regions_xywh\.left: a patch spans x 0 to 1, y 0 to 4, but the scene is 4 x 3 pixels",
        ),
        ("{ left = [0, 0, 1, 3], right = [3, 0, 1, 3] }", "[1]", r"scene\.regions_xywh is \[1\]"),
    ],
)
def test_error_names_table_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "images").mkdir()
    saved(tmp_path / "images" / "a.npy")
    with pytest.raises(ConfigurationError, match="^mine.toml: " + message):
        Chain.from_toml(CHAIN.replace(old, new), "mine.toml", tmp_path)


def with_value(value: float) -> np.ndarray:
    image = IMAGE.astype(np.float64)
    image[1, 1] = value
    return image


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
@pytest.mark.parametrize(
    ("image", "message"),
    [
        (with_value(np.nan), r"a scene has luminance from nan to nan cd/m\^2: give numbers from 0 to 1e\+12"),
        (np.ones((5, 6, 3), np.uint8), r"which holds uint8 of shape \(5, 6, 3\): give a 2-D grey image$"),
        (with_value(1e300), r"a scene has luminance from 0 to inf cd/m\^2"),
    ],
)
def test_values_that_are_no_luminance_are_refused(tmp_path: Path, name: str, image: np.ndarray, message: str) -> None:
    scene = ImageScene(saved(tmp_path / name, image))
    with pytest.raises(InputError, match=rf"^path is '.*{name}'.*{message}"):
        scene.luminance_map()


def test_pickled_objects_are_not_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    with pytest.raises(InputError, match=r"^path is '.*a.npy': it holds 'object'"):
        ImageScene(tmp_path / "a.npy").luminance_map()
