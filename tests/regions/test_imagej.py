"""ImageJ's region files: what ImageJ writes is read as ImageJ means it, and the way back."""

import struct
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.regions import EllipseShape, PolygonShape, RectangleShape, load_regions, rois_of, save_regions
from labcdp.regions.imagej import imagej_file, parse_imagej

SHAPE = (120, 120)


def pixels(shape):
    (roi,) = shape.rois()
    whole = np.zeros(SHAPE, dtype=bool)
    whole[roi.window(SHAPE)] = roi.mask(SHAPE)
    return whole


def imagej(
    kind,
    bounds,
    *,
    floats=(0, 0, 0, 0),
    corners=(),
    subpixel=(),
    subtype=0,
    options=0,
    parameter=b"\0" * 4,
    name="",
    size=0,
):
    """Bytes of a region, by the comment in ImageJ's RoiDecoder.java; `bounds` is top, left, bottom, right."""
    head = struct.pack(">4shBx4hH", b"Iout", 227, kind, *bounds, len(corners))
    head += struct.pack(">4f", *floats) + struct.pack(">hi8xhh", 0, size, subtype, options) + parameter
    x, y = zip(*corners, strict=True) if corners else ((), ())
    data = b"".join(struct.pack(">h", v) for v in (*x, *y))
    x, y = zip(*subpixel, strict=True) if subpixel else ((), ())
    data += b"".join(struct.pack(">f", v) for v in (*x, *y))
    header2 = 64 + len(data)
    text = name.encode("utf-16-be")
    head2 = struct.pack(">16xii40x", header2 + 64, len(name)) + text
    return head + struct.pack(">ii", 0, header2) + data + head2


def test_a_rectangle_holds_the_pixels_that_imagej_shows():
    (shape,) = parse_imagej(imagej(1, (20, 10, 24, 15), name="grey"), "file")
    assert shape == RectangleShape("grey", 10, 20, 5, 4)
    held = np.argwhere(pixels(shape))
    assert (held.min(axis=0).tolist(), held.max(axis=0).tolist(), len(held)) == ([20, 10], [23, 14], 20)


def test_an_oval_holds_the_pixels_within_the_ellipse():
    (shape,) = parse_imagej(imagej(2, (20, 10, 41, 40)), "lamp")
    assert shape == EllipseShape("lamp", 10, 20, 30, 21)
    # OvalRoi of ImageJ: the centre of a pixel is within the ellipse.
    y, x = np.mgrid[:120, :120]
    assert np.array_equal(pixels(shape), ((x - 24.5) / 15) ** 2 + ((y - 30) / 10.5) ** 2 <= 1)


@pytest.mark.parametrize("kind", [0, 7, 8])
def test_polygon_freehand_and_traced_regions_are_corners_of_pixels(kind):
    (shape,) = parse_imagej(imagej(kind, (20, 10, 24, 15), corners=[(0, 0), (5, 0), (5, 4), (0, 4)]), "p")
    assert shape == PolygonShape("p", ((10, 20), (15, 20), (15, 24), (10, 24)))
    assert np.array_equal(pixels(shape), pixels(RectangleShape("r", 10, 20, 5, 4)))


def composite(*rings):
    """Bytes of a region of several rings, as a path: 0 moves, 1 draws, 4 closes (ShapeRoi.java of ImageJ)."""
    path = [value for ring in rings for value in (0.0, *ring[0], *(v for one in ring[1:] for v in (1.0, *one)), 4.0)]
    head = struct.pack(">4shBx4hH", b"Iout", 227, 1, 0, 0, 100, 100, 0)
    head += struct.pack(">4f", 0, 0, 0, 0) + struct.pack(">hi8xhh", 0, len(path), 0, 0) + b"\0" * 4
    data = struct.pack(f">{len(path)}f", *path)
    return head + struct.pack(">ii", 0, 0) + data


def box(x, y, width, height):
    return [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]


