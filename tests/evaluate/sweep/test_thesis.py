import numpy as np
import pytest

from labcdp.evaluate.sweep.thesis import TABLE_5_3, intensity_sweep, reproduce_row, reproduce_thesis
from labcdp.evaluate.sweep.thesis_report import thesis_files, thesis_result

from ...conftest import valid
from ...output.test_results_folder import write


@pytest.mark.parametrize(
    "row",
    [
        pytest.param(row, marks=[] if number % 3 == 0 else pytest.mark.long, id=f"row {row.label}")
        for number, row in enumerate(TABLE_5_3[:7])
    ],
)
def test_published_value_lies_within_two_standard_deviations(row):
    result = reproduce_row(row, range(15))
    assert abs(result.z) <= 2
    assert result.standard_deviation < 0.02


def test_intensity_sweep_falls_to_zero_where_the_well_is_full_while_snr_rises():
    sweep = intensity_sweep(13)
    assert sweep.luminance_cd_m2[[0, -1]] == pytest.approx([1e-3, 1e9])
    assert (sweep.cdp.max(), sweep.cdp[-1], sweep.snr_db[-1]) == (1.0, 0.0, np.inf)
    assert sweep.corrected_cdp.max() > 0.99
    assert sweep.corrected_cdp[-1] == 0.0


def test_the_files_hold_published_values_and_ours(tmp_path):
    reproduction = reproduce_thesis(2)
    # Where rows and columns share no pattern, neighbours are as any two pixels of the regions.
    last = reproduction.table[7]
    assert last.corrected_exact == pytest.approx(last.corrected_mean, abs=0.001)
    write(tmp_path, thesis_files(thesis_result(reproduction)))
    values = valid((tmp_path / "results.json").read_text())
    rows = values["tables"]["table_5_3"]["rows"]
    assert [row["mean"] for row in rows] == [row.mean for row in reproduction.table]
    assert (rows[7]["published_cdp"], rows[7]["z"], rows[7]["all_pairs_mean"]) == (0.99834205, 0.0, 1.0)
    assert ("thesis-unfilled-slots", "8") in [(one["code"], one["subject"]) for one in values["findings"]]
