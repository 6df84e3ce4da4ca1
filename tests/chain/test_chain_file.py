from copy import deepcopy
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import (
    Chain,
    PatchScene,
    StepChart,
    preset_names,
)
from labcdp.core.errors import ConfigurationError, InputError

SENSOR = """
pixel_pitch_m = 3e-6
quantum_efficiency = 0.5
full_well_e = 10000
k_dn_per_e = 0.25
read_noise_e = 2
dark_current_e_s = 3
bits = 12
"""

CHAIN = f"""
name = "mine"
description = "for tests"
spectrum = "A"
[scene]
type = "checkerboard"
width = 8
height = 6
luminance_cd_m2 = 5.0
contrast = 0.5
[windscreen]
transmittance = 0.9
[optics]
f_number = 2.0
transmittance = 0.8
[exposure]
exposure_s = [0.01, 0.04]
temperature_c = 40
[sensor]{SENSOR}
[hdr]
method = "normal"
[isp]
bits = 10
"""


def chain(old: str = "", new: str = "", *more: tuple[str, str]) -> Chain:
    text = CHAIN
    for before, after in ((old, new), *more):
        assert before in text
        text = text.replace(before, after, 1) if before else text
    return Chain.from_toml(text, "my.toml")


def two_sensors(first: str = 'name = "left"', second: str = 'name = "right"') -> Chain:
    return chain(f"[sensor]{SENSOR}", f"[[sensor]]\n{first}{SENSOR}[[sensor]]\n{second}{SENSOR}")


def test_size_may_stand_in_the_sensor() -> None:
    made = chain("width = 8\nheight = 6\n", "", ("bits = 12", "bits = 12\nwidth = 30\nheight = 20"))
    assert made.scene.shape == made.sensors[0][1].shape == (20, 30)


def test_lists_of_values_and_of_tables() -> None:
    size = {"width": 8, "height": 6}
    chart = {"type": "step-chart", **size, "luminances_cd_m2": [1, 2.5]}
    assert Chain.from_document({"scene": chart}).scene == StepChart(8, 6, (1.0, 2.5))
    patches = [{"x": x, "y": 0, "width": 1, "height": 4, "luminance_cd_m2": 7.0 + x} for x in (1, 0)]
    made = Chain.from_document({"scene": {"type": "patches", **size, "background_cd_m2": 1, "patches": patches}}).scene
    assert isinstance(made, PatchScene)
    assert [(patch.x, patch.height, patch.luminance_cd_m2) for patch in made.patches] == [(1, 4, 8), (0, 4, 7)]


