"""The public data sets of EMVA 1288 beside the figures of the reference implementation."""

import pytest
from validation.real_camera import real_camera

from labcdp.calibration.emva.data_set import characterise_data_set

from .conftest import reference_set
from .reference_figures import NAMES, SETS


@pytest.mark.parametrize(("name", "reference", "deviation", "codes"), SETS)
def test_values_agree_as_the_docs_state(name, reference, deviation, codes):
    found = characterise_data_set(folder := reference_set(name))
    assert [getattr(found, name).value for name in NAMES] == pytest.approx(reference, rel=deviation)
    assert [one.code for one in found.findings] == codes
    if name.startswith("001"):
        mean, variance = found.dark_current_e_s, found.dark_current_by_variance_e_s
        spread = (mean.u**2 + variance.u**2) ** 0.5
        assert abs(mean.value - variance.value) < 3 * spread
        assert {one.verdict for one in real_camera(folder, found)} == {"agrees"}