def test_holes_and_parts_hold_the_pixels_of_the_even_odd_rule(tmp_path):
    rings = box(10, 10, 40, 30), box(20, 15, 10, 10), box(22, 17, 3, 3), box(70, 70, 8, 8)
    (tmp_path / "a.roi").write_bytes(composite(*rings))
    (shape,) = load_regions(tmp_path / "a.roi")
    expected = np.zeros(SHAPE, bool)
    for (x, y), _, (x1, y1), _ in rings:
        expected[y:y1, x:x1] ^= True
    assert np.array_equal(pixels(shape), expected)
    assert shape.rois()[0].area == expected.sum()
    save_regions(tmp_path / "a.json", [shape])
    assert load_regions(tmp_path / "a.json") == (shape,)


def test_a_region_of_the_wand_may_touch_itself(tmp_path):
    """Two pixels that touch at a corner, traced by one line."""
    corners = [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (1, 2), (1, 1), (0, 1)]
    (tmp_path / "a.roi").write_bytes(imagej(8, (30, 20, 32, 22), corners=corners))
    (shape,) = load_regions(tmp_path / "a.roi")
    assert np.argwhere(pixels(shape)).tolist() == [[30, 20], [31, 21]]


def test_a_region_that_cannot_be_read_is_left_out(tmp_path, caplog):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("line.roi", imagej(3, (0, 0, 9, 9)))
        archive.writestr("grey.roi", imagej(1, (20, 10, 24, 15)))
    assert [shape.name for shape in load_regions(tmp_path / "a.zip")] == ["grey"]
    assert "'line' is of the kind line, which has no area" in caplog.text


def test_a_rotated_rectangle_lies_along_its_line():
    # Makes RotatedRectRoi(20, 30, 60, 60, 20): from one side's middle to the other's, 20 wide.
    data = imagej(
        7, (0, 0, 99, 99), floats=(20, 30, 60, 60), subtype=5, parameter=struct.pack(">f", 20), corners=[(0, 0)] * 4
    )
    (roi,) = rois_of(parse_imagej(data, "r"))
    assert sorted(roi.corners) == [pytest.approx(corner) for corner in [(14, 38), (26, 22), (54, 68), (66, 52)]]


def test_a_rotated_ellipse_lies_along_its_long_axis():
    data = imagej(
        7, (0, 0, 99, 99), floats=(20, 30, 60, 60), subtype=3, parameter=struct.pack(">f", 0.5), corners=[(0, 0)] * 4
    )
    (shape,) = parse_imagej(data, "e")
    assert isinstance(shape, EllipseShape)
    assert (shape.width, shape.height, shape.angle_deg) == pytest.approx((50, 25, 36.87), abs=0.01)
    assert (shape.x + shape.width / 2, shape.y + shape.height / 2) == pytest.approx((40, 45))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (imagej(3, (0, 0, 9, 9)), r"'x' is of the kind line, which has no area: leave it out, or draw an area"),
        (imagej(3, (0, 0, 9, 9), subtype=2), r"'x' is of the kind arrow, which has no area"),
        (imagej(4, (0, 0, 9, 9)), r"kind freehand line"),
        (imagej(5, (0, 0, 9, 9)), r"kind segmented line"),
        (imagej(9, (0, 0, 9, 9)), r"kind angle"),
        (imagej(10, (0, 0, 9, 9), corners=[(0, 0)]), r"kind point"),
        (imagej(1, (0, 0, 9, 9), subtype=1), r"kind text"),
        (imagej(1, (0, 0, 9, 9), subtype=4), r"kind image"),
        (imagej(77, (0, 0, 9, 9)), r"'x' is of the unknown kind 77, 0: draw it as a polygon"),
        (imagej(1, (0, 0, 9, 9), parameter=b"\0\0\0\5"), r"'x' is a rectangle with rounded corners"),
        (imagej(0, (0, 0, 9, 9), corners=[(0, 0), (9, 0), (9, 9)], options=1), r"'x' is a fitted spline"),
        (imagej(0, (0, 0, 9, 9), corners=[(0, 0), (9, 0)]), r"'x' has 2 corners: draw it again"),
        (imagej(1, (0, 5, 9, 5)), r"region 'x': width is 0: give a number of pixels above 0"),
        (imagej(0, (0, 0, 9, 9), corners=[(0, 0), (9, 0), (9, 9)])[:70], r"'x' is damaged \(.*\): save it again"),
        (b"Iout" + b"\0" * 10, r"'x' is damaged or none: save it again in ImageJ"),
        (imagej(7, (0, 0, 9, 9), floats=(float("nan"),) * 4, subtype=5), r"region 'x': x is nan: give a finite number"),
    ],
)  # fmt: skip
def test_a_region_that_is_none_is_refused_by_kind_and_name(data, message):
    with pytest.raises(InputError, match=message):
        parse_imagej(data, "x")


