"""What a tired person types: each gets one line that names it, exit status 1, and leaves nothing behind."""

import shlex
import shutil
import subprocess
from dataclasses import replace

import pytest

from labcdp.calibration import ColourCalibration, load, save
from labcdp.core.frame import PLANES
from labcdp.regions import RectangleShape, load_regions, save_regions
from labcdp.session import Session, SessionConfiguration

from .conftest import only_line

#: Commands and what their refusal names.
REFUSED = (
    ("info ''", "the argument after info is empty"),
    ("image a.png --output=", "is empty: give a value"),
    ("info none.csv", "none.csv does not exist"),
    ("info v.csv --source candle", "--source: spectrum is 'candle'"),
    ("meter --meter /dev/no-such-port", "there is no such serial port"),
    ("calibrate empty", "empty is not a session"),
    ("calibrate s --output file/results", "file/results lies in a file"),
    ("evaluate s", "run 'labcdp calibrate"),
    ("evaluate s --calibration file", "file: not valid JSON"),
    ("evaluate s --recalibrate --contrast 10", "--contrast is '10'"),
    ("evaluate s --recalibrate --pair P02:P01", "--pair needs a contrast"),
    ("evaluate s --recalibrate --contrast 5% --pair P02:P77", "there is no 'P77'"),
    ("acquire s/session.toml own", "no serial port for the meter: give --meter, or meter.port"),
    ("acquire s/session.toml own --virtual-clock", "--virtual-clock requires --simulated"),
    ("acquire s/session.toml own --simulated --replay x", "--simulated cannot be combined with --replay"),
    ("acquire s/session.toml own --simulated --meter /dev/ttyS0", "--meter cannot be combined with --simulated"),
    ("acquire s/session.toml own --replay s --transcript t.txt", "--transcript cannot be combined"),
    ("acquire s/session.toml begun --replay s", "begun already has frames or readings"),
    ("simulate-bench s/session.toml --faults faults.txt", "faults.txt, line 2: 'vanisch' is not a known fault"),
    (
        "simulate-bench --simulated-bench key.toml",
        "sensor.black_level is not a known key: did you mean",
    ),
    ("verify c/calibration.json small.toml own x --simulated", "3 paths after the calibration are too many"),
    ("verify c/calibration.json s --tolerance 0%", "tolerance_rel is 0.0"),
    ("verify c/calibration.json small.toml", "small.toml is a file: give the folder of a session"),
    ("verify c/calibration.json s --simulated", "options of devices cannot be used with a recorded session"),
    ("verify colour.json s/session.toml own --simulated --virtual-clock", "simulated bench has no colour filters"),
    ("history c/calibration.json -o history.pdf", "--output is history.pdf"),
    ("history c/calibration.json -o history.png --open", "--open opens a page"),
    ("luminance c/calibration.json s -o a.jpg", "ends in .tif, .tiff, .exr, .npz"),
    ("luminance c/calibration.json s -o a.npz --frame 99", "no frame 99"),
    ("luminance c/calibration.json s -o a.npz --exposure 5ms", "it has 2ms, 8ms, 32ms"),
    ("twin s -o file", "file is not a folder"),
    ("twin dark", "no dark frames: cover the lens"),
    ("image-map a.png --region-size 9", "the size of the regions is 9 pixels"),
    ("image-map a.png --region-size 50", "superpixels of 50 pixels are larger than the image"),
    ("video a.avi --roi three.json", "three.json holds 3 regions"),
    ("video a.avi --roi rois.json --neighbours", "--neighbours needs no regions"),
    ("video a.avi --roi rois.json --contrast=-5%", "--contrast is '-5%': give contrasts above 0%"),
    ("video a.avi --roi rois.json --start 500", "has no frame from 500 to its end"),
    ("video a.avi --roi rois.json --calibration a.json --camera-spec b.toml", "are given: give one"),
    ("simulate small.toml --contrast \u0665\u0660%", "give a number with a percent sign"),
    ("simulate small.toml --set scene.luminance_cd_m2=nan", "scene.luminance_cd_m2 is nan"),
    ("sweep thesis-2018 --exact --over scene.contrast=1,2", "is no EMVA 1288 sensor"),
    ("reproduce paper", "there is nothing to reproduce called 'paper'"),
)


@pytest.fixture(scope="module")
def folder(inputs, tmp_path_factory):
    """Inputs, good and bad."""
    folder = shutil.copytree(inputs, tmp_path_factory.mktemp("refused") / "in")
    (folder / "empty").mkdir()
    (folder / "file").write_text("")
    (folder / "object.json").write_text("{}")
    (folder / "key.toml").write_text("[sensor]\nblack_level = 32.0\n")
    (folder / "v.csv").write_text("wavelength_nm,V\n380,0\n555,1\n780,0\n")
    (folder / "faults.txt").write_text("at 1 s stall for 1 s\nat 5 min vanisch\n")
    dark, bright = load_regions(folder / "rois.json")
    save_regions(folder / "three.json", [dark, bright, RectangleShape("third", 30, 30, 9, 9)])
    mono = load(folder / "c/calibration.json")
    planes = tuple(replace(mono, state=replace(mono.state, plane=plane)) for plane in PLANES)
    nothing, low_high = ((0.0,) * 4,) * 4, mono.range_cd_m2
    save(
        ColourCalibration(planes, (0.25,) * 4, nothing, 0.0, 0.0, low_high, mono.residuals, (), (), (), None, None, ()),
        folder / "colour.json",
    )
    with Session.open(shutil.copytree(folder / "s", folder / "dark"), writable=True) as session:
        session.supersede(session.frames("dark"), "test")
        reading = session.readings()[0]
    with Session.create(folder / "begun", SessionConfiguration.load(folder / "s/session.toml")) as begun:
        begun.add_reading(reading.reading, reading.patch)
    return folder


def refused(labcdp_in, folder, command):
    """Run a command that must fail and leave the folder as it is; returns the line it says."""
    before = sorted(folder.rglob("*"))
    done = labcdp_in(folder, *shlex.split(command))
    assert done.stdout == ""
    assert sorted(folder.rglob("*")) == before
    return only_line(done)


@pytest.mark.parametrize(("command", "named"), REFUSED)
def test_a_mistake_is_one_line_and_costs_nothing(labcdp_in, folder, command, named):
    assert named in refused(labcdp_in, folder, command)


@pytest.mark.parametrize(
    ("command", "cut"), [("calibrate s", -1), ("evaluate s --calibration c/calibration.json", 1000)]
)
def test_a_damaged_frame_is_named(labcdp_in, inputs, tmp_path, command, cut):
    folder = shutil.copytree(inputs, tmp_path / "in")
    frame = min((folder / "s/frames").iterdir())
    frame.write_bytes(frame.read_bytes()[:cut])
    assert frame.name in refused(labcdp_in, folder, command)


def test_a_full_device_behind_the_output(labcdp_path):
    with open("/dev/full", "w") as full:
        done = subprocess.run([labcdp_path, "presets", "thesis-2018"], stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 1
    assert done.stderr == "labcdp: the output cannot be written (No space left on device): free some disk space\n"
