"""The drawing with its files and measurements, without a browser."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labcdp.core.errors import InputError
from labcdp.core.luminance import LuminanceMap
from labcdp.core.result import warning
from labcdp.metrics.pair import evaluate_pair
from labcdp.metrics.region import evaluate_region
from labcdp.regions import RectangleShape, load_regions, save_regions
from labcdp.web.regions.drawing import Drawing, History
from labcdp.web.regions.files import DrawingFiles, Start
from labcdp.web.regions.measurements import Measurements
from labcdp.web.regions.page_image import PageImage
from labcdp.web.regions.wording import pair_table, region_table, warning_list
from labcdp.web.regions.workspace import Workspace

from .conftest import HEIGHT, WIDTH, known_dn

BOX = {"do": "box", "kind": "rectangle", "start": [10, 10], "end": [90, 110]}
OTHER = {"do": "box", "kind": "rectangle", "start": [400, 10], "end": [480, 110]}


@pytest.fixture
def image() -> PageImage:
    light = known_dn().astype(np.float32) / 100
    flags = np.zeros(light.shape, dtype=np.uint8)
    flags[:5, :5] = 1
    luminance = LuminanceMap(light, np.full_like(light, 0.1), 0.02, flags)
    return PageImage("a <b>.png", known_dn(), True, None, luminance, "cd/m^2", (warning("camera-guessed"),))


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


@pytest.fixture
def space(image: PageImage, later: Later, tmp_path: Path) -> Workspace:
    """Workspace whose output is r.json."""
    start = Start(History(Drawing.of(image.size, ())), ())
    return Workspace(Measurements(image, [9.0]), DrawingFiles(tmp_path / "r.json", image.size), start, later)


def test_what_is_measured_is_what_labcdp_says(space: Workspace, image: PageImage, later: Later, tmp_path: Path) -> None:
    assert space.do(dict(BOX))
    assert space.do(dict(OTHER))
    later.run()
    a, b = space.drawing.rois
    result = evaluate_pair(image.luminance, a, b, [9.0])
    assert space.measured.pair is not None
    assert space.measured.pair.result == result
    assert space.measured.regions[a].result == evaluate_region(image.luminance, a)
    assert space.measured.regions[a].value == pytest.approx(known_dn()[10:110, 10:90].mean())
    assert space.measured.regions[a].value_std == pytest.approx(known_dn()[10:110, 10:90].std(ddof=1))
    assert space.measured.regions[a].light == pytest.approx(result.a.mean)
    table = region_table(image, space.drawing, space.measured, "region 1")
    assert "<td>8000</td>" in table
    assert f"{result.results[0].result.cdp:.3f}" in pair_table(space.drawing, space.measured)


def test_warnings_of_the_checks_are_shown_and_names_are_escaped(space, image, later, tmp_path):
    space.do({**BOX, "start": [0, 0]})
    space.do({"do": "rename", "name": "region 1", "to": "<i>&'"})
    later.run()
    said = warning_list(image, space.drawing, space.measured)
    assert "are saturated" in said
    assert "The camera parameters are guessed" in said
    assert "<i>" not in said + region_table(image, space.drawing, space.measured, None)


def test_what_is_not_saved_is_kept_and_the_next_run_has_it(space, image, later, tmp_path):
    space.do(dict(BOX))
    kept = DrawingFiles(tmp_path / "r.json", image.size).kept()
    assert kept == space.drawing.shapes
    assert space.last_words() == [
        f"Not saved: the drawing of 1 region; it is kept in {tmp_path / 'r.json.unsaved.json'}, and the same command "
        "resumes with it"
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


def test_a_file_that_somebody_else_changed_is_replaced_only_when_confirmed(space, image, later, tmp_path):
    path = tmp_path / "r.json"
    space.do(dict(BOX))
    # One that appears is another program's, too.
    path.write_text("mine")
    assert not space.do({"do": "save"})
    assert path.read_text() == "mine"
    path.unlink()
    assert space.do({"do": "save"})
    theirs = (RectangleShape("theirs", 1, 1, 5, 5),)
    save_regions(path, theirs, image.size, force=True)
    space.do(dict(OTHER))
    for _ in range(2):
        assert not space.do({"do": "save"})
        assert "was changed by another program since it was read, and is not replaced" in space.notice.text
        assert load_regions(path, image.size) == theirs
    assert space.do({"do": "save", "name": "mine.json"})
    assert len(load_regions(tmp_path / "mine.json", image.size)) == 2
    assert not space.do({"do": "save"})
    # What is confirmed is the replacement of what was seen, not of what came later.
    save_regions(path, (*theirs, RectangleShape("later", 9, 9, 5, 5)), image.size, force=True)
    assert not space.do({"do": "replace"})
    assert space.do({"do": "replace"})
    assert load_regions(path, image.size) == space.drawing.shapes
    assert not space.do({"do": "replace"})
    assert space.notice.text == "There is no file to replace: save the drawing"
    # A file that is gone is nobody's work.
    path.unlink()
    assert space.do({"do": "save"})


def test_proposals_that_are_there_already_are_not_proposed_again(space, image, later, tmp_path):
    space.do(dict(BOX))
    same, new = RectangleShape("found", 11, 10, 80, 100), RectangleShape("new", 50, 10, 80, 100)
    space.propose((same, new), "Step chart")
    assert space.notice.text == (
        "Step chart: 1 region proposed. They count once you accept them. 1 more exists already."
    )
    assert space.drawing.proposals == (new,)
    space.propose((same,), "Step chart")
    assert space.notice.text == "Step chart: the region exists already."
    assert space.drawing.proposals == ()


@pytest.mark.parametrize(
    ("name", "message"),
    [
        *((name, "") for name in ("other.zip", "other.json", "other.roi")),
        *((name, "not a plain file name") for name in ("../r.json", "/etc/r.json", "", ".r.json", "a\0.json")),
        ("r.txt", "has an unknown suffix"),
        ("there.json", "exists already"),
    ],
)
def test_other_files_are_written_next_to_the_output_and_nowhere_else(space, image, tmp_path, name, message):
    (tmp_path / "there.json").write_text("mine")
    space.do(dict(BOX))
    if space.do({"do": "save", "name": name}):
        assert message == ""
        assert load_regions(tmp_path / name, image.size)[0].rois()[0].corners == space.drawing.rois[0].corners
    else:
        assert message
        assert message in space.notice.text
    assert (tmp_path / "there.json").read_text() == "mine"


def test_a_kept_drawing_of_another_image_is_refused(tmp_path: Path) -> None:
    files = DrawingFiles(tmp_path / "r.json", (WIDTH, HEIGHT))
    save_regions(files.unsaved, [RectangleShape("r", 1, 1, 5, 5)], (100, 100))
    with pytest.raises(InputError, match=r"100 x 100 pixels.*holds what was drawn and not saved"):
        files.kept()


def test_the_pointer_reads_dn_and_luminance(image: PageImage) -> None:
    assert image.readout(50.9, 100.2) == "x 50, y 100 · DN 12340 · 123 ± 25 cd/m²"
    assert image.readout(0, 0).endswith("cd/m² · saturated")
    assert (image.readout(-0.1, 3), image.readout(WIDTH, 3)) == ("", "")
