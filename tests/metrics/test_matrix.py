"""CDP of all pairs of many regions: exact arithmetic, single pairs, closed forms and coverage."""

from fractions import Fraction
from itertools import product
from math import inf, isfinite, sqrt

import numpy as np
import pytest
from scipy.ndimage import uniform_filter

from labcdp import cdp_matrix
from labcdp.core.errors import InputError
from labcdp.metrics import DetectionInterval, cdp, cnr, csnr, d_prime, variance_inflation, weber_contrast_of_means

from .closed_forms import NORMAL, share_of_normal

#: Fields of `Cdp` and the variables that they are.
FIELDS = {
    "cdp": lambda result: result.cdp,
    "cdp_low": lambda result: result.interval.low,
    "cdp_high": lambda result: result.interval.high,
    "u_cdp": lambda result: result.u,
    "below": lambda result: result.below,
    "above": lambda result: result.above,
    "undefined": lambda result: result.undefined,
    "correlation_inflation": lambda result: result.correlation_inflation,
}
RATIOS = {"cnr": cnr, "csnr": csnr, "d_prime": d_prime}


def random_regions(rng):
    """Two to four regions of few levels: equal values, regions and means, zeros and negative values are common."""
    lowest, highest = [(-2, 6), (0, 3), (90, 130), (0, 4095)][rng.integers(4)]
    return [rng.integers(lowest, highest + 1, rng.integers(1, 8)).tolist() for _ in range(rng.integers(2, 5))]


def random_tolerance(rng):
    """A number, or an interval with two ends or one."""
    below, above = rng.integers(1, 101, 2).tolist()
    return [
        below / 100,
        DetectionInterval(below / 100, above / 50),
        DetectionInterval.at_least(below / 100),
        DetectionInterval.at_most(above / 50),
    ][rng.integers(4)]


def exact_range(contrast, epsilon):
    below, above = (epsilon.below, epsilon.above) if isinstance(epsilon, DetectionInterval) else (epsilon, epsilon)
    middle = Fraction(str(contrast))
    low = -inf if below is None else middle * (1 - Fraction(str(below)))
    return low, inf if above is None else middle * (1 + Fraction(str(above)))


@pytest.mark.parametrize("n", [200, pytest.param(2000, marks=pytest.mark.long)])
def test_random_matrices_are_those_of_exact_arithmetic(all_contrasts, n):
    rng, n_open = np.random.default_rng(1), 0
    for _ in range(n):
        regions, epsilon, contrast = random_regions(rng), random_tolerance(rng), float(rng.integers(1, 100)) / 100
        low, high = exact_range(contrast, epsilon)
        n_open += not (isfinite(low) and isfinite(high))
        matrix = cdp_matrix(regions, contrast, epsilon)
        shares = np.array([matrix.cdp, matrix.below, matrix.above])
        for i, j in np.ndindex(len(regions), len(regions)):
            if i == j or max(regions[i] + regions[j]) <= 0:
                assert np.isnan(shares[:, i, j]).all()
                continue
            flat = [value for row in all_contrasts(regions[i], regions[j]) for value in row]
            counts = (
                sum(low <= value <= high for value in flat),
                sum(not value >= low for value in flat),
                sum(value > high for value in flat),
            )
            assert shares[:, i, j].tolist() == [count / len(flat) for count in counts]
    assert n_open > n / 4


@pytest.fixture(scope="module")
def patches():
    """Regions of all kinds: floats and integers, parts of an image with and without correlation, ties, darkness."""
    rng = np.random.default_rng(3)
    levels = rng.integers(0, 4, 30)
    return {
        **{f"float {level}": rng.normal(level, level / 12, (15, 16)) for level in (3, 30, 33, 300)},
        "smooth": uniform_filter(rng.normal(31, 6, (20, 20)), 3),
        "single precision": rng.normal(28, 3, 50).astype(np.float32),
        "levels": levels,
        "same levels": levels[::-1],
        "part of levels": levels.reshape(5, 6).astype(np.uint8),
        "around zero": [-3, 1, 1, 4],
        "equal": [5, 5, 5],
        "pixel": [7],
        "two values": [6.0, 8.0],
        "dark": [0, 0],
        "below zero": np.array([-2.0, -1.0]),
    }


