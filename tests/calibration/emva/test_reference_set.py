"""The figures of the reference evaluation of set 001 (Basler CCD, 12 bit)."""

import pytest

from labcdp.calibration.emva import characterise_data_set

#: What the makers of the set published about it; the linearity errors are fractions.
PUBLISHED = {
    "responsivity": 0.126727,
    "k_dn_per_e": 0.28006,
    "quantum_efficiency": 0.4525,
    "saturation_photons": 30957.0,
    "prnu_rel": 0.00433,
}
PUBLISHED_LINEARITY = {"linearity_error_min_rel": -0.00616, "linearity_error_max_rel": 0.0048}


@pytest.fixture(scope="module")
def found(reference_set):
    return characterise_data_set(reference_set)


@pytest.mark.parametrize(("name", "reference"), PUBLISHED.items())
def test_values_agree_as_the_docs_state(found, name, reference):
    assert getattr(found, name).value == pytest.approx(reference, rel=0.0006)


@pytest.mark.parametrize(("name", "reference"), PUBLISHED_LINEARITY.items())
def test_linearity_errors_agree_as_the_docs_state(found, name, reference):
    assert getattr(found, name).value == pytest.approx(reference, abs=1e-5)


def test_dark_current_by_mean_and_by_variance_agree(found):
    mean, variance = found.dark_current_e_s, found.dark_current_by_variance_e_s
    spread = (mean.standard_uncertainty**2 + variance.standard_uncertainty**2) ** 0.5
    assert abs(mean.value - variance.value) < 3 * spread


def test_nothing_is_suspicious_but_the_converters_end(found):
    assert [(one.code, one.severity) for one in found.findings] == [("converter-saturates", "info")]
    assert found.saturation_limit == "converter"
