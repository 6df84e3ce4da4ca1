"""Contrast never survives a veil, whichever way a scene is evaluated."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.chain import Chain, StepChart, Windscreen
from labcdp.chain.predict.chain import predict_chain
from labcdp.core.luminance import LuminanceMap
from labcdp.evaluate.picture.edges.edges import ContrastMapSettings, EdgeKind
from labcdp.evaluate.picture.edges.map import contrast_map
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


def light_of(luminance_cd_m2):
    nothing = np.zeros(luminance_cd_m2.shape, np.uint8)
    return LuminanceMap(luminance_cd_m2, np.full(luminance_cd_m2.shape, 0.01), (), nothing)


def test_map_asked_for_the_contrast_of_the_scene_loses_what_the_veil_takes():
    """Of the 50 % of the clear scene there are 50 / 300 behind the veil."""
    scene = np.broadcast_to(np.where(np.arange(320) < 167, 100.0, 150.0), (240, 320))
    noise = 3 * np.random.default_rng(0).normal(size=(2, *scene.shape))
    clear, dim = light_of(scene + noise[0]), light_of(scene + 200 + noise[1])
    by_own, *others = (
        contrast_map(dim, ContrastMapSettings(30, contrast=given), reference)
        for given, reference in ((None, None), (None, clear), (0.5, None))
    )
    edges = by_own.of_kind(EdgeKind.SEEN)
    assert edges.sum() > 5
    assert by_own.count(EdgeKind.LOST) == 0
    assert by_own.edges.asked_contrast[edges] == pytest.approx(50 / 300, rel=0.02)
    assert [one.code for one in by_own.findings] == ["map-of-own-contrast"]
    for found in others:
        lost = found.of_kind(EdgeKind.LOST)
        assert lost.sum() > 5
        assert found.count(EdgeKind.SEEN, EdgeKind.UNEVEN, EdgeKind.FAINT) == 0
        asked, seen, cdps = (getattr(found.edges, name)[lost] for name in ("asked_contrast", "contrast", "cdp"))
        assert asked == pytest.approx(0.5, rel=0.02)
        assert seen == pytest.approx(50 / 300, rel=0.02)
        assert cdps == pytest.approx(0, abs=1e-3)