@pytest.mark.parametrize(
    "epsilon", [0.5, DetectionInterval(0.2, 1.5), DetectionInterval.at_least(0), DetectionInterval.at_most(0.5)]
)
def test_each_cell_is_that_of_the_pair_to_the_last_bit(patches, epsilon):
    contrasts = [0.1, 0.5, 3.0]
    matrix, n_undefined = cdp_matrix(patches, contrasts, epsilon), 0
    for bright, dark in product(patches, repeat=2):
        cell = matrix.sel(bright=bright, dark=dark)
        if bright == dark or {bright, dark} == {"dark", "below zero"}:
            assert all(np.isnan(cell[name]).all() for name in (*FIELDS, *RATIOS, "measured_contrast", "u_cnr"))
            n_undefined += 1
            continue
        expected = cdp(patches[bright], patches[dark], contrasts, epsilon)
        for name, value in FIELDS.items():
            np.testing.assert_array_equal(cell[name], value(expected), err_msg=f"{name} of {bright} / {dark}")
        assert bool(cell.swapped) == expected.swapped
    assert n_undefined == len(patches) + 2


def test_measured_contrasts_and_their_cdp_are_those_of_the_pairs(patches):
    matrix, n_usable = cdp_matrix(patches, epsilon=0.4), 0
    for bright, dark in product(patches, repeat=2):
        cell = matrix.sel(bright=bright, dark=dark)
        if bright == dark or {bright, dark} == {"dark", "below zero"}:
            continue
        contrast = weber_contrast_of_means(patches[bright], patches[dark])
        np.testing.assert_array_equal(cell.measured_contrast, contrast)
        if not 0 < contrast < inf:
            assert np.isnan(cell.cdp)
            assert np.isnan(cell.contrast)
            continue
        n_usable += 1
        expected = cdp(patches[bright], patches[dark], contrast, 0.4)
        assert cell.contrast == contrast
        for name, value in FIELDS.items():
            np.testing.assert_array_equal(cell[name], value(expected), err_msg=f"{name} of {bright} / {dark}")
    assert n_usable > 100


def test_ratios_are_those_of_the_pairs_and_their_u_includes_correlation(patches):
    matrix = cdp_matrix(patches, 0.2)
    for bright, dark in product(patches, repeat=2):
        if bright == dark or {bright, dark} == {"dark", "below zero"}:
            continue
        cell, both = matrix.sel(bright=bright, dark=dark), [np.asarray(patches[name]) for name in (bright, dark)]
        factor = 1.0
        if all(pixels.ndim == 2 for pixels in both):
            factor = sqrt(max(variance_inflation(pixels, np.ones(pixels.shape, dtype=bool)) for pixels in both))
            assert factor > 1.5 or "smooth" not in (bright, dark)
        for name, function in RATIOS.items():
            expected = function(patches[bright], patches[dark])
            np.testing.assert_allclose(cell[name], expected.value, rtol=1e-14, err_msg=f"{name} of {bright} / {dark}")
            u = expected.u * factor
            np.testing.assert_allclose(cell[f"u_{name}"], u, rtol=1e-9, err_msg=f"u_{name} of {bright} / {dark}")


