"""The drawing with its files, without a browser: what is drawn, refused, undone, kept and saved."""

import json
import math
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.core.result import warning
from labcdp.regions import (
    EllipseShape,
    GridShape,
    PolygonShape,
    RectangleShape,
    Shape,
    load_regions,
    rois_of,
    save_regions,
)
from labcdp.web.regions import shapes
from labcdp.web.regions.drawing import Drawing, History
from labcdp.web.regions.files import DrawingFiles, Start
from labcdp.web.regions.measurements import Measurements
from labcdp.web.regions.messages import parse_message
from labcdp.web.regions.page_image import PageImage
from labcdp.web.regions.shapes import box_shape, handles, moved, propose, with_handle
from labcdp.web.regions.wording import region_table, warning_list
from labcdp.web.regions.workspace import Workspace

WIDTH, HEIGHT = SIZE = (100, 80)
A, B, C = (RectangleShape(name, 5 + 20 * at, 5, 10, 10) for at, name in enumerate("ABC"))
BOX = {"do": "box", "kind": "rectangle", "start": [10, 10], "end": [60, 70]}
SHAPES: list[Shape] = [
    PolygonShape("t", ((10, 10), (40, 10), (10, 40))),
    RectangleShape("r", 10, 20, 30, 40),
    RectangleShape("turned", 30, 20, 30, 20, 30.0),
    EllipseShape("e", 10, 20, 30, 40),
    GridShape("g", 10, 20, 60, 40, 2, 3, 2),
]


def at_once(steps: Iterator[Any], then: Callable[[Any], None], done: Callable[[], None]) -> None:
    """Run what the page runs elsewhere."""
    for found in steps:
        then(found)
    done()


def workspace(folder: Path) -> Workspace:
    """Workspace of an empty drawing on an image whose corner is saturated; its output is r.json."""
    flags = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
    flags[:5, :5] = 1
    light = np.random.default_rng(3).normal(80, 4, (HEIGHT, WIDTH)).astype(np.float32)
    luminance = LuminanceMap(light, np.full_like(light, 0.1), 0.02, flags)
    dn = light.astype(np.uint16)
    image = PageImage("a <b>.png", dn, True, None, luminance, "cd/m^2", (warning("camera-guessed"),))
    start = Start(History(Drawing.of(SIZE, ())))
    return Workspace(Measurements(image, [9.0]), DrawingFiles(folder / "r.json", SIZE), start, at_once)


@pytest.fixture
def space(tmp_path: Path) -> Workspace:
    return workspace(tmp_path)


ACTS = ("polygon", "box", "corner", "insert", "remove corner", "move", "delete", "rename", "accept", "limits", "x")
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=10,
)
_PLACE = st.lists(st.floats(-20, 120), min_size=2, max_size=2) | _JSON
_NAME = st.sampled_from(["region 1", "region 2", "A", "B"]) | _JSON
_MESSAGE = st.fixed_dictionaries(
    {"do": st.sampled_from(ACTS)},
    optional={
        "name": _NAME,
        "at": st.integers(-1, 4) | _PLACE,
        "after": st.integers(-1, 4) | _JSON,
        "kind": st.sampled_from(["rectangle", "ellipse"]) | _JSON,
        **dict.fromkeys(("by", "start", "end"), _PLACE),
        "to": _PLACE | st.text(max_size=5),
        "of": _JSON,
        "corners": st.lists(_PLACE, min_size=3, max_size=5) | _JSON,
    },
)
_GOOD = st.sampled_from(
    [
        BOX,
        {"do": "polygon", "corners": [[10, 10], [60, 10], [10, 60]]},
        {"do": "insert", "name": "region 1", "after": 1, "at": [60, 60]},
        {"do": "remove corner", "name": "region 1", "at": 0},
        {"do": "corner", "name": "region 1", "at": 1, "to": [70, 5]},
        *({"do": what} for what in ("undo", "redo", "undo", "redo", "accept all", "pair")),
    ]
)


@given(messages=st.lists(_MESSAGE | _GOOD, max_size=15))
@settings(max_examples=100)
def test_whatever_a_page_sends_is_carried_out_or_refused_and_can_be_undone(messages: list[dict[str, Any]]) -> None:
    with TemporaryDirectory() as folder:
        space = workspace(Path(folder))
        states, at = [space.drawing], 0
        for message in messages:
            try:
                done = space.do(parse_message(json.dumps(message)))
            except InputError:
                continue
            if done and message["do"] in ("undo", "redo"):
                at += 1 if message["do"] == "redo" else -1
            elif done and space.drawing != states[at]:
                states, at = [*states[: at + 1], space.drawing], at + 1
            assert space.drawing == states[at]
            for roi in space.drawing.rois:
                roi.window((HEIGHT, WIDTH))
            # What is not saved is in the file that the next run resumes with.
            assert space.files.kept() == space.drawing.shapes


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"do": 3}', "[" * 100_000])
def test_what_is_no_message_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="the page sent"):
        parse_message(text)


