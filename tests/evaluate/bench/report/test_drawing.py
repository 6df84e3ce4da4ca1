"""Images made small, and pictures of them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from labcdp.core.luminance import Invalid, LuminanceMap
from labcdp.evaluate.bench.session import SessionEvaluation
from labcdp.report.drawing import block_mean
from labcdp.report.maps import luminance_picture

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


def luminance(evaluation: SessionEvaluation) -> bytes:
    return luminance_picture(evaluation.map, "luminance", False, evaluation.calibration.range_cd_m2)


def with_map(evaluation: SessionEvaluation, invalid: NDArray[np.uint8], luminance_cd_m2: float) -> SessionEvaluation:
    luminance = np.full(invalid.shape, luminance_cd_m2)
    return replace(evaluation, map=LuminanceMap(luminance, np.full(invalid.shape, 0.01), 0.01, invalid))


def test_one_saturated_pixel_of_nine_shows(real_evaluation: SessionEvaluation) -> None:
    invalid = np.zeros((2040, 2040), dtype=np.uint8)  # drawn pixels stand for 3 x 3
    invalid[0, 0] = Invalid.SATURATED
    dot = area(luminance(with_map(real_evaluation, invalid, 5.0)), VERMILLION)
    invalid[500:1700, 1001] = Invalid.SATURATED
    line = area(luminance(with_map(real_evaluation, invalid, 5.0)), VERMILLION)
    assert line >= dot + 400  # of the line, each third pixel at least; the legend is in both


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
    picture = luminance(with_map(real_evaluation, invalid, luminance_cd_m2))
    assert area(picture, colour) > 0.3 * decoded(picture)[..., 0].size
