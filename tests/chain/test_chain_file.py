"""Chain files: what they may hold, and the one line that says what of them cannot be used."""

import re
import sys
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import Chain, register, registry
from labcdp.chain.parameters import Sized
from labcdp.core.errors import ConfigurationError, InputError

from ..test_documentation import blocks

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
    (in_order("scene", "optics", "windscreen", "exposure", "sensor"), "windscreen takes luminance in cd/m²"),
    (in_order("scene", "windscreen", "exposure", "sensor"), "the sensor takes illuminance in lx, but its input"),
    (in_order("hdr", "scene", "optics", "exposure", "sensor"), "hdr merges the exposures of a sensor"),
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


# Parts of one's own, in chain files and in packages


@pytest.fixture(autouse=True)
def own_registry(monkeypatch):
    """What a test registers is gone after it."""
    monkeypatch.setattr(registry, "_CLASSES", {table: dict(types) for table, types in registry._CLASSES.items()})


@dataclass(frozen=True)
class Ramp(Sized):
    """Scene that rises from left to right."""

    def luminance_map(self):
        return np.broadcast_to(np.arange(1, self.width + 1, dtype=np.float32), self.shape)

    def regions(self):
        return {}

    levels = pairs = lambda self: ()


FLAT = '[scene]\ntype = "flat"\nwidth = 4\nheight = 3\nluminance_cd_m2 = 1\n'
EXPOSED = """
[optics]
f_number = 0.5
transmittance = 1.0
[exposure]
exposure_s = 1.0
[sensor]
type = "perfect"
pixel_pitch_m = 1e-6
dn_per_lx_s = 1e4
"""


def test_programs_of_the_documentation_make_a_chain_with_a_scene_of_ones_own():
    names = {"__name__": "docs_chain"}
    for page in ("docs/howto/choose-a-sensor.md", "docs/howto/own-stage.md"):
        for block in blocks(page, "python"):
            exec(compile(block, page, "exec"), names)
    assert names["luminance"].shape == (420, 301)
    register("scene", Ramp, "ramp")
    scene = '[scene]\ntype = "ramp"\nwidth = 4\nheight = 3\n[haze]\ntransmittance = 0.5\nluminance_cd_m2 = 3.0\n'
    run = Chain.from_toml(scene + EXPOSED, "own.toml").run()
    assert list(run) == ["scene", "haze", "optics", "sensor"]
    ramp = np.tile(np.arange(1.0, 5.0), (3, 1))
    np.testing.assert_allclose(run["haze"].values, 0.5 * ramp + 0.5 * 3)
    np.testing.assert_allclose(run["sensor"].luminance_cd_m2, ramp, atol=1e-3)


MODULE = """
from dataclasses import dataclass
from typing import ClassVar
from labcdp.chain import Chain, register

@dataclass(frozen=True)
class Filter:
    takes: ClassVar[str] = "luminance"
    gives: ClassVar[str] = "luminance"

    def process(self, signal, context):
        return signal

register("filter", Filter)
register("windscreen", Filter, "filter")
"""


def install(folder, monkeypatch, module, text):
    """Lay a package with an entry point beside the installed ones."""
    (folder / f"{module}.py").write_text(text)
    info = folder / f"{module}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[labcdp.chain]\nfilter = {module}\n")
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.delitem(sys.modules, module)


def test_chain_file_of_the_documentation_runs():
    run = Chain.from_toml(blocks("docs/reference/chain-files.md", "toml")[0], "example.toml").run()
    assert list(run)[-2:] == ["hdr", "isp"]


def test_installed_package_makes_its_parts_known(tmp_path, monkeypatch):
    install(tmp_path, monkeypatch, "some_filter", MODULE)
    for table in ("[filter]\n", '[windscreen]\ntype = "filter"\n'):
        assert len(Chain.from_toml(FLAT + table, "own.toml").run()) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import not_there_at_all\n", r"entry point 'other_filter'.*No module named 'not_there_at_all'"),
        (MODULE.replace("process", "proceed"), "filter is registered as Filter, which is not a stage"),
    ],
)
def test_package_that_cannot_be_imported_or_has_no_stage_is_named(tmp_path, monkeypatch, text, message):
    install(tmp_path, monkeypatch, "other_filter", text)
    with pytest.raises(ConfigurationError, match=message):
        Chain.from_toml(FLAT + "[filter]\n", "own.toml")
