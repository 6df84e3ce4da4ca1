"""What a tired person types: each gets one line that names it, exit status 1, and leaves nothing behind."""

import errno
import json
import shlex
import shutil
import subprocess
from dataclasses import replace
from unittest.mock import Mock

import pytest
import typer

from labcdp.cli.app import app, main
from labcdp.cli.bench import devices
from labcdp.cli.commands import all_commands
from labcdp.regions import RectangleShape, load_regions, save_regions
from labcdp.session import Session, SessionConfiguration

from ..evaluate.bench.synthetic import again
from .conftest import only_line

#: Commands and what their refusal names.
REFUSED = (
    ("info ''", "the argument after info is empty"),
    ("image a.png --output=", "is empty: give a value"),
    ("image a.png --roi rois.json --pair bright:sky", "there is no 'sky': choose from"),
    ("info none.csv", "none.csv does not exist"),
    ("meter --meter /dev/no-such-port", "there is no such serial port"),
    ("calibrate empty", "empty is not a session"),
    ("calibrate s --output file/results", "file/results lies inside a file"),
    ("calibrate cut", "0001_light_2ms.tif"),
    ("calibrate unlit", "no light frames: uncover the lens"),
    ("evaluate s", "run 'labcdp calibrate"),
    ("evaluate s --recalibrate --contrast 5% --pair P02:P77", "there is no 'P77'"),
    ("acquire s/session.toml own", "no serial port for the meter: give --meter, or meter.port"),
    ("acquire s/session.toml begun --replay s", "begun already has frames or readings"),
    ("simulate-bench s/session.toml --faults faults.txt", "faults.txt, line 2: 'vanisch' is not a known fault"),
    ("simulate-bench --simulated-bench key.toml", "sensor.black_level is not a known key: did you mean"),
    ("verify c/calibration.json s --tolerance 0%", "tolerance_rel is 0.0"),
    ("luminance c/calibration.json s -o a.jpg", "ends in .tif, .tiff, .exr, .npz"),
    ("luminance c/calibration.json s -o a.npz --only-exposure 5ms", "it has 2ms, 8ms, 32ms"),
    (f"image {1000 * 'a/'}b.png --roi rois.json", "a/a/..."),
    ("init bench s/session.toml --force", "is part of a recorded session"),
    ("compare a.png a.png", "give its regions, or"),
    # A frame of it is damaged, which nobody comes to know.
    ("compare cut small.toml", "cut is a session, but small.toml is a chain"),
    ("image a.avi", "a.avi is a video (AVI), not a picture: evaluate it with labcdp video"),
    ("video a.png", "a.png is a picture (PNG), not a video: evaluate it with labcdp image"),
    ("verify c/calibration.json s --tolerance 3", "give a number with a percent sign, for example 3%"),
    ("simulate small.toml --set scene.contrast=30", 'which would be 3000 %: give it with its sign, "30%" or "3000%"'),
    ("sweep small.toml --exact --over scene.contrast=10,50", "which would be 5000 %"),
    ("twin dark", "no dark frames: cover the lens"),
    ("calibrate begun", "no frames: start the acquisition"),
    ("calibrate s coloured", "some of the sessions have colour filters, others have none"),
    ("evaluate s --recalibrate --against rows.json", "in tables luminance rows: 16 values instead of 15 values"),
    ("evaluate s --recalibrate --against row.json", "in tables luminance rows 2 patch: 'P02' instead of 'P77'"),
    ("evaluate s --recalibrate --against finding.json", "first in findings"),
    ("evaluate s --recalibrate --against table.json", "in tables luminance: 3 values instead of None"),
    ("info column.json", "column.json is not as labcdp writes results (key tables.luminance.columns.0.name"),
    (f"info {100_000 * 'a'}", 60 * "a" + "..." + 32 * "a" + " cannot be used (File name too long)"),
    ("image-map a.png --region-size 9", "region size is 9 pixels"),
    ("video a.avi --roi three.json", "three.json holds 3 regions"),
    ("video a.avi --roi rois.json --contrast=-5%", "--contrast is '-5%': give contrasts above 0%"),
    ("rois a.png -o rois.txt", "rois.txt has an unknown suffix"),
    ("rois a.avi --frame 9", "a.avi has 3 frames, 0 to 2, and none at 9: choose another with --frame"),
    ("bench --simulated --contrast 10%:200%:51", "51 target contrasts: the page shows at most 50"),
    ("simulate small.toml --set scene.luminance_cd_m2=nan", "scene.luminance_cd_m2 is nan"),
    ("sweep thesis-2018 --exact --over scene.contrast=1,2", "EMVA 1288 sensor"),
    ("simulate small.toml --epsilon 200%", "--epsilon is '200%': give a percentage above 0%, up to 100%"),
    ("reproduce paper", "reproduce 'paper'"),
)

