"""Chain files: what they may hold, and the one line that says what of them cannot be used."""

import re
from copy import deepcopy
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import Chain, Flat, Optics, PatchScene, StepChart, Windscreen, preset_names, preset_text
from labcdp.core.errors import ConfigurationError, InputError

SIZE = {"width": 8, "height": 6}
DOCUMENT = Chain.load("thesis-2018").with_(**{f"scene.{key}": value for key, value in SIZE.items()}).document
SENSOR = DOCUMENT["sensor"]
PATCH = {"x": 0, "y": 0, "width": 1, "height": 1, "luminance_cd_m2": 1.0}


def patches(**change: Any) -> dict[str, Any]:
    return {"type": "patches", **SIZE, "background_cd_m2": 1.0, "patches": [PATCH, PATCH | change]}


def test_size_may_stand_in_the_sensor() -> None:
    scene = {key: value for key, value in DOCUMENT["scene"].items() if key not in SIZE}
    made = Chain.from_document(DOCUMENT | {"scene": scene, "sensor": SENSOR | {"width": 30, "height": 20}})
    assert made.scene.shape == made.sensors[0][1].shape == (20, 30)


def test_lists_of_values_and_of_tables() -> None:
    chart = {"type": "step-chart", **SIZE, "luminances_cd_m2": [1, 2.5]}
    assert Chain.from_document({"scene": chart}).scene == StepChart(8, 6, (1.0, 2.5))
    made = Chain.from_document({"scene": patches(x=3, luminance_cd_m2=7.0)}).scene
    assert isinstance(made, PatchScene)
    assert [(patch.x, patch.luminance_cd_m2) for patch in made.patches] == [(0, 1), (3, 7)]


def test_key_of_several_sensors_is_that_of_all_or_of_one() -> None:
    tables = [SENSOR | {"name": "left"}, SENSOR | {"name": "right"}]
    original = Chain.from_document(DOCUMENT | {"sensor": tables})
    before = deepcopy(original.document)
    assert [sensor.bits for _, sensor in original.with_(**{"sensor.bits": 10}).sensors] == [10, 10]
    both = original.with_(**{"sensor.bits": 10, "sensor.left.bits": 8})
    assert [sensor.bits for _, sensor in both.sensors] == [8, 10]
    assert original.document == before
    with pytest.raises(ConfigurationError, match=r"^'sensor\.middle\.bits': there is no sensor 'middle', give one of"):
        original.with_(**{"sensor.middle.bits": 10})


def in_order(*tables: str, **more: Any) -> dict[str, Any]:
    return {name: DOCUMENT[name] for name in tables} | more


FRONT = ("scene", "windscreen", "optics", "exposure")
REFUSED: list[tuple[dict[str, Any], str]] = [
    (in_order("scene", "optics", "windscreen", "exposure", "sensor"),
     "windscreen takes luminance in cd/m², but what comes to it is illuminance in lx: put it elsewhere"),
    (in_order("scene", "optics", "isp", "exposure", "sensor"),
     "isp takes digital number in DN, but what comes to it is illuminance in lx: put it elsewhere in the chain"),
    (in_order("scene", "windscreen", "exposure", "sensor"),
     "the sensor takes illuminance in lx, but what comes to it is luminance in cd/m²: add optics in front"),
    (in_order("hdr", "scene", "optics", "exposure", "sensor"), "hdr merges the exposures of a sensor: put it right be"),
    (in_order("scene", "optics", "exposure"), "there is no sensor to expose: add a sensor, or leave out what follows"),
    (in_order("scene", "optics", "sensor"), "exposure is missing: add a table [exposure] with exposure_s, in s"),
    (in_order(*FRONT, "sensor", "isp"), "exposure.exposure_s has 3 times and nothing merges them"),
    ({}, "scene is missing: add a table [scene]"),
    (in_order(*FRONT, sensor=3), "sensor is 3: give a table [sensor], or several tables [[sensor]]"),
    (in_order(*FRONT, sensor=[{"name": "a"}, {"name": "a"}]), "sensor has the names a, a: give each sensor a name of"),
    (in_order(*FRONT, sensor=[{"name": ["a"]}]), "sensor.name is ['a']: give text in quotes"),
    ({"scene": patches(xx=1)}, "scene.patches[1].xx is not a known key: did you mean x?"),
    ({"scene": patches(y=-1)}, "scene.patches[1].y is -1: give a number of at least 0 pixels"),
    ({"scene": patches(x=8)}, "scene: a patch spans x 8 to 9, y 0 to 1, but the scene is 8 x 6 pixels: move it insid"),
    ({"scene": patches() | {"patches": 3}}, "scene.patches is 3: give tables [[scene.patches]]"),
]  # fmt: skip


