"""Contrast never survives a veil, whichever way a scene is evaluated."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from labcdp.chain import Chain, Scene, StepChart, Windscreen
from labcdp.chain.predict.chain import predict_chain
from labcdp.core.luminance import LuminanceMap
from labcdp.evaluate.picture.edges.edges import ContrastMapSettings, EdgeKind
from labcdp.evaluate.picture.edges.map import contrast_map
from labcdp.evaluate.sweep.simulation.evaluation import evaluate_run

GLARES = (0.0, 0.3, 1.0, 4.0)


def veiled(glare_fraction: float, scene: Scene | None = None) -> Chain:
    """A camera behind a windscreen; 20 and 40 cd/m^2 without black level and dark current."""
    camera = Chain.load("manta-g505").with_(
        **{"sensor.width": 128, "sensor.height": 96, "scene.square_px": 16, "sensor.black_level_dn": 0.0},
        **{"sensor.dsnu_e_s": 0.0, "sensor.dark_current_e_s": 0.0, "optics.focal_length_m": None},
        **{"exposure.exposure_s": 0.005},
    )
    screen = ("windscreen", Windscreen(0.9, glare_fraction))
    return replace(camera, before=(screen, *camera.before), scene=scene or camera.scene)


def contrast_left(dark_cd_m2: float, bright_cd_m2: float, mean_cd_m2: float, glare_fraction: float) -> float:
    return (bright_cd_m2 - dark_cd_m2) / (dark_cd_m2 + glare_fraction * mean_cd_m2)


@pytest.mark.parametrize("chart", [None, StepChart(128, 96, (12.0, 24.0, 40.0, 6.0))])
def test_simulated_contrast_is_what_the_veil_leaves(chart: Scene | None) -> None:
    for glare_fraction in GLARES:
        run = veiled(glare_fraction, chart).run(seed=1)
        scene, levels = run.chain.scene, {one.name: one.luminance_cd_m2 for one in run.chain.scene.levels()}
        for stage in evaluate_run(run).stages[1:]:
            for pair in stage.pairs:
                mean_cd_m2 = float(scene.luminance_map().mean())
                left = contrast_left(levels[pair.dark], levels[pair.bright], mean_cd_m2, glare_fraction)
                # Noise of the sensor over 3072 pixels of a region at the least; before it there is none.
                sigma = 0.0 if stage.name != "sensor" else (1 + left) * sqrt(2 / 3072) / pair.cnr.value * left
                assert pair.measured_contrast == pytest.approx(left, rel=1e-5, abs=5 * sigma)


@pytest.mark.parametrize("by_simulation", [True, False])
def test_probability_of_detection_falls_with_the_veil(by_simulation: bool) -> None:
    cdps = []
    for glare_fraction in GLARES:
        chain = veiled(glare_fraction)
        simulated = evaluate_run(chain.run(seed=1)).stages[-1].pairs[0].cdp
        assert simulated is not None
        cdps.append(simulated.cdp if by_simulation else float(predict_chain(chain).cdp[0]))
    assert cdps == sorted(cdps, reverse=True)
    assert cdps[0] > 0.99
    assert cdps[-1] < 0.05


def test_map_asked_for_the_contrast_of_the_scene_loses_what_the_veil_takes() -> None:
    scene = np.full((240, 320), 100.0)
    scene[:, 167:] = 150.0
    noise = 3 * np.random.default_rng(0).normal(size=(2, *scene.shape))
    clear, veiled = (light_of(scene + noise[0]), light_of(scene + 200 + noise[1]))
    by_own, by_reference, by_contrast = (
        contrast_map(veiled, ContrastMapSettings(30, contrast=given), reference)
        for given, reference in ((None, None), (None, clear), (0.5, None))
    )
    edges = by_own.of_kind(EdgeKind.SEEN)
    assert edges.sum() > 5
    assert by_own.count(EdgeKind.LOST) == 0
    assert by_own.edges.asked_contrast[edges] == pytest.approx(50 / 300, rel=0.02)
    assert [one.code for one in by_own.findings] == ["map-of-own-contrast"]
    for found in (by_reference, by_contrast):
        lost = found.of_kind(EdgeKind.LOST)
        assert lost.sum() > 5
        assert found.count(EdgeKind.SEEN, EdgeKind.UNEVEN, EdgeKind.FAINT) == 0
        assert found.edges.asked_contrast[lost] == pytest.approx(0.5, rel=0.02)
        assert found.edges.contrast[lost] == pytest.approx(50 / 300, rel=0.02)
        assert found.edges.cdp[lost] == pytest.approx(0, abs=1e-3)


def light_of(luminance_cd_m2: np.ndarray) -> LuminanceMap:
    nothing = np.zeros(luminance_cd_m2.shape, np.uint8)
    return LuminanceMap(luminance_cd_m2, np.full(luminance_cd_m2.shape, 0.01), (), nothing)
