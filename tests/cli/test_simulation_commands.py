import json
import signal
import subprocess
import time
import tomllib

import numpy as np
import pytest

from labcdp.chain import preset_names
from labcdp.evaluate.sweep_journal import FILE_NAME

SMALL = """
name = "small"
[scene]
type = "checkerboard"
width = 60
height = 40
luminance_cd_m2 = 50.0
contrast = 0.5
square_px = 10
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


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return "small.toml"


def test_presets_are_listed(labcdp):
    done = labcdp("presets", "--json")
    assert done.returncode == 0
    assert tuple(json.loads(done.stdout)) == preset_names()
    assert "manta-g505" in labcdp("presets").stdout


def test_preset_is_written_as_a_file_that_simulates_alike(labcdp, tmp_path):
    assert labcdp("presets", "thesis-2018", "--output", "my.toml").returncode == 0
    # With its comments.
    assert "of the dark squares" in (tmp_path / "my.toml").read_text()
    own = json.loads(labcdp("simulate", "my.toml", "--json").stdout)
    preset = json.loads(labcdp("simulate", "thesis-2018", "--json").stdout)
    assert own["stages"] == preset["stages"]


def test_existing_file_is_not_overwritten(labcdp, fails, tmp_path):
    (tmp_path / "my.toml").write_text("mine")
    assert fails("presets", "thesis-2018", "--output", "my.toml") == (
        "labcdp: my.toml exists: give the name of a new file"
    )
    assert (tmp_path / "my.toml").read_text() == "mine"


def test_simulate_writes_and_prints_the_same(labcdp, small, tmp_path):
    done = labcdp("simulate", small, "--seed", "3", "--contrast", "50%", "--epsilon", "40%", "--json")
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    folder = tmp_path / printed.pop("output")
    assert json.loads((folder / "results.json").read_text()) == printed
    assert [stage["name"] for stage in printed["stages"]] == ["scene", "optics", "sensor"]
    assert printed["stages"][2]["pairs"][0]["cdp"]["interval"] == [0.3, 0.7]
    assert tomllib.loads((folder / "chain.toml").read_text()) == tomllib.loads(SMALL)
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "results.json",
        "report.html",
        "results.xlsx",
        "chain.toml",
        "figures/chain-1.png",
        "figures/contrasts-1.png",
        *(f"figures/stage-{name}.png" for name in ("scene", "optics", "sensor")),
        *(f"images/{name}.png" for name in ("scene", "optics", "sensor")),
    }


def test_simulate_shows_tables(labcdp, small):
    done = labcdp("simulate", small)
    assert done.returncode == 0, done.stderr
    assert "Signal and noise" in done.stdout
    assert "Contrast detection probability" in done.stdout
    assert "Report: small-simulation/report.html" in done.stderr


def test_set_changes_a_parameter(labcdp, small):
    done = labcdp("simulate", small, "--set", "exposure.exposure_s=0.001", "--set", "scene.contrast=20%", "--json")
    printed = json.loads(done.stdout)
    assert printed["parameters"]["exposure"]["exposure_s"] == 0.001
    assert printed["stages"][0]["pairs"][0]["true_contrast"] == 0.2


def test_sweep_exact_and_simulated(labcdp, small, tmp_path):
    over = ("--over", "scene.luminance_cd_m2=1:100:4:log", "--over", "scene.contrast=20%,100%")
    for name, method in (("exact", ("--exact",)), ("simulated", ())):
        done = labcdp("sweep", small, *over, *method, "--output", name, "--json")
        assert done.returncode == 0, done.stderr
        printed = json.loads(done.stdout)
        assert printed["method"] == name
        assert list(printed["axes"]) == ["scene.luminance_cd_m2", "scene.contrast"]
        names = {path.name for path in (tmp_path / name).iterdir()}
        assert names == {"map.nc", "map.png", "map.html", "map.xlsx", "map.json", FILE_NAME}
    import xarray

    with (
        xarray.open_dataset(tmp_path / "exact" / "map.nc") as exact,
        xarray.open_dataset(tmp_path / "simulated" / "map.nc") as simulated,
    ):
        assert (abs(exact["cdp"] - simulated["cdp"]) <= 5 * simulated["standard_error"] + 1e-3).all()


def test_killed_sweep_goes_on_and_loses_nothing(labcdp_path, labcdp, small, tmp_path):
    arguments = ["sweep", small, "--over", "scene.luminance_cd_m2=1:100:400:log", "--json"]
    process = subprocess.Popen(
        [labcdp_path, *arguments], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    journal = tmp_path / "small-sweep" / FILE_NAME
    deadline = time.monotonic() + 60
    while not (journal.exists() and journal.read_text().count("\n") > 20):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=10)
    kept = journal.read_bytes()
    assert kept.count(b"\n") <= 400
    assert labcdp(*arguments).returncode == 0
    # What was recorded is still there, and the rest followed; each cell stands once.
    lines = journal.read_bytes().splitlines()
    whole = kept[: kept.rfind(b"\n") + 1].splitlines()
    assert lines[: len(whole)] == whole
    assert sorted(json.loads(line)["first"] for line in lines[1:]) == list(range(400))
    # And is what an unbroken sweep gives.
    assert labcdp(*arguments, "--output", "whole").returncode == 0
    import xarray

    with (
        xarray.open_dataset(tmp_path / "small-sweep" / "map.nc") as broken,
        xarray.open_dataset(tmp_path / "whole" / "map.nc") as unbroken,
    ):
        np.testing.assert_array_equal(broken["cdp"], unbroken["cdp"])


def test_reproduce_prints_the_table(labcdp, tmp_path):
    done = labcdp("reproduce", "thesis", "--seeds", "5", "--json")
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout)
    assert [row["published"]["published_cdp"] for row in printed["table_5_3"]][7] == 0.99834205
    assert printed["table_5_3"][7]["all_pairs_mean"] == 1.0
    assert len(printed["intensity_sweep"]["cdp"]) == 200
    assert (tmp_path / "thesis-reproduction" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "thesis"), "there is no preset 'thesis': did you mean thesis-2018?"),
        (("simulate", "absent.toml"), "absent.toml cannot be read (No such file or directory): give a chain file"),
        (("simulate", "manta-g505", "--contrast", "0%"), "contrast is 0.0: give a fraction above 0"),
        (("simulate", "manta-g505", "--contrast", "100"), "--contrast is '100': give a number with a percent sign"),
        (("simulate", "manta-g505", "--contrast", "1e400%"), "--contrast is '1e400%': give a number with"),
        (("simulate", "manta-g505", "--epsilon", "150%"), "epsilon is 1.5: give a fraction above 0, up to 1"),
        (
            ("simulate", "small.toml", "--set", "scene.luminance_cd_m2=nan"),
            "scene.luminance_cd_m2 is nan: give a number",
        ),
        (("simulate", "small.toml", "--set", "scene.luminance_cd_m2=-1"), "scene.luminance_cd_m2 is -1: give a number"),
        (("simulate", "small.toml", "--set", "optics.transmittance=1.2"), "optics.transmittance is 1.2: give a number"),
        (
            ("simulate", "small.toml", "--set", "exposure.exposure_s=0"),
            "exposure.exposure_s is 0: give a number from 1e-09 to",
        ),
        (("simulate", "small.toml", "--set", "sensor.bits=17"), "sensor.bits is 17: give a number from 1 to 16 bits"),
        (("simulate", "small.toml", "--set", "spectrum=D66"), "spectrum is 'D66', which is not known"),
        (("simulate", "small.toml", "--set", "nonsense"), "--set is 'nonsense': give NAME=VALUE, for example"),
        (("sweep", "small.toml", "--over", "scene.contrast=0%:10%:3"), "scene.contrast is 0.0: give a number above 0"),
        (
            ("sweep", "small.toml", "--over", "scene.kontrast=1,2"),
            "scene.kontrast is not a known key: did you mean contrast?",
        ),
        (
            ("sweep", "small.toml", "--over", "scene.contrast=1,2", "--stage", "lens"),
            "stage is 'lens': give one of scene",
        ),
        (("sweep", "thesis-2018", "--exact", "--over", "scene.contrast=1,2"), "is no EMVA 1288 sensor"),
        (("reproduce", "paper"), "there is nothing to reproduce called 'paper': give thesis"),
        (("presets", "manta"), "there is no preset 'manta': did you mean manta-g505?"),
    ],
)
def test_mistakes_get_one_clear_line(fails, small, arguments, words):
    assert words in fails(*arguments)
