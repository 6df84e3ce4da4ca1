from operator import attrgetter
from typing import Any

import pytest

from labcdp.chain import Chain, Sensor, preset_names, preset_text
from labcdp.core.errors import ConfigurationError


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


PUBLISHED = [
    (
        "thesis-2018",  # its tables 5.1 and 5.2
        {"pixel_pitch_m": 2e-6, "quantum_efficiency": 0.7, "full_well_e": 15_000, "k_dn_per_e": 0.25, "bits": 12},
        {"scene.shape": (420, 301), "settings.exposure_s": (0.003, 0.007, 0.015), "hdr.method": "normal"},
    ),
    ("thesis-second-sensor", {"pixel_pitch_m": 3e-6, "quantum_efficiency": 0.8}, {"hdr.method": "linear"}),
    ("manta-g505", {"pixel_pitch_m": 3.45e-6, "shape": (2056, 2452), "bits": 12}, {}),  # the camera's data sheet
]


@pytest.mark.parametrize(("name", "of_sensor", "of_chain"), PUBLISHED, ids=[name for name, *_ in PUBLISHED])
def test_preset_has_the_published_values(name: str, of_sensor: dict[str, Any], of_chain: dict[str, Any]) -> None:
    chain = Chain.load(name)
    assert {key: getattr(chain.sensors[0][1], key) for key in of_sensor} == of_sensor
    assert {key: attrgetter(key)(chain) for key in of_chain} == of_chain


def test_thesis_preset_becomes_correct_physics_as_its_comment_says() -> None:
    text = preset_text("thesis-2018").replace('spectrum = "thesis-2018"', 'spectrum = "D65"')
    tables = text.replace('type = "thesis-2018"', "").split("[sensor]")
    sensor = preset_text("manta-g505").split("[sensor]")[1]
    lines = [line for line in sensor.splitlines() if not line.startswith(("width", "height"))]
    chain = Chain.from_toml(tables[0] + "[sensor]\n" + "\n".join(lines), "completed")
    assert isinstance(chain.sensors[0][1], Sensor)
    assert chain.sensors[0][1].shape == (420, 301)


def test_unknown_preset_is_refused_with_a_hint_or_the_names() -> None:
    with pytest.raises(ConfigurationError, match=r"^there is no preset 'thesis2018': did you mean thesis-2018\?$"):
        Chain.load("thesis2018")
    names = ", ".join(preset_names())
    with pytest.raises(ConfigurationError, match=rf"^there is no preset 'x': give a .toml file, or one of {names}$"):
        preset_text("x")