@pytest.mark.parametrize(("document", "message"), REFUSED)
def test_what_cannot_be_used_is_refused_in_one_line(document: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^x: {re.escape(message)}"):
        Chain.from_document(document, "x")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("scen.width", 3, "'scen.width' is no parameter of this chain"),
        ("scene", 3, "'scene' is a table: give one of its keys too, such as scene.luminance_cd_m2"),
        ("spectrum.x", "A", "'spectrum.x' is no parameter of this chain"),
        ("scene.widht", 3, "mine: scene.widht is not a known key: did you mean width?"),
        ("sensor.bits", 17, "mine: sensor.bits is 17: give a number from 1 to 16 bits"),
        ("spectrum", "D66", "mine: spectrum is 'D66', which is not known"),
    ],
)
def test_value_that_cannot_be_replaced(path: str, value: Any, message: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^{re.escape(message)}"):
        Chain.from_document(DOCUMENT, "mine").with_(**{path: value})


def test_parts_put_together_by_hand_are_checked_too() -> None:
    chain = Chain.from_document(DOCUMENT)
    lens, sensor = ("optics", Optics(2.0, 0.9)), chain.sensors[0][1]
    for change, message in (
        (
            {"before": (lens, ("windscreen", Windscreen(0.9)))},
            "windscreen takes luminance in cd/m², but what comes to",
        ),
        ({"behind": (lens,)}, "optics takes luminance in cd/m², but what comes to it is digital number in DN"),
        ({"sensors": (("a", sensor), ("a", sensor))}, "two signals would have the name 'hdr (a)': give each its own"),
        ({"scene": Flat(3, 2, 1.0)}, "sensor has width 8 and height 6, the scene 3 and 2: give them once"),
    ):
        with pytest.raises(InputError, match=f"^{re.escape(message)}"):
            replace(chain, **change)


def test_a_sensor_that_does_not_see_the_light_is_refused() -> None:
    blind = {"sensor.quantum_efficiency": [[400, 0.5], [500, 0.5]], "spectrum": "monochromatic 600 nm"}
    message = r"^quantum_efficiency is 0 wherever 'monochromatic 600 nm' has light: give values there$"
    with pytest.raises(InputError, match=message):
        Chain.load("manta-g505").with_(**blind).run()


def test_unknown_preset_is_refused_with_a_hint_or_the_names() -> None:
    with pytest.raises(ConfigurationError, match=r"^there is no preset 'thesis2018': did you mean thesis-2018\?$"):
        Chain.load("thesis2018")
    names = ", ".join(preset_names())
    with pytest.raises(ConfigurationError, match=rf"^there is no preset 'x': give a .toml file, or one of {names}$"):
        preset_text("x")


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)
CHAINS = {name: Chain.load(name) for name in ("manta-g505", "thesis-2018")}
PATHS = [
    (name, f"{table}.{key}")
    for name, chain in CHAINS.items()
    for table, held in chain.document.items()
    if isinstance(held, dict)
    for key in held
]


@given(path=st.sampled_from(PATHS), value=values)
def test_any_value_for_any_key_makes_a_chain_or_one_line_of_text(path: tuple[str, str], value: Any) -> None:
    name, parameter = path
    message = ""
    try:
        CHAINS[name].with_(**{parameter: value})
    except ConfigurationError as error:
        message = str(error)
    assert message.startswith(f"{CHAINS[name].source}: ") or not message
    assert "\n" not in message


@given(document=st.dictionaries(st.sampled_from(["scene", "sensor", "hdr", "exposure", "optics", "name", "x"]), values))
def test_any_document_makes_a_chain_or_an_error(document: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^any: "):
        Chain.from_document(document, "any")
