"""No command deletes, replaces or alters a file that labcdp did not write, whatever its name."""

import os
import shutil
from pathlib import Path

import pytest

from labcdp.cli.app import app
from labcdp.cli.options import default_folder
from labcdp.core.errors import LabcdpError
from labcdp.output import LIST_FILE
from labcdp.regions import RectangleShape, save_regions

from ..conftest import valid
from ..output.test_results_folder import contents

#: Commands with folders of results, and their inputs.
FOLDERS = {
    "calibrate": ["s"],
    "evaluate": ["s", "--calibration", "c/calibration.json"],
    "characterise": ["s"],
    "verify": ["c/calibration.json", "s"],
    "twin": ["s"],
    "image": ["a.png", "--roi", "rois.json"],
    "image-map": ["a.png", "--region-size", "10"],
    "sfr": ["a.png", "--roi", "rois.json"],
    "flare": ["a.png", "--source", "rois.json"],
    "video": ["a.avi", "--roi", "rois.json", "--method", "fixed", "--annotated", "--frames"],
    "simulate": ["small.toml"],
    "sweep": ["small.toml", "--exact", "--over", "scene.contrast=0.2,0.5"],
    "reproduce": ["thesis", "--seeds", "5"],
    "compare": ["c", "c"],
    "history": ["c"],
    "demo": [],
}
#: Commands that do not take long.
FAST = ("image", "image-map", "simulate", "sweep")
#: Commands with single files.
FILES = {
    "luminance": (["c/calibration.json", "s"], ["--output"], ".tif"),
    "luminance --preview": (["c/calibration.json", "s", "--output", "new.npz"], ["--preview"], ".png"),
    "rois": (["a.png", "--roi", "rois.json", "--detect", "superpixels", "--no-page"], ["--output"], ".json"),
    "snap": ([], [], ".tif"),
    "init": (["bench"], [], ".toml"),
}
#: What commands write, and other names.
USUAL = (
    *("report.html", "results.json", "results.xlsx", "results.nc", "chain.toml", "calibration.json", "session/x"),
    *("figures/target.png", "images/sensor.png", "map.png", "a.png", ".hidden", "sub/a.png", "video.jsonl"),
    *("sweep.jsonl", ".labcdp-unfinished/a.png", ".labcdp-0123456789abcdef.part", "annotated.mp4", "twin.png"),
)


@pytest.fixture
def work(inputs, tmp_path, monkeypatch):
    """A current folder with the inputs, which all stay as they are."""
    shutil.copytree(inputs, tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    before = contents(inputs)
    yield tmp_path / "work"
    after = contents(tmp_path / "work")
    assert {name: after.get(name) for name in before} == before


def run(command, *arguments):
    """Run a command in this process; returns its error, if any."""
    try:
        app([command.split()[0], *map(str, arguments)], standalone_mode=False)
    except LabcdpError as error:
        return str(error)
    return ""


def put_foreign(folder, names=USUAL):
    """Put files, and links, of these names into a folder where the names are free; returns what is in it."""
    (folder.parent / "elsewhere").mkdir()
    for number, name in enumerate(names):
        path = folder / name
        if not os.path.lexists(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.symlink_to(folder.parent / "elsewhere") if number % 5 == 4 else path.write_text(f"mine {name}")
    return contents(folder)


@pytest.mark.parametrize("command", FOLDERS)
def test_a_folder_of_others_is_refused_before_any_work(command, work):
    put_foreign(work / "out")
    source = Path([*FOLDERS[command], "labcdp"][1 if command == "verify" else 0])
    folder = default_folder(work / source, command).name
    (work / folder).mkdir()
    (work / folder / "mine").touch()
    before = contents(work)
    for output in ("out", ".", "", "small.toml", "a.png"):
        for force in ([], ["--force"]):
            error = run(command, *FOLDERS[command], "--output", output, *force)
            assert "another folder" in error, (output, error)
    # The default folder says input and command.
    assert f"{folder} contains files but no {LIST_FILE}" in run(command, *FOLDERS[command])
    assert contents(work) == before


@pytest.mark.parametrize("command", FAST)
def test_results_are_replaced_with_force_only_and_other_files_stay(command, work, capsys):
    command_line = (command, *FOLDERS[command], "--output", "out")
    assert run(*command_line, "--json") == ""
    printed = capsys.readouterr().out
    assert valid(printed)["kind"] == command
    assert (work / "out/results.json").read_text() == printed
    first = contents(work / "out")
    before = put_foreign(work / "out")
    assert "out already has results" in run(*command_line)
    assert contents(work / "out") == before
    assert run(*command_line, "--force") == ""
    after = contents(work / "out")
    assert set(after) == set(before)
    assert {name: after[name] for name in before if name not in first} == {
        name: data for name, data in before.items() if name not in first
    }
    assert contents(work / "elsewhere") == {}


@pytest.mark.parametrize("command", FILES)
def test_an_existing_file_is_refused_before_any_work(command, work):
    arguments, option, suffix = FILES[command]
    file, folder, link, nowhere = (work / f"mine-{kind}{suffix}" for kind in ("file", "folder", "link", "nowhere"))
    file.write_text("mine")
    folder.mkdir()
    link.symlink_to("a.png")
    nowhere.symlink_to("nowhere")
    before = contents(work)
    for path in (file, folder, link, nowhere):
        assert path.name in run(command, *arguments, *option, path.name)
        assert contents(work) == before


def test_force_replaces_an_existing_file_but_no_input(work):
    (work / "mine.toml").write_text("mine")
    assert run("init", "chain", "mine.toml", "--force") == ""
    assert (work / "mine.toml").read_text() != "mine"
    frame = next((work / "s" / "frames").iterdir())
    os.link(frame, work / "mine.png")
    save_regions(work / "imagej.zip", [RectangleShape("a", 2, 2, 8, 8)])
    before = contents(work)
    for session, output in (
        (frame, ["--output", frame]),
        (frame, ["--output", "new.npz", "--preview", "mine.png"]),
        ("s", ["--output", frame]),
    ):
        error = run("luminance", "c/calibration.json", session, *output, "--force")
        assert "is an input of this command" in error
        assert contents(work) == before
    # Nor is a region file of another program.
    run("rois", "a.png", "--no-page", "--detect", "superpixels", "--roi", "imagej.zip")
    assert contents(work)["imagej.zip"] == before["imagej.zip"]


def test_a_session_is_not_begun_among_files_of_others(work):
    before = put_foreign(work / "out")
    assert "out" in run("acquire", "s/session.toml", "out", "--simulated", "--virtual-clock")
    assert contents(work / "out") == before
