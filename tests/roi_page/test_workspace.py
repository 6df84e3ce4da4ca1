"""The drawing with its files and measurements, without a browser."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labcdp.errors import InputError
from labcdp.evaluate.pair import evaluate_pair
from labcdp.evaluate.pair_region import evaluate_region
from labcdp.luminance import LuminanceMap
from labcdp.regions import PolygonShape, RectangleShape, load_regions, save_regions
from labcdp.roi_page.drawing import Drawing, History
from labcdp.roi_page.files import DrawingFiles
from labcdp.roi_page.measurements import Measurements
from labcdp.roi_page.page_image import PageImage
from labcdp.roi_page.wording import pair_table, region_table, warning_list
from labcdp.roi_page.workspace import Start, Workspace

from .conftest import HEIGHT, WIDTH, known_dn

BOX = {"do": "box", "kind": "rectangle", "start": [10, 10], "end": [90, 110]}
OTHER = {"do": "box", "kind": "rectangle", "start": [400, 10], "end": [480, 110]}


@pytest.fixture
def image() -> PageImage:
    light = known_dn().astype(np.float32) / 100
    flags = np.zeros(light.shape, dtype=np.uint8)
    flags[:5, :5] = 1
    luminance = LuminanceMap(light, np.full_like(light, 0.1), 0.02, flags)
    return PageImage("a <b>.png", known_dn(), True, None, luminance, "cd/m^2", ("minded",))


class Later:
    """Runs work when told to."""

    def __init__(self) -> None:
        self.waiting: list[Callable[[], None]] = []

    def __call__(self, steps: Iterator[Any], then: Callable[[Any], None], done: Callable[[], None]) -> None:
        def work() -> None:
            for found in steps:
                then(found)
            done()

        self.waiting.append(work)

    def run(self) -> None:
        while self.waiting:
            self.waiting.pop(0)()


@pytest.fixture
def later() -> Later:
    return Later()


def workspace(image: PageImage, later: Later, output: Path, **more: Any) -> Workspace:
    files = DrawingFiles(output, image.size)
    history = History(Drawing.of(image.size, more.get("saved", ())))
    return Workspace(Measurements(image, [9.0]), files, Start(history, more.get("saved", ())), later)


def test_what_is_measured_is_what_labcdp_says(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    assert space.do(dict(BOX))
    assert space.do(dict(OTHER))
    later.run()
    a, b = space.drawing.rois
    result = evaluate_pair(image.luminance, a, b, [9.0])
    assert space.evaluated.pair is not None
    assert space.evaluated.pair.result == result
    assert space.evaluated.regions[a].result == evaluate_region(image.luminance, a)
    assert space.means[a].value == pytest.approx(known_dn()[10:110, 10:90].mean())
    assert space.means[a].value_std == pytest.approx(known_dn()[10:110, 10:90].std(ddof=1))
    assert space.means[a].light == pytest.approx(result.a.mean)
    table = region_table(image, space.drawing, space.means, space.evaluated, "region 1")
    assert "<td>8000</td>" in table
    assert f"{result.results[0].result.cdp:.3f}" in pair_table(space.drawing, space.evaluated)


def test_means_do_not_wait_for_the_evaluation_of_an_older_drawing(
    image: PageImage, later: Later, tmp_path: Path
) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    means, _evaluation = later.waiting
    later.waiting.clear()
    means()
    space.do(dict(OTHER))
    (means,) = later.waiting  # that of the evaluation is still under way
    means()
    assert len(space.means) == 2
    assert space.evaluated.regions == {}


def test_regions_that_overlap_say_so_in_place_of_a_cdp(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    space.do({**BOX, "end": [50, 50]})
    later.run()
    assert "have 1600 pixels in common" in pair_table(space.drawing, space.evaluated)


def test_warnings_of_the_checks_are_shown_and_names_are_escaped(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.do({**BOX, "start": [0, 0]})
    space.do({"do": "rename", "name": "region 1", "to": "<i>&'"})
    later.run()
    said = warning_list(image, space.drawing, space.means, space.evaluated)
    assert "are saturated" in said
    assert "Minded" in said
    assert "<i>" not in said + region_table(image, space.drawing, space.means, space.evaluated, None)


def test_what_is_not_saved_is_kept_and_the_next_run_has_it(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    kept = DrawingFiles(tmp_path / "r.json", image.size).kept()
    assert kept == space.drawing.shapes
    assert space.last_words() == [
        f"Not saved: the drawing of 1 region; it is kept in {tmp_path / 'r.json.unsaved.json'}, and the same command "
        "goes on with it"
    ]
    assert space.do({"do": "save"})
    assert load_regions(tmp_path / "r.json", image.size) == kept
    assert [path.name for path in tmp_path.iterdir()] == ["r.json"]
    assert (space.unsaved, space.last_words()) == (False, [f"Saved: {tmp_path / 'r.json'}"])
    # Back to what it was before: different from the file, and kept again.
    space.do({"do": "undo"})
    space.do({"do": "redo"})
    assert not space.unsaved
    space.do({"do": "delete", "name": "region 1"})
    assert space.last_words()[-1] == "Not saved: all regions were deleted; the file is as it was"


def test_a_drawing_that_cannot_be_kept_is_told(image: PageImage, later: Later, tmp_path: Path) -> None:
    (tmp_path / "r.json.unsaved.json").mkdir()
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    assert "cannot be kept" in space.notice.text
    assert "it is lost, since it could not be kept" in space.last_words()[-1]


def test_a_file_that_somebody_else_changed_is_replaced_only_when_confirmed(
    image: PageImage, later: Later, tmp_path: Path
) -> None:
    path = tmp_path / "r.json"
    space = workspace(image, later, path)
    space.do(dict(BOX))
    assert space.do({"do": "save"})
    theirs = (RectangleShape("theirs", 1, 1, 5, 5),)
    save_regions(path, theirs, image.size)
    space.do(dict(OTHER))
    for _ in range(2):
        assert not space.do({"do": "save"})
        assert "was changed by somebody else since it was read, and is not replaced" in space.notice.text
        assert load_regions(path, image.size) == theirs
    assert space.do({"do": "save", "name": "mine.json"})
    assert len(load_regions(tmp_path / "mine.json", image.size)) == 2
    assert not space.do({"do": "save"})
    # What is confirmed is the replacement of what was seen, not of what came later.
    save_regions(path, (*theirs, RectangleShape("later", 9, 9, 5, 5)), image.size)
    assert not space.do({"do": "replace"})
    assert space.do({"do": "replace"})
    assert load_regions(path, image.size) == space.drawing.shapes
    assert not space.do({"do": "replace"})
    assert space.notice.text == "There is no file to replace: save the drawing"
    # A file that is gone is nobody's work.
    path.unlink()
    assert space.do({"do": "save"})


def test_a_file_that_appears_under_the_name_of_the_output_is_not_replaced(
    image: PageImage, later: Later, tmp_path: Path
) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    (tmp_path / "r.json").write_text("mine")
    space.do(dict(BOX))
    assert not space.do({"do": "save"})
    assert (tmp_path / "r.json").read_text() == "mine"


def test_proposals_that_are_there_already_are_not_proposed_again(
    image: PageImage, later: Later, tmp_path: Path
) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    same, new = RectangleShape("found", 11, 10, 80, 100), RectangleShape("new", 50, 10, 80, 100)
    space.propose((same, new), "Step chart")
    assert space.notice.text == (
        "Step chart: 1 region proposed. They count once you accept them. 1 more is there already."
    )
    assert space.drawing.proposals == (new,)
    space.propose((same,), "Step chart")
    assert space.notice.text == "Step chart: the region is there already."
    assert space.drawing.proposals == ()


@pytest.mark.parametrize("name", ["other.zip", "other.json", "other.roi"])
def test_other_files_are_written_beside_the_output(image: PageImage, later: Later, tmp_path: Path, name: str) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    assert space.do({"do": "save", "name": name})
    assert load_regions(tmp_path / name, image.size)[0].rois()[0].corners == space.drawing.rois[0].corners


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("../r.json", "no plain file name"),
        ("/etc/r.json", "no plain file name"),
        ("", "no plain file name"),
        (".r.json", "no plain file name"),
        ("r.txt", "has no known end"),
        ("there.json", "is there already"),
        ("a\0.json", "no plain file name"),
    ],
)
def test_names_of_files_that_do_harm_are_refused(
    image: PageImage, later: Later, tmp_path: Path, name: str, message: str
) -> None:
    (tmp_path / "there.json").write_text("mine")
    space = workspace(image, later, tmp_path / "r.json")
    space.do(dict(BOX))
    assert not space.do({"do": "save", "name": name})
    assert message in space.notice.text
    assert space.notice.kind == "warning"
    assert (tmp_path / "there.json").read_text() == "mine"


def test_nothing_is_saved_of_nothing(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    assert not space.do({"do": "save"})
    assert "no region to save" in space.notice.text
    assert space.last_words() == ["Nothing was changed"]


def test_what_is_refused_changes_nothing_and_says_why(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    told: list[str] = []
    end = space.listen(lambda: told.append(space.notice.text))
    assert not space.do({"do": "polygon", "corners": [[10, 10], [90, 90], [90, 10], [10, 90]]})
    assert told == ["Region 'region 1' crosses itself at x 50, y 50: give its corners in order around it"]
    assert space.drawing.shapes == ()
    end()
    space.do({"do": "nonsense"})
    assert len(told) == 1


def test_proposals_wait_for_a_person(image: PageImage, later: Later, tmp_path: Path) -> None:
    space = workspace(image, later, tmp_path / "r.json")
    space.propose([RectangleShape("r", 10, 10, 20, 20), PolygonShape("p", ((50, 50), (70, 50), (50, 70)))], "Found")
    assert space.notice.text == "Found: 2 regions proposed. They count once you accept them."
    assert (space.drawing.rois, space.unsaved) == ((), False)
    space.do({"do": "select", "name": "p"})
    assert space.selected == "p"
    space.do({"do": "accept", "name": "p"})
    space.do({"do": "discard"})
    assert [roi.name for roi in space.drawing.rois] == ["p"]
    space.do({"do": "undo"})
    space.do({"do": "accept all"})
    assert [roi.name for roi in space.drawing.rois] == ["p", "r"]


def test_a_kept_drawing_of_another_image_is_not_taken(tmp_path: Path) -> None:
    files = DrawingFiles(tmp_path / "r.json", (WIDTH, HEIGHT))
    save_regions(files.unsaved, [RectangleShape("r", 1, 1, 5, 5)], (100, 100))
    with pytest.raises(InputError, match=r"100 x 100 pixels.*holds what was drawn and not saved"):
        files.kept()


@pytest.mark.parametrize(
    ("name", "message"),
    [("r.txt", "has no known end"), ("none/r.json", "is no folder"), ("folder.json", "is a folder")],
)
def test_outputs_that_cannot_be_written_are_refused_before_anything_is_drawn(
    tmp_path: Path, name: str, message: str
) -> None:
    (tmp_path / "folder.json").mkdir()
    with pytest.raises(InputError, match=message):
        DrawingFiles(tmp_path / name, (10, 10))


def test_the_pointer_reads_dn_and_luminance(image: PageImage) -> None:
    assert image.readout(50.9, 100.2) == "x 50, y 100 · DN 12340 · 123.4 cd/m²"
    assert image.readout(0, 0).endswith("cd/m² · saturated")
    assert image.readout(-0.1, 3) == ""
    assert image.readout(WIDTH, 3) == ""


def test_the_pointer_names_the_colour_behind_which_a_pixel_is() -> None:
    dn = np.arange(64, dtype=np.uint16).reshape(8, 8)
    light = np.arange(16, dtype=np.float32).reshape(4, 4)
    none = np.zeros((4, 4), dtype=np.uint8)
    luminance = LuminanceMap(light, np.zeros_like(light), 0.0, none, step=2)
    image = PageImage("a", dn, True, "GR", luminance, "relative")
    assert [image.readout(x, y).split(" · ")[1] for x, y in ((2, 2), (3, 2), (2, 3), (3, 3))] == [
        "DN 18 (G)", "DN 19 (R)", "DN 26 (B)", "DN 27 (G)",
    ]  # fmt: skip
    assert image.readout(7, 7).endswith("light 15.00")
    assert image.display.tolist() == dn.reshape(4, 2, 4, 2).mean(axis=(1, 3)).tolist()
    assert image.saturated.shape == (8, 8)
