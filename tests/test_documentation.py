"""The commands and programs of README and docs run as written, on a reader's files; devices are simulated."""

import inspect
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from importlib import import_module
from io import StringIO
from pathlib import Path

import cv2
import numpy as np
import pytest

from labcdp import Session
from labcdp.cli.commands import all_commands
from labcdp.regions import RectangleShape, save_regions
from labcdp.session import example_session

from .chart_picture import make_picture
from .evaluate.bench.synthetic import again
from .evaluate.bench.test_tone_curve import bench_of
from .files.conftest import write_dng
from .metrics.slanted_edges import edge_image
from .series_camera import SeriesCamera, write_bench

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path.relative_to(ROOT)
    for path in (ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").rglob("*.md"))
    if "generated" not in path.parts
)
#: Stands for the examples that the help of commands gives.
HELP = "help"
#: Commands that serve a page until Ctrl-C.
SERVE = ("bench", "rois", "view")
#: Exit statuses that are answers: undecided, and a fault of the computer that tests run on.
VERDICTS = {"verify": (0, 4), "doctor": (0, 1)}
#: Names of real devices on the pages.
REAL = re.compile("/dev/ttyUSB0|50-0503363706|169.254.12.7")
#: Not run: it needs other computers; tests/evaluate/video/test_archive.py has workers with TLS on this one.
NOT_RUN = "--cluster tls://"
SMALL = f"--simulated-bench {ROOT / 'tests/cli/small-bench.toml'}"
#: What stands for real devices: in acquisitions and the live bench a simulated bench, else the wire of one.
STAND_INS = (
    (r"(labcdp (?:acquire|bench) .*)--meter /dev/ttyUSB0", r"\1--simulated"),
    (r"(labcdp verify .*\.toml check-1)(?! --sim)", rf"\1 {SMALL}"),
)
#: What was done before the commands of a page.
BEFORE = {
    "docs/howto/bench.md": "labcdp init simulated-bench my-bench.toml",
    "docs/howto/compare.md": "labcdp calibrate spring; labcdp calibrate autumn",
    "docs/reference/picture-files.md": "labcdp init camera camera.toml",
    HELP: """
        labcdp calibrate my-session; labcdp init chain my-chain.toml; cp night.png night-1.png
        labcdp luminance calibration.json my-session --output target.exr""",
    # The camera and the lens of the RAW files.
    "docs/howto/calibrate.md": "sed -i '/= .Manta/d; s/^f_n.*/f_number = 2.8/; s/^foc.*/focal_length_m = 0.05/' *.toml",
}


def blocks(page, language):
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)


def test_examples_print_what_is_next_to_them():
    (block,) = blocks("docs/reference/metrics.md", "python")
    with redirect_stdout(StringIO()) as output:
        exec(block, {})
    lines = [line for line in block.splitlines() if line.startswith("print")]
    both = zip(lines, output.getvalue().splitlines(), strict=True)
    said = [(line.split("# ")[1], printed) for line, printed in both if "# " in line]
    assert len(said) >= 2
    assert all(one == printed for one, printed in said)


def commands(page):
    if page == HELP:
        return [line for one in all_commands().values() for line in re.findall("^Example: (.*)", one.help, re.M)]
    return [line for block in blocks(page, "sh") for line in block.splitlines() if line.startswith("labcdp ")]


@pytest.mark.parametrize("page", [page for page in (*PAGES, HELP) if commands(page)], ids=str)
def test_every_command_and_option_is_known(page):
    known = all_commands()
    for line in commands(page):
        _, name, *arguments = shlex.split(line, comments=True)
        # Raises a usage error for an unknown option or a missing argument; nothing runs.
        known[name].make_context(name, arguments)


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_commands_in_sentences_are_known_with_their_options(page):
    known = all_commands()
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    for name, rest in re.findall(r"`labcdp ([a-z][a-z-]*)([^`]*)`", text):
        options = {one for option in known[name].params for one in (*option.opts, *option.secondary_opts)}
        assert set(re.findall(r"(?<= )--[a-z-]+", rest)) <= options, name


def test_every_name_that_pages_import_is_in_the_reference():
    source = (ROOT / "docs/extensions/pages_from_code.py").read_text(encoding="utf-8")
    modules = [import_module(name) for name in re.findall(r"^    \"(labcdp[\w.]*)\": \"", source, re.M)]
    (public,) = re.findall('^PUBLIC = r"(.*)"$', source, re.M)
    names = {one: getattr(one, "__all__", None) or re.findall(public, inspect.getsource(one), re.M) for one in modules}
    documented = {id(getattr(module, name)) for module in modules for name in names[module]}
    pages = [*PAGES, *(path.relative_to(ROOT) for path in (ROOT / "examples").glob("*.md"))]
    for page in pages:
        text = (ROOT / page).read_text(encoding="utf-8")
        for module, names in re.findall(r"^ *from (labcdp[\w.]*) import ([\w, ]+)$", text, re.M):
            things = {name: id(getattr(import_module(module), name)) for name in names.split(", ")}
            assert {name for name, thing in things.items() if thing not in documented} == set(), page


