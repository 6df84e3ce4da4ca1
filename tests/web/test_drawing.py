import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import InputError
from labcdp.regions import PolygonShape, RectangleShape
from labcdp.web.regions.drawing import Drawing, History
from labcdp.web.regions.messages import change, parse_message

SIZE = (100, 80)
A, B, C = (RectangleShape(name, 5 + 20 * at, 5, 10, 10) for at, name in enumerate("ABC"))


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
        (lambda of: of.deleted("D"), "there is no region 'D'"),
        (lambda of: of.paired("A", "D"), "there is no region 'D'"),
        (lambda of: of.accepted(["A"]), "there is no such proposal"),
    ],
)
def test_what_cannot_be_a_region_or_is_unknown_is_refused(act: Any, message: str) -> None:
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


@given(st.lists(st.sampled_from(["add", "delete", "undo", "redo"]), max_size=30))
def test_undo_and_redo_are_each_others_way_back(steps: list[str]) -> None:
    history, brute, at = History(Drawing(SIZE)), [Drawing(SIZE)], 0
    for number, step in enumerate(steps):
        drawing = history.present
        if step in ("undo", "redo"):
            to = at + (1 if step == "redo" else -1)
            if not 0 <= to < len(brute):
                with pytest.raises(InputError, match=f"nothing to {step}"):
                    history.undone() if step == "undo" else history.redone()
                continue
            at, history = to, history.undone() if step == "undo" else history.redone()
        else:
            if step == "delete" and not drawing.shapes:
                continue
            new = (
                drawing.added(RectangleShape(f"r{number}", number, 5, 3, 3))
                if step == "add"
                else drawing.deleted(drawing.shapes[0].name)
            )
            history, brute, at = history.changed(new), [*brute[: at + 1], new], at + 1
        assert history.present == brute[at]


def test_mouse_and_keys_change_the_drawing() -> None:
    drawing, selected = Drawing(SIZE), None
    for message in (
        {"do": "polygon", "corners": [[1, 1], [20, 1], [20, 20]]},
        {"do": "box", "kind": "rectangle", "start": [30, 1], "end": [40, 11]},
        {"do": "corner", "name": "region 2", "at": 2, "to": [50, 21]},
        {"do": "move", "name": "region 2", "by": [5, 5]},
        {"do": "insert", "name": "region 1", "after": 2, "at": [1, 20]},
        {"do": "remove corner", "name": "region 1", "at": 0},
        {"do": "rename", "name": "region 1", "to": " sky "},
    ):
        drawing, selected = change(drawing, message)
    sky, box = PolygonShape("sky", ((20, 1), (20, 20), (1, 20))), RectangleShape("region 2", 35, 6, 20, 20)
    assert (drawing.shapes, selected) == ((sky, box), "sky")
    drawing, selected = change(drawing.proposed((A,)), {"do": "delete", "name": "sky"})
    assert (drawing.shapes, selected) == ((box,), None)
    assert change(drawing, {"do": "accept", "name": "A"})[0].shapes == (box, A)


ACTS = ("polygon", "box", "corner", "insert", "remove corner", "move", "delete", "rename", "accept", "x")
_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=10,
)


@given(
    do=st.sampled_from(ACTS),
    rest=st.fixed_dictionaries(
        {},
        optional={
            "name": st.just("A") | _JSON,
            "at": st.integers() | st.lists(st.floats(), min_size=2, max_size=2) | _JSON,
            "after": st.integers(-9, 9) | _JSON,
            "kind": st.just("rectangle") | _JSON,
            **dict.fromkeys(("to", "by", "start", "end"), st.lists(st.floats(), min_size=2, max_size=2) | _JSON),
            "corners": st.lists(st.lists(st.floats(), min_size=2, max_size=2), max_size=5) | _JSON,
        },
    ),
)
def test_whatever_a_page_sends_is_carried_out_or_refused(do: str, rest: dict[str, Any]) -> None:
    try:
        message = parse_message(json.dumps({**rest, "do": do}))
        drawing, _ = change(Drawing.of(SIZE, (A, B)), message)
    except InputError:
        return
    for roi in drawing.rois:
        roi.window((SIZE[1], SIZE[0]))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"do": 3}', "[" * 100_000])
def test_what_is_no_message_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="the page sent"):
        parse_message(text)
