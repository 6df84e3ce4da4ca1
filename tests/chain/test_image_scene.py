import pickle
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

from labcdp.chain import ImageScene, Scene, chain_from_toml, replaced
from labcdp.errors import ConfigurationError, InputError

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


def test_has_the_members_of_a_scene_and_no_levels(tmp_path: Path) -> None:
    scene = ImageScene(saved(tmp_path / "a.npy"))
    assert isinstance(scene, Scene)
    assert scene.levels() == ()
    assert scene.regions() == {}
    assert scene.pairs() == ()


def test_regions_are_rectangles_and_pairs_neighbours_in_mean_luminance(tmp_path: Path) -> None:
    regions = {"high": (2, 2, 2, 1), "low": (0, 0, 2, 2), "low again": (0, 0, 2, 2)}
    scene = ImageScene(saved(tmp_path / "a.npy"), regions_xywh=regions)
    np.testing.assert_array_equal(scene.regions()["high"], IMAGE >= 10)
    assert scene.luminance_map()[scene.regions()["low"]].tolist() == [0, 1, 4, 5]
    assert scene.pairs() == (("low again", "high"),)


def test_map_cannot_be_changed(tmp_path: Path) -> None:
    scene = ImageScene(saved(tmp_path / "a.npy"))
    with pytest.raises(ValueError, match="read-only"):
        scene.luminance_map()[0, 0] = 1


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
    chain = chain_from_toml(CHAIN, "mine.toml", tmp_path)
    np.testing.assert_array_equal(chain.run()["scene"].values, IMAGE)
    brighter = replaced(chain, {"scene.cd_m2_per_value": 3.0})
    np.testing.assert_array_equal(brighter.run()["scene"].values, IMAGE * 3)
    assert brighter.scene.pairs() == (("left", "right"),)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "a.npy",
            "b.npy",
            r"scene\.path is '.*b\.npy', which cannot be read \(No such file or directory\)",
        ),
        ("a.npy", "a.png", r"scene\.path is '.*a\.png': give a \.npy, \.tif or \.tiff file of luminance$"),
        ('"images/a.npy"', "3", r"scene\.path is 3: give the name of a file in quotes$"),
        ('path = "images/a.npy"', "", r"scene\.path is missing: add it to the table \[scene\]$"),
        (
            "[0, 0, 1, 3]",
            "[0, 0, 1]",
            r"scene\.regions_xywh\.left is \[0, 0, 1\]: give a list of x, y, width and height",
        ),
        ("[0, 0, 1, 3]", '"0013"', r"scene\.regions_xywh\.left is '0013': give a list of x, y, width and height"),
        (
            "[0, 0, 1, 3]",
            "[0, 0, 1, 0.5]",
            r"scene\.regions_xywh\.left: height is 0\.5: give a whole number of",
        ),
        ("[0, 0, 1, 3]", "[-1, 0, 1, 3]", r"scene\.regions_xywh\.left: x is -1: give a number of at least 0 pixels$"),
        (
            "[0, 0, 1, 3]",
            "[0, 0, 1, 4]",
            r"scene\.regions_xywh\.left: a patch spans x 0 to 1, y 0 to 4, but the scene is 4 x 3 pixels",
        ),
        (
            "{ left = [0, 0, 1, 3], right = [3, 0, 1, 3] }",
            "[1]",
            r"scene\.regions_xywh is \[1\]: give a table of names",
        ),
    ],
)
def test_error_names_table_and_key(tmp_path: Path, old: str, new: str, message: str) -> None:
    (tmp_path / "images").mkdir()
    saved(tmp_path / "images" / "a.npy")
    with pytest.raises(ConfigurationError, match="^mine.toml: " + message):
        chain_from_toml(CHAIN.replace(old, new), "mine.toml", tmp_path)


def with_value(value: float) -> np.ndarray:
    image = IMAGE.astype(np.float64)
    image[1, 1] = value
    return image


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
@pytest.mark.parametrize(
    ("image", "message"),
    [
        (with_value(np.nan), r"a scene has luminance from nan to nan cd/m\^2: give numbers from 0 to 1e\+12"),
        (with_value(-2), r"a scene has luminance from -2 to 11 cd/m\^2"),
        (with_value(np.inf), r"a scene has luminance from 0 to inf cd/m\^2"),
        (with_value(1e300), r"a scene has luminance from 0 to inf cd/m\^2"),
    ],
)
def test_values_that_are_no_luminance_are_refused(tmp_path: Path, name: str, image: np.ndarray, message: str) -> None:
    scene = ImageScene(saved(tmp_path / name, image))
    with pytest.raises(InputError, match=rf"^path is '.*{name}': {message}"):
        scene.luminance_map()


