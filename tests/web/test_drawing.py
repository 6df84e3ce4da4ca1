"""The drawing with its files, without a browser: what is drawn, refused, undone, kept and saved."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.core.result import warning
from labcdp.regions import RectangleShape, load_regions, rois_of, save_regions
from labcdp.web.regions.drawing import Drawing, History
from labcdp.web.regions.files import DrawingFiles, Start
from labcdp.web.regions.measurements import Measurements
from labcdp.web.regions.messages import parse_message
from labcdp.web.regions.page_image import PageImage
from labcdp.web.regions.shapes import propose
from labcdp.web.regions.wording import region_table, warning_list
from labcdp.web.regions.workspace import Workspace

WIDTH, HEIGHT = SIZE = (100, 80)
A, B, C = (RectangleShape(name, 5 + 20 * at, 5, 10, 10) for at, name in enumerate("ABC"))
BOX = {"do": "box", "kind": "rectangle", "start": [10, 10], "end": [60, 70]}


def at_once(steps, then, done):
    """Run what the page runs elsewhere."""
    for found in steps:
        then(found)
    done()


def workspace(folder):
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
def space(tmp_path):
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
def test_whatever_a_page_sends_is_carried_out_or_refused_and_can_be_undone(messages):
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
def test_what_is_no_message_is_refused(text):
    with pytest.raises(InputError, match="the page sent"):
        parse_message(text)


def test_proposals_count_once_they_are_accepted():
    drawing = Drawing.of(SIZE, (A,)).proposed((RectangleShape("A", 5, 40, 10, 10), B, C))
    assert [shape.name for shape in drawing.proposals] == ["A (2)", "B", "C"]
    assert [roi.name for roi in drawing.rois] == ["A"]
    one = drawing.accepted(["B"])
    assert ([shape.name for shape in one.shapes], len(one.proposals)) == (["A", "B"], 2)
    assert [shape.name for shape in one.accepted().shapes] == ["A", "B", "A (2)", "C"]
    assert [shape.name for shape in drawing.deleted("C").proposals] == ["A (2)", "B"]


def test_warnings_of_the_checks_are_shown_and_names_are_escaped(space):
    space.do({**BOX, "start": [0, 0]})
    space.do({"do": "rename", "name": "region 1", "to": "<i>&'"})
    said = warning_list(space.image, space.drawing, space.measured)
    assert "are saturated" in said
    assert "<i>" not in said + region_table(space.image, space.drawing, space.measured, None)


def test_a_file_that_somebody_else_changed_is_replaced_only_when_confirmed(space, tmp_path):
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


def test_regions_of_a_file_are_loaded_and_may_be_saved_there_again(space, tmp_path):
    save_regions(tmp_path / "other.zip", (A, B), SIZE)
    space.do(dict(BOX))
    before = space.drawing
    assert space.do({"do": "load", "name": "other.zip"})
    assert [shape.name for shape in space.drawing.shapes] == [A.name, B.name]
    assert not space.unsaved
    assert not space.do({"do": "load", "name": "missing.json"})
    assert space.do({"do": "save", "name": "other.zip"})
    space.do({"do": "undo"})
    assert space.drawing == before


def test_other_files_are_written_next_to_the_output_and_nowhere_else(space, tmp_path):
    (tmp_path / "there.json").write_text("mine")
    space.do(dict(BOX))
    for name in ("other.zip", "other.json", "other.roi"):
        assert space.do({"do": "save", "name": name})
        assert load_regions(tmp_path / name, SIZE)[0].rois()[0].corners == space.drawing.rois[0].corners
    for name in ("../r.json", "/etc/r.json", "", ".r.json", "a\0.json", "r.txt", "there.json"):
        assert not space.do({"do": "save", "name": name})
    assert (tmp_path / "there.json").read_text() == "mine"
    assert not (tmp_path.parent / "r.json").exists()


def test_a_kept_drawing_of_another_image_is_refused(tmp_path):
    files = DrawingFiles(tmp_path / "r.json", (WIDTH, HEIGHT))
    save_regions(files.unsaved, [A], (50, 50))
    with pytest.raises(InputError, match=r"50 x 50 pixels.*unsaved drawing"):
        files.kept()


def test_superpixels_of_a_colour_sensor_are_joined_and_in_pixels_of_the_image():
    light = np.random.default_rng(2).normal(100, 1, (60, 80)).astype(np.float32)
    light[:, 40:] *= 3
    none, dn = np.zeros(light.shape, dtype=np.uint8), light.repeat(2, axis=0).repeat(2, axis=1).astype(np.uint16)
    of_map = LuminanceMap(light, np.zeros_like(light), 0.0, none, step=2)
    found = propose(PageImage("a", dn, True, "RG", of_map, "relative"), "superpixels", 20)
    # The edge is at 80; each half is one region, less a margin.
    left, right = sorted(roi.bounds for roi in rois_of(found))
    assert left == pytest.approx((0, 0, 80, 120), abs=9)
    assert right == pytest.approx((80, 0, 160, 120), abs=9)
    assert left[2] < 80 < right[0]
