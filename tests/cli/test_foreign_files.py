"""No command deletes, replaces or alters a file that labcdp did not write, whatever its name."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp.calibration import load, save
from labcdp.cli.app import app
from labcdp.core.errors import LabcdpError
from labcdp.output import LIST_FILE
from labcdp.regions import RectangleShape, save_regions
from labcdp.session import example_session

CHAIN = """
name = "small"
[scene]
type = "checkerboard"
width = 24
height = 16
luminance_cd_m2 = 50.0
contrast = 0.5
square_px = 4
[optics]
f_number = 2.0
transmittance = 0.9
[exposure]
exposure_s = 0.005
[sensor]
pixel_pitch_m = 4e-6
quantum_efficiency = 0.6
full_well_e = 10000
k_dn_per_e = 0.3
read_noise_e = 4.0
dark_current_e_s = 5.0
bits = 12
black_level_dn = 32.0
"""

#: Fewer patches than the session has, which are quicker.
FEW = [text for i in range(1, 13) if i not in (1, 5) for text in ("--without", f"P{i:02}")]

#: Commands with folders of results, and their inputs.
FOLDERS = {
    "calibrate": ["s"],
    "evaluate": ["s", "--calibration", "c/calibration.json"],
    "characterise": ["s"],
    "verify": ["c/calibration.json", "s"],
    "twin": ["s", *FEW],
    "image": ["a.png", "--roi", "rois.json"],
    "image-map": ["a.png", "--region-size", "10"],
    "video": ["a.avi", "--roi", "rois.json", "--method", "fixed", "--annotated", "--frames"],
    "simulate": ["small.toml"],
    "sweep": ["small.toml", "--exact", "--over", "scene.contrast=0.2,0.5"],
    "reproduce": ["thesis", "--seeds", "5"],
    "demo": [],
}

#: Commands that are only refused here.
SLOW = ("demo", "evaluate", "reproduce", "twin", "characterise")

#: Commands with single files.
FILES = {
    "luminance": (["c/calibration.json", "s"], "--output", ".tif"),
    "luminance --preview": (["c/calibration.json", "s", "--output", "new.npz"], "--preview", ".png"),
    "history": (["c"], "--output", ".html"),
    "rois": (["a.png", "--roi", "rois.json", "--detect", "superpixels", "--no-page"], "--output", ".json"),
    "snap": ([], "", ".tif"),
    "init": (["bench"], "", ".toml"),
}

INPUTS = {"a.png", "a.avi", "rois.json", "small.toml", "s", "c"}

#: What commands write, and other names.
USUAL = (
    *("report.html", "results.json", "results.xlsx", "results.nc", "chain.toml", "calibration.json", "session/x"),
    *("figures/target.png", "images/sensor.png", "map.png", "a.png", ".hidden", "sub/a.png", "video.jsonl"),
    *("sweep.jsonl", ".labcdp-unfinished/a.png", ".labcdp-0123456789abcdef.part", "annotated.mp4", "twin.png"),
)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Small inputs for all commands."""
    folder = tmp_path_factory.mktemp("inputs")
    rng = np.random.default_rng(0)
    picture = np.clip(rng.normal(60, 3, (48, 64)) + 100 * (np.arange(64) > 32), 0, 255).astype(np.uint8)
    cv2.imwrite(str(folder / "a.png"), picture)
    save_regions(folder / "rois.json", [RectangleShape("dark", 4, 4, 12, 12), RectangleShape("bright", 44, 4, 12, 12)])
    writer = cv2.VideoWriter(str(folder / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (64, 48))
    for _ in range(3):
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    (folder / "small.toml").write_text(CHAIN)
    shutil.copytree(example_session(), folder / "s")
    app(["calibrate", str(folder / "s"), "--output", str(folder / "c")], standalone_mode=False)
    # As if it was made from another session: its own one verifies nothing.
    calibration = load(folder / "c" / "calibration.json")
    provenance = replace(calibration.provenance, input_sha256="0" * 64)
    (folder / "c" / "calibration.json").unlink()
    save(replace(calibration, provenance=provenance), folder / "c" / "calibration.json")
    return folder


@pytest.fixture
def work(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A current folder with the inputs, which all stay as they are."""
    shutil.copytree(inputs, tmp_path / "work")
    monkeypatch.chdir(tmp_path / "work")
    before = contents(inputs)
    yield tmp_path / "work"
    after = contents(tmp_path / "work")
    assert {name: after.get(name) for name in before} == before


def contents(folder: Path) -> dict[str, bytes | str]:
    """All that is in a folder: content of files, targets of links."""
    found: dict[str, bytes | str] = {}
    for path in folder.rglob("*"):
        if path.is_symlink():
            found[str(path.relative_to(folder))] = os.readlink(path)
        elif path.is_file():
            found[str(path.relative_to(folder))] = path.read_bytes()
    return found


def run(command: str, *arguments: str) -> str:
    """Run a command in this process; returns its error, if any."""
    try:
        app([command.split()[0], *arguments], standalone_mode=False)
    except LabcdpError as error:
        return str(error)
    return ""


def put_foreign(folder: Path, names: tuple[str, ...]) -> dict[str, bytes | str]:
    """Put files, and links, of these names into a folder where the names are free."""
    (folder.parent / "elsewhere").mkdir()
    for number, name in enumerate(names):
        path = folder / name
        if not os.path.lexists(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.symlink_to(folder.parent / "elsewhere") if number % 5 == 4 else path.write_text(f"mine {name}")
    return contents(folder)


@pytest.mark.parametrize("command", FOLDERS)
def test_a_folder_of_others_is_refused_before_any_work(command: str, work: Path) -> None:
    before = put_foreign(work / "out", USUAL)
    for force in ([], ["--force"]):
        for output in ("out", ".", "", "small.toml", "a.png"):
            error = run(command, *FOLDERS[command], "--output", output, *force)
            assert "give another --output" in error, (output, error)
    assert contents(work / "out") == before
    assert {path.name for path in work.iterdir()} == INPUTS | {"elsewhere", "out"}


@pytest.mark.parametrize("command", [name for name in FOLDERS if name not in SLOW])
def test_results_are_replaced_with_force_only_and_other_files_stay(command: str, work: Path) -> None:
    assert run(command, *FOLDERS[command], "--output", "out") == ""
    first = contents(work / "out")
    before = put_foreign(work / "out", USUAL)
    foreign = {name: data for name, data in before.items() if name not in first}
    assert "out already has results: give --force" in run(command, *FOLDERS[command], "--output", "out")
    assert contents(work / "out") == before
    assert run(command, *FOLDERS[command], "--output", "out", "--force") == ""
    after = contents(work / "out")
    assert set(after) == set(before)
    assert {name: after[name] for name in foreign} == foreign
    changed = next(name for name in first if name != LIST_FILE)
    (work / "out" / changed).write_bytes(b"mine")
    before = contents(work / "out")
    assert "was changed since labcdp wrote it" in run(command, *FOLDERS[command], "--output", "out", "--force")
    assert contents(work / "out") == before
    assert contents(work / "elsewhere") == {}


@pytest.mark.parametrize("command", FILES)
@pytest.mark.parametrize("kind", ["file", "folder", "link", "nowhere"])
def test_an_existing_file_is_refused_before_any_work(command: str, kind: str, work: Path) -> None:
    arguments, option, suffix = FILES[command]
    path = work / f"mine{suffix}"
    make: dict[str, Callable[[], object]] = {
        "file": lambda: path.write_text("mine"),
        "folder": path.mkdir,
        "link": lambda: path.symlink_to("a.png"),
        "nowhere": lambda: path.symlink_to("nowhere"),
    }
    make[kind]()
    before = contents(work)
    assert f"mine{suffix}" in run(command, *arguments, *([option] if option else []), path.name)
    assert contents(work) == before


@pytest.mark.parametrize("option", ["--output", "--preview"])
def test_an_input_is_not_replaced_even_with_force(option: str, work: Path) -> None:
    frame = next((work / "s" / "frames").iterdir())
    os.link(frame, work / "mine.png")
    given = {"--output": "new.npz"} | {option: "mine.png" if option == "--preview" else str(frame)}
    options = [text for pair in given.items() for text in pair]
    assert "is an input of this command" in run("luminance", "c/calibration.json", str(frame), *options, "--force")
    assert not (work / "new.npz").exists()


def test_a_frame_of_the_session_that_is_read_is_not_replaced_even_with_force(work: Path) -> None:
    frame = next((work / "s" / "frames").iterdir())
    before = frame.read_bytes()
    assert "is an input of this command" in run("luminance", "c/calibration.json", "s", "-o", str(frame), "--force")
    assert frame.read_bytes() == before


def test_a_region_file_of_another_program_is_not_changed(work: Path) -> None:
    save_regions(work / "imagej.zip", [RectangleShape("a", 2, 2, 8, 8)])
    before = (work / "imagej.zip").read_bytes()
    run("rois", "a.png", "--no-page", "--detect", "superpixels", "--roi", "imagej.zip")
    assert (work / "imagej.zip").read_bytes() == before


def test_a_bad_preview_is_refused_before_the_map_is_written(work: Path) -> None:
    assert "--preview" in run("luminance", "c/calibration.json", "s", "--output", "new.npz", "--preview", "a.jpg")
    assert not (work / "new.npz").exists()


@pytest.mark.parametrize("command", [name for name in FOLDERS if name != "demo"])
def test_the_default_folder_says_input_and_command(command: str, work: Path) -> None:
    name = Path(FOLDERS[command][-1 if command == "verify" else 0]).stem
    (work / f"{name}-{command}").mkdir()
    (work / f"{name}-{command}" / "mine").touch()
    assert f"{name}-{command} has files and no {LIST_FILE}" in run(command, *FOLDERS[command])


def test_an_existing_file_is_replaced_with_force(work: Path) -> None:
    (work / "mine.toml").write_text("mine")
    assert run("init", "chain", "mine.toml", "--force") == ""
    assert run("simulate", "mine.toml", "--set", "sensor.width=a", "--output", "new") != ""
    assert (work / "mine.toml").read_text() != "mine"
    assert not (work / "new").exists()


def test_a_session_is_not_begun_among_files_of_others(work: Path) -> None:
    before = put_foreign(work / "out", USUAL)
    assert "out" in run("acquire", "s/session.toml", "out", "--simulated", "--virtual-clock")
    assert contents(work / "out") == before
