"""A changed parameter is the same in a run, an exact prediction and a saved chain file."""

import tomllib
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.chain import Chain, Checkerboard, ImageScene, preset_names, preset_text
from labcdp.chain.predict.chain import predict_chain
from labcdp.core.disk.text import toml_text
from labcdp.core.errors import ConfigurationError, InputError
from labcdp.evaluate.sweep.plan import Axis, Sweep
from labcdp.evaluate.sweep.run import run_sweep

#: Every kind of stage that can be predicted.
FULL = """
name = "full"
spectrum = "A"
[scene]
type = "checkerboard"
width = 12
height = 10
luminance_cd_m2 = 50.0
contrast = 0.5
square_px = 3
[windscreen]
transmittance = 0.9
glare_fraction = 0.1
[optics]
f_number = 2.0
transmittance = 0.8
focal_length_m = 0.006
magnification = 0.01
diffraction_nm = 550.0
blur_sigma_m = 1e-6
defocus_disc_m = 3e-6
mtf = [[0, 1.0], [50, 0.8], [200, 0.2], [300, 0.0]]
[exposure]
exposure_s = [0.004, 0.001]
gain_db = 1.0
temperature_c = 40.0
[sensor]
pixel_pitch_m = 3e-6
quantum_efficiency = 0.5
full_well_e = 1000
k_dn_per_e = 0.5
read_noise_e = 2
dark_current_e_s = 30
bits = 9
black_level_dn = 20
prnu_rel = 0.01
dsnu_e = 1.0
dsnu_e_s = 3.0
column_dsnu_e = 0.5
row_dsnu_e = 0.4
[hdr]
method = "weighted"
bits = 18
[isp]
isp_bits = 18
bits = 9
"""
SIZE = {"width": 12, "height": 10}


def text_of(name: str) -> str:
    """Chain file of a preset at a small size."""
    document = tomllib.loads(FULL if name == "full" else preset_text(name))
    for table in (document["scene"], document["sensor"]):
        table |= {key: SIZE[key] for key in SIZE if key in table}
    document["scene"] |= {"square_px": 3}
    return toml_text(document)


def parts(chain: Chain) -> dict[str, Any]:
    found = {"scene": chain.scene, "exposure": chain.settings, "hdr": chain.hdr}
    found |= dict(chain.before) | {"sensor": chain.sensors[0][1]} | dict(chain.behind)
    return {name: part for name, part in found.items() if part is not None}


def with_part(chain: Chain, name: str, part: Any) -> Chain:
    """Return the chain with another part, as a user would by `dataclasses.replace`."""
    if name in ("scene", "hdr"):
        return replace(chain, **{name: part})
    if name == "exposure":
        return replace(chain, settings=part)
    changed = {
        group: tuple((own, part if own == name else one) for own, one in getattr(chain, group))
        for group in ("before", "sensors", "behind")
    }
    return replace(chain, **changed)


def numeric_fields() -> list[tuple[str, str, str]]:
    """Each number of each kind of stage, in the first chain that has it."""
    found: dict[tuple[type, str, bool], tuple[str, str, str]] = {}
    for preset in ("full", *preset_names()):
        chain = Chain.from_toml(text_of(preset))
        for name, part in parts(chain).items():
            for field in fields(part):
                value, key = getattr(part, field.name), field.name
                if key == "exposure_s" or (isinstance(value, int | float) and key not in SIZE):
                    bracket = isinstance(value, tuple) and len(value) > 1
                    found.setdefault((type(part), key, bracket), (preset, name, key))
    return list(found.values())


