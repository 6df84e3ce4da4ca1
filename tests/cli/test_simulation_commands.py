import pytest
import xarray

from labcdp.chain import Chain, preset_names
from labcdp.evaluate.sweep.run import JOURNAL

from .conftest import results_of, rows_of


@pytest.fixture
def small(inputs, tmp_path):
    (tmp_path / "small.toml").write_text((inputs / "small.toml").read_text())
    return "small.toml"


def written(folder):
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def test_a_preset_is_listed_and_as_a_file_simulates_alike(labcdp, tmp_path):
    rows = rows_of(labcdp("presets", "--json"), "presets")
    assert tuple(row["name"] for row in rows) == preset_names()
    assert labcdp("init", "chain", "my.toml", "--preset", "manta-g505").returncode == 0
    # With its comments.
    assert "of the dark squares" in (tmp_path / "my.toml").read_text()
    size = ("--set", "sensor.width=320", "--set", "sensor.height=240", "--set", "scene.square_px=32")
    own, preset = (results_of(labcdp("simulate", name, *size, "--json")) for name in ("my.toml", "manta-g505"))
    assert own["tables"]["detection"] == preset["tables"]["detection"]
    assert [one["inputs"][0]["role"] for one in (own, preset)] == ["chain", "preset"]
    rows = rows_of(labcdp("init", "bench", "bench.toml", "--json"), "template")
    assert rows == [{"template": "bench", "next_command": "labcdp acquire bench.toml my-session --simulated"}]


def test_simulate_writes_and_prints_the_same(labcdp, small, tmp_path):
    options = ("--seed", "3", "--contrast", "50%", "--epsilon", "40%", "--set", "exposure.exposure_s=0.001")
    done = labcdp("simulate", small, *options, "--set", "scene.contrast=20%", "--json")
    rows, folder = rows_of(done, "detection"), tmp_path / "small-simulate"
    assert (folder / "results.json").read_text() == done.stdout
    assert [row["stage"] for row in rows] == ["scene", "optics", "sensor"]
    assert [rows[2]["lowest_contrast"], rows[2]["highest_contrast"]] == [0.3, 0.7]
    assert rows[0]["scene_contrast"] == 0.2
    changed = Chain.load(tmp_path / small).with_(exposure__exposure_s=0.001, scene__contrast=0.2)
    assert Chain.load(folder / "chain.toml") == changed
    assert results_of(done)["configuration"]["chain"]["exposure"]["exposure_s"] == 0.001
    assert written(folder) == {
        *("labcdp-files.json", "results.json", "report.html", "results.xlsx", "chain.toml"),
        *("figures/chain-1.png", "figures/contrasts-1.png"),
        *(f"{kind}{name}.png" for name in ("scene", "optics", "sensor") for kind in ("figures/stage-", "images/")),
    }


def test_sweep_exact_and_simulated(labcdp, small, tmp_path):
    over = ("--over", "scene.luminance_cd_m2=1:100:4:log", "--over", "scene.contrast=20%,100%")
    maps = {}
    for name, method in (("exact", ("--exact",)), ("simulated", ())):
        values = results_of(labcdp("sweep", small, *over, *method, "--output", name, "--json"))
        assert values["configuration"]["method"] == name
        assert list(values["configuration"]["axes"]) == ["scene.luminance_cd_m2", "scene.contrast"]
        files = {"map.nc", "map.png", "report.html", "results.xlsx", "results.json", JOURNAL, "labcdp-files.json"}
        assert written(tmp_path / name) == files
        maps[name] = xarray.load_dataset(tmp_path / name / "map.nc")
        assert [row["cdp"] for row in values["tables"]["map"]["rows"]] == maps[name]["cdp"].values.ravel().tolist()
    difference = abs(maps["exact"]["cdp"] - maps["simulated"]["cdp"])
    assert (difference <= 5 * maps["simulated"]["standard_error"] + 1e-3).all()
