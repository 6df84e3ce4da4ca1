from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import (
    Chain,
    Checkerboard,
    PatchScene,
    Sensor,
    StepChart,
    ThesisSensor,
    ThesisWindscreen,
    ToneCurve,
    Windscreen,
    chain_from_document,
    chain_from_toml,
    load,
    preset_names,
    replaced,
)
from labcdp.errors import ConfigurationError, InputError

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
    return chain_from_toml(text, "my.toml")


def two_sensors(first: str = 'name = "left"', second: str = 'name = "right"') -> Chain:
    return chain(f"[sensor]{SENSOR}", f"[[sensor]]\n{first}{SENSOR}[[sensor]]\n{second}{SENSOR}")


def test_tables_become_the_parts_of_the_chain() -> None:
    made = chain()
    assert (made.name, made.description, made.spectrum) == ("mine", "for tests", "A")
    assert made.scene == Checkerboard(8, 6, 5.0, 0.5)
    assert [name for name, _ in made.before] == ["windscreen", "optics"]
    assert dict(made.before)["windscreen"] == Windscreen(0.9)
    assert made.settings is not None
    assert (made.settings.exposure_s, made.settings.temperature_c) == ((0.01, 0.04), 40)
    assert made.hdr is not None
    assert made.hdr.method == "normal"
    assert made.behind == (("isp", ToneCurve(bits=10)),)
    ((name, sensor),) = made.sensors
    assert name == "sensor"
    assert isinstance(sensor, Sensor)
    assert sensor.shape == (6, 8)


def test_light_is_d65_unless_given() -> None:
    assert chain('spectrum = "A"', "").spectrum == "D65"


def test_type_chooses_the_class() -> None:
    assert isinstance(
        dict(chain("[windscreen]", '[windscreen]\ntype = "thesis-2018"').before)["windscreen"], Windscreen
    )
    made = load("thesis-2018")
    assert isinstance(dict(made.before)["windscreen"], ThesisWindscreen)
    assert isinstance(made.sensors[0][1], ThesisSensor)


def test_stages_left_out_are_not_there() -> None:
    made = chain("[windscreen]\ntransmittance = 0.9\n", "", ("[isp]\nbits = 10\n", ""))
    assert made.stage_names == ("scene", "optics", "sensor 10 ms", "sensor 40 ms", "hdr")


def test_size_may_stand_in_the_sensor() -> None:
    made = chain("width = 8\nheight = 6\n", "", ("bits = 12", "bits = 12\nwidth = 30\nheight = 20"))
    assert made.scene.shape == made.sensors[0][1].shape == (20, 30)


def test_size_may_stand_in_both_if_it_is_the_same() -> None:
    assert chain("bits = 12", "bits = 12\nwidth = 8\nheight = 6").scene.shape == (6, 8)


def test_lists_of_values_and_of_tables() -> None:
    scene = '[scene]\ntype = "checkerboard"\nwidth = 8\nheight = 6\nluminance_cd_m2 = 5.0\ncontrast = 0.5\n'
    chart = '[scene]\ntype = "step-chart"\nwidth = 8\nheight = 6\nluminances_cd_m2 = [1, 2.5]\n'
    assert chain(scene, chart).scene == StepChart(8, 6, (1.0, 2.5))
    patches = (
        '[scene]\ntype = "patches"\nwidth = 8\nheight = 6\nbackground_cd_m2 = 1\n'
        "[[scene.patches]]\nx = 1\ny = 2\nwidth = 3\nheight = 4\nluminance_cd_m2 = 7\n"
        "[[scene.patches]]\nx = 0\ny = 0\nwidth = 1\nheight = 1\nluminance_cd_m2 = 9\n"
    )
    made = chain(scene, patches).scene
    assert isinstance(made, PatchScene)
    assert [(patch.x, patch.y, patch.luminance_cd_m2) for patch in made.patches] == [(1, 2, 7), (0, 0, 9)]


def test_sensors_have_the_names_of_their_tables() -> None:
    assert [name for name, _ in two_sensors().sensors] == ["left", "right"]