SHAPES = (
    PolygonShape("whole", ((10, 10), (40, 12), (38, 33))),
    PolygonShape("between", ((10.25, 50.5), (40, 52.125), (38.75, 73))),
    RectangleShape("box", 50, 10, 20, 30),
    RectangleShape("box between", 50.5, 50.25, 20.5, 30),
    RectangleShape("turned", 80, 15, 20, 10, 12.5),
    EllipseShape("oval", 80, 40, 25, 11),
    EllipseShape("Öl / Lampe", 80.25, 60.5, 30, 10, -30),
    EllipseShape("steep", 10, 85, 10, 30, 20),
)


@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.name)
def test_a_single_file_keeps_name_kind_and_pixels(tmp_path, shape):
    save_regions(tmp_path / "a.roi", [shape])
    (read,) = load_regions(tmp_path / "a.roi")
    assert (read.name, read.kind) == (shape.name, shape.kind)
    assert np.array_equal(pixels(read), pixels(shape))


def test_several_in_a_zip_keep_names_kinds_pixels_and_order(tmp_path):
    save_regions(tmp_path / "a.zip", SHAPES)
    read = load_regions(tmp_path / "a.zip")
    assert [(shape.name, shape.kind) for shape in read] == [(shape.name, shape.kind) for shape in SHAPES]
    assert all(np.array_equal(pixels(a), pixels(b)) for a, b in zip(read, SHAPES, strict=True))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda z: z.writestr("a.txt", b"x"), r"it holds no \.roi file: save the regions in ImageJ's ROI Manager"),
        (lambda z: z.writestr("a.roi", b"x"), r"ImageJ region 'a' is damaged or none"),
        (lambda z: z.writestr("a.roi", b"Iout" + bytes(5 * 2**20)), r"'a\.roi' unpacks to more than 4 MiB"),
        (lambda z: [z.writestr(f"{n}.roi", b"") for n in range(10_001)], r"it holds 10001 regions: give at most 10000"),
    ],
)
def test_a_zip_that_holds_no_regions_is_refused(tmp_path, make, message):
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        make(archive)
    with pytest.raises(InputError, match=message):
        load_regions(tmp_path / "a.zip")


def test_many_entries_that_unpack_to_too_much_are_refused(tmp_path):
    region = imagej(0, (0, 0, 9, 9), corners=[(0, 0), (9, 0), (9, 9)]) + bytes(4 * 2**20 - 1000)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for n in range(20):
            archive.writestr(f"{n}.roi", region)
    with pytest.raises(InputError, match=r"or all to more than 64 MiB: these are no regions"):
        load_regions(tmp_path / "a.zip")


GOOD = imagej_file(SHAPES, True)


@settings(max_examples=150, deadline=None)
@given(st.integers(0, len(GOOD)), st.integers(0, len(GOOD) - 1), st.integers(0, 255))
def test_a_damaged_zip_is_read_or_refused(end, at, value):
    data = bytearray(GOOD)
    data[at] = value
    try:
        parse_imagej(bytes(data[:end]), "x")
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - what is accepted is fine too


ONE = imagej(
    0,
    (20, 10, 25, 15),
    corners=[(0, 0), (5, 1), (2, 5)],
    subpixel=[(10, 20), (15, 21), (12, 25)],
    options=128,
    name="p",
)


@settings(max_examples=300, deadline=None)
@given(st.lists(st.tuples(st.integers(0, len(ONE) - 1), st.integers(0, 255)), max_size=4), st.integers(4, len(ONE)))
def test_a_damaged_region_is_read_or_refused(changes, end):
    data = bytearray(ONE)
    for at, value in changes:
        data[at] = value
    data = bytes(data[:end])
    try:
        parse_imagej(b"Iout" + data[4:], "x")
    except InputError as error:
        assert "\n" not in str(error)  # noqa: PT017 - what is accepted is fine too
