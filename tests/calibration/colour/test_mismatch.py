"""Spectral mismatch errors: coverage for simulated cameras and measured reflectances, and what cancels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from labcdp.calibration.colour.conversion import colourfulness, mismatch_errors
from labcdp.calibration.colour.weights import ColourData, Prior, combine
from labcdp.core.photometry import spectral_weights

LIGHTS = ("LED-B3", "LED-B1", "LED-B4", "D65", "A", "E", "FL11", "LED-V1", "LED-BH1")
COLOURS = arrays(float, 3, elements=st.floats(0.1, 10))


def patterns(by_colour, spectral_rel=1.0):
    return np.array([error.relative for error in mismatch_errors(np.asarray(by_colour), spectral_rel)])


@given(one=COLOURS, other=COLOURS, factor=st.floats(0.01, 100))
def test_errors_have_the_stated_size_and_cancel_for_one_chromaticity_only(one, other, factor):
    for by_colour in (one, other):
        assert np.linalg.norm(patterns(by_colour, 0.3)) == pytest.approx(0.3 * np.std(by_colour) / np.mean(by_colour))
    assert patterns(factor * one) == pytest.approx(patterns(one), abs=1e-9)
    assert colourfulness(one) == pytest.approx(np.std(one) / np.mean(one))


def random_camera(rng, nm):
    """Bells with unlike flanks at usual places, cross talk, and a filter for infrared light."""

    def bell(peak_nm, left_nm, right_nm):
        return np.exp(-(((nm - peak_nm) / np.where(nm < peak_nm, left_nm, right_nm)) ** 2) / 2)

    def cross_talk(peak_nm):
        return rng.uniform(0, 0.1) * bell(peak_nm, 40, 40)

    red = bell(rng.normal(603, 8), rng.uniform(18, 35), rng.uniform(30, 50)) + cross_talk(450) + cross_talk(530)
    green = bell(rng.normal(535, 7), rng.uniform(28, 42), rng.uniform(28, 45)) + cross_talk(620)
    blue = bell(rng.normal(458, 7), rng.uniform(20, 32), rng.uniform(25, 40)) + cross_talk(540)
    return np.stack([red, green, blue]) / (1 + np.exp((nm - rng.uniform(650, 690)) / 8))


def seen_of_chart(rng, nm, visibility, reflectances):
    """Luminances of the chart by R, G and B of a random camera in a random light, over the true ones; 1 for grey."""
    camera, power = random_camera(rng, nm), spectral_weights(str(rng.choice(LIGHTS)))[1]
    reflected = reflectances * power
    luminance = reflected @ visibility / (power @ visibility)
    return rng.permutation(reflected @ camera.T / (power @ camera.T) / luminance[:, None])


def test_contrasts_of_other_colours_lie_in_their_interval():
    """60 cameras and lights; 4 to 12 coloured patches in the fit, contrasts between the others and to grey.

    The pairs of one camera are dependent: the standard error is that of the mean over cameras. Pairs of similar colours
    have less, as two materials that look alike to a camera may differ in luminance.
    """
    import colour

    rng, noise_rel = np.random.default_rng(14), 0.003
    nm, _, visibility = spectral_weights("E")
    chart = colour.SDS_COLOURCHECKERS["ColorChecker N Ohta"]
    reflectances = np.array([np.interp(nm, one.wavelengths, one.values) for one in chart.values()])[:18]
    covered = {"unlike": [], "to grey": [], "all": []}
    for _ in range(60):
        seen, n = seen_of_chart(rng, nm, visibility, reflectances), int(rng.integers(4, 13))
        fitted = np.concatenate([np.ones((6, 3)), seen[:n]])
        fitted *= 1 + rng.normal(0, noise_rel, (len(fitted), 1))
        own, shared = np.full(fitted.shape, 0.001), np.full(len(fitted), noise_rel)
        found = combine(ColourData(fitted, own, shared, colourfulness(fitted)), Prior(np.array([0.3, 0.5, 0.2]), 0.5))
        others = np.concatenate([seen[n:], np.ones((1, 3))])
        indicated = others @ found.weights
        errors = found.spectral_rel * patterns(others).T
        i, j = np.triu_indices(len(others), 1)
        by_weights = others[i] / indicated[i, None] - others[j] / indicated[j, None]
        variance = np.sum((by_weights @ found.covariance) * by_weights, axis=1)
        variance += np.sum((errors[i] - errors[j]) ** 2, axis=1)
        inside = np.abs(np.log(indicated[i] / indicated[j])) < 1.96 * np.sqrt(variance)
        grey, relative = j == len(others) - 1, others / others.mean(axis=1, keepdims=True)
        unlike = ~grey & (np.linalg.norm(relative[i] - relative[j], axis=1) > 0.6)
        for kind, of_kind in (("to grey", grey), ("unlike", unlike), ("all", np.ones_like(grey))):
            covered[kind].append(inside[of_kind].mean() if of_kind.any() else np.nan)
    for kind, shares in covered.items():
        error = np.nanstd(shares) / np.sqrt(len(shares))
        assert 0.93 - 2 * error < np.nanmean(shares) < 0.97 + 2 * error, kind
