import numpy as np
import pytest

from labcdp.evaluate.sweep.thesis import (
    NEIGHBOUR_PAIRS,
    TABLE_5_3,
    UNFILLED_SLOTS,
    intensity_sweep,
    reproduce_row,
    thesis_chain,
)


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, marks=[] if number % 3 == 0 else pytest.mark.long, id=f"row {row.label}")
        for number, row in enumerate(TABLE_5_3[:7])
    ],
)
def test_published_value_lies_within_two_standard_deviations(row):
    result = reproduce_row(row, range(30))
    assert abs(result.z) <= 2
    assert result.standard_deviation < 0.02


def test_pairs_of_neighbours_of_the_thesis_sensor():
    height, width = thesis_chain(TABLE_5_3[0]).scene.shape
    assert height * (width - 1) + (height - 1) * width == NEIGHBOUR_PAIRS
    # The slot of a row's first pixel is written again by the next one, in all rows but the first and the last.
    assert height - 2 == UNFILLED_SLOTS


def test_prediction_of_corrected_physics_agrees_where_rows_and_columns_share_nothing():
    row = TABLE_5_3[7]
    result = reproduce_row(row, range(4))
    assert result.corrected_exact == pytest.approx(result.corrected_mean, abs=0.001)


def test_intensity_sweep_falls_to_zero_where_the_well_is_full_while_snr_rises():
    sweep = intensity_sweep(13)
    assert sweep.luminance_cd_m2[0] == pytest.approx(1e-3)
    assert sweep.luminance_cd_m2[-1] == pytest.approx(1e9)
    assert sweep.cdp[-1] == 0.0
    assert sweep.snr_db[-1] == np.inf
    assert sweep.cdp.max() == 1.0
    assert sweep.corrected_cdp.max() > 0.99
    assert sweep.corrected_cdp[-1] == 0.0