def test_factor_that_makes_the_luminance_infinite_is_refused(tmp_path: Path) -> None:
    scene = ImageScene(saved(tmp_path / "a.npy", with_value(1e300)), cd_m2_per_value=1e300)
    with pytest.raises(InputError, match=r"a scene has luminance from 0 to inf cd/m\^2"):
        scene.luminance_map()


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
def test_colour_image_is_refused(tmp_path: Path, name: str) -> None:
    scene = ImageScene(saved(tmp_path / name, np.ones((5, 6, 3), np.uint8)))
    with pytest.raises(InputError, match=r"which holds uint8 of shape \(5, 6, 3\): give a 2-D grey image$"):
        scene.luminance_map()


@pytest.mark.parametrize("image", [np.ones((2, 2), bool), np.ones((2, 2), complex), np.ones(3), np.float64(1)])
def test_array_that_is_no_grey_image_is_refused(tmp_path: Path, image: Any) -> None:
    scene = ImageScene(saved(tmp_path / "a.npy", image))
    with pytest.raises(InputError, match=r"which holds \w+ of shape \([\d, ]*\): give a 2-D grey image$"):
        scene.luminance_map()


def test_empty_image_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"non-empty 2-D map of luminance in cd/m\^2, got the shape \(0, 3\)"):
        ImageScene(saved(tmp_path / "a.npy", np.empty((0, 3)))).luminance_map()


def test_pickled_objects_are_not_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.array([[{}]], dtype=object), allow_pickle=True)
    (tmp_path / "b.npy").write_bytes(pickle.dumps([1]))
    np.savez(tmp_path / "c.npz", IMAGE)
    (tmp_path / "c.npz").rename(tmp_path / "c.npy")
    for name in ("a.npy", "b.npy", "c.npy"):
        with pytest.raises(
            InputError, match=rf"^path is '.*{name}', which is no such image \(.*\): give a grey image$"
        ):
            ImageScene(tmp_path / name).luminance_map()


def test_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.npy").mkdir()
    with pytest.raises(InputError, match=r"which cannot be read \(Is a directory\): give a file$"):
        ImageScene(tmp_path / "a.npy").luminance_map()


@pytest.mark.parametrize("name", ["a.npy", "a.tif"])
@pytest.mark.filterwarnings("ignore:Reading `.npy` or `.npz` file required:UserWarning")
def test_damaged_file_is_refused_or_read_but_never_stops_the_program(tmp_path: Path, name: str) -> None:
    path = saved(tmp_path / name)
    whole = path.read_bytes()
    rng = random.Random(5)
    messages = []
    damaged = [whole[: rng.randrange(len(whole))] for _ in range(60)]
    for _ in range(120):
        content = bytearray(whole)
        for _ in range(rng.choice((1, 3))):
            content[rng.randrange(len(content))] = rng.randrange(256)
        damaged.append(bytes(content))
    for content in damaged:
        path.write_bytes(content)
        try:
            ImageScene(path).luminance_map()
        except InputError as error:
            messages.append(str(error))
    assert len(messages) >= 60
    assert all(message.startswith(f"path is {str(path)!r}") for message in messages)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"cd_m2_per_value": 0.0}, r"^cd_m2_per_value is 0.0: give a number above 0 cd/m\^2"),
        ({"cd_m2_per_value": np.nan}, r"^cd_m2_per_value is nan"),
        ({"regions_xywh": {"a": (0, 0, 0, 1)}}, r"^regions_xywh.a: width is 0: give a number of at least 1 pixels"),
        ({"regions_xywh": {"a": 3}}, r"^regions_xywh.a is 3: give a list of x, y, width and height in pixels"),
    ],
)
def test_value_out_of_range_is_refused_before_the_file_is_read(values: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ImageScene(Path("not there.npy"), **values)