def test_u_of_the_measured_contrast_is_its_scatter():
    rng, n, repeats = np.random.default_rng(5), 40, 500
    found = np.empty((repeats, 2))
    for i in range(repeats):
        matrix = cdp_matrix({"a": rng.normal(120, 10, n), "b": rng.normal(100, 5, n)})
        found[i] = matrix.measured_contrast[0, 1], matrix.u_measured_contrast[0, 1]
    expected = 1.2 * sqrt((10 / 120) ** 2 + (5 / 100) ** 2) / sqrt(n)
    # A standard deviation of N values has the relative scatter 1 / sqrt(2 N), of the n pixels of the wider region 0.11.
    assert found[:, 0].std() == pytest.approx(expected, rel=4 / sqrt(2 * repeats))
    assert found[:, 1].mean() == pytest.approx(expected, rel=4 * 0.11 / sqrt(repeats))


def test_normal_patches_give_the_closed_form():
    rng, n = np.random.default_rng(11), 10_000
    for (dark, dark_std, bright, bright_std), published in NORMAL:
        patches = {"bright": (bright, bright_std), "dark": (dark, dark_std), "darkest": (dark / 2, dark_std / 2)}
        contrast = bright / dark - 1
        matrix = cdp_matrix({name: rng.normal(*patch, n) for name, patch in patches.items()}, contrast)
        for upper, lower in (("bright", "dark"), ("dark", "darkest"), ("bright", "darkest")):
            cell = matrix.sel(bright=upper, dark=lower)
            expected = share_of_normal(patches[upper], patches[lower], 0.5 * contrast, 1.5 * contrast)
            # 4 standard uncertainties; where a CDP is near 0, its interval instead.
            assert abs(cell.cdp - expected) < 4 * cell.u_cdp or cell.cdp_low <= expected <= cell.cdp_high
        assert abs(matrix.cdp.sel(bright="bright", dark="dark") - published) < 4 * matrix.u_cdp.sel(
            bright="bright", dark="dark"
        )


@pytest.mark.parametrize(("repeats", "off"), [(100, 0.065), pytest.param(500, 0.02, marks=pytest.mark.long)])
@pytest.mark.parametrize("shape", [(225,), (15, 15), (25, 25)])
def test_intervals_of_a_matrix_cover_the_truth_in_95_percent(shape, repeats, off):
    levels, deviation = {"a": 100.0, "b": 115.0, "c": 135.0, "d": 160.0}, 0.08
    rng, pairs = np.random.default_rng(21), [("b", "a"), ("c", "b"), ("d", "c"), ("c", "a")]
    contrast = 0.2
    truths = [
        share_of_normal(*((levels[name], deviation * levels[name]) for name in pair), 0.5 * contrast, 1.5 * contrast)
        for pair in pairs
    ]
    covered = np.zeros(len(pairs))
    for _ in range(repeats):
        regions = {name: rng.normal(level, deviation * level, shape) for name, level in levels.items()}
        matrix = cdp_matrix(regions, contrast)
        for i, ((bright, dark), truth) in enumerate(zip(pairs, truths, strict=True)):
            cell = matrix.sel(bright=bright, dark=dark)
            covered[i] += float(cell.cdp_low) <= truth <= float(cell.cdp_high)
    # Of each pair within 3 sigma / sqrt(N), and 2 of many, with sigma = sqrt(0.95 * 0.05).
    assert (np.abs(covered / repeats - 0.95) < off).all()


def test_contrasts_of_stated_values_are_detected():
    rng = np.random.default_rng(2)
    regions = {name: rng.normal(level, 3, 100) for name, level in (("a", 50), ("b", 100), ("c", 120))}
    matrix = cdp_matrix(regions, {"a": 40.0, "b": 100.0, "c": 90.0, "other": 1.0}, "50%")
    assert matrix.contrast.sel(bright="b", dark="a") == matrix.contrast.sel(bright="a", dark="b") == 1.5
    assert matrix.cdp.sel(bright="a", dark="b") == cdp(regions["a"], regions["b"], 1.5).cdp
    # The brighter region has the smaller value.
    assert np.isnan(matrix.cdp.sel(bright="c", dark="b"))
    assert matrix.measured_contrast.sel(bright="c", dark="b") > 0.1


