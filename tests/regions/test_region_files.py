"""Region files in JSON, and what all kinds of files have in common."""

import json
import re
import struct
import zipfile
from math import nan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.regions import EllipseShape, GridShape, PolygonShape, RectangleShape, load_regions, rois_of, save_regions
from labcdp.regions.imagej import parse_imagej
from labcdp.regions.region_file import parse_regions, regions_json

from .test_shapes import pixels

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
        (json.dumps(document(BOX)).replace("50", "NaN"), "NaN is not a number"),
        (document(BOX, version=2), "version is 2, this labcdp reads 1"),
        ("[5]", 'it is not a region file: it needs a table with "format"'),
        (document({"name": "b"}), "region 'b': kind is missing: give one of polygon"),
        (document({**BOX, "height": -4}), "region 'b': height is -4"),
        (document({**POLYGON, "corners": [[0, 0], [9, 9], [9, 0], [0, 9]]}), "'a' crosses itself at x 4.5, y 4.5"),
        (document({**GRID, "rows": 200, "columns": 200}), "200 rows of 200 columns are 40000 regions"),
        (document(BOX, image={"width": 100, "height": 95}), "drawn on an image of 100 x 95 pixels, this one has 60"),
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


# ImageJ's files: what ImageJ writes is read as ImageJ means it, and the inverse


SHAPE = (120, 120)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]]


def imagej(kind, bounds, *, floats=(0, 0, 0, 0), corners=(), path=(), more=(0, 0, 0.0), name=""):
    """Bytes of a region, by the comment in ImageJ's RoiDecoder.java.

    `bounds` is top, left, bottom, right, `more` has the subtype, options, and what the subtype needs.
    """
    head = struct.pack(">4shBx4hH4f", b"Iout", 227, kind, *bounds, len(corners), *floats)
    head += struct.pack(">hi8xhhf", 0, len(path), *more)
    data = b"".join(struct.pack(">h", value) for axis in zip(*corners, strict=True) for value in axis)
    data += struct.pack(f">{len(path)}f", *path)
    head2 = struct.pack(">16xii40x", 128 + len(data), len(name)) + name.encode("utf-16-be")
    return head + struct.pack(">ii", 0, 64 + len(data)) + data + head2


def composite(*rings):
    """Bytes of a region of several rings, as a path: 0 moves, 1 draws, 4 closes (ShapeRoi.java of ImageJ)."""
    path = [value for ring in rings for value in (0.0, *ring[0], *(v for one in ring[1:] for v in (1.0, *one)), 4.0)]
    return imagej(1, (0, 0, 100, 100), path=path)


def box(x, y, width, height):
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def covers(x, y, width, height):
    return (x <= X) & (x + width > X) & (y <= Y) & (y + height > Y)


OUTER, HOLE, ISLAND, PART = (10, 10, 40, 30), (20, 15, 10, 10), (22, 17, 3, 3), (70, 70, 8, 8)