def outputs():
    """What the reference says each command writes into its folder, of one picture or video."""
    rows = re.findall(r"^\| `([a-z-]+)` \| (.*?) \| .*\|$", (ROOT / "docs/reference/results.md").read_text(), re.M)
    of_one = {name: text.partition("; of several")[0] for name, text in rows if name in all_commands()}
    return {name: re.findall(r"`([a-z-]+\.[a-z]+)`", text) for name, text in of_one.items()}


def test_what_each_command_writes_is_documented():
    assert list(outputs()) == list(all_commands())


@pytest.mark.parametrize("page", PAGES, ids=str)
def test_every_link_to_a_file_leads_somewhere(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    targets = [target for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text) if ":" not in target]
    folder = ROOT / page.parent
    missing = [one for one in targets if not (folder / one).exists() and "generated" not in one]
    assert missing == []


def record(path, session, change):
    """Write the session anew, with its frames changed."""
    again(path, session, lambda frames: ((change(one, role), role, None) for one, role in frames))


def even(frame, role):
    """Of uniform light."""
    noise = np.random.default_rng(frame.frame_id).normal(0, 1, frame.dn.shape)
    return replace(frame, dn=((130 if role == "light" else 4) + noise).round().astype(np.uint8))


@pytest.fixture(scope="module")
def reader(tmp_path_factory):
    """What readers have: sessions of a camera of 8 bits, its calibration, pictures and videos of it, and regions."""
    folder = tmp_path_factory.mktemp("reader")
    eight = {"bit_depth": 8, "saturation_dn": 255.0, "pixel_format": "Mono8"}
    sessions = {
        "even": even,
        "day2-at-6dB": lambda one, _: replace(one, gain_db=6.02, exposure_s=one.exposure_s / 2),
        "day3-warm": lambda one, _: replace(one, temperature_c=45.0),
    }
    with Session.open(example_session()) as example:
        shutil.copy(example.path / "session.toml", folder / "bench.toml")
        record(folder / "my-session", example, lambda one, _: replace(one, dn=(one.dn >> 4).astype(np.uint8), **eight))
    session = Session.open(folder / "my-session")
    for name, change in sessions.items():
        record(folder / name, session, change)
    session.calibrate().save(folder / "calibration.json")
    bench_of(folder / "gamma-session")
    readings = [f"{one.patch};{one.reading.luminance_cd_m2:.4g}" for one in session.readings()]
    (folder / "meter.csv").write_text("\n".join(["patch;luminance_cd_m2", *readings]))
    with Session.open(example_session()) as example:
        for number, one in enumerate(example.frames()):
            frame = example.load(one)
            path = folder / "raw" / one.role / f"{number}.NEF"
            path.parent.mkdir(exist_ok=True, parents=True)
            write_dng(path, frame.dn, exposure=(1, round(1 / frame.exposure_s)), cfa=(1, (0,)))
    for name in ("day1", "spring", "autumn", "my-drive"):
        shutil.copytree(folder / "my-session", folder / name)
    shutil.copy(folder / "calibration.json", folder / "camera.json")
    recorded = [one for one in session.frames("light") if one.exposure_s == 0.008]
    shown = [session.load(one).dn for one in recorded]
    for name in ("night", "bench", "before", "after", "drive/1", "drive/2"):
        (folder / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(folder / f"{name}.png"), shown[name in ("after", "drive/2")])
    shutil.copy(session.path / recorded[0].file.name, folder / "frame.tif")
    darkest = min(session.frames("light"), key=lambda one: one.exposure_s)
    for name, one in (("lamp-1", darkest), ("lamp-2", recorded[0]), ("direct", darkest)):
        shutil.copy(session.path / one.file.name, folder / f"{name}.tif")
    (folder / "archive").mkdir()
    for name in ("drive.mp4", "archive/a.mp4", "archive/b.mp4", "checkerboard.avi"):
        code = "mp4v" if "mp4" in name else "MJPG"
        video = cv2.VideoWriter(str(folder / name), cv2.VideoWriter.fourcc(*code), 10, (480, 400), False)
        for number in range(110 if name == "drive.mp4" else 5):
            video.write(shown[number % 2])
        video.release()
    board = (np.indices((400, 480)) // 40).sum(axis=0) % 2 * 100 + 50
    cv2.imwrite(str(folder / "board.png"), board.astype(np.uint8))
    white, grey = RectangleShape("white", 160, 120, 60, 60), RectangleShape("grey", 260, 120, 60, 60)
    save_regions(folder / "rois.json", [white, grey], image_size=(480, 400))
    save_regions(folder / "lamp.json", [RectangleShape("lamp", 160, 120, 60, 60)], image_size=(480, 400))
    for number in (1, 2):
        make_picture(folder / f"chart-{number}.tif", seed=number)
    light = np.full((400, 480), 400.0)
    light[150:250, 210:270] = edge_image(100, 60, 5, 0.7, 400, 1600)
    noisy = 64 + np.random.default_rng(4).normal(light, 5)
    cv2.imwrite(str(folder / "edges.tif"), noisy.round().astype(np.uint16))
    save_regions(folder / "edges.json", [RectangleShape("middle", 210, 150, 60, 100)], image_size=(480, 400))
    series_camera = SeriesCamera(exposures_s=(0.032,))
    write_bench(folder / "front", series_camera, encoding=None)
    rows, columns = series_camera.shape
    (_, dark), (_, bright) = list(series_camera.regions().items())[6:8]
    shapes = [RectangleShape("bright", *bright), RectangleShape("dark", *dark)]
    save_regions(folder / "front-rois.json", shapes, image_size=(columns, rows))
    return folder


@pytest.fixture
def folder(reader, tmp_path, monkeypatch):
    """The files of a reader, for one page."""
    shutil.copytree(reader, tmp_path, dirs_exist_ok=True)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


@pytest.fixture
def devices():
    """The wire of a simulated bench: names that stand for those of a reader's devices."""
    with subprocess.Popen(["labcdp", "simulate-bench", "--json"], stdin=-1, stdout=-1, text=True) as bench:
        text = ""
        while not text.endswith("\n}\n"):
            text += bench.stdout.readline()
        camera, meter = json.loads(text)["tables"]["devices"]["rows"]
        yield {"/dev/ttyUSB0": meter["address"], "50-0503363706": camera["serial"], "169.254.12.7": camera["address"]}
        bench.communicate("quit\n", timeout=60)


def run(folder, line):
    """Run a command of a page; one that serves a page is ended by Ctrl-C once it has an address."""
    words = shlex.split(line, comments=True)
    if words[1] not in SERVE or "--no-page" in words:
        # Enter for each manual step, and the end of what listens.
        said = {"input": "\n" * 99 + "quit\n", "capture_output": True, "text": True, "timeout": 600}
        done = subprocess.run(["bash", "-c", line], cwd=folder, check=False, **said)
        assert done.returncode in VERDICTS.get(words[1], (0,)), f"{line}\n{done.stdout}{done.stderr}"
        for results in folder.glob(f"*-{words[1]}"):
            assert {*outputs()[words[1]]} <= {one.name for one in results.iterdir()}, line
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
@pytest.mark.parametrize("page", [HELP, *(str(page) for page in PAGES if commands(page) or blocks(page, "python"))])
def test_commands_and_programs_run_as_written(folder, request, page):
    text = "" if page == HELP else (ROOT / page).read_text(encoding="utf-8")
    for name, content in re.findall(r"Save this as `([^`]+)`.*?^```toml\n(.*?)^```$", text, re.DOTALL | re.MULTILINE):
        (folder / name).write_text(content)
    lines = [line for line in commands(page) if NOT_RUN not in line]
    # What the page itself makes is not there before.
    made = re.findall(r"labcdp (?:init|acquire|import) \S+ (\S+)", "\n".join(lines))
    subprocess.run(["rm", "-rf", *made], cwd=folder, check=True)
    subprocess.run(["bash", "-ec", BEFORE.get(page, "")], cwd=folder, check=True)
    for pattern, stand_in in STAND_INS:
        lines = [re.sub(pattern, stand_in, line) for line in lines]
    program = "" if page == HELP else "\n".join(blocks(page, "python"))
    if REAL.search("\n".join([*lines, program])):
        names = request.getfixturevalue("devices")
        *lines, program = (REAL.sub(lambda found: names[found[0]], one) for one in (*lines, program))
    for line in lines:
        run(folder, line)
    subprocess.run([sys.executable, "-c", program], cwd=folder, check=True)


# The notebooks of examples/, as programs; make docs runs them as notebooks


EXAMPLES = sorted((ROOT / "examples").glob("*.md"))
_COMMAND = re.compile(r"^!(.*)$", re.MULTILINE)


def program(notebook):
    """The code cells of a notebook; a line that begins with ! is a command of the shell, with names in braces."""
    text = notebook.read_text(encoding="utf-8")
    cells = re.findall(r"^```\{code-cell\} ipython3\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    code = _COMMAND.sub(r"__import__('subprocess').run(f'''\1''', shell=True, check=True)", "\n".join(cells))
    return f"import warnings\nwarnings.simplefilter('error')\n{code}"


@pytest.mark.parametrize(
    "notebook",
    [pytest.param(one, marks=() if one.stem == "first-cdp" else pytest.mark.long, id=one.stem) for one in EXAMPLES],
)
def test_notebook_runs(tmp_path, notebook):
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    environment = os.environ | {"MPLBACKEND": "Agg", "PATH": path}
    subprocess.run([sys.executable, "-c", program(notebook)], cwd=tmp_path, env=environment, check=True, timeout=600)
