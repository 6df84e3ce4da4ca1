from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from labcdp.chain import (
    Chain,
    ChainRun,
    Context,
    Flat,
    Optics,
    ThesisWindscreen,
    Windscreen,
    preset_names,
)
from labcdp.core.errors import InputError

SENSOR: dict[str, Any] = {
    "pixel_pitch_m": 3e-6,
    "quantum_efficiency": 0.5,
    "full_well_e": 10_000,
    "k_dn_per_e": 0.25,
    "read_noise_e": 3.0,
    "dark_current_e_s": 20.0,
    "bits": 12,
    "black_level_dn": 16.0,
}
# Rows of more than one block of random numbers.
DOCUMENT: dict[str, Any] = {
    "scene": {
        "type": "checkerboard",
        "width": 40,
        "height": 150,
        "luminance_cd_m2": 20.0,
        "contrast": 1.0,
        "square_px": 7,
    },
    "windscreen": {"transmittance": 0.9, "glare_fraction": 0.2, "glare_subtracted": True},
    "optics": {"f_number": 2.0, "transmittance": 0.9, "focal_length_m": 6e-3},
    "exposure": {"exposure_s": 0.01},
    "sensor": SENSOR,
}
HDR_AND_ISP: dict[str, Any] = {"hdr": {"method": "normal", "bits": 20}, "isp": {"isp_bits": 20, "bits": 8}}
BRACKET = {"exposure": {"exposure_s": [0.003, 0.0155]}}


def chain_of(*changes: Mapping[str, Any], without: tuple[str, ...] = ()) -> Chain:
    document = dict(DOCUMENT)
    for change in changes:
        document |= change
    return Chain.from_document({key: value for key, value in document.items() if key not in without}, "test")


def small(preset: str) -> Chain:
    """A preset of few pixels; odd sizes have a pixel on the axis."""
    name = "scene" if preset.startswith("thesis") else "sensor"
    return Chain.load(preset).with_(**{f"{name}.width": 31, f"{name}.height": 21, "scene.square_px": 3})


def same_values(first: ChainRun, second: ChainRun) -> dict[str, bool]:
    return {name: bool((first[name].values == second[name].values).all()) for name in first}


TWO_SENSORS = {"sensor": [SENSOR | {"name": "left"}, SENSOR | {"name": "right", "pixel_pitch_m": 6e-6}]}


@pytest.mark.parametrize(
    ("chain", "names"),
    [
        (chain_of(), ["scene", "windscreen", "optics", "sensor"]),
        (chain_of(without=("windscreen", "optics", "exposure", "sensor")), ["scene"]),
        (
            chain_of(BRACKET, HDR_AND_ISP),
            ["scene", "windscreen", "optics", "sensor 3 ms", "sensor 15.5 ms", "hdr", "isp"],
        ),
        (
            chain_of(BRACKET, TWO_SENSORS, {"hdr": {"method": "linear"}}),
            [
                "scene",
                "windscreen",
                "optics",
                "sensor 3 ms (left)",
                "sensor 15.5 ms (left)",
                "hdr (left)",
                "sensor 3 ms (right)",
                "sensor 15.5 ms (right)",
                "hdr (right)",
            ],
        ),
    ],
)
def test_a_run_has_the_signal_behind_each_stage_in_order(chain: Chain, names: list[str]) -> None:
    run = chain.run()
    assert list(run) == list(chain.stage_names) == names
    with pytest.raises(InputError, match=r"^stage is 'x': give one of scene"):
        run["x"]
    assert ("x" in run, run.get("x"), len(run)) == (False, None, len(names))
    assert {run[name].values.shape for name in run} == {chain.scene.shape}


def test_same_seed_same_values_on_any_number_of_threads() -> None:
    chain = chain_of(BRACKET, HDR_AND_ISP)
    assert all(same_values(chain.run(3, threads=1), chain.run(3, threads=2)).values())


def test_each_sensor_sees_the_image_for_its_own_pixels() -> None:
    run = chain_of(TWO_SENSORS).run()
    for table in TWO_SENSORS["sensor"]:
        alone = chain_of({"sensor": table}).run()["sensor"]
        np.testing.assert_array_equal(run[f"sensor ({table['name']})"].values, alone.values)
        np.testing.assert_array_equal(run[f"sensor ({table['name']})"].luminance_cd_m2, alone.luminance_cd_m2)