@pytest.mark.parametrize(
    ("data", "kind", "expected"),
    [
        (imagej(1, (20, 10, 24, 15)), "rectangle", covers(10, 20, 5, 4)),
        # OvalRoi of ImageJ: the centre of a pixel is within the ellipse.
        (imagej(2, (20, 10, 41, 40)), "ellipse", ((X - 24.5) / 15) ** 2 + ((Y - 30) / 10.5) ** 2 <= 1),
        *((imagej(k, (20, 10, 24, 15), corners=box(0, 0, 5, 4)), "polygon", covers(10, 20, 5, 4)) for k in (0, 7, 8)),
        # Two pixels that touch at a corner, traced by one line as the wand does.
        (imagej(8, (30, 20, 32, 22), corners=[(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (1, 2), (1, 1), (0, 1)]),
         None, covers(20, 30, 1, 1) | covers(21, 31, 1, 1)),
        # The even-odd rule.
        (composite(*(box(*one) for one in (OUTER, HOLE, ISLAND, PART))), "composite",
         covers(*OUTER) ^ covers(*HOLE) ^ covers(*ISLAND) ^ covers(*PART)),
    ],
)  # fmt: skip
def test_a_region_holds_the_pixels_that_imagej_shows(tmp_path, data, kind, expected):
    (tmp_path / "a.roi").write_bytes(data)
    (shape,) = load_regions(tmp_path / "a.roi")
    assert kind in (shape.kind, None)
    assert np.array_equal(pixels(*shape.rois(), SHAPE), expected)
    assert shape.rois()[0].area == pytest.approx(expected.sum(), rel=0.01)
    save_regions(tmp_path / "a.json", [shape])
    assert load_regions(tmp_path / "a.json") == (shape,)


def test_rotated_regions_lie_along_their_line():
    along = {"floats": (20, 30, 60, 60), "corners": [(0, 0)] * 4}
    # Makes RotatedRectRoi(20, 30, 60, 60, 20): from one side's middle to the other's, 20 wide.
    (roi,) = rois_of(parse_imagej(imagej(7, (0, 0, 99, 99), more=(5, 0, 20), **along), "r"))
    assert sorted(roi.corners) == [pytest.approx(corner) for corner in [(14, 38), (26, 22), (54, 68), (66, 52)]]
    (shape,) = parse_imagej(imagej(7, (0, 0, 99, 99), more=(3, 0, 0.5), **along), "e")
    assert (shape.width, shape.height, shape.angle_deg) == pytest.approx((50, 25, 36.87), abs=0.01)
    assert (shape.x + shape.width / 2, shape.y + shape.height / 2) == pytest.approx((40, 45))


TRIANGLE = imagej(0, (0, 0, 9, 9), corners=[(0, 0), (9, 0), (9, 9)])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (imagej(3, (0, 0, 9, 9), more=(2, 0, 0)), r"'a' is of the kind arrow"),
        (imagej(1, (0, 5, 9, 5)), r"region 'a': width is 0"),
        (TRIANGLE[:70], r"'a' cannot be read"),
        (imagej(1, (0, 0, 9, 9), path=[0, 1, 1, 3, 1, 2, 3, 4, 5, 6, 4]), r"'a' is a composite selection with curves"),
        (imagej(7, (0, 0, 9, 9), floats=(nan,) * 4, more=(5, 0, 0)), r"region 'a': x is nan"),
        ({"a.roi": b"Iout" + bytes(5 * 2**20)}, r"'a\.roi' unpacks to more than 4 MiB"),
        ({f"{n}.roi": TRIANGLE + bytes(2**22 - 999) for n in range(17)}, r"or all to more than 64 MiB"),
    ],
    ids=["arrow", "empty", "cut", "curves", "nan", "bomb", "bomb of many"],
)
def test_a_file_without_a_region_is_refused_by_kind_and_name(tmp_path, content, message):
    path = tmp_path / "a.roi"
    if isinstance(content, dict):
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in content.items():
                archive.writestr(name, data)
    else:
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        load_regions(path)


SHAPES = (
    PolygonShape("between", ((10.25, 50.5), (40, 52.125), (38.75, 73))),
    RectangleShape("box", 50, 10, 20, 30),
    RectangleShape("turned", 80, 15, 20, 10, 12.5),
    EllipseShape("Öl / Lampe", 80.25, 60.5, 30, 10, -30),
    EllipseShape("steep", 10, 85, 10, 30, 20),
)


@pytest.mark.parametrize("shapes", [SHAPES, SHAPES[:1]])
def test_what_is_saved_keeps_names_kinds_pixels_and_order(tmp_path, shapes):
    path = tmp_path / ("a.zip" if len(shapes) > 1 else "a.roi")
    save_regions(path, shapes)
    for read, shape in zip(load_regions(path), shapes, strict=True):
        assert (read.name, read.kind) == (shape.name, shape.kind)
        assert np.array_equal(*(pixels(*one.rois(), SHAPE) for one in (read, shape)))