#: Files of results that differ from those of the session.
DIFFERENCES = {
    "table.json": lambda content: content["tables"].pop("luminance"),
    "rows.json": lambda content: content["tables"]["luminance"]["rows"].pop(),
    "row.json": lambda content: content["tables"]["luminance"]["rows"][1].update(patch="P77"),
    "column.json": lambda content: content["tables"]["luminance"]["columns"][0].update(name=[]),
    "finding.json": lambda content: content["findings"].append({**content["findings"][0], "subject": "another"}),
}


def coloured(frames):
    """Frames as of a sensor with colour filters."""
    return ((replace(one, colour_filter="RG", pixel_format="BayerRG12"), role, None) for one, role in frames)


@pytest.fixture(scope="module")
def folder(inputs, tmp_path_factory):
    """Inputs, good and bad."""
    folder = shutil.copytree(inputs, tmp_path_factory.mktemp("refused") / "in")
    (folder / "empty").mkdir()
    (folder / "file").write_text("")
    (folder / "key.toml").write_text("[sensor]\nblack_level = 32.0\n")
    (folder / "faults.txt").write_text("at 1 s stall for 1 s\nat 5 min vanisch\n")
    regions = load_regions(folder / "rois.json")
    save_regions(folder / "three.json", [*regions, RectangleShape("third", 30, 30, 9, 9)])
    frame = min(shutil.copytree(folder / "s", folder / "cut").glob("frames/*"))
    frame.write_bytes(frame.read_bytes()[:-1])
    for name, role in (("dark", "dark"), ("unlit", "light")):
        with Session.open(shutil.copytree(folder / "s", folder / name), writable=True) as session:
            session.supersede(session.frames(role), "test")
    with Session.create(folder / "begun", SessionConfiguration.load(folder / "s/session.toml")) as begun:
        begun.add_reading(session.readings()[0].reading, "P01")
    again(folder / "coloured", session, coloured)
    app(["evaluate", str(folder / "s"), "--recalibrate", "--output", str(folder / "e")], standalone_mode=False)
    for name, change in DIFFERENCES.items():
        content = json.loads((folder / "e/results.json").read_text())
        change(content)
        (folder / name).write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(("command", "named"), REFUSED)
def test_a_mistake_is_one_line_and_costs_nothing(labcdp_in, folder, command, named):
    before = sorted(folder.rglob("*"))
    done = labcdp_in(folder, *shlex.split(command))
    assert done.stdout == ""
    assert sorted(folder.rglob("*")) == before
    assert named in only_line(done)


@pytest.mark.parametrize("line", ["{}", "init {} x", "image --{}"])
def test_messages_about_arguments_are_short(labcdp_in, folder, line):
    done = labcdp_in(folder, *line.format(1000 * "a").split())
    assert done.returncode == 2
    assert "a...a" in done.stderr
    assert len(done.stderr) < 1000


@pytest.mark.parametrize("error", [OSError(errno.EIO, "Input/output error"), OSError(errno.ENODEV, "x"), OSError("y")])
def test_an_error_of_the_system_without_a_file_is_not_one_of_the_output(monkeypatch, capsys, error):
    monkeypatch.setattr(devices, "discover", Mock(side_effect=error))
    monkeypatch.setattr("sys.argv", ["labcdp", "devices"])
    with pytest.raises(SystemExit, match="1"):
        main()
    reason = error.strerror or error
    said = capsys.readouterr().err
    assert said.startswith(f"labcdp: the system refuses ({reason}): ")
    assert said.count("\n") == 1


def test_a_full_device_behind_the_output(labcdp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([labcdp_path, "presets", "thesis-2018"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "labcdp: the output cannot be written (No space left on device): free some disk space\n"


@pytest.mark.parametrize("command", all_commands().items(), ids=lambda command: command[0])
def test_no_option_is_taken_for_the_value_of_the_one_before_it(command):
    name, parser = command
    usage_error = typer.BadParameter.__base__
    for option in parser.params:
        if option.param_type_name == "option" and not option.is_flag:
            with pytest.raises(usage_error) as refused:
                parser.make_context(name, [option.opts[0], "--json"])
            assert refused.value.message == f"{option.opts[0]} has no value: the option --json follows it"


def test_a_value_may_begin_with_a_dash_and_a_file_be_called_as_an_option(labcdp_in, folder):
    refused = labcdp_in(folder, "video", "a.avi", "--roi", "rois.json", "--contrast", "-5%")
    assert "--contrast is '-5%': give contrasts above 0%" in only_line(refused)
    refused = labcdp_in(folder, "image", "--", "--roi")
    assert "no regions: add --roi" in only_line(refused)


def test_regions_of_a_video_in_no_pair_are_named(labcdp_in, folder):
    done = labcdp_in(folder, "video", "a.avi", "--roi", "three.json", "--pair", "bright:dark", "-o", "paired")
    assert done.returncode == 0, done.stderr
    assert "Note: in no --pair and not followed: 'third'" in done.stderr
    shutil.rmtree(folder / "paired")
