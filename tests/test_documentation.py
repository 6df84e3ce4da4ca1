"""The commands of README and docs are as written: all are known with their options, and those of some pages run."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp import Session
from labcdp.cli.commands import all_commands
from labcdp.regions import RectangleShape, save_regions
from labcdp.session import example_session

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path.relative_to(ROOT)
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md"))
    if "generated" not in path.parts
)
#: Pages whose commands run in one folder, one after the other.
RUN = (
    "README.md",
    "docs/tutorial/bench.md",
    "docs/howto/choose-a-sensor.md",
    "docs/howto/luminance-map.md",
    "docs/howto/picture.md",
)
#: Commands that serve a page until Ctrl-C.
SERVE = ("bench", "rois", "view")


def blocks(page, language):
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def commands(page):
    return [line for block in blocks(page, "sh") for line in block.splitlines() if line.startswith("labcdp ")]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)], ids=str)
def test_every_command_and_option_is_known(page):
    known = all_commands()
    for line in commands(page):
        _, name, *arguments = shlex.split(line, comments=True)
        # Raises a usage error for an unknown option or a missing argument; nothing runs.
        known[name].make_context(name, arguments)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_every_link_to_a_file_leads_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    targets = [target for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text) if ":" not in target]
    folder = ROOT / page.parent
    missing = [one for one in targets if not (folder / one).exists() and "generated" not in one]
    assert missing == []


@pytest.fixture
def folder(tmp_path, monkeypatch, request):
    """Pictures, a video, regions and, but for pages that record their own, a session, as a reader would have them."""
    rng = np.random.default_rng(5)
    scene = cv2.GaussianBlur(rng.normal(60, 40, (240, 320)), (0, 0), 3)
    scene[80:140, 100:150], scene[80:140, 150:200] = 160, 80
    frames = [np.clip(scene + rng.normal(0, 3, scene.shape), 0, 255).round().astype(np.uint8) for _ in range(4)]
    (tmp_path / "drive").mkdir()
    for name, frame in zip(("night", "board", "drive/1", "drive/2"), frames, strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.png"), frame)
    video = cv2.VideoWriter(str(tmp_path / "drive.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 10, (320, 240), False)
    for frame in frames:
        video.write(frame)
    video.release()
    regions = [RectangleShape("white", 105, 85, 40, 50), RectangleShape("grey", 155, 85, 40, 50)]
    save_regions(tmp_path / "rois.json", regions, image_size=(320, 240))
    if request.node.callspec.params["page"] == "docs/howto/luminance-map.md":
        shutil.copytree(example_session(), tmp_path / "my-session")
        shutil.copy(min((example_session() / "frames").glob("*light*")), tmp_path / "frame.tif")
        Session.open(example_session()).calibrate().save(tmp_path / "calibration.json")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    return tmp_path


def run(folder, line):
    """Run a command of a page; one that serves a page is ended by Ctrl-C once it has an address."""
    words = shlex.split(line, comments=True)
    if words[1] not in SERVE:
        done = subprocess.run(["bash", "-c", line], cwd=folder, capture_output=True, text=True, timeout=900)
        assert done.returncode == 0, f"{line}\n{done.stdout}{done.stderr}"
        return
    with subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True) as process:
        said = ""
        while "Open: http" not in said:
            text = process.stderr.readline()
            assert text, f"{line}\n{said}"
            said += text
        process.send_signal(signal.SIGINT)
        process.stderr.read()


@pytest.mark.long
@pytest.mark.parametrize("page", RUN)
def test_commands_run_as_written(folder, page):
    text = (ROOT / page).read_text(encoding="utf-8")
    for name, content in re.findall(r"Save this as `([^`]+)`.*?^```toml\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        (folder / name).write_text(content)
    for line in commands(page):
        run(folder, line)
    program = "\n".join(blocks(page, "python"))
    subprocess.run([sys.executable, "-c", program], cwd=folder, check=True, env=os.environ | {"MPLBACKEND": "Agg"})