def test_document_is_not_changed() -> None:
    document = {"scene": {"type": "flat", "luminance_cd_m2": 1.0, "width": 2, "height": 2}}
    before = deepcopy(document)
    chain_from_document(document, "x")
    assert document == before


ERRORS: list[tuple[str, str, str]] = [
    # What is no chain file at all.
    ("[scene]", "[scene", r"is not TOML: Expected"),
    ("[windscreen]", "[scene]", r"is not TOML: Cannot declare .*scene"),
    # Tables.
    ("[optics]", "[optcs]", r": optcs is not known: did you mean optics\?"),
    ("[exposure]", "[exposur]", r": exposur is not known: did you mean exposure\?"),
    ("[hdr]", "[hdrr]", r": hdrr is not known: did you mean hdr\?"),
    ("spectrum", "spectrm", r": spectrm is not known: did you mean spectrum\?"),
    (
        "[windscreen]",
        "[filter]",
        r": filter is not known: give one of scene, windscreen, optics, sensor, isp, exposure, hdr, name, ",
    ),
    ("[scene]", "[windscreen.scene]", r": scene is missing: add a table \[scene\]"),
    ("[optics]", "[[optics]]", r": optics is \[\{'f_number': 2\.0, 'transmittance': 0\.8\}\]: give a table \[optics\]"),
    ("[hdr]", "[[hdr]]", r": hdr is \[\{'method': 'normal'\}\]: give a table \[hdr\]"),
    ("[exposure]", "[[exposure]]", r": exposure is \[.*\]: give a table \[exposure\]"),
    ('name = "mine"', "sensor = 3", r"is not TOML"),
    ('name = "mine"', "name = 3", r": name is 3: give text in quotes"),
    ('spectrum = "A"', "spectrum = 555", r": spectrum is 555: give text in quotes"),
    ('spectrum = "A"', 'spectrum = "D66"', r": spectrum is 'D66', which is not known: give 'monochromatic 555 nm'"),
    # Types.
    (
        'type = "checkerboard"',
        "",
        r": scene\.type is missing: give one of flat, checkerboard, step-chart, patches, image",
    ),
    (
        '"checkerboard"',
        '"chequerboard"',
        r": scene\.type is 'chequerboard', which is not known: did you mean checkerboa",
    ),
    ('"checkerboard"', '"x"', r": scene\.type is 'x', which is not known: give one of flat, checkerboard, step-chart"),
    ('"checkerboard"', "3", r": scene\.type is 3: give text in quotes"),
    ("[sensor]", '[sensor]\ntype = "emva"', r": sensor\.type is 'emva', which is not known: did you mean emva1288\?"),
    (
        "[exposure]",
        '[exposure]\ntype = "x"',
        r": exposure\.type is not a known key: give some of exposure_s, gain_db, t",
    ),
    ("[hdr]", '[hdr]\ntype = "x"', r": hdr\.type is not a known key: give some of method, bits"),
    # Keys.
    ("f_number", "f_numbr", r": optics\.f_numbr is not a known key: did you mean f_number\?"),
    ("[isp]", "[isp]\nx = 1", r": isp\.x is not a known key: give some of isp_bits, bits"),
    ("[isp]", '[isp]\nname = "x"', r": isp\.name is not a known key: give some of isp_bits, bits"),
    ("contrast = 0.5", "", r": scene\.contrast is missing: add it to the table \[scene\]"),
    ("k_dn_per_e = 0.25", "", r": sensor\.k_dn_per_e is missing: add it to the table \[sensor\]"),
    ("exposure_s = [0.01, 0.04]", "", r": exposure\.exposure_s is missing: add it to the table \[exposure\]"),
    ("width = 8", "", r": scene\.width is missing: add it to the table \[scene\]"),
    # Values.
    ("f_number = 2.0", 'f_number = "2"', r": optics\.f_number is '2': give a number from 0\.5 to 128"),
    ("f_number = 2.0", "f_number = [2.0]", r": optics\.f_number is \[2\.0\]: give a number from 0\.5 to 128"),
    ("f_number = 2.0", "f_number = true", r": optics\.f_number is True: give a number from 0\.5 to 128"),
    ("width = 8", "width = true", r": scene\.width is True: give a whole number of pixels"),
    ("f_number = 2.0", f"f_number = 1{'0' * 400}", r": optics\.f_number is a very large whole number: give a number"),
    ("f_number = 2.0", f"f_number = 1{'0' * 5000}", r"is not TOML: Exceeds the limit"),
    ("f_number = 2.0", "f_number = nan", r": optics\.f_number is nan: give a number from 0\.5 to 128"),
    (
        "f_number = 2.0",
        "f_number = 2020-01-01",
        r": optics\.f_number is datetime\.date\(2020, 1, 1\): give a number fro",
    ),
    ("width = 8", "width = 8.0", r": scene\.width is 8\.0: give a whole number of pixels"),
    ("e = 0.9", "e = 1.01", r": windscreen\.transmittance is 1\.01: give a number above 0 to 1 \(a fraction\)"),
    ("e = 0.9", "e = 0", r": windscreen\.transmittance is 0: give a number above 0 to 1 \(a fraction\)"),
    ("e = 0.8", "e = -0.1", r": optics\.transmittance is -0\.1: give a number above 0 to 1 \(a fraction\)"),
    ("cd_m2 = 5.0", "cd_m2 = -1", r": scene\.luminance_cd_m2 is -1: give a number from 0 to 1e\+12 cd/m\^2"),
    ("cd_m2 = 5.0", "cd_m2 = nan", r": scene\.luminance_cd_m2 is nan: give a number from 0 to 1e\+12 cd/m\^2"),
    ("cd_m2 = 5.0", "cd_m2 = inf", r": scene\.luminance_cd_m2 is inf: give a number from 0 to 1e\+12 cd/m\^2"),
    (
        "contrast = 0.5",
        "contrast = 0",
        r": scene\.contrast is 0: give a number above 0 to 1e\+06 \(a fraction; 1\.0 is 1",
    ),
    ("contrast = 0.5", "contrast = -0.5", r": scene\.contrast is -0\.5: give a number above 0"),
    ("[0.01, 0.04]", "[]", r": exposure\.exposure_s is empty: give one exposure time in s, or several"),
    ("[0.01, 0.04]", "[0.01, 0]", r": exposure\.exposure_s is 0: give a number from 1e-09 to 100000 s"),
    (
        "[0.01, 0.04]",
        "[1, 1.0]",
        r": exposure\.exposure_s has the times \[1, 1\.0\] s, of which two are equal: give each",
    ),
    ("[0.01, 0.04]", "{ a = 1 }", r": exposure\.exposure_s is \{'a': 1\}: give a number from 1e-09"),
    ("bits = 12", "bits = 0", r": sensor\.bits is 0: give a number from 1 to 16 bits"),
    ("bits = 12", "bits = 17", r": sensor\.bits is 17: give a number from 1 to 16 bits"),
    ('method = "normal"', 'method = "norml"', r": hdr\.method is 'norml': give one of normal, linear, weighted"),
    (
        "efficiency = 0.5",
        'efficiency = "0.5"',
        r": sensor\.quantum_efficiency is '0\.5': give a fraction, or at least tw",
    ),
    (
        "efficiency = 0.5",
        "efficiency = true",
        r": sensor\.quantum_efficiency is True: give a fraction, or at least two",
    ),
    (
        "efficiency = 0.5",
        "efficiency = [[400, 0.5]]",
        r": sensor\.quantum_efficiency is \[\[400, 0\.5\]\]: give a fractio",
    ),
    (
        "efficiency = 0.5",
        "efficiency = [400, [500, 1]]",
        r": sensor\.quantum_efficiency is \[400, \[500, 1\]\]: give a ",
    ),
    # Order and what belongs together.
    ("[sensor]", "[isp2]\n[sensor]", r": isp2 is not known: did you mean isp\?"),
    (
        "bits = 12",
        "bits = 12\nwidth = 9",
        r": sensor has width 9 and height 6, the scene 8 and 6: give them once, in sce",
    ),
    (
        "bits = 12",
        "bits = 12\n[sensor.x]",
        r": sensor\.x is not a known key: give some of pixel_pitch_m, width, height",
    ),
    ("[sensor]", "[sensor]\nname = 3", r": sensor\.name is 3: give text in quotes"),
]


