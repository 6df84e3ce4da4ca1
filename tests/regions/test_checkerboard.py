"""Checkerboards in pictures of known ones."""

import numpy as np
import pytest

from labcdp.chain import Checkerboard
from labcdp.core.errors import InputError
from labcdp.regions import detect_checkerboard, rois_of

from .scenes import SHAPE, board, on_target, picture, seen_from


def square_of(shape, matrix):
    """Row and column of the square that a detected one lies in; None if it lies in several."""
    u, v = on_target(matrix, *np.array(shape.corners).T)
    rows, columns = set(np.floor(v).astype(int).tolist()), set(np.floor(u).astype(int).tolist())
    return (rows.pop(), columns.pop()) if len(rows) == len(columns) == 1 else None


def whole_squares(rows, columns, matrix, shape=SHAPE):
    """Squares that the picture shows with all their corners."""
    height, width = shape
    whole = set()
    for row, column in np.ndindex(rows, columns):
        u, v = np.array([column, column + 1, column + 1, column]), np.array([row, row, row + 1, row + 1])
        x, y, w = matrix @ np.stack([u, v, np.ones(4)])
        if ((x / w >= 0) & (x / w <= width) & (y / w >= 0) & (y / w <= height)).all():
            whole.add((row, column))
    return whole


def check_all_squares(shapes, rows, columns, matrix, missed=0):
    """Each shape lies in one square of its tone, named by place; no more than `missed` squares are left out."""
    squares = {shape.name: square_of(shape, matrix) for shape in shapes}
    first_row = min(row for row, _ in squares.values())
    first_column = min(column for _, column in squares.values())
    for name, (row, column) in squares.items():
        tone = "light" if (row + column) % 2 == 0 else "dark"
        assert name == f"r{row - first_row + 1}c{column - first_column + 1}-{tone}"
    whole = whole_squares(rows, columns, matrix)
    assert set(squares.values()) <= {(row, column) for row, column in np.ndindex(rows, columns)}
    assert len(whole - set(squares.values())) <= missed


VIEWS = {
    "upright": {},
    "turned": {"turn_deg": 33},
    "in perspective": {"perspective": 0.5},
    "turned in perspective": {"turn_deg": -20, "perspective": 0.4},
}
LIGHTS = {
    "clean": {"noise": 0.0},
    "noisy": {"noise": 25.0},
    "blurred": {"blur_px": 3.0},
    "uneven": {"uneven": 0.8},
}


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("view", VIEWS)
def test_all_squares_are_found_and_named(view, light):
    rng = np.random.default_rng(1)
    matrix = seen_from(rng, 6, 8, 28, **VIEWS[view])
    image = picture(matrix, board(6, 8), rng, **LIGHTS[light])
    # In light that falls to a fifth, a square at the dark end may be left out.
    check_all_squares(detect_checkerboard(image), 6, 8, matrix, missed=1 if light == "uneven" else 0)


def test_corners_are_where_they_are():
    # Without the margin of at least 1.5 pixels the squares' corners are those of the board.
    rng = np.random.default_rng(2)
    matrix = seen_from(rng, 6, 8, 30, turn_deg=10, perspective=0.3)
    shapes = detect_checkerboard(picture(matrix, board(6, 8), rng, noise=2), margin_rel=0.05)
    off = []
    for shape in shapes:
        row, column = square_of(shape, matrix)
        x, y, w = matrix @ np.array([column + 0.5, row + 0.5, 1])
        # The middle of a square is where its diagonals meet, in perspective too; the same margin moves it little.
        (x0, y0), (x1, y1), (x2, y2), (x3, y3) = shape.corners
        lines = np.array([[y2 - y0, x0 - x2], [y3 - y1, x1 - x3]])
        meeting = np.linalg.solve(lines, [x0 * y2 - x2 * y0, x1 * y3 - x3 * y1])
        off.append(np.hypot(*(meeting - np.array([x / w, y / w]))))
    assert np.median(off) < 0.1
    assert max(off) < 0.3


@pytest.mark.parametrize("around", [50.0, 200.0])
def test_surroundings_like_a_square_are_no_squares(around):
    rng = np.random.default_rng(4)
    matrix = seen_from(rng, 5, 7, 32, turn_deg=8)
    image = picture(matrix, board(5, 7, around=around), rng)
    check_all_squares(detect_checkerboard(image), 5, 7, matrix)


def test_a_cropped_board_gives_its_whole_squares():
    rng = np.random.default_rng(5)
    matrix = seen_from(rng, 9, 12, 40, turn_deg=12, shift=(60, -40))
    shapes = detect_checkerboard(picture(matrix, board(9, 12), rng))
    # A row or column of which but one or two squares are whole may be taken for surroundings.
    check_all_squares(shapes, 9, 12, matrix, missed=3)


@pytest.mark.parametrize("square_px", [20, 50])
def test_a_board_that_fills_the_image(square_px):
    scene = Checkerboard(400, 300, 20.0, 1.0, square_px)
    rois = rois_of(detect_checkerboard(scene.luminance_map()))
    assert len(rois) == (400 // square_px) * (300 // square_px)
    regions = scene.regions()
    for roi in rois:
        assert regions["bright" if "light" in roi.name else "dark"][roi.window((300, 400))][roi.mask((300, 400))].all()


def stripes(u, v):
    return np.where(np.floor(u) % 2 == 0, 200.0, 50.0)


def windows(u, v):
    return np.where((u % 1 < 0.5) & (v % 1 < 0.5), 50.0, 200.0)


def bricks(u, v):
    return np.where(((u + 0.5 * (np.floor(v) % 2)) % 1 < 0.9) & (v % 1 < 0.8), 90.0, 200.0)


def dots(u, v):
    return np.where((u % 1 - 0.5) ** 2 + (v % 1 - 0.5) ** 2 < 0.35**2, 30.0, 200.0)


@pytest.mark.parametrize("pattern", [stripes, windows, bricks, dots])
def test_another_pattern_is_not_a_checkerboard(pattern):
    rng = np.random.default_rng(7)
    image = picture(seen_from(rng, 6, 8, 30, turn_deg=3), pattern, rng)
    with pytest.raises(InputError, match=r"no checkerboard was found in the image of 400 x 300 pixels: show at least"):
        detect_checkerboard(image)


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((200, 300)),
        np.random.default_rng(8).normal(100, 20, (200, 300)),
        Checkerboard(300, 200, 20.0, 1.0, 1).luminance_map(),
        Checkerboard(300, 200, 20.0, 1.0, 3).luminance_map(),
        Checkerboard(300, 200, 20.0, 1.0, 100).luminance_map(),
    ],
    ids=["flat", "noise", "squares of a pixel", "squares of 3 pixels", "six squares"],
)
def test_an_image_without_a_board_that_can_be_used(image):
    with pytest.raises(InputError, match=r"no checkerboard was found in the image of 300 x 200 pixels"):
        detect_checkerboard(image)