def test_the_first_two_regions_are_the_pair_and_gaps_are_filled() -> None:
    drawing = Drawing.of(SIZE, (A, B, C))
    assert drawing.pair == ("A", "B")
    assert drawing.deleted("A").pair == ("C", "B")
    assert drawing.deleted("A").deleted("C").pair == (None, "B")
    assert drawing.paired("C", "A").renamed("C", "sky").pair == ("sky", "A")


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda of: of.added(RectangleShape("A", 50, 50, 5, 5)), "2 regions have the name 'A'"),
        (lambda of: of.added(PolygonShape("x", ((10.6, 10.1), (11.4, 10.1), (11, 10.3)))), "'x' holds no pixel"),
        (lambda of: of.renamed("A", "C"), "there is a region 'C' already"),
        (lambda of: of.paired("A", "D"), "there is no region 'D'"),
        (lambda of: box_shape("rectangle", "r", (10, 20), (10.3, 50), SIZE), "holds no pixel"),
        (lambda of: with_handle(SHAPES[1], 2, (10, 50), SIZE), "nothing would be left of region 'r'"),
        (lambda of: shapes.without_corner(SHAPES[0], 0), "'t' has 3 corners left"),
    ],
)
def test_what_cannot_be_a_region_is_refused(act: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        act(Drawing.of(SIZE, (A, B)).proposed((C,)))


def test_proposals_count_once_they_are_accepted() -> None:
    drawing = Drawing.of(SIZE, (A,)).proposed((RectangleShape("A", 5, 40, 10, 10), B, C))
    assert [shape.name for shape in drawing.proposals] == ["A (2)", "B", "C"]
    assert [roi.name for roi in drawing.rois] == ["A"]
    one = drawing.accepted(["B"])
    assert ([shape.name for shape in one.shapes], len(one.proposals)) == (["A", "B"], 2)
    assert [shape.name for shape in one.accepted().shapes] == ["A", "B", "A (2)", "C"]
    assert [shape.name for shape in drawing.deleted("C").proposals] == ["A (2)", "B"]


@pytest.mark.parametrize("at", range(4))
@pytest.mark.parametrize("shape", SHAPES[1:], ids=lambda shape: shape.name)
def test_the_opposite_corner_of_a_box_stays_and_the_dragged_one_follows(shape: Shape, at: int) -> None:
    x, y = handles(shape)[at]
    to = (x + 4, y + 3) if at in (1, 2) else (x - 4, y - 3)
    changed = with_handle(shape, at, to, SIZE)
    assert handles(changed)[(at + 2) % 4] == pytest.approx(handles(shape)[(at + 2) % 4], abs=0.02)
    assert handles(changed)[at] == pytest.approx(to, abs=0.02)
    assert getattr(changed, "angle_deg", None) == getattr(shape, "angle_deg", None)


@given(shape=st.sampled_from(SHAPES), by=st.tuples(st.floats(-300, 300), st.floats(-300, 300)))
def test_what_is_moved_keeps_its_form_and_stays_in_the_image(shape: Shape, by: tuple[float, float]) -> None:
    after = moved(shape, by, SIZE)
    for roi in after.rois():
        roi.window((HEIGHT, WIDTH))
    old, new = ([math.dist(*pair) for pair in pairwise(handles(one))] for one in (shape, after))
    assert new == pytest.approx(old, abs=0.05)


def test_warnings_of_the_checks_are_shown_and_names_are_escaped(space: Workspace) -> None:
    space.do({**BOX, "start": [0, 0]})
    space.do({"do": "rename", "name": "region 1", "to": "<i>&'"})
    said = warning_list(space.image, space.drawing, space.measured)
    assert "are saturated" in said
    assert "The camera parameters are guessed" in said
    assert "<i>" not in said + region_table(space.image, space.drawing, space.measured, None)
    # A name keeps its small letter.
    for text, shown in (
        ("m.csv cannot be written", "m.csv cannot be written"),
        ("the disk is full", "The disk is full"),
    ):
        space.say(text)
        assert space.notice.text == shown


def test_a_file_that_somebody_else_changed_is_replaced_only_when_confirmed(space: Workspace, tmp_path: Path) -> None:
    path = tmp_path / "r.json"
    space.do(dict(BOX))
    # One that appears is another program's, too.
    path.write_text("mine")
    assert not space.do({"do": "save"})
    assert path.read_text() == "mine"
    path.unlink()
    assert space.do({"do": "save"})
    save_regions(path, (A,), SIZE, force=True)
    space.do({"do": "move", "name": "region 1", "by": [5, 5]})
    for _ in range(2):
        assert not space.do({"do": "save"})
        assert "was changed by another program since it was read, and is not replaced" in space.notice.text
        assert load_regions(path, SIZE) == (A,)
    assert space.do({"do": "save", "name": "mine.json"})
    assert not space.do({"do": "save"})
    # What is confirmed is the replacement of what was seen, not of what came later.
    save_regions(path, (A, B), SIZE, force=True)
    assert [space.do({"do": "replace"}) for _ in range(3)] == [False, True, False]
    assert load_regions(path, SIZE) == space.drawing.shapes
    # A file that is gone is nobody's work.
    path.unlink()
    assert space.do({"do": "save"})
    assert space.last_words() == [f"Saved: {path}", f"Saved: {tmp_path / 'mine.json'}"]
    space.do({"do": "delete", "name": "region 1"})
    assert space.last_words()[-1] == "Not saved: all regions were deleted; the file is as it was"


def test_proposals_that_are_there_already_are_not_proposed_again(space: Workspace) -> None:
    space.do(dict(BOX))
    same, new = RectangleShape("found", 11, 10, 50, 60), RectangleShape("new", 70, 10, 20, 50)
    space.propose((same, new), "Step chart")
    assert space.notice.text.endswith("1 region proposed. They count once you accept them. 1 more exists already.")
    assert space.drawing.proposals == (new,)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        *((name, "") for name in ("other.zip", "other.json", "other.roi")),
        *((name, "not a plain file name") for name in ("../r.json", "/etc/r.json", "", ".r.json", "a\0.json")),
        ("r.txt", "has an unknown suffix"),
        ("there.json", "exists already"),
    ],
)
def test_other_files_are_written_next_to_the_output_and_nowhere_else(
    space: Workspace, tmp_path: Path, name: str, message: str
) -> None:
    (tmp_path / "there.json").write_text("mine")
    space.do(dict(BOX))
    assert space.do({"do": "save", "name": name}) == (message == "")
    assert message in space.notice.text
    if not message:
        assert load_regions(tmp_path / name, SIZE)[0].rois()[0].corners == space.drawing.rois[0].corners
    assert (tmp_path / "there.json").read_text() == "mine"


