"""Chain files: what they may hold, and the one line that says what of them cannot be used."""

import re
from copy import deepcopy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import Chain
from labcdp.core.errors import ConfigurationError, InputError

SIZE = {"width": 8, "height": 6}
DOCUMENT = Chain.load("thesis-2018").with_(**{f"scene.{key}": value for key, value in SIZE.items()}).document
SENSOR = DOCUMENT["sensor"]
PATCH = {"x": 0, "y": 0, "width": 1, "height": 1, "luminance_cd_m2": 1.0}


def patches(**change):
    return {"type": "patches", **SIZE, "background_cd_m2": 1.0, "patches": [PATCH, PATCH | change]}


def test_size_may_stand_in_the_sensor():
    scene = {key: value for key, value in DOCUMENT["scene"].items() if key not in SIZE}
    made = Chain.from_document(DOCUMENT | {"scene": scene, "sensor": SENSOR | {"width": 30, "height": 20}})
    assert made.scene.shape == made.sensors[0][1].shape == (20, 30)


def test_key_of_several_sensors_is_that_of_all_or_of_one():
    tables = [SENSOR | {"name": "left"}, SENSOR | {"name": "right"}]
    original = Chain.from_document(DOCUMENT | {"sensor": tables})
    before = deepcopy(original.document)
    assert original.final_stages == ("isp (left)", "isp (right)")
    assert [sensor.bits for _, sensor in original.with_(**{"sensor.bits": 10}).sensors] == [10, 10]
    both = original.with_(**{"sensor.bits": 10, "sensor.left.bits": 8})
    assert [sensor.bits for _, sensor in both.sensors] == [8, 10]
    assert original.document == before
    with pytest.raises(ConfigurationError, match=r"^'sensor\.middle\.bits': there is no sensor 'middle', give one of"):
        original.with_(**{"sensor.middle.bits": 10})


def in_order(*tables, **more):
    return {name: DOCUMENT[name] for name in tables} | more


FRONT = ("scene", "windscreen", "optics", "exposure")
REFUSED = [
    (in_order("scene", "optics", "windscreen", "exposure", "sensor"), "windscreen takes luminance in cd/m², but what"),
    (in_order("scene", "windscreen", "exposure", "sensor"), "the sensor takes illuminance in lx, but what comes to it"),
    (in_order("hdr", "scene", "optics", "exposure", "sensor"), "hdr merges the exposures of a sensor: put it right be"),
    (in_order(*FRONT, "sensor", "isp"), "exposure.exposure_s has 3 times and nothing merges them"),
    (in_order(*FRONT, sensor=[{"name": "a"}, {"name": "a"}]), "sensor has the names a, a: give each sensor a name of"),
    ({"scene": patches(xx=1)}, "scene.patches[1].xx is not a known key: did you mean x?"),
    ({"scene": patches(x=8)}, "scene: a patch spans x 8 to 9, y 0 to 1, but the scene is 8 x 6 pixels: move it insid"),
]


@pytest.mark.parametrize(("document", "message"), REFUSED)
def test_what_cannot_be_used_is_refused_in_one_line(document, message):
    with pytest.raises(ConfigurationError, match=f"^x: {re.escape(message)}"):
        Chain.from_document(document, "x")


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
def test_any_value_for_any_key_makes_a_chain_or_one_line_of_text(path, value):
    name, parameter = path
    message = ""
    try:
        CHAINS[name].with_(**{parameter: value})
    except ConfigurationError as error:
        message = str(error)
    assert message.startswith(f"{CHAINS[name].source}: ") or not message
    assert "\n" not in message


@given(document=st.dictionaries(st.sampled_from(["scene", "sensor", "hdr", "exposure", "optics", "name", "x"]), values))
def test_any_document_makes_a_chain_or_an_error(document):
    with pytest.raises(InputError, match=r"^any: "):
        Chain.from_document(document, "any")