@pytest.mark.parametrize(("old", "new", "message"), ERRORS)
def test_error_names_file_table_key_and_value(old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=rf"^my\.toml ?{message}"):
        chain(old, new)


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
        (
            ("scene", "exposure", "sensor", "optics"),
            r"the sensor takes illuminance in lx, but what comes to it is luminance in cd/m\^2: add optics in front",
        ),
        (("hdr", "scene", "optics", "exposure", "sensor"), "hdr merges the exposures of a sensor: put it right behind"),
        (("scene", "optics", "exposure", "sensor", "isp", "hdr"), "hdr merges the exposures of a sensor: put it right"),
        (("scene", "optics", "hdr"), "there is no sensor to expose: add a sensor, or leave out what follows it"),
        (("scene", "optics", "exposure"), "there is no sensor to expose: add a sensor, or leave out what follows it"),
        (("scene", "optics", "sensor"), r"exposure is missing: add a table \[exposure\] with exposure_s, in s"),
        (
            ("scene", "optics", "exposure", "sensor", "isp"),
            r"exposure\.exposure_s has 2 times and nothing merges them: add a table \[hdr\], or give one time",
        ),
        ((), r"scene is missing: add a table \[scene\]"),
        (("optics",), r"scene is missing: add a table \[scene\]"),
    ],
)
def test_wrong_order_or_company_is_refused(tables: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigurationError, match=f"^order: {message}"):
        chain_from_document(in_order(*tables), "order")


