from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from labcdp.chain import Chain, ImageScene, fixed_pattern
from labcdp.chain.predict.chain import predict_chain
from labcdp.chain.scene import image
from labcdp.core.errors import ConfigurationError, InputError
from labcdp.evaluate.sweep.plan import Axis, Sweep
from labcdp.evaluate.sweep.run import JOURNAL as FILE_NAME
from labcdp.evaluate.sweep.run import VARIABLES, run_sweep
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_pair

from .chains import MERGE, small


@pytest.fixture(scope="module")
def chain():
    size = {"scene.width": 60, "scene.height": 40, "scene.square_px": 10, "scene.contrast": 0.5}
    exposures = {"exposure.exposure_s": [0.01, 0.001], "exposure.temperature_c": 40.0}
    pattern = {"sensor.prnu_rel": 0.01, "sensor.dsnu_e": 2.0, "windscreen.glare_fraction": 0.5}
    return small(MERGE, scene__luminance_cd_m2=20.0, **size, **exposures, **pattern)


@pytest.fixture
def image_chain(tmp_path, chain):
    """Make a chain whose scene is two fields in a file."""

    def make(bright):
        np.save(tmp_path / "scene.npy", np.repeat([[10.0, bright]], 9, axis=1).repeat(11, axis=0))
        scene = ImageScene(tmp_path / "scene.npy", 1.0, {"a": (0, 0, 9, 9), "b": (9, 0, 9, 9)})
        ((name, sensor),) = chain.sensors
        return replace(chain, scene=scene, sensors=((name, replace(sensor, width=18, height=11)),))

    return make


LUMINANCE = Axis("scene.luminance_cd_m2", (2.0, 20.0, 200.0))
CONTRAST = Axis("scene.contrast", (0.2, 1.0))
TEMPERATURE = Axis("exposure.temperature_c", (20.0, 60.0))


def test_simulated_cell_is_the_run_of_its_chain(chain):
    sweep = Sweep(chain, (LUMINANCE, TEMPERATURE), exact=False, stage="hdr", seed=5)
    result = run_sweep(sweep)
    assert result["cdp"].dims == ("scene.luminance_cd_m2", "exposure.temperature_c")
    seed = int(np.random.SeedSequence(5, spawn_key=(3,)).generate_state(1)[0])
    run = chain.with_(**{"scene.luminance_cd_m2": 20.0, "exposure.temperature_c": 60.0}).run(seed)
    pair, dark, bright = evaluate_pair(run, "hdr")
    cell = result.sel({"scene.luminance_cd_m2": 20.0, "exposure.temperature_c": 60.0})
    assert float(cell["cdp"]) == pair.cdp.cdp
    assert float(cell["standard_error"]) == pair.cdp.standard_error
    assert float(cell["mean_contrast"]) == pair.mean_contrast
    assert float(cell["snr_dark"]) == dark.luminance_snr.value
    assert float(cell["saturated_share"]) == bright.saturated_share


@pytest.fixture(scope="module")
def exact_map(chain):
    return run_sweep(Sweep(chain, (TEMPERATURE, LUMINANCE), exact=True))


@pytest.mark.parametrize(
    ("stage", "glare_subtracted", "axes"),
    [
        ("sensor 10 ms", True, (LUMINANCE, CONTRAST, TEMPERATURE)),
        ("sensor 1 ms", False, (LUMINANCE, CONTRAST, TEMPERATURE)),
        ("hdr", True, (LUMINANCE, TEMPERATURE)),
        ("isp", False, (LUMINANCE, CONTRAST)),
    ],
)
def test_exact_and_simulated_agree(chain, stage, glare_subtracted, axes):
    chain = chain.with_(windscreen__glare_subtracted=glare_subtracted)
    exact = run_sweep(Sweep(chain, axes, exact=True, stage=stage))
    simulated = run_sweep(Sweep(chain, axes, exact=False, stage=stage, seed=1))
    distance = abs(exact["cdp"] - simulated["cdp"])
    # One fixed pattern for all cells, so they are not independent; 5 standard errors for up to 12 cells.
    assert (distance <= 5 * simulated["standard_error"] + 1e-3).all()


