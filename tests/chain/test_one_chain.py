"""A chain with any values changed: the same in a run, an exact prediction and a saved file, and exact as simulated."""

import tomllib
from contextlib import suppress
from copy import deepcopy
from dataclasses import fields, replace
from itertools import product
from math import sqrt
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.chain import Chain, Checkerboard, ImageScene, Patch, PatchScene, StepChart, ToneCurve, preset_text
from labcdp.chain.optics import Windscreen
from labcdp.chain.predict.chain import predict_chain
from labcdp.core.disk.text import toml_text
from labcdp.core.errors import ConfigurationError, InputError
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_run

OPTICS = {"f_number": 2.0, "transmittance": 0.8, "focal_length_m": 0.006, "magnification": 0.01}
OPTICS |= {"diffraction_nm": 550.0, "blur_sigma_m": 1e-6, "defocus_disc_m": 3e-6}
OPTICS |= {"mtf": [[0, 1.0], [50, 0.8], [200, 0.2], [300, 0.0]]}
SENSOR = {"pixel_pitch_m": 3e-6, "quantum_efficiency": 0.5, "full_well_e": 1000, "k_dn_per_e": 0.5, "read_noise_e": 2}
SENSOR |= {"dark_current_e_s": 30, "bits": 9, "black_level_dn": 20, "prnu_rel": 0.05, "dsnu_e": 1.0, "dsnu_e_s": 20.0}
SENSOR |= {"column_dsnu_e": 0.5, "row_dsnu_e": 0.4}
BOARD = {"type": "checkerboard", "luminance_cd_m2": 50.0, "contrast": 0.5, "square_px": 3, "width": 12, "height": 10}
#: Every kind of stage that can be predicted.
FULL = {
    "spectrum": "A",
    "scene": BOARD,
    "windscreen": {"transmittance": 0.9, "glare_fraction": 0.1},
    "optics": OPTICS,
    "exposure": {"exposure_s": [0.004, 0.001], "gain_db": 1.0, "temperature_c": 40.0},
    "sensor": SENSOR,
    "hdr": {"method": "weighted", "bits": 18},
    "isp": {"isp_bits": 18, "bits": 9},
}
SIZE = {"width": 12, "height": 10}
#: All kinds of scenes' cameras, sensors and merges are among them.
PRESETS = ["full", "manta-g505", "thesis-2018", "thesis-second-sensor"]


def text_of(name):
    """Chain file of a preset at a small size."""
    document = deepcopy(FULL) if name == "full" else tomllib.loads(preset_text(name))
    for table in (document["scene"], document["sensor"]):
        table |= {key: SIZE[key] for key in SIZE if key in table}
    document["scene"] |= {"square_px": 3}
    return toml_text(document)


def parts(chain):
    found = {"scene": chain.scene, "exposure": chain.settings, "hdr": chain.hdr}
    found |= dict(chain.before) | {"sensor": chain.sensors[0][1]} | dict(chain.behind)
    return {name: part for name, part in found.items() if part is not None}


def with_parts(chain, new):
    """Return the chain with other parts, as a user would by `dataclasses.replace`."""
    groups = {
        group: tuple((name, new[name]) for name, _ in getattr(chain, group))
        for group in ("before", "sensors", "behind")
    }
    return replace(chain, scene=new["scene"], settings=new["exposure"], hdr=new.get("hdr"), **groups)


def other(value, factor):
    if isinstance(value, tuple):
        return [factor * item for item in value] if len(value) > 1 else factor * value[0]
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value - 1 if value > 1 else value + 1
    return factor * value if value else 1e-4


@st.composite
def edits(draw, chain, lowest=0.7):
    """Other values for any of the numbers of a chain, by table and key; at least one."""
    numbers = [
        (name, field.name)
        for name, part in parts(chain).items()
        for field in fields(part)
        if field.name == "exposure_s" or (isinstance(getattr(part, field.name), int | float) and field.name not in SIZE)
    ]
    found = {}
    for name, key in draw(st.lists(st.sampled_from(numbers), min_size=1, unique=True)):
        found.setdefault(name, {})[key] = other(getattr(parts(chain)[name], key), draw(st.floats(lowest, 0.97)))
    return found


def same_run(one, two):
    runs = one.run(seed=3, threads=1), two.run(seed=3, threads=1)
    assert list(runs[0]) == list(runs[1])
    for stage in runs[0]:
        np.testing.assert_array_equal(runs[0][stage].values, runs[1][stage].values)
        np.testing.assert_array_equal(runs[0][stage].luminance_cd_m2, runs[1][stage].luminance_cd_m2)


def prediction(chain):
    """Return what is predicted, or why it cannot be."""
    try:
        return vars(predict_chain(chain))
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("preset", PRESETS)
@settings(max_examples=3)
@given(data=st.data())
def test_changed_values_are_the_same_everywhere(preset, data):
    chain = Chain.from_toml(text_of(preset))
    changes = data.draw(edits(chain))
    document = tomllib.loads(text_of(preset))
    for table, values in changes.items():
        document.setdefault(table, {}).update(values)
    edited = Chain.from_toml(toml_text(document))
    assert edited != chain
    by_name = chain.with_(**{f"{table}__{key}": value for table in changes for key, value in changes[table].items()})
    by_part = with_parts(chain, {name: replace(part, **changes.get(name, {})) for name, part in parts(chain).items()})
    for changed in (by_name, by_part):
        assert changed == edited
        assert changed.document == edited.document
        assert Chain.from_toml(changed.to_toml()) == edited
    # What no file has been read for.
    same_run(by_part, edited)
    np.testing.assert_equal(prediction(by_part), prediction(edited))