def test_scene_and_exposure_may_be_anywhere() -> None:
    tables = ("exposure", "windscreen", "optics", "sensor", "hdr", "isp", "scene")
    assert chain_from_document(in_order(*tables), "order").stage_names == chain().stage_names


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        (3, r"sensor is 3: give a table \[sensor\], or several tables \[\[sensor\]\]"),
        ("abc", r"sensor is 'abc': give a table \[sensor\], or several"),
        ([1], r"sensor is \[1\]: give a table \[sensor\], or several"),
        ([], "there is no sensor to expose: add a sensor, or leave out what follows it"),
        ([{"name": "a"}, {"name": "a"}], "sensor has the names a, a: give each sensor a name of its own"),
        ([{}, {}], "sensor has the names sensor, sensor: give each sensor a name of its own"),
        ([{"name": ["a"]}], r"sensor\.name is \['a'\]: give text in quotes"),
    ],
)
def test_what_is_no_sensor_is_refused(sensor: Any, message: str) -> None:
    document = in_order("scene", "windscreen", "optics", "exposure") | {"sensor": sensor}
    with pytest.raises(ConfigurationError, match=f"^x: {message}"):
        chain_from_document(document, "x")


def test_two_sensors_of_other_sizes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match=r"sensor has width 9 and height 6, the scene 8 and 6: give them once"):
        two_sensors(second='name = "right"\nwidth = 9')


@pytest.mark.parametrize("patches", [3, [1], "x", {"x": 1}])
def test_what_is_no_list_of_patches_is_refused(patches: Any) -> None:
    scene = {"type": "patches", "width": 8, "height": 6, "background_cd_m2": 1.0, "patches": patches}
    with pytest.raises(
        ConfigurationError, match=r"^x: scene\.patches.* is .*: give (a table|tables) \[.*scene\.patches"
    ):
        chain_from_document({"scene": scene}, "x")


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
        chain_from_document({"scene": scene}, "x")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("scene.luminance_cd_m2", 7.0),
        ("scene.square_px", 2),
        ("windscreen.glare_fraction", 0.3),
        ("optics.f_number", 4),
        ("exposure.exposure_s", 0.02),
        ("exposure.gain_db", 6.0),
        ("sensor.bits", 10),
        ("sensor.device_seed", 3),
        ("hdr.method", "linear"),
        ("isp.bits", 8),
    ],
)
def test_one_value_is_replaced_and_nothing_else(path: str, value: Any) -> None:
    original = chain()
    before = deepcopy(original.document)
    table, key = path.split(".")
    expected = deepcopy(before)
    expected[table][key] = value
    assert replaced(original, {path: value}).document == expected
    assert original.document == before


