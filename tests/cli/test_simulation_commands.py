import json
import signal
import subprocess
import time

import numpy as np
import pytest
import xarray
from jsonschema import Draft202012Validator

from labcdp.chain import Chain, preset_names
from labcdp.evaluate.sweep.run import JOURNAL as FILE_NAME
from labcdp.report.envelope import schema

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


def rows_of(text: str, table: str) -> list[dict[str, object]]:
    """Rows of a table in what a command printed, which has to follow the schema."""
    values = json.loads(text)
    Draft202012Validator(schema()).validate(values)
    return values["tables"][table]["rows"]


@pytest.fixture
def small(tmp_path):
    (tmp_path / "small.toml").write_text(SMALL)
    return "small.toml"


def test_presets_are_listed(labcdp):
    done = labcdp("presets", "--json")
    assert done.returncode == 0
    rows = rows_of(done.stdout, "presets")
    assert tuple(row["name"] for row in rows) == preset_names()
    assert "manta-g505" in labcdp("presets").stdout


def test_preset_is_written_as_a_file_that_simulates_alike(labcdp, tmp_path):
    assert labcdp("init", "chain", "my.toml", "--preset", "thesis-2018").returncode == 0
    # With its comments.
    assert "of the dark squares" in (tmp_path / "my.toml").read_text()
    own, preset = (labcdp("simulate", name, "--json").stdout for name in ("my.toml", "thesis-2018"))
    assert rows_of(own, "detection") == rows_of(preset, "detection")
    assert [json.loads(text)["inputs"][0]["role"] for text in (own, preset)] == ["chain", "preset"]


def test_template_is_named_as_json(labcdp):
    rows = rows_of(labcdp("init", "bench", "bench.toml", "--json").stdout, "template")
    assert rows == [{"template": "bench", "next_command": "labcdp acquire bench.toml my-session --simulated"}]


def test_simulate_writes_and_prints_the_same(labcdp, small, tmp_path):
    done = labcdp("simulate", small, "--seed", "3", "--contrast", "50%", "--epsilon", "40%", "--json")
    assert done.returncode == 0, done.stderr
    rows, folder = rows_of(done.stdout, "detection"), tmp_path / "small-simulate"
    assert (folder / "results.json").read_text() == done.stdout
    assert [row["stage"] for row in rows] == ["scene", "optics", "sensor"]
    assert [rows[2]["lowest_contrast"], rows[2]["highest_contrast"]] == [0.3, 0.7]
    assert Chain.load(folder / "chain.toml") == Chain.load(tmp_path / small)
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "labcdp-files.json",
        "results.json",
        "report.html",
        "results.xlsx",
        "chain.toml",
        "figures/chain-1.png",
        "figures/contrasts-1.png",
        *(f"figures/stage-{name}.png" for name in ("scene", "optics", "sensor")),
        *(f"images/{name}.png" for name in ("scene", "optics", "sensor")),
    }


def test_set_changes_a_parameter(labcdp, small):
    done = labcdp("simulate", small, "--set", "exposure.exposure_s=0.001", "--set", "scene.contrast=20%", "--json")
    assert json.loads(done.stdout)["configuration"]["chain"]["exposure"]["exposure_s"] == 0.001
    assert rows_of(done.stdout, "detection")[0]["scene_contrast"] == 0.2