def test_signals_know_which_pixels_are_saturated() -> None:
    run = chain_of({"exposure": {"exposure_s": [0.002, 0.05]}}, HDR_AND_ISP).run()
    bright = run.chain.scene.regions()["bright"]
    assert run["sensor 50 ms"].saturated[bright].mean() > 0.9
    for name in ("sensor 2 ms", "hdr", "isp"):
        assert not run[name].saturated.any()
    assert run["optics"].saturated is None


@pytest.mark.parametrize("preset", preset_names())
def test_without_noise_each_stage_of_a_preset_gives_back_the_scene(preset: str) -> None:
    chain = small(preset)
    run = chain.run()
    scene = run["scene"].values.astype(np.float64)
    expected = scene
    windscreen = dict(chain.before).get("windscreen")
    if isinstance(windscreen, ThesisWindscreen):
        tau = windscreen.transmittance
        expected = tau * scene + windscreen.glare_fraction * scene.mean() * (tau - 1 / tau)
    np.testing.assert_array_equal(run["scene"].luminance_cd_m2, run["scene"].values)
    for name, _ in chain.before:
        np.testing.assert_allclose(run[name].luminance_cd_m2, expected, rtol=1e-5)
    sensor = chain.sensors[0][1]
    context = Context(chain.spectrum, 0, sensor.pixel_pitch_m, chain.settings)
    captures = [sensor.capture(run["optics"], context, index) for index in range(len(chain.settings.exposure_s))]
    if chain.hdr is not None:
        captures.append(chain.hdr.merge(captures))
    for name, shot in zip(chain.recorded_names, captures, strict=False):
        noise_free = shot.dark_dn + shot.dn_per_lx * run["optics"].values.astype(np.float64)
        np.testing.assert_allclose(run[name].to_luminance(noise_free), expected, rtol=1e-4)


@pytest.mark.parametrize("preset", preset_names())
def test_levels_take_the_way_of_the_image_on_the_axis(preset: str) -> None:
    chain = small(preset)
    run = chain.run()
    levels = chain.scene.levels()
    front = chain.front(
        np.array([[level.luminance_cd_m2 for level in levels]]), np.array([[level.share for level in levels]])
    )
    on_axis = np.zeros(chain.scene.shape, bool)
    on_axis[10, 15] = True
    lens = dict(chain.before)["optics"]
    checked = 0
    for number, level in enumerate(levels):
        region = chain.scene.regions()[level.name] & (on_axis | (lens.focal_length_m is None))
        for got in run["optics"].values[region]:
            assert got == pytest.approx(front.values[0, number], rel=1e-5)
            checked += 1
        for got in run["optics"].luminance_cd_m2[region]:
            assert got == pytest.approx(front.luminance_cd_m2[0, number], rel=1e-5)
    assert checked > 0


def test_a_sensor_that_does_not_see_the_light_is_refused() -> None:
    chain = chain_of().with_(
        **{"sensor.quantum_efficiency": [[400, 0.5], [500, 0.5]], "spectrum": "monochromatic 600 nm"}
    )
    message = r"^quantum_efficiency is 0 wherever 'monochromatic 600 nm' has light: give values there$"
    with pytest.raises(InputError, match=message):
        chain.run()


def test_parts_put_together_by_hand_are_checked_too() -> None:
    chain = chain_of()
    with pytest.raises(
        InputError, match=r"^windscreen takes luminance in cd/m\^2, but what comes to it is illuminance"
    ):
        replace(chain, before=(("optics", Optics(2.0, 0.9)), ("windscreen", Windscreen(0.9))))
    with pytest.raises(
        InputError, match=r"^optics takes luminance in cd/m\^2, but what comes to it is digital number in"
    ):
        replace(chain, behind=(("optics", Optics(2.0, 0.9)),))
    sensor = chain.sensors[0][1]
    with pytest.raises(InputError, match=r"^two signals would have the name 'sensor \(a\)': give each its own"):
        replace(chain, sensors=(("a", sensor), ("a", sensor)))
    with pytest.raises(InputError, match=r"^sensor has width 40 and height 150, the scene 3 and 2: give them once"):
        replace(chain, scene=Flat(3, 2, 1.0))


def test_camera_takes_windscreen_optics_and_sensor_of_the_chain() -> None:
    chain = chain_of()
    camera = chain.camera()
    assert (camera.windscreen, camera.optics) == tuple(stage for _, stage in chain.before)
    assert camera.sensor is chain.sensors[0][1]
    scene = chain.scene.luminance_map()
    dn = camera.sensor.expose(camera.electron_rate(scene), 0.01, temperature_c=25.0, seed=5, exposure_index=0)
    np.testing.assert_array_equal(dn, chain.run(5)["sensor"].values)