def test_exact_cells_do_not_depend_on_what_they_are_calculated_with(chain, exact_map):
    one = predict_chain(chain.with_(**{"exposure.temperature_c": 60.0, "scene.luminance_cd_m2": 200.0}))
    cell = exact_map.isel({"exposure.temperature_c": 1, "scene.luminance_cd_m2": 2})
    assert float(cell["cdp"]) == pytest.approx(float(one.cdp[0]), abs=1e-6)
    of_contrasts = run_sweep(Sweep(chain.with_(exposure__temperature_c=60.0), (CONTRAST, LUMINANCE), exact=True))
    one = predict_chain(chain.with_(**{"exposure.temperature_c": 60.0, "scene.contrast": 0.2}))
    cell = of_contrasts.isel({"scene.contrast": 0, "scene.luminance_cd_m2": 1})
    assert float(cell["cdp"]) == pytest.approx(float(one.cdp[0]), abs=1e-6)
    assert np.isnan(exact_map["standard_error"]).all()


def test_result_says_what_it_is(chain):
    result = run_sweep(Sweep(chain, (LUMINANCE, Axis("scene.contrast", (0.2,))), exact=True))
    assert set(result.data_vars) == set(VARIABLES)
    assert result["scene.luminance_cd_m2"].attrs == {"unit": "cd/m^2", "long_name": "scene luminance"}
    assert result.attrs["method"] == "exact"
    assert result.attrs["stage"] == "isp"
    assert np.isnan(result.attrs["contrast"])
    assert Chain.from_toml(result.attrs["chain"], "again").scene == chain.scene


class Killed(BaseException):
    """Stands for a signal that ends the process between two cells."""


@pytest.mark.parametrize("exact", [False, True])
def test_interrupted_sweep_is_resumed(chain, tmp_path, exact):
    sweep = Sweep(chain, (TEMPERATURE, LUMINANCE), exact=exact, seed=3)
    whole = run_sweep(sweep)

    def kill(done, total):
        raise Killed

    with pytest.raises(Killed):
        run_sweep(sweep, tmp_path, kill)
    kept = (tmp_path / FILE_NAME).read_text().count("\n") - 1
    assert kept >= 1
    calculated = []
    again = run_sweep(sweep, tmp_path, lambda done, total: calculated.append(done))
    # What was kept was not calculated again.
    assert calculated[0] > 1
    assert again.identical(whole)


def test_another_image_is_another_sweep(image_chain, tmp_path):
    run_sweep(Sweep(image_chain(20.0), (TEMPERATURE,), exact=False), tmp_path / "out")
    with pytest.raises(InputError, match=r"holds the results of another sweep \(another image\)"):
        run_sweep(Sweep(image_chain(40.0), (TEMPERATURE,), exact=False), tmp_path / "out")


def test_every_value_is_checked_before_the_first_cell(chain):
    with pytest.raises(ConfigurationError, match=r"sensor\.bits is 20: give a number from 1 to 16 bits"):
        Sweep(chain, (Axis("sensor.bits", (10, 20)),), exact=True)


def test_sweep_over_an_image_reads_the_file_and_draws_the_pattern_once(image_chain, monkeypatch):
    read, draw = (Mock(wraps=one) for one in (image._read, fixed_pattern._draw))
    monkeypatch.setattr(image, "_read", read)
    monkeypatch.setattr(fixed_pattern, "_draw", draw)
    chain = image_chain(30.0).with_(sensor__device_seed=99)
    run_sweep(Sweep(chain, (TEMPERATURE, Axis("exposure.gain_db", (0.0, 1.0, 2.0))), exact=False))
    # Photo response and offsets of the pixels.
    assert (read.call_count, draw.call_count) == (1, 2)