WRONG = (None, "wrong", b"w", 1j, True, -3.5, object(), {"a": 1}, [None], [1, 2, "a"], (("a", 3),), np.zeros(3))


def users(key, value):
    """Return a part as its chain or scene takes it."""
    return [("x", value)] if key in ("before", "sensors", "behind") else value


@pytest.mark.parametrize("preset", PRESETS)
def test_values_of_wrong_types_are_refused_by_name_or_are_the_same_everywhere(preset):
    chain = Chain.from_toml(text_of(preset))
    image = ImageScene("night.npy", regions_xywh={"left lamp": np.array([1, 2, 3, 4])})
    of_patches = PatchScene(64, 64, 30.0, [Patch(4, 4, 9, 7, 20.0)])
    for owner in (chain, image, of_patches, *parts(chain).values()):
        for field in fields(owner):
            for value in (*WRONG, *(users(field.name, value) for value in WRONG)):
                with suppress(InputError):
                    made = replace(owner, **{field.name: value})
                    assert not isinstance(made, Chain) or Chain.from_toml(made.to_toml()) == made
    keys = [f"{name}.{field.name}" for name, part in parts(chain).items() for field in fields(part)]
    for key, value in product(keys, WRONG):
        with suppress(ConfigurationError):
            chain.with_(**{key: value})


def test_lists_are_taken_for_tuples():
    chain = Chain.from_document(FULL)
    lists = {key: [list(pair) for pair in getattr(chain, key)] for key in ("before", "sensors", "behind")}
    assert replace(chain, **lists) == chain
    image = ImageScene("night.npy", regions_xywh={"left lamp": np.array([1, 2, 3, 4])})
    assert image == ImageScene(Path("night.npy"), regions_xywh={"left lamp": (1, 2, 3, 4)})
    assert tomllib.loads(toml_text({"scene": {"left lamp": [1, 2]}})) == {"scene": {"left lamp": [1, 2]}}


def scene(kind):
    patches = (Patch(4, 4, 9, 7, 20.0), Patch(30, 30, 12, 12, 26.0))
    return {
        "pixels": Checkerboard(64, 64, 20.0, 0.6, 1),
        "squares": Checkerboard(64, 64, 20.0, 0.6, 4),
        "fractions": Checkerboard(64, 64, 20.0, 0.6, 2.5, oversampling=2),
        "steps": StepChart(64, 64, (10.0, 14.0, 20.0, 40.0)),
        "patches": PatchScene(64, 64, 30.0, patches),
    }[kind]


SHARP = {"diffraction_nm": None, "blur_sigma_m": 0.0, "defocus_disc_m": 0.0, "mtf": ()}
SPREADS = {"diffraction_nm": 550.0, "blur_sigma_m": 1.2e-6, "defocus_disc_m": 7e-6, "mtf": ((0, 1.0), (180, 0.3))}


@st.composite
def cameras(draw):
    """A chain with any scene, point spread, exposures, merge and values."""
    full = Chain.from_document(FULL)
    new = parts(full) | {"scene": scene(draw(st.sampled_from(["pixels", "squares", "fractions", "steps", "patches"])))}
    # Patterns of rows and columns make the pixels' mean uncertain, which the standard error does not know.
    new["sensor"] = replace(new["sensor"], width=64, height=64, row_dsnu_e=0.0, column_dsnu_e=0.0)
    spread = {key: SPREADS[key] for key in draw(st.lists(st.sampled_from(sorted(SPREADS)), unique=True))}
    new["optics"] = replace(new["optics"], **(SHARP | spread))
    new["windscreen"] = replace(new["windscreen"], glare_fraction=0.5, glare_subtracted=draw(st.booleans()))
    times = draw(st.sampled_from([0.016, 0.3, (0.016, 0.002), (0.3, 0.002), (0.016, 0.004, 0.0005)]))
    new["exposure"] = replace(new["exposure"], exposure_s=times)
    method = draw(st.sampled_from(["normal", "linear", "weighted"] + [None] * isinstance(times, float)))
    new["hdr"] = None if method is None else replace(new["hdr"], method=method)
    made = replace(
        with_parts(full, new), behind=(("isp", ToneCurve(draw(st.integers(8, 18)), 9)),) if draw(st.booleans()) else ()
    )
    changes = draw(edits(made, 0.5))
    edited = ("windscreen", "exposure", "sensor")
    return with_parts(made, parts(made) | {name: replace(new[name], **changes.get(name, {})) for name in edited})


