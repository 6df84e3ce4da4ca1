"""Region files in JSON, and what all kinds of files have in common."""

import json
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.regions import EllipseShape, GridShape, PolygonShape, RectangleShape, load_regions, rois_of, save_regions
from labcdp.regions.region_file import parse_regions, regions_json

POLYGON = {"name": "a", "kind": "polygon", "corners": [[10, 10], [40, 12.5], [38, 33]]}
GRID = {"name": "g", "kind": "grid", "x": 1, "y": 2, "width": 9, "height": 9, "rows": 2, "columns": 2}
BOX = {"name": "b", "kind": "rectangle", "x": 50, "y": 10, "width": 20, "height": 30}


def document(*regions, **keys):
    return {"format": "labcdp regions", "version": 1, "regions": list(regions), **keys}


def test_the_file_is_as_described(tmp_path):
    shapes = PolygonShape("a", ((10, 10), (40, 12.5), (38, 33))), RectangleShape("b", 50, 10, 20, 30)
    save_regions(tmp_path / "rois.json", shapes, image_size=(100, 95))
    written = json.loads((tmp_path / "rois.json").read_text(encoding="utf-8"))
    assert written == document(POLYGON, BOX, image={"width": 100, "height": 95})


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (json.dumps(document(BOX)).replace("50", "NaN"), "NaN stands where a number should"),
        (document(BOX, version=2), "version is 2, this labcdp reads 1"),
        ("[5]", 'it is no region file: give a table with "format"'),
        (document({"name": "b"}), "region 'b': kind is missing: give one of polygon"),
        (document({**BOX, "height": -4}), "region 'b': height is -4"),
        (document({**POLYGON, "corners": [[0, 0], [9, 9], [9, 0], [0, 9]]}), "'a' crosses itself at x 4.5, y 4.5"),
        (document({**GRID, "rows": 200, "columns": 200}), "200 rows of 200 columns are 40000 regions"),
        (document(BOX, image={"width": 100, "height": 95}), "belong to an image of 100 x 95 pixels, this one has 60"),
        (document(BOX), "region 'b' spans x 50 to 70, y 10 to 40, but the image is 60 x 95 pixels"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_key_and_region(tmp_path, content, message):
    (path := tmp_path / "rois.json").write_text(json.dumps(content) if isinstance(content, dict) else content)
    with pytest.raises(InputError, match=rf"^{re.escape(str(path))}.*{message}"):
        load_regions(path, image_size=(60, 95))


names = st.text(min_size=1, max_size=12).filter(lambda name: name == name.strip() and name.isprintable())
numbers, sizes, angles = st.floats(-1e6, 1e6), st.floats(1e-3, 1e6), st.floats(-360, 360)
shapes = st.one_of(
    st.builds(PolygonShape, names, st.lists(st.tuples(numbers, numbers), min_size=3, max_size=8).map(tuple)),
    st.builds(RectangleShape, names, numbers, numbers, sizes, sizes, angles),
    st.builds(EllipseShape, names, numbers, numbers, sizes, sizes, angles),
    st.builds(GridShape, names, numbers, numbers, sizes, sizes, st.integers(1, 9), st.integers(1, 9)),
)


@settings(max_examples=25)
@given(st.lists(shapes, max_size=5), st.none() | st.tuples(st.integers(1, 10**5), st.integers(1, 10**5)))
def test_any_shapes_come_back_from_their_text(shapes, size):
    assert parse_regions(regions_json(shapes, size)) == (tuple(shapes), size)


def test_regions_of_a_grid_are_named_by_row_and_column():
    rois = rois_of([GridShape("board", 10, 20, 32, 20, rows=2, columns=3, gap=4)])
    assert [roi.name for roi in rois] == [f"board-r{r}c{c}" for r in (1, 2) for c in (1, 2, 3)]
    assert (rois[0].bounds, rois[5].bounds) == ((10, 20, 18, 28), (34, 32, 42, 40))
