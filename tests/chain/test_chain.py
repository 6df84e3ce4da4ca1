"""Runs of chains and of the presets: signals behind each stage, their inverse, and published values."""

import numpy as np
import pytest

from labcdp.chain import Chain, Context, ThesisWindscreen, preset_names

# Rows of more than one block of random numbers.
DOCUMENT = Chain.load("manta-g505").document
DOCUMENT["scene"] |= {"width": 40, "height": 150, "square_px": 7}
DOCUMENT["windscreen"] = {"transmittance": 0.9, "glare_fraction": 0.2, "glare_subtracted": True}
DOCUMENT = {key: DOCUMENT[key] for key in ("scene", "windscreen", "optics", "exposure", "sensor")}
SENSOR = DOCUMENT["sensor"]
HDR_AND_ISP = {"hdr": {"method": "normal", "bits": 20}, "isp": {"isp_bits": 20, "bits": 8}}
BRACKET = {"exposure": {"exposure_s": [0.003, 0.0155]}}
TWO_SENSORS = {"sensor": [SENSOR | {"name": "left"}, SENSOR | {"name": "right", "pixel_pitch_m": 6e-6}]}


def chain_of(*changes):
    document = dict(DOCUMENT)
    for change in changes:
        document |= change
    return Chain.from_document(document, "test")


def test_a_run_has_the_signal_behind_each_stage_in_order():
    front, merged = ["scene", "windscreen", "optics"], ["sensor 3 ms", "sensor 15.5 ms", "hdr"]
    both = [f"{name} ({sensor})" for sensor in ("left", "right") for name in merged]
    for chain, names in (
        (chain_of(BRACKET, HDR_AND_ISP), [*front, *merged, "isp"]),
        (chain_of(BRACKET, TWO_SENSORS, {"hdr": {"method": "linear"}}), [*front, *both]),
    ):
        run = chain.run()
        assert list(run) == list(chain.stage_names) == names
        assert {run[name].values.shape for name in run} == {chain.scene.shape}


def test_same_seed_same_values_on_any_number_of_threads():
    one, two = (chain_of(BRACKET, HDR_AND_ISP).run(3, threads=threads) for threads in (1, 2))
    assert all((one[name].values == two[name].values).all() for name in one)


def test_each_sensor_sees_the_image_for_its_own_pixels():
    run = chain_of(TWO_SENSORS).run()
    for table in TWO_SENSORS["sensor"]:
        alone = chain_of({"sensor": table}).run()["sensor"]
        np.testing.assert_array_equal(run[f"sensor ({table['name']})"].values, alone.values)
        np.testing.assert_array_equal(run[f"sensor ({table['name']})"].luminance_cd_m2, alone.luminance_cd_m2)


def test_signals_know_which_pixels_are_saturated():
    run = chain_of({"exposure": {"exposure_s": [0.002, 0.2]}}, HDR_AND_ISP).run()
    bright = run.chain.scene.regions()["bright"]
    assert run["sensor 200 ms"].saturated[bright].mean() > 0.9
    for name in ("sensor 2 ms", "hdr", "isp"):
        assert not run[name].saturated.any()


@pytest.mark.parametrize("preset", preset_names())
def test_a_preset_is_as_its_file_and_without_noise_gives_back_the_scene(preset):
    assert Chain.from_toml(Chain.load(preset).to_toml()) == Chain.load(preset)
    # Odd sizes have a pixel on the axis.
    chain = Chain.load(preset).with_(**{"scene.width": 31, "scene.height": 21, "scene.square_px": 3})
    run = chain.run()
    scene = expected = run["scene"].values.astype(np.float64)
    windscreen = dict(chain.before).get("windscreen")
    if isinstance(windscreen, ThesisWindscreen):
        tau = windscreen.transmittance
        expected = tau * scene + windscreen.glare_fraction * scene.mean() * (tau - 1 / tau)
    np.testing.assert_array_equal(run["scene"].luminance_cd_m2, run["scene"].values)
    for name, _ in chain.before:
        np.testing.assert_allclose(run[name].luminance_cd_m2, expected, rtol=1e-5)
    sensor = chain.sensors[0][1]
    context = Context(chain.spectrum, 0, sensor.pixel_pitch_m, chain.settings)
    captures = [sensor.capture(run["optics"], context, index) for index in range(len(chain.capture_names))]
    if chain.hdr is not None:
        captures.append(chain.hdr.merge(captures))
    for name, shot in zip(chain.recorded_names, captures, strict=False):
        noise_free = shot.dark_dn + shot.dn_per_lx * run["optics"].values.astype(np.float64)
        np.testing.assert_allclose(run[name].to_luminance(noise_free), expected, rtol=1e-4)
    # Levels, of which predictions are made, take the way of the image on the axis.
    levels = chain.scene.levels()
    luminances, shares = (np.array([[getattr(one, key) for one in levels]]) for key in ("luminance_cd_m2", "share"))
    front = chain.front(luminances, shares)
    (middle,) = (number for number, one in enumerate(levels) if chain.scene.regions()[one.name][10, 15])
    assert run["optics"].values[10, 15] == pytest.approx(front.values[0, middle], rel=1e-5)
    assert run["optics"].luminance_cd_m2[10, 15] == pytest.approx(front.luminance_cd_m2[0, middle], rel=1e-5)


def test_camera_takes_windscreen_optics_and_sensor_of_the_chain():
    chain = chain_of()
    camera = chain.camera()
    scene = chain.scene.luminance_map()
    dn = camera.sensor.expose(camera.electron_rate(scene), 5e-3, temperature_c=35.0, seed=5, exposure_index=0)
    np.testing.assert_array_equal(dn, chain.run(5)["sensor"].values)


def test_merge_takes_no_full_pixel_for_the_scene():
    """Where pixels are full below the converter's end, read noise must not make a full pixel count."""
    size = {"scene.width": 60, "scene.height": 40, "scene.square_px": 5}
    full = {"sensor.full_well_e": 8000.0, "sensor.k_dn_per_e": 0.3, "scene.luminance_cd_m2": 1e9}
    merged = list(Chain.load("small-pixel-hdr").with_(**size, **full).run(seed=2).values())[-1]
    assert merged.saturated.all()
