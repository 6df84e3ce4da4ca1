"""Contrast never survives a veil, whichever way a scene is evaluated."""

from dataclasses import replace
from math import sqrt

import pytest

from labcdp.chain import Chain, StepChart, Windscreen
from labcdp.chain.predict.chain import predict_chain
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_run

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