def test_replaced_values_reach_the_parts() -> None:
    changes = {"scene.luminance_cd_m2": 7.0, "sensor.bits": 10, "exposure.exposure_s": 0.02, "spectrum": "D65"}
    made = replaced(chain(), changes | {"name": "other"})
    assert (made.scene.luminance_map().min(), made.sensors[0][1].bits) == (7.0, 10)
    assert (made.settings.exposure_s, made.spectrum, made.name) == ((0.02,), "D65", "other")


def test_nothing_replaced_is_the_same_chain() -> None:
    original = chain()
    copy = replaced(original, {})
    assert (copy.scene, copy.before, copy.sensors, copy.settings, copy.hdr, copy.behind, copy.folder) == (
        *(original.scene, original.before, original.sensors, original.settings),
        *(original.hdr, original.behind, original.folder),
    )


def test_key_of_several_sensors_is_that_of_all_or_of_one() -> None:
    original = two_sensors()
    before = deepcopy(original.document)
    assert [sensor.bits for _, sensor in replaced(original, {"sensor.bits": 10}).sensors] == [10, 10]
    assert [sensor.bits for _, sensor in replaced(original, {"sensor.right.bits": 10}).sensors] == [12, 10]
    both = replaced(original, {"sensor.bits": 10, "sensor.left.bits": 8})
    assert [sensor.bits for _, sensor in both.sensors] == [8, 10]
    assert original.document == before


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "scen.width",
            3,
            r"^'scen\.width' is no parameter of this chain: give spectrum, or a table .*; did you mean scene",
        ),
        (
            "filter.x",
            3,
            r"^'filter\.x' is no parameter .*; it has scene, windscreen, optics, exposure, sensor, hdr, isp$",
        ),
        ("scene", 3, r"^'scene' is a table: give one of its keys too, such as scene\.luminance_cd_m2$"),
        ("width", 3, r"^'width' is no parameter of this chain"),
        ("", 3, r"^'' is no parameter of this chain"),
        ("spectrum.x", "A", r"^'spectrum\.x' is no parameter of this chain"),
        ("scene.", 3, r"^'scene\.' is a table: give one of its keys too"),
        ("scene.widht", 3, r"^my\.toml: scene\.widht is not a known key: did you mean width\?$"),
        ("sensor.left.bits", 3, r"^my\.toml: sensor\.left\.bits is not a known key"),
        ("sensor.bits", 17, r"^my\.toml: sensor\.bits is 17: give a number from 1 to 16 bits$"),
        ("spectrum", "D66", r"^my\.toml: spectrum is 'D66', which is not known"),
        ("exposure.exposure_s", -1, r"^my\.toml: exposure\.exposure_s is -1: give a number from 1e-09 to 100000 s$"),
        ("scene.width", 9.5, r"^my\.toml: scene\.width is 9\.5: give a whole number of pixels$"),
    ],
)
def test_value_that_cannot_be_replaced(path: str, value: Any, message: str) -> None:
    original = chain()
    before = deepcopy(original.document)
    with pytest.raises(ConfigurationError, match=message):
        replaced(original, {path: value})
    assert original.document == before


def test_unknown_sensor_is_named() -> None:
    with pytest.raises(
        ConfigurationError, match=r"^'sensor\.top\.bits': there is no sensor 'top', give one of left, ri"
    ):
        replaced(two_sensors(), {"sensor.top.bits": 10})


def test_folder_is_kept(tmp_path: Path) -> None:
    made = chain_from_toml(CHAIN, "x", tmp_path)
    assert replaced(made, {"spectrum": "D65"}).folder == tmp_path


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.dates(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=4,
)


def paths() -> list[tuple[str, str]]:
    documents = {name: load(name).document for name in preset_names()}
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
        replaced(load(preset), {parameter: value})
    except ConfigurationError as error:
        message = str(error)
    assert message.startswith(f"{preset}: ") or not message
    assert "\n" not in message


@given(document=st.dictionaries(st.sampled_from(["scene", "sensor", "hdr", "exposure", "optics", "name", "x"]), values))
def test_any_document_makes_a_chain_or_an_error(document: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"^any: "):
        chain_from_document(document, "any")