@settings(max_examples=15)
@given(chain=cameras(), seed=st.integers(0, 2**31))
def test_exact_and_simulated_agree(chain, seed):
    """Within five standard errors, and what the classes of mixed pixels and the vignetting may differ."""
    stage = evaluate_run(chain.run(seed=seed, threads=1)).stages[-1]
    pair, rows = stage.pairs[0], {row.region: row for row in stage.regions}
    exact = predict_chain(chain, contrast=pair.true_contrast)
    for row, share, snr in (
        (rows[pair.bright], exact.saturated_share[0], exact.snr_bright[0]),
        (rows[pair.dark], exact.saturated_share_dark[0], exact.snr_dark[0]),
    ):
        pixels = chain.scene.regions()[row.region].sum()
        assert row.saturated_share == pytest.approx(share, abs=5 * sqrt(share * (1 - share) / pixels) + 2e-3)
        if share < 0.5:
            measured = row.luminance_snr
            assert snr == pytest.approx(measured.value, rel=0.02, abs=5 * measured.u)
    # Of two saturated regions either may come out as the brighter one.
    if exact.saturated_share[0] < 0.5:
        assert pair.cdp is not None
        tolerance = 5 * pair.cdp.u + 2e-3
        for name in ("cdp", "below", "above"):
            assert getattr(exact, name)[0] == pytest.approx(getattr(pair.cdp, name), abs=tolerance)


@pytest.mark.parametrize("name", ["scene__width", "sensor.width"])
def test_size_is_that_of_scene_and_sensor(name):
    chain = Chain.from_toml(text_of("full")).with_(**{name: 20, "scene.height": 14})
    assert chain.scene.shape == chain.sensors[0][1].shape == (14, 20)
    assert Chain.from_toml(chain.to_toml()) == chain


def test_paths_are_saved_relative_to_the_new_file_which_replaces_no_other_unasked(tmp_path):
    np.save(tmp_path / "scene.npy", np.full((10, 12), 5.0))
    document = FULL | {"scene": {"type": "image", "path": "scene.npy"}}
    chain = Chain.from_document(document, "image", tmp_path)
    (tmp_path / "below").mkdir()
    for path in (tmp_path / "saved.toml", tmp_path / "below" / "saved.toml"):
        chain.save(path)
        assert Chain.load(path).scene.path.samefile(tmp_path / "scene.npy")
    text = (tmp_path / "saved.toml").read_text()
    with pytest.raises(InputError, match=r"exists: .* force"):
        Chain.load("manta-g505").save(tmp_path / "saved.toml")
    assert (tmp_path / "saved.toml").read_text() == text


@pytest.mark.parametrize("number", [np.float64(0.3), np.float32(0.25), np.int64(2)])
def test_numpy_numbers_are_saved_as_numbers(number):
    chain = Chain.from_document(FULL)
    for changed in (chain.with_(scene__contrast=number), replace(chain, scene=Checkerboard(12, 10, 50.0, number, 3))):
        assert Chain.from_toml(changed.to_toml()).scene.contrast == number


# A veil always lowers contrast, whichever way a scene is evaluated


GLARES = (0.0, 0.3, 1.0, 4.0)


def veiled(glare_fraction, scene=None):
    """A camera behind a windscreen; 20 and 40 cd/m^2 without black level and dark current."""
    camera = Chain.load("manta-g505").with_(
        **{"sensor.width": 128, "sensor.height": 96, "scene.square_px": 16, "sensor.black_level_dn": 0.0},
        **{"sensor.dsnu_e_s": 0.0, "sensor.dark_current_e_s": 0.0, "optics.focal_length_m": None},
        **{"exposure.exposure_s": 0.005},
    )
    screen = ("windscreen", Windscreen(0.9, glare_fraction))
    return replace(camera, before=(screen, *camera.before), scene=scene or camera.scene)


@pytest.mark.parametrize("chart", [None, StepChart(128, 96, (12.0, 24.0, 40.0, 6.0))])
def test_contrast_is_what_the_veil_leaves_and_its_probability_of_detection_falls(chart):
    simulated, predicted = [], []
    for glare_fraction in GLARES:
        run = veiled(glare_fraction, chart).run(seed=1)
        scene, levels = run.chain.scene, {one.name: one.luminance_cd_m2 for one in run.chain.scene.levels()}
        veil_cd_m2 = glare_fraction * float(scene.luminance_map().mean())
        stages = evaluate_run(run).stages
        for stage in stages[1:]:
            for pair in stage.pairs:
                left = (levels[pair.bright] - levels[pair.dark]) / (levels[pair.dark] + veil_cd_m2)
                # Noise of the sensor over 3072 pixels of a region at the least; before it there is none.
                sigma = 0.0 if stage.name != "sensor" else (1 + left) * sqrt(2 / 3072) / pair.cnr.value * left
                assert pair.measured_contrast == pytest.approx(left, rel=1e-5, abs=5 * sigma)
        simulated.append(stages[-1].pairs[0].cdp.cdp)
        predicted.append(float(predict_chain(run.chain).cdp[0]))
    for cdps in (simulated, predicted) if chart is None else ():
        assert cdps == sorted(cdps, reverse=True)
        assert cdps[0] > 0.99
        assert cdps[-1] < 0.05