def other(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return [factor * item for item in value] if len(value) > 1 else factor * value[0]
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value - 1 if value > 1 else value + 1
    return factor * value if value else 1e-4


def same_run(one: Chain, two: Chain) -> None:
    runs = one.run(seed=3, threads=1), two.run(seed=3, threads=1)
    assert list(runs[0]) == list(runs[1])
    for stage in runs[0]:
        np.testing.assert_array_equal(runs[0][stage].values, runs[1][stage].values)
        np.testing.assert_array_equal(runs[0][stage].luminance_cd_m2, runs[1][stage].luminance_cd_m2)


def prediction(chain: Chain) -> dict[str, Any] | str:
    """Return what is predicted, or why it cannot be."""
    try:
        return vars(predict_chain(chain))
    except InputError as error:
        return str(error)


@pytest.mark.parametrize(("preset", "table", "key"), numeric_fields())
@settings(max_examples=1)
@given(factor=st.floats(0.7, 0.97))
def test_changed_parameter_is_the_same_everywhere(preset: str, table: str, key: str, factor: float) -> None:
    chain = Chain.from_toml(text_of(preset))
    part = parts(chain)[table]
    value = other(getattr(part, key), factor)
    document = tomllib.loads(text_of(preset))
    document.setdefault(table, {})[key] = value
    edited = Chain.from_toml(toml_text(document))
    assert edited != chain
    by_name = chain.with_(**{f"{table}__{key}": value})
    by_part = with_part(chain, table, replace(part, **{key: value}))
    for changed in (by_name, by_part):
        assert changed == edited
        assert changed.document == edited.document
        assert Chain.from_toml(changed.to_toml()) == edited
    # What no file has been read for.
    same_run(by_part, edited)
    np.testing.assert_equal(prediction(by_part), prediction(edited))


@pytest.mark.parametrize("preset", ["full", *preset_names()])
def test_chain_is_the_same_after_a_round_trip_through_its_file(preset: str, tmp_path: Path) -> None:
    chain = Chain.from_toml(FULL) if preset == "full" else Chain.load(preset)
    chain.save(tmp_path / "saved.toml")
    assert Chain.load(tmp_path / "saved.toml") == chain


@pytest.mark.parametrize("name", ["scene__width", "sensor__width", "sensor.width"])
@pytest.mark.parametrize("preset", ["full", *preset_names()])
def test_size_is_that_of_scene_and_sensor(preset: str, name: str) -> None:
    chain = Chain.from_toml(text_of(preset)).with_(**{name: 20, "scene.height": 14})
    assert chain.scene.shape == chain.sensors[0][1].shape == (14, 20)
    assert Chain.from_toml(chain.to_toml()) == chain


def test_paths_are_saved_relative_to_the_new_file(tmp_path: Path) -> None:
    np.save(tmp_path / "scene.npy", np.full((10, 12), 5.0))
    text = FULL.replace('type = "checkerboard"', 'type = "image"\npath = "scene.npy"')
    text = "\n".join(
        line
        for line in text.splitlines()
        if line.split(" = ")[0] not in SIZE | dict.fromkeys(("luminance_cd_m2", "contrast", "square_px"))
    )
    chain = Chain.from_toml(text, "image", tmp_path)
    (tmp_path / "below").mkdir()
    for path in (tmp_path / "saved.toml", tmp_path / "below" / "saved.toml"):
        chain.save(path)
        loaded = Chain.load(path)
        assert isinstance(loaded.scene, ImageScene)
        assert loaded.scene.path.samefile(tmp_path / "scene.npy")
    assert 'path = "scene.npy"' in (tmp_path / "saved.toml").read_text()


def test_file_that_exists_is_not_replaced_unasked(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("# mine")
    with pytest.raises(InputError, match="exists: give another name, or force=True"):
        Chain.load("manta-g505").save(path)
    assert path.read_text() == "# mine"
    Chain.load("manta-g505").save(path, force=True)
    assert Chain.load(path) == Chain.load("manta-g505")


def test_two_sizes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"^width is 20 and 21: scene and sensor have one size$"):
        Chain.from_toml(FULL).with_(scene__width=20, sensor__width=21)


def test_journal_of_a_changed_chain_is_not_that_of_the_original(tmp_path: Path) -> None:
    chain = Chain.from_toml(FULL)
    axes = (Axis("exposure.gain_db", (0.0, 3.0)),)
    run_sweep(Sweep(chain, axes, exact=True), tmp_path)
    with pytest.raises(InputError):
        run_sweep(Sweep(replace(chain, spectrum="D65"), axes, exact=True), tmp_path)


@pytest.mark.parametrize("number", [np.float64(0.3), np.float32(0.25), np.int64(2), 2])
def test_numpy_numbers_are_saved_as_numbers(number: Any) -> None:
    for chain in (
        Chain.from_toml(FULL).with_(scene__contrast=number),
        replace(Chain.from_toml(FULL), scene=Checkerboard(12, 10, 50.0, number, 3)),
    ):
        assert Chain.from_toml(chain.to_toml()).scene.contrast == number