def test_dimensions_are_those_of_the_contrasts_and_regions_have_numbers_without_names():
    regions = np.arange(1, 25).reshape(3, 8)
    several, number, measured = (cdp_matrix(regions, contrast) for contrast in (["50%", 2], "50%", None))
    assert several.cdp.dims == ("bright", "dark", "contrast")
    assert number.cdp.dims == measured.cdp.dims == measured.contrast.dims == ("bright", "dark")
    assert several.bright.values.tolist() == several.dark.values.tolist() == ["1", "2", "3"]
    assert several.contrast.values.tolist() == [0.5, 2.0]
    np.testing.assert_array_equal(number.cdp, several.cdp.sel(contrast=0.5))
    assert all(several[name].attrs["long_name"] for name in several.variables)
    assert several.u_cdp.attrs["units"] == "1"
    assert (several.attrs["epsilon"], cdp_matrix(regions, 1, DetectionInterval(0.1, None)).attrs["epsilon"]) == (
        0.5, "DetectionInterval(below=0.1, above=None)"
    )  # fmt: skip


REFUSED = [
    ({"regions": {"a": [1]}}, "1 regions are given: give two or more, by name or as a list"),
    ({"regions": 3}, "regions is int: give arrays of pixels by name, or a list of them"),
    ({"regions": [[1, 2], []]}, "region '2' holds no pixel: give at least one"),
    ({"regions": [[1, 2], [1, np.nan]]}, "region '2' holds 1 values that are not finite: leave such pixels out"),
    ({"contrast": 0}, r"contrast is 0.0: give a fraction above 0 \(1.0 is 100 %\)"),
    ({"contrast": [[0.1]]}, r"contrast has the shape \(1, 1\): give a number, a list, or stated values of the regions"),
    ({"contrast": {"1": 2.0}}, "no value is stated for region '2': give one for each region"),
    ({"contrast": {"1": 2.0, "2": 0.0}}, "the value stated for region '2' is 0.0: give a number above 0"),
    ({"contrast": {"1": "2x", "2": 1.0}}, "the value stated for region '1' is '2x': give a number above 0"),
    ({"contrast": {"1": [2.0], "2": 1.0}}, r"the value stated for region '1' is \[2.0\]: give a number above 0"),
    ({"contrast": {"1": True, "2": 1.0}}, "the value stated for region '1' is True: give a number above 0"),
    ({"regions": {(1, 2): [1.0], (1, 3): [2.0]}}, r"\(1, 2\) is no name of a region: give text or a whole number"),
    ({"regions": b"abc"}, "regions is bytes: give arrays of pixels by name, or a list of them"),
    ({"contrast": None, "epsilon": 0}, "epsilon is 0: give a fraction above 0, up to 1"),
]


@pytest.mark.parametrize(("values", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_cannot_be_used_is_refused(values, message):
    with pytest.raises(InputError, match=f"^{message}$"):
        cdp_matrix(**({"regions": [[1, 2], [3, 4]], "contrast": 0.2} | values))


@pytest.mark.parametrize("shape", [(25,), (8, 8)])
def test_intervals_hold_in_each_cell(shape):
    """Of 200 repeats of normal patches 95 % less 4 standard deviations; of 500 they held in 92 to 99 % of each cell."""
    rng, levels, repeats = np.random.default_rng(3), (100, 112, 140, 200), 200
    truth = np.array([[share_of_normal((a, 12), (b, 12), 0.15, 0.45) for b in levels] for a in levels])
    brighter = np.greater.outer(levels, levels)
    held = np.zeros(truth.shape)
    for _ in range(repeats):
        matrix = cdp_matrix({str(level): rng.normal(level, 12, shape) for level in levels}, 0.3)
        held += (matrix.cdp_low.values <= truth) & (truth <= matrix.cdp_high.values)
    assert (held[brighter] / repeats > 0.95 - 4 * sqrt(0.95 * 0.05 / repeats)).all()
