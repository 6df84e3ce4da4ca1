"""Region files in JSON, and what all kinds of files have in common."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.regions import EllipseShape, GridShape, PolygonShape, RectangleShape, load_regions, save_regions
from labcdp.regions.region_json import parse_regions, regions_json

SHAPES = (
    PolygonShape("bright", ((10, 10), (40, 12.5), (38, 33))),
    RectangleShape("dark", 50, 10, 20, 30),
    RectangleShape("turned", 50, 50, 20, 10, 12.5),
    EllipseShape("Öllampe", 10, 50, 20, 10, -30),
    GridShape("g", 1, 70, 40, 20, 2, 3, 1.5),
)

POLYGON = {"name": "a", "kind": "polygon", "corners": [[0, 0], [9, 0], [9, 9]]}
GRID = {"name": "g", "kind": "grid", "x": 1, "y": 2, "width": 9, "height": 9, "rows": 2, "columns": 2}
BOX = {"name": "a", "kind": "rectangle", "x": 1, "y": 2, "width": 3, "height": 4}


def written(tmp_path, text):
    path = tmp_path / "rois.json"
    path.write_text(text, encoding="utf-8")
    return path


def document(*regions, **keys):
    return json.dumps({"format": "labcdp regions", "version": 1, "regions": list(regions), **keys})


def test_the_file_is_as_described(tmp_path):
    save_regions(tmp_path / "rois.json", SHAPES[:2], image_size=(100, 95))
    assert json.loads((tmp_path / "rois.json").read_text(encoding="utf-8")) == {
        "format": "labcdp regions",
        "version": 1,
        "image": {"width": 100, "height": 95},
        "regions": [
            {"name": "bright", "kind": "polygon", "corners": [[10, 10], [40, 12.5], [38, 33]]},
            {"name": "dark", "kind": "rectangle", "x": 50, "y": 10, "width": 20, "height": 30},
        ],
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"rois\.json is empty: give a file with regions"),
        ("{", r"not valid JSON: Expecting property name enclosed in double quotes in line 1, column 2"),
        ("{}", r"format is missing: give it"),
        (document(version=2), r"version is 2, this labcdp reads 1: use a newer labcdp"),
        (document(), r"there is no region: give at least one"),
        (document(image={"width": 0, "height": 5}), r"image: width is 0: give a whole number of pixels of at least 1"),
        (document(image={"width": 5}), r"image: height is missing"),
        (document({"name": "a"}), r"region 'a': kind is missing: give one of polygon, composite, rectangle"),
        (document({**POLYGON, "kind": "blob"}), r"region 'a': kind is 'blob': give one of polygon"),
        (document(POLYGON, {"kind": "polygon", "corners": []}), r"regions\[1\]: name is missing"),
        (document({**POLYGON, "name": 7}), r"the name of a region is 7: give 1 to 100 printable characters"),
        (document({**BOX, "angle_deg": "5"}), r"region 'a': angle_deg is '5': give a finite number"),
        (document({**BOX, "height": -4}), r"region 'a': height is -4: give a number of pixels above 0"),
        (document({**BOX, "x": 10**400}), r"a number has 401 digits: give at most 40"),
        (document({**POLYGON, "corners": [[0, 0], [9, 0]]}), r"corners is \[\[0, 0\], \[9, 0\]\]: give a list of 3"),
        (document({**POLYGON, "corners": [[0, 0], [9, 9], [9, 0], [0, 9]]}), r"'a' crosses itself at x 4.5, y 4.5"),
        (document({**POLYGON, "corners": [[0, 0], [9, 9], [3, 3]]}), r"region 'a' has no area"),
        (document(POLYGON, BOX), r"2 regions have the name 'a': give each its own"),
        (document(BOX).replace("3", "NaN"), r"NaN stands where a number should: give a finite number"),
        (document(BOX).replace('"x"', '"width"'), r"the key 'width' is given twice in one table: leave one out"),
        (document({**GRID, "rows": 1e9}), r"region 'g': rows is 1000000000.0: give a whole number"),
        ("[" * 100_000, r"its lists and tables are nested more than 64 levels deep"),
    ],
)  # fmt: skip
def test_a_file_that_cannot_be_used_is_refused_with_key_and_region(tmp_path, text, message):
    path = written(tmp_path, text)
    with pytest.raises(InputError, match=message) as caught:
        load_regions(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_regions_of_an_image_of_another_size_are_refused(tmp_path):
    save_regions(tmp_path / "a.json", SHAPES, image_size=(100, 95))
    with pytest.raises(InputError, match=r"belong to an image of 100 x 95 pixels, this one has 200 x 190: draw them"):
        load_regions(tmp_path / "a.json", image_size=(200, 190))


def test_a_region_outside_the_image_is_named(tmp_path):
    save_regions(tmp_path / "a.json", SHAPES)
    with pytest.raises(
        InputError, match=r"region 'dark' spans x 50 to 70, y 10 to 40, but the image is 60 x 95 pixels"
    ):
        load_regions(tmp_path / "a.json", image_size=(60, 95))


names = st.text(min_size=1, max_size=12).filter(lambda name: name == name.strip() and name.isprintable())
numbers = st.floats(-1e6, 1e6)
sizes = st.floats(1e-3, 1e6)
shapes = st.one_of(
    st.builds(PolygonShape, names, st.lists(st.tuples(numbers, numbers), min_size=3, max_size=8).map(tuple)),
    st.builds(RectangleShape, names, numbers, numbers, sizes, sizes, st.floats(-360, 360)),
    st.builds(EllipseShape, names, numbers, numbers, sizes, sizes, st.floats(-360, 360)),
    st.builds(GridShape, names, numbers, numbers, sizes, sizes, st.integers(1, 9), st.integers(1, 9)),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(shapes, max_size=5), st.none() | st.tuples(st.integers(1, 10**5), st.integers(1, 10**5)))
def test_any_shapes_come_back_from_their_text(shapes, size):
    assert parse_regions(regions_json(shapes, size)) == (tuple(shapes), size)


values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=10,
)
keys = ("name", "kind", "corners", "x", "y", "width", "height", "rows", "columns", "gap", "angle_deg")


@settings(max_examples=200, deadline=None)
@given(
    st.dictionaries(st.sampled_from(keys), values)
    | st.sampled_from([POLYGON, BOX]).flatmap(
        lambda table: st.sampled_from(sorted(table)).flatmap(
            lambda key: values.map(lambda value: {**table, key: value})
        )
    )
)
def test_any_table_is_a_region_or_refused_in_one_line(table):
    text = document(table)
    try:
        parse_regions(text)
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - any region that is accepted is fine too


def test_a_file_of_another_kind_is_refused(tmp_path):
    (tmp_path / "a.json").write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(InputError, match=r"it is neither JSON nor an ImageJ file of regions"):
        load_regions(tmp_path / "a.json")