def test_sweep_exact_and_simulated(labcdp, small, tmp_path):
    over = ("--over", "scene.luminance_cd_m2=1:100:4:log", "--over", "scene.contrast=20%,100%")
    for name, method in (("exact", ("--exact",)), ("simulated", ())):
        done = labcdp("sweep", small, *over, *method, "--output", name, "--json")
        assert done.returncode == 0, done.stderr
        rows, configuration = rows_of(done.stdout, "map"), json.loads(done.stdout)["configuration"]
        assert configuration["method"] == name
        assert list(configuration["axes"]) == ["scene.luminance_cd_m2", "scene.contrast"]
        names = {path.name for path in (tmp_path / name).iterdir()}
        kept = {FILE_NAME, "labcdp-files.json"}
        assert names == {"map.nc", "map.png", "report.html", "results.xlsx", "results.json", *kept}
        with xarray.open_dataset(tmp_path / name / "map.nc") as dataset:
            assert [row["cdp"] for row in rows] == dataset["cdp"].values.ravel().tolist()
    with (
        xarray.open_dataset(tmp_path / "exact" / "map.nc") as exact,
        xarray.open_dataset(tmp_path / "simulated" / "map.nc") as simulated,
    ):
        assert (abs(exact["cdp"] - simulated["cdp"]) <= 5 * simulated["standard_error"] + 1e-3).all()


def test_killed_sweep_is_resumed_and_loses_nothing(labcdp_path, labcdp, small, tmp_path):
    arguments = ["sweep", small, "--over", "scene.luminance_cd_m2=1:100:200:log", "--json"]
    process = subprocess.Popen(
        [labcdp_path, *arguments], cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    journal = tmp_path / "small-sweep" / FILE_NAME
    deadline = time.monotonic() + 300
    while not (journal.exists() and journal.read_text().count("\n") > 20):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait(timeout=300)
    kept = journal.read_bytes()
    assert kept.count(b"\n") <= 200
    assert labcdp(*arguments).returncode == 0
    # What was recorded is still there, and the rest followed; each cell stands once.
    lines = journal.read_bytes().splitlines()
    whole = kept[: kept.rfind(b"\n") + 1].splitlines()
    assert lines[: len(whole)] == whole
    assert sorted(json.loads(line.rpartition(b"\t")[0])["first"] for line in lines[1:]) == list(range(200))
    # And is what an unbroken sweep gives.
    assert labcdp(*arguments, "--output", "whole").returncode == 0
    with (
        xarray.open_dataset(tmp_path / "small-sweep" / "map.nc") as broken,
        xarray.open_dataset(tmp_path / "whole" / "map.nc") as unbroken,
    ):
        np.testing.assert_array_equal(broken["cdp"], unbroken["cdp"])


def test_reproduce_prints_the_table(labcdp, tmp_path):
    done = labcdp("reproduce", "thesis", "--seeds", "5", "--json")
    assert done.returncode == 0, done.stderr
    row = rows_of(done.stdout, "table_5_3")[7]
    assert (row["published_cdp"], row["all_pairs_mean"]) == (0.99834205, 1.0)
    assert len(rows_of(done.stdout, "intensity_sweep")) == 200
    assert (tmp_path / "thesis-reproduce" / "report.html").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "thesis"), "there is no preset 'thesis': did you mean thesis-2018?"),
        (("simulate", "absent.toml"), "absent.toml cannot be read (No such file or directory): give a chain file"),
        (("simulate", "manta-g505", "--contrast", "100"), "--contrast is '100': give a number with a percent sign"),
        (
            ("simulate", "small.toml", "--set", "scene.luminance_cd_m2=nan"),
            "scene.luminance_cd_m2 is nan: give a number",
        ),
        (("simulate", "small.toml", "--set", "nonsense"), "--set is 'nonsense': give NAME=VALUE, for example"),
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
    ],
)
def test_mistakes_get_one_clear_line(fails, small, arguments, words):
    assert words in fails(*arguments)


def test_simulate_exact_predicts_what_is_simulated(labcdp, small):
    exact, simulated = (
        json.loads(labcdp("simulate", small, "--json", "-o", name, *more).stdout)
        for name, more in (("exact", ("--exact",)), ("simulated", ()))
    )
    Draft202012Validator(schema()).validate(exact)
    (predicted,) = exact["tables"]["detection"]["rows"]
    found = simulated["tables"]["detection"]["rows"][-1]
    assert (predicted["stage"], exact["configuration"]["method"]) == ("sensor", "exact")
    assert abs(predicted["cdp"] - found["cdp"]) < 5 * found["u_cdp"] + 1e-9
