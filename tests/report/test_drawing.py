"""Images made small, and pictures of them."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from labcdp.evaluate import SessionEvaluation
from labcdp.luminance import Invalid, LuminanceMap
from labcdp.report.drawing import block_mean
from labcdp.report.pictures import luminance_figure, target_figure
from labcdp.report.plots import contrast_figure, fit_figure

VERMILLION, GREY, PINK, BLUE = (213, 94, 0), (154, 154, 154), (204, 121, 167), (0, 114, 178)


def decoded(png: bytes) -> NDArray[np.uint8]:
    """Picture as RGB, shape (height, width, 3)."""
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture[..., ::-1]


def area(png: bytes, colour: tuple[int, int, int]) -> int:
    """Pixels of exactly a colour."""
    return int(np.all(decoded(png) == colour, axis=-1).sum())


@pytest.mark.parametrize(("shape", "side"), [((7, 9), 3), ((6, 9), 3), ((5, 1), 4), ((1, 1), 1), ((8, 8), 1)])
def test_block_mean_against_a_loop(shape: tuple[int, int], side: int) -> None:
    image = np.random.default_rng(0).normal(size=shape)
    expected = [
        [image[y : y + side, x : x + side].mean() for x in range(0, shape[1], side)] for y in range(0, shape[0], side)
    ]
    np.testing.assert_allclose(block_mean(image, side), expected, rtol=0, atol=1e-15)


def test_block_mean_of_a_mask_is_a_share() -> None:
    mask = np.zeros((4, 4), dtype=np.bool_)
    mask[0, :3] = True
    np.testing.assert_array_equal(block_mean(mask, 2), [[0.5, 0.25], [0.0, 0.0]])


def with_map(evaluation: SessionEvaluation, invalid: NDArray[np.uint8], luminance_cd_m2: float) -> SessionEvaluation:
    luminance = np.full(invalid.shape, luminance_cd_m2)
    return replace(evaluation, map=LuminanceMap(luminance, np.full(invalid.shape, 0.01), 0.01, invalid))


def test_one_saturated_pixel_of_nine_shows(real_evaluation: SessionEvaluation) -> None:
    invalid = np.zeros((2100, 2100), dtype=np.uint8)  # drawn pixels stand for 3 x 3
    invalid[0, 0] = Invalid.SATURATED
    dot = area(luminance_figure(with_map(real_evaluation, invalid, 5.0)), VERMILLION)
    invalid[500:1700, 1001] = Invalid.SATURATED
    line = area(luminance_figure(with_map(real_evaluation, invalid, 5.0)), VERMILLION)
    assert line >= dot + 400  # of the line, each third pixel at least; the legend is in both


@pytest.mark.parametrize(("of_four", "shown"), [(1, False), (3, True)])
def test_a_drawn_pixel_is_not_valid_if_most_of_its_pixels_are_not(
    real_evaluation: SessionEvaluation, of_four: int, shown: bool
) -> None:
    invalid = np.zeros((1000, 1200), dtype=np.uint8)  # drawn pixels stand for 2 x 2
    for i in range(of_four):
        invalid[i // 2 :: 2, i % 2 :: 2] = Invalid.OUTSIDE_CALIBRATED
    dark = 0.5 * real_evaluation.calibration.range_cd_m2[0]
    picture = luminance_figure(with_map(real_evaluation, invalid, dark))
    assert (area(picture, GREY) > 0.3 * decoded(picture)[..., 0].size) == shown


@pytest.mark.parametrize(
    ("flag", "luminance_rel", "colour"),
    [
        (Invalid.SATURATED, 1.0, VERMILLION),
        (Invalid.BELOW_BLACK | Invalid.OUTSIDE_CALIBRATED, -0.1, (0, 0, 0)),
        (Invalid.OUTSIDE_CALIBRATED, 0.5, GREY),
        (Invalid.OUTSIDE_CALIBRATED, 1e4, PINK),
    ],
)
def test_each_reason_has_its_colour(
    real_evaluation: SessionEvaluation, flag: int, luminance_rel: float, colour: tuple[int, int, int]
) -> None:
    invalid = np.full((50, 60), flag, dtype=np.uint8)
    luminance_cd_m2 = luminance_rel * real_evaluation.calibration.range_cd_m2[0]
    picture = luminance_figure(with_map(real_evaluation, invalid, luminance_cd_m2))
    assert area(picture, colour) > 0.3 * decoded(picture)[..., 0].size


def test_names_that_fit_stand_in_the_picture_others_beside_it(
    renamed: Callable[[list[str]], SessionEvaluation],
) -> None:
    short, long = (
        decoded(target_figure(renamed([f"{letter * n} {i}" for i in range(6)]))) for letter, n in (("P", 1), ("W", 25))
    )
    assert long.shape[1] > short.shape[1] + 150


@pytest.mark.parametrize("name", ["$", "$\\frac$", "a_b^{c", "\x07bell", "\u7070\u8272", "\U0001f4a1", "x" * 500])
def test_any_name_can_be_drawn(renamed: Callable[[list[str]], SessionEvaluation], name: str) -> None:
    assert decoded(target_figure(renamed([name, "a", "b", "c", "d", "e"]))).std() > 10


@pytest.mark.parametrize("draw", [target_figure, fit_figure])
def test_figures_of_a_simulated_bench_say_so(
    evaluation: SessionEvaluation,
    real_evaluation: SessionEvaluation,
    draw: Callable[[SessionEvaluation], bytes],
) -> None:
    assert area(draw(evaluation), VERMILLION) > area(draw(real_evaluation), VERMILLION) == 0


def test_contrast_figure_survives_a_distribution_beside_the_plot(evaluation: SessionEvaluation) -> None:
    row = evaluation.contrasts[0]
    empty = replace(row.distribution, cumulative=np.zeros_like(row.distribution.cumulative))
    assert area(contrast_figure(replace(row, distribution=empty), simulated=False), BLUE) > 0
