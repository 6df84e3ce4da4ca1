from pathlib import Path

import numpy as np
import pytest

from labcdp.chain import Chain, Sensor, ThesisSensor, preset_names, preset_text
from labcdp.core.errors import ConfigurationError


@pytest.mark.parametrize("name", preset_names())
def test_preset_loads_and_runs(name: str) -> None:
    chain = Chain.load(name)
    assert chain.name == name
    assert chain.description
    own = "sensor" if "width" in chain.document["sensor"] else "scene"
    run = chain.with_(**{f"{own}.width": 24, f"{own}.height": 18, "scene.square_px": 2}).run()
    assert list(run)[:2] == ["scene", next(iter(dict(chain.before)))]
    assert all(signal.values.shape == (18, 24) for signal in run.values())
    assert all(np.isfinite(signal.luminance_cd_m2).all() for signal in run.values())


@pytest.mark.parametrize("name", [one for one in preset_names() if "the converter ends just" in preset_text(one)])
def test_converter_ends_before_the_full_well_where_the_preset_says_so(name: str) -> None:
    for _, sensor in Chain.load(name).sensors:
        assert isinstance(sensor, Sensor)
        assert sensor.saturation_dn() == 2**sensor.bits - 1


def test_merge_takes_no_full_pixel_for_the_scene() -> None:
    """Where pixels are full below the converter's end, read noise must not make a full pixel count."""
    wanted = {"sensor.full_well_e": 8000.0, "sensor.k_dn_per_e": 0.3, "scene.luminance_cd_m2": 1e9}
    merged = list(Chain.load("split-pixel").with_(**wanted).run(seed=2).values())[-1]
    assert merged.saturated is not None
    assert merged.saturated.all()


def test_thesis_preset_has_the_values_of_its_tables() -> None:
    chain = Chain.load("thesis-2018")
    sensor = chain.sensors[0][1]
    assert isinstance(sensor, ThesisSensor)
    assert (sensor.quantum_efficiency, sensor.full_well_e, sensor.k_dn_per_e, sensor.bits) == (0.7, 15_000, 0.25, 12)
    assert chain.scene.shape == (420, 301)
    assert chain.settings.exposure_s == (0.003, 0.007, 0.015)


def test_second_sensor_differs_from_the_first_as_in_the_thesis_appendix() -> None:
    first, second = Chain.load("thesis-2018"), Chain.load("thesis-second-sensor")
    assert first.sensors[0][1].pixel_pitch_m == pytest.approx(2e-6)
    assert second.sensors[0][1].pixel_pitch_m == pytest.approx(3e-6)
    assert second.sensors[0][1].quantum_efficiency == 0.8
    assert (first.hdr.method, second.hdr.method) == ("normal", "linear")


def test_thesis_preset_becomes_correct_physics_as_its_comment_says() -> None:
    text = preset_text("thesis-2018").replace('spectrum = "thesis-2018"', 'spectrum = "D65"')
    tables = text.replace('type = "thesis-2018"', "").split("[sensor]")
    sensor = preset_text("manta-g505").split("[sensor]")[1]
    lines = [line for line in sensor.splitlines() if not line.startswith(("width", "height"))]
    chain = Chain.from_toml(tables[0] + "[sensor]\n" + "\n".join(lines), "completed")
    assert isinstance(chain.sensors[0][1], Sensor)
    assert chain.sensors[0][1].shape == (420, 301)


def test_manta_is_the_camera_of_the_data_sheet() -> None:
    camera = Chain.load("manta-g505").camera()
    assert camera.sensor.shape == (2056, 2452)
    assert camera.sensor.pixel_pitch_m == 3.45e-6


def test_unknown_preset_is_refused_with_a_hint_or_the_names() -> None:
    with pytest.raises(ConfigurationError, match=r"^there is no preset 'thesis2018': did you mean thesis-2018\?$"):
        Chain.load("thesis2018")
    names = ", ".join(preset_names())
    with pytest.raises(ConfigurationError, match=rf"^there is no preset 'x': give a .toml file, or one of {names}$"):
        preset_text("x")


def test_paths_in_a_file_are_relative_to_its_folder(tmp_path: Path) -> None:
    np.save(tmp_path / "scene.npy", np.full((2, 3), 4.0))
    (tmp_path / "a.toml").write_text("[scene]\ntype = 'image'\npath = 'scene.npy'\n", encoding="utf-8")
    assert Chain.load(tmp_path / "a.toml").scene.shape == (2, 3)