def in_order(*tables: str) -> dict[str, Any]:
    document = chain().document
    return {name: document[name] for name in tables}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        (
            ("scene", "optics", "windscreen", "exposure", "sensor"),
            r"windscreen takes luminance in cd/m\^2, but what comes to it is illuminance in lx: put it elsewhere",
        ),
        (
            ("scene", "optics", "isp", "exposure", "sensor"),
            r"isp takes digital number in DN, but what comes to it is illuminance in lx: put it elsewhere in the chain",
        ),
        (
            ("scene", "windscreen", "exposure", "sensor"),
            r"the sensor takes illuminance in lx, but what comes to it is luminance in cd/m\^2: add optics in front",
        ),
        (("hdr", "scene", "optics", "exposure", "sensor"), "hdr merges the exposures of a sensor: put it right behind"),
        (("scene", "optics", "exposure"), "there is no sensor to expose: add a sensor, or leave out what follows it"),
        (("scene", "optics", "sensor"), r"exposure is missing: add a table \[exposure\] with exposure_s, in s"),
        (("scene", "optics", "exposure", "sensor", "isp"), r"exposure\.exposure_s has 2 times and nothing merges them"),
        ((), r"scene is missing: add a table \[scene\]"),
    ],
)
def test_wrong_order_or_company_is_refused(tables: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^order: {message}"):
        Chain.from_document(in_order(*tables), "order")


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (3, r"sensor is 3: give a table \[sensor\], or several tables \[\[sensor\]\]"),
        ([], "there is no sensor to expose: add a sensor, or leave out what follows it"),
        ([{"name": "a"}, {"name": "a"}], "sensor has the names a, a: give each sensor a name of its own"),
        ([{"name": ["a"]}], r"sensor\.name is \['a'\]: give text in quotes"),
    ],
)
def test_what_is_not_a_sensor_is_refused(sensor: Any, message: str) -> None:
    document = in_order("scene", "windscreen", "optics", "exposure") | {"sensor": sensor}
    with pytest.raises(ConfigurationError, match=f"^x: {message}"):
        Chain.from_document(document, "x")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"xx": 1}, r"scene\.patches\[1\]\.xx is not a known key: did you mean x\?"),
        ({"type": "x"}, r"scene\.patches\[1\]\.type is not a known key"),
        ({"y": -1}, r"scene\.patches\[1\]\.y is -1: give a number of at least 0 pixels"),
        ({"x": 8}, r"scene: a patch spans x 8 to 9, y 0 to 1, but the scene is 8 x 6 pixels: move it inside"),
    ],
)
def test_error_of_a_patch_names_it(change: dict[str, Any], message: str) -> None:
    good = {"x": 0, "y": 0, "width": 1, "height": 1, "luminance_cd_m2": 1.0}
    scene = {"type": "patches", "width": 8, "height": 6, "background_cd_m2": 1.0, "patches": [good, good | change]}
    with pytest.raises(ConfigurationError, match=f"^x: {message}"):
        Chain.from_document({"scene": scene}, "x")


def test_key_of_several_sensors_is_that_of_all_or_of_one() -> None:
    original = two_sensors()
    before = deepcopy(original.document)
    assert [sensor.bits for _, sensor in original.with_(**{"sensor.bits": 10}).sensors] == [10, 10]
    assert [sensor.bits for _, sensor in original.with_(**{"sensor.right.bits": 10}).sensors] == [12, 10]
    both = original.with_(**{"sensor.bits": 10, "sensor.left.bits": 8})
    assert [sensor.bits for _, sensor in both.sensors] == [8, 10]
    assert original.document == before


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("scen.width", 3, r"^'scen\.width' is no parameter of this chain"),
        ("scene", 3, r"^'scene' is a table: give one of its keys too, such as scene\.luminance_cd_m2$"),
        ("spectrum.x", "A", r"^'spectrum\.x' is no parameter of this chain"),
        ("scene.widht", 3, r"^my\.toml: scene\.widht is not a known key: did you mean width\?$"),
        ("sensor.bits", 17, r"^my\.toml: sensor\.bits is 17: give a number from 1 to 16 bits$"),
        ("spectrum", "D66", r"^my\.toml: spectrum is 'D66', which is not known"),
    ],
)
def test_value_that_cannot_be_replaced(path: str, value: Any, message: str) -> None:
    original = chain()
    before = deepcopy(original.document)
    with pytest.raises(ConfigurationError, match=message):
        original.with_(**{path: value})
    assert original.document == before


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


def paths() -> list[tuple[str, str]]:
    documents = {name: Chain.load(name).document for name in preset_names()}
    return [
        (preset, f"{table}.{key}")
        for preset, document in documents.items()
        for table, held in document.items()
        if isinstance(held, dict)
        for key in held
    ]


@given(path=st.sampled_from(paths()), value=values)
def test_any_value_for_any_key_makes_a_chain_or_one_line_of_text(path: tuple[str, str], value: Any) -> None:
    preset, parameter = path
    message = ""
    try:
        Chain.load(preset).with_(**{parameter: value})
    except ConfigurationError as error:
        message = str(error)
    assert message.startswith(f"{preset}: ") or not message
    assert "\n" not in message


@given(document=st.dictionaries(st.sampled_from(["scene", "sensor", "hdr", "exposure", "optics", "name", "x"]), values))
def test_any_document_makes_a_chain_or_an_error(document: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^any: "):
        Chain.from_document(document, "any")
