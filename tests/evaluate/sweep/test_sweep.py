from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from labcdp.chain import Chain, ImageScene
from labcdp.chain.predict.chain import predict_chain
from labcdp.cli.values import fraction_of_percent, parse_pair
from labcdp.core.errors import InputError
from labcdp.evaluate.contrasts import parse_contrasts
from labcdp.evaluate.sweep.plan import Axis, Sweep, parse_axis, parse_value
from labcdp.evaluate.sweep.run import JOURNAL as FILE_NAME
from labcdp.evaluate.sweep.run import run_sweep
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_pair

from .chains import small


@pytest.fixture(scope="module")
def chain():
    merge = {"hdr": {"method": "weighted"}, "isp": {"isp_bits": 16, "bits": 10}}
    size = {"scene.width": 60, "scene.height": 40, "scene.square_px": 10, "scene.contrast": 0.5}
    exposures = {"exposure.exposure_s": [0.01, 0.001], "exposure.temperature_c": 40.0}
    pattern = {"sensor.prnu_rel": 0.01, "sensor.dsnu_e": 2.0, "windscreen.glare_fraction": 0.5}
    return small(merge, scene__luminance_cd_m2=20.0, **size, **exposures, **pattern)


LUMINANCE = Axis("scene.luminance_cd_m2", (2.0, 20.0, 200.0))
CONTRAST = Axis("scene.contrast", (0.2, 1.0))
TEMPERATURE = Axis("exposure.temperature_c", (20.0, 60.0))


def test_simulated_cell_is_the_run_of_its_chain(chain):
    sweep = Sweep(chain, (LUMINANCE, TEMPERATURE), exact=False, stage="hdr", seed=5, contrast=(0.3, 0.7))
    result = run_sweep(sweep)
    assert result["cdp"].dims == (*result["snr_dark"].dims, "contrast")
    assert result["snr_dark"].dims == ("scene.luminance_cd_m2", "exposure.temperature_c")
    assert result["scene.luminance_cd_m2"].attrs == {"unit": "cd/m^2", "long_name": "scene luminance"}
    assert Chain.from_toml(result.attrs["chain"], "again").scene == chain.scene
    seed = int(np.random.SeedSequence(5, spawn_key=(3,)).generate_state(1)[0])
    run = chain.with_(**{"scene.luminance_cd_m2": 20.0, "exposure.temperature_c": 60.0}).run(seed)
    cell = result.sel({"scene.luminance_cd_m2": 20.0, "exposure.temperature_c": 60.0})
    for contrast in (0.3, 0.7):
        (pair,), dark, bright = evaluate_pair(run, "hdr", contrast)
        assert cell["cdp"].sel(contrast=contrast) == pair.cdp.cdp
        assert cell["standard_error"].sel(contrast=contrast) == pair.cdp.u
    assert float(cell["mean_contrast"]) == pair.mean_contrast
    assert float(cell["snr_dark"]) == dark.luminance_snr.value
    assert float(cell["saturated_share"]) == bright.saturated_share


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


@pytest.mark.parametrize("axes", [(TEMPERATURE, LUMINANCE), (CONTRAST, LUMINANCE)])
def test_exact_cells_do_not_depend_on_what_they_are_calculated_with(chain, axes):
    found = run_sweep(Sweep(chain, axes, exact=True))
    asked = {axis.parameter: axis.values[-1] for axis in axes}
    one = predict_chain(chain.with_(**asked))
    assert float(found.sel(asked)["cdp"]) == pytest.approx(float(one.cdp[0]), abs=1e-6)
    assert np.isnan(found["standard_error"]).all()
    several = run_sweep(Sweep(chain, axes, exact=True, contrast=(0.3, 0.7)))
    for contrast in (0.3, 0.7):
        alone = run_sweep(Sweep(chain, axes, exact=True, contrast=contrast))
        xr.testing.assert_allclose(several.sel(contrast=contrast, drop=True), alone, rtol=1e-12)


class Killed(BaseException):
    """Stands for a signal that ends the process between two cells."""


@pytest.mark.parametrize("exact", [False, True])
def test_interrupted_sweep_is_resumed(chain, tmp_path, exact):
    sweep = Sweep(chain, (TEMPERATURE, LUMINANCE), exact=exact, seed=3, contrast=(0.3, 0.7))
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


def test_another_image_is_another_sweep(chain, tmp_path):
    def sweep(bright):
        np.save(tmp_path / "scene.npy", np.repeat([[10.0, bright]], 9, axis=1).repeat(11, axis=0))
        scene = ImageScene(tmp_path / "scene.npy", 1.0, {"a": (0, 0, 9, 9), "b": (9, 0, 9, 9)})
        ((name, sensor),) = chain.sensors
        of_image = replace(chain, scene=scene, sensors=((name, replace(sensor, width=18, height=11)),))
        return run_sweep(Sweep(of_image, (TEMPERATURE,), exact=False), tmp_path / "out")

    sweep(20.0)
    with pytest.raises(InputError, match=r"holds the results of another sweep \(another image\)"):
        sweep(40.0)


# What is typed


@given(start=st.floats(1e-6, 1e6), ratio=st.floats(1.01, 1e6), count=st.integers(2, 50), logarithmic=st.booleans())
def test_spaced_axes_have_their_count_and_ends(start, ratio, count, logarithmic):
    values = parse_axis(f"a.b={start!r}:{start * ratio!r}:{count}" + (":log" if logarithmic else "")).values
    steps = np.diff(np.log(values) if logarithmic else values)
    assert (values[0], values[-1], len(values)) == (pytest.approx(start), pytest.approx(start * ratio), count)
    assert steps == pytest.approx(steps.mean(), rel=1e-6)
    assert parse_axis(f"a.b=0:{2**70}:2").values == (0, 2**70)


def test_what_is_not_an_axis_is_refused():
    for text in ["a.b=", "=1,2", "a.b=1:2", "a.b=1:2:3:lin", "a.b=1:1:5", "a.b=1:2:1", "a.b=1:inf:5", "a.b=1:2:1e9"]:
        with pytest.raises(InputError, match="give"):
            parse_axis(text)


@given(st.decimals("0.01", "9999", places=2), st.integers(1, 200), st.integers(1, 50), st.integers(1, 60))
def test_percentages_are_the_floats_nearest_to_what_was_typed_and_contrasts_each_once(percent, start, step, n):
    nearest = float(Fraction(percent) / 100)
    assert fraction_of_percent(f"{percent}%", "--epsilon") == parse_value(f"{percent}%") == nearest
    spaced = [Fraction(start + k * step, 100) for k in range(n + 1)]
    typed = [f" {percent} %,{start}%", f"{start}%:{start + n * step}%:{n + 1}"]
    assert parse_contrasts(typed) == tuple(map(float, sorted({Fraction(percent) / 100, *spaced})))
    assert parse_contrasts(["10%:1000%:3:log"]) == pytest.approx((0.1, 1.0, 10.0), rel=1e-15)


def test_pairs_are_two_names_that_may_hold_colons():
    assert parse_pair("a:b:c", ["a:b", "c", "b"]) == ("a:b", "c")
    for text, message in (("a", "by a colon"), ("a:x", "no 'x'"), ("a:a", "two different")):
        with pytest.raises(InputError, match=message):
            parse_pair(text, ["a", "b"])
