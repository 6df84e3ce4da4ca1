"""Flare of a simulated lens whose spread function is known, and the uncertainty of what a calibration leaves."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

from labcdp.core.errors import InputError
from labcdp.core.luminance import CommonError, Invalid, LuminanceMap
from labcdp.core.quantity import Quantity
from labcdp.core.roi import Roi
from labcdp.metrics import flare
from labcdp.metrics.stray_light import attenuation_db

#: Size of the picture, middle, radius and luminance of the source, and what a lens spreads of the light of each point.
SHAPE, MIDDLE, RADIUS_PX, SOURCE_CD_M2 = (240, 320), (130.0, 120.0), 12.0, 50_000.0
SPREAD, CORE_PX = 0.05, 15.0
MASK = [Roi.rectangle("lamp", 110, 100, 40, 40)]


def seen_light():
    """Light of an even disc through a lens that spreads a share of it as 1 / (1 + (r / core)²)^1.5, and the spread."""
    y, x = (np.arange(size) + 0.5 for size in SHAPE)
    distance = np.hypot(x - MIDDLE[0], y[:, None] - MIDDLE[1])
    scene = SOURCE_CD_M2 * np.clip(RADIUS_PX + 0.5 - distance, 0, 1)
    v, u = np.mgrid[-SHAPE[0] + 1 : SHAPE[0], -SHAPE[1] + 1 : SHAPE[1]]
    kernel = (1 + (u**2 + v**2) / CORE_PX**2) ** -1.5
    # Of the whole plane: the integral of 2 pi r (1 + (r / c)²)^-1.5 is 2 pi c².
    kernel *= SPREAD / (2 * np.pi * CORE_PX**2)
    stray = fftconvolve(scene, kernel, mode="valid" if scene.shape == kernel.shape else "same")
    return (1 - SPREAD) * scene, stray


SCENE, STRAY = seen_light()


def test_flare_of_a_known_spread_function():
    noisy = SCENE + STRAY + np.random.default_rng(1).normal(0, 0.02, SHAPE)
    found = flare(noisy, MASK, unit="cd/m²", block_px=16)
    np.testing.assert_allclose(found.centre_px, MIDDLE)
    y, x = (np.arange(size) + 0.5 for size in SHAPE)
    distance, ratio = np.hypot(x - MIDDLE[0], y[:, None] - MIDDLE[1]), 10 ** (1 / 16)
    # Mean radius of a ring over its inner one.
    mean_over_inner = 2 / 3 * (ratio**3 - 1) / (ratio**2 - 1)
    for radius, value, u in zip(found.radius_px, found.light.profile.value, found.light.profile.u, strict=True):
        if 60 < radius < 100:
            inner = radius / mean_over_inner
            ring = (distance > inner) & (distance < ratio * inner)
            assert value == pytest.approx(STRAY[ring].mean(), rel=0.01)
            assert u < 0.01 * value
    outside = np.ones(SHAPE, bool)
    outside[100:140, 110:150] = False
    assert found.light.mean.value == pytest.approx(STRAY[outside].mean(), rel=1e-3)
    weighted, free = (part.reshape(15, 16, 20, 16).sum(axis=(1, 3)) for part in (STRAY * outside, outside))
    blocks = weighted / np.maximum(free, 1)
    row, column = (round(float(at)) // 16 for at in found.worst_px[::-1])
    assert found.light.worst.value == pytest.approx(blocks[row, column], rel=0.01)
    assert found.light.worst.value == np.nanmax(found.light.blocks.value)
    shown = free >= 0.5 * 16**2
    np.testing.assert_array_equal(np.isfinite(found.light.blocks.value), shown)
    bright = shown & (blocks > 1)
    np.testing.assert_allclose(found.light.blocks.value[bright], blocks[bright], rtol=0.01)


def test_intensity_and_normalised_flare():
    light = SCENE + STRAY
    direct = light / 1000
    found = flare(
        light,
        MASK,
        unit="cd/m²",
        illuminance_lx=Quantity(250.0, 5.0),
        direct=direct,
        attenuation=Quantity(1000.0, 20.0),
    )
    assert found.intensity.worst.value == pytest.approx(np.pi * found.light.worst.value / 250)
    assert found.intensity.worst.u == pytest.approx(
        found.intensity.worst.value * np.hypot(0.02, found.light.worst.u / found.light.worst.value)
    )
    # The source as it is seen: its own light less what is spread, and what is spread into it.
    source = np.median(light[light >= 0.5 * light.max()])
    assert found.normalised.mean.value == pytest.approx(found.light.mean.value / source, rel=1e-6)
    assert found.normalised.mean.u == pytest.approx(0.02 * found.normalised.mean.value, rel=0.02)
    assert attenuation_db(found.normalised.mean.value) == pytest.approx(
        10 * np.log10(source / found.light.mean.value), rel=1e-6
    )
    assert attenuation_db(2.0) == 0


def test_noise_alone_has_a_mean_within_its_uncertainty():
    random, inside = np.random.default_rng(3), []
    for _ in range(60):
        light = np.full((60, 80), 5.0) + random.normal(0, 1, (60, 80))
        found = flare(light, [Roi.rectangle("lamp", 30, 20, 12, 12)], block_px=10)
        inside.append(abs(found.light.mean.value - 5) < found.light.mean.U)
        profile = found.light.profile
        inside += (np.abs(profile.value - 5) < profile.U).tolist()
    assert np.mean(inside) == pytest.approx(0.95, abs=3 * np.sqrt(0.95 * 0.05 / len(inside)))


def as_map(light, scale_rel, slow_cd_m2=0.0, invalid=None):
    flags = np.zeros(light.shape, np.uint8) if invalid is None else invalid
    return LuminanceMap(
        light, np.zeros_like(light), (CommonError("meter scale", scale_rel),), flags, slow_cd_m2=slow_cd_m2
    )


def test_errors_that_pictures_share_cancel():
    light = SCENE + STRAY
    alone = flare(as_map(light, 0.03), MASK, unit="cd/m²")
    assert alone.light.mean.u_rel == pytest.approx(0.03, rel=1e-3)
    over_itself = flare(as_map(light, 0.03), MASK, unit="cd/m²", direct=as_map(light / 100, 0.03))
    assert over_itself.normalised.mean.u_rel < 5e-3
    # A scale that is only guessed is that of both.
    guessed = flare(as_map(light, np.inf), MASK, unit="cd/m²", direct=as_map(light / 100, np.inf))
    assert np.isnan(guessed.light.mean.u)
    assert guessed.normalised.mean.u_rel < 5e-3
    # What is added to both, of darkness, does not average down within a place.
    dark = flare(as_map(light, 0.0, slow_cd_m2=0.5), MASK, unit="cd/m²")
    assert dark.light.mean.u == pytest.approx(0.5, rel=1e-2)


def test_background_is_subtracted_with_its_errors():
    light, room = SCENE + STRAY, np.full(SHAPE, 40.0)
    found = flare(as_map(light + room, 0.03), MASK, unit="cd/m²", background=as_map(room, 0.03))
    assert found.light.mean.value == pytest.approx(flare(light, MASK).light.mean.value)
    assert found.light.mean.u_rel == pytest.approx(0.03, rel=1e-3)


def test_defects_are_left_out_and_saturation_is_counted():
    light, invalid = SCENE + STRAY, np.zeros(SHAPE, np.uint8)
    light[10, 10:60], invalid[10, 10:60] = 1e6, Invalid.DEFECT
    invalid[200, :10] = Invalid.SATURATED
    found = flare(as_map(light, 0.0, invalid=invalid), MASK, unit="cd/m²")
    assert found.light.mean.value == pytest.approx(flare(SCENE + STRAY, MASK).light.mean.value, rel=1e-3)
    assert found.saturated_share == pytest.approx(10 / (SCENE.size - 1600 - 50))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"source": [Roi.rectangle("all", 0, 0, 320, 240)]}, "the regions of the source hold all pixels, or none"),
        ({"source": []}, "the regions of the source hold all pixels, or none"),
        ({"illuminance_lx": Quantity(100.0, 1.0)}, "the illuminance is given, but the light has no scale"),
        ({"illuminance_lx": Quantity(0.0, 1.0), "unit": "cd/m²"}, "the illuminance is 0 lx: give a number above 0"),
        ({"direct": np.zeros(SHAPE)}, "the direct picture has no light in the regions of the source"),
        ({"direct": np.zeros((10, 10))}, "the direct picture has 10 x 10 pixels, the picture 320 x 240"),
        ({"direct": SCENE * 1e300}, "the direct picture reaches"),
        ({"direct": [["bright"]]}, "the direct picture has type"),
        ({"block_px": 0}, "the blocks have 0 pixels a side: give at least 1"),
    ],
)
def test_refusals(options, message):
    with pytest.raises(InputError, match=message):
        flare(SCENE + STRAY, **{"source": MASK, **options})