def test_a_kept_drawing_of_another_image_is_refused(tmp_path: Path) -> None:
    files = DrawingFiles(tmp_path / "r.json", (WIDTH, HEIGHT))
    save_regions(files.unsaved, [A], (50, 50))
    with pytest.raises(InputError, match=r"50 x 50 pixels.*holds what was drawn and not saved"):
        files.kept()


def bayer(light: np.ndarray) -> PageImage:
    """Frame of a colour sensor whose map has a pixel for four."""
    none = np.zeros(light.shape, dtype=np.uint8)
    dn = light.repeat(2, axis=0).repeat(2, axis=1).astype(np.uint16)
    return PageImage("a", dn, True, "RG", LuminanceMap(light, np.zeros_like(light), 0.0, none, step=2), "relative")


def test_superpixels_of_a_colour_sensor_are_joined_and_in_pixels_of_the_image() -> None:
    light = np.random.default_rng(2).normal(100, 1, (60, 80)).astype(np.float32)
    light[:, 40:] *= 3
    found = propose(bayer(light), "superpixels", 20)
    # The edge is at 80; each half is one region, less a margin.
    left, right = sorted(roi.bounds for roi in rois_of(found))
    assert left == pytest.approx((0, 0, 80, 120), abs=9)
    assert right == pytest.approx((80, 0, 160, 120), abs=9)
    assert left[2] < 80 < right[0]


def test_more_proposals_than_a_person_confirms_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    squares = np.random.default_rng(2).uniform(50, 500, (6, 8)).repeat(20, axis=0).repeat(20, axis=1)
    monkeypatch.setattr(shapes, "MOST_PROPOSALS", 40)
    with pytest.raises(InputError, match=r"regions were found, .* limit of 40: give a larger size"):
        propose(bayer(squares.astype(np.float32)), "superpixels", 20)
