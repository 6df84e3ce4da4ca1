"""A camera with colour filters: its budget, and what verification finds changed: a plane, all planes, a dark level."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest

from labcdp.calibration import colour_patch_luminance, fit_colour
from labcdp.calibration.budget import budget, budget_exposure_s
from labcdp.calibration.record import load_verification, save_verification
from labcdp.calibration.setup import meter_scale
from labcdp.calibration.verify.history import histories
from labcdp.calibration.verify.verify import verify
from labcdp.core.frame import PLANES

from ..conftest import RESPONSIVITIES, SimulatedMeter, codes, colour_bench, row

#: Luminance is this sum of what red, green and blue see.
TRUE_WEIGHTS = (0.25, 0.85, -0.1)
GREYS = {"grey 90": 270.0, "grey 55": 165.0, "grey 35": 105.0, "grey 20": 60.0, "grey 8": 24.0, "grey 3": 9.0}
#: What red, green and blue see of coloured patches, in cd/m^2 of a grey one.
COLOURED = {"red": (90.0, 25.0, 20.0), "green": (30.0, 70.0, 30.0), "blue": (15.0, 25.0, 80.0),
            "yellow": (160.0, 140.0, 30.0), "cyan": (20.0, 80.0, 100.0)}  # fmt: skip
COLOURS = {name: (value, value, value) for name, value in GREYS.items()} | COLOURED
AGAIN = ("grey 90", "grey 35", "grey 8")


def luminance(name):
    return float(np.dot(TRUE_WEIGHTS, COLOURS[name]))


def measured(seed, names=AGAIN, **changes):
    """Measure patches; `changes` are factors on the responsivity, or what is added to the dark level."""
    rng, meter = np.random.default_rng(seed), SimulatedMeter(true_scale_error_rel=0.008)
    seen = colour_bench(lambda plane, name: COLOURS[name]["RGB".index(plane[0])], names, rng, **changes)
    readings = {n: [meter.read(luminance(n), rng, second) for second in range(3)] for n in names}
    return *seen, readings, meter_scale(readings)


@pytest.fixture(scope="module")
def calibration(setup):
    return fit_colour(*measured(3, tuple(COLOURS))[:3], setup)


def test_nothing_changed(calibration):
    result = verify(calibration, *measured(4))
    assert result.verdict == "conform"
    assert abs(result.mean_rel) < result.mean_expanded_rel < 0.01
    assert [plane.plane for plane in result.planes] == list(PLANES)
    for plane, truth in zip(result.planes, RESPONSIVITIES.values(), strict=True):
        assert plane.drift.responsivity_dn_s_cd_m2 == pytest.approx(truth / 1.008, rel=0.01)
    assert {"colour-balance-kept", "dark-level-kept"} <= codes(result)


@pytest.mark.parametrize("planes", [("B",), ("Gr", "Gb")])
def test_a_colour_that_lost_five_percent_is_named(calibration, planes):
    result = verify(calibration, *measured(5, changes=dict.fromkeys(planes, 0.95)))
    changed = {one.plane: one for one in result.planes}
    weights = dict(zip(PLANES, calibration.weights, strict=True))
    lost = sum(0.05 * weights[plane] for plane in planes)
    for name, one in changed.items():
        truth = (0.95 if name in planes else 1.0) / (1 - lost) - 1
        # Four standard uncertainties.
        assert one.balance_rel == pytest.approx(truth, abs=2 * one.balance_expanded_rel)
        assert one.balance_expanded_rel < 0.01
    assert "colour-balance-changed" in codes(result)
    assert result.mean_rel == pytest.approx(-lost, abs=2 * result.mean_expanded_rel)


def test_a_balance_that_matters_does_not_conform(calibration):
    # Red gains what green loses in the luminance of grey patches: only coloured ones are wrong.
    w = dict(zip(PLANES, calibration.weights, strict=True))
    up = 1 + 0.05 * (w["Gr"] + w["Gb"]) / w["R"]
    result = verify(calibration, *measured(7, changes={"R": up, "Gr": 0.95, "Gb": 0.95}))
    assert {one.verdict for one in result.patches} == {"conform"}
    assert (result.verdict, result.findings[0].code) == ("not conform", "verification-not-conform-colours")
    (found,) = [one for one in result.findings if one.code == "colour-balance-changed"]
    assert found.subject == "R"


def test_files_and_history(calibration, tmp_path):
    lost = verify(calibration, *measured(5, changes={"B": 0.95}))
    coloured = verify(calibration, *measured(11, names=("cyan",)))
    assert "colour-balance-unknown" in codes(coloured)
    for number, result in enumerate((lost, coloured)):
        save_verification(result, tmp_path / f"{number}.json")
        assert load_verification(tmp_path / f"{number}.json") == result
    late = replace(lost, measured=lost.measured.replace(year=2020))
    last = replace(coloured, measured=coloured.measured.replace(year=2021))
    found = histories({"c": calibration}, {"last": last, "late": late})
    assert [one.plane for one in found] == list(PLANES)
    for one in found:
        assert [point.source for point in one.points] == ["c", "late", "last"]
        # The last one had no grey patch, so it tells the darkness only.
        assert one.points[2].responsivity is None
        change, half_width = one.change_rel
        assert change == pytest.approx(-0.05 if one.plane == "B" else 0.0, abs=2 * half_width)
        assert half_width < 0.015


@pytest.mark.parametrize(("luminance", "scatter_rel"), [(10.0, 0.0), (60.0, 0.004), (250.0, 0.0)])
def test_rows_make_the_uncertainty_of_a_grey_patch(calibration, luminance, scatter_rel):
    scattered = replace(calibration, scatter_rel=scatter_rel)
    exposure_s = budget_exposure_s(calibration, luminance)
    observations, _ = colour_bench(lambda plane, name: luminance, ["P"], None, exposures_s=(exposure_s,))
    patch = colour_patch_luminance(scattered, observations)
    whole = budget(scattered, luminance, exposure_s, 400, 4)
    rows = whole.rows
    # Fitted planes see a grey patch a little coloured, and photon transfer gives K: a part in a hundred.
    assert whole.u_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=0.01)
    assert whole.U_rel == pytest.approx(patch.U_rel, rel=0.01)
    parts = [row(rows, source).u_rel for source in ("fit", "meter repeatability")]
    variance = np.ones(4) @ np.array(calibration.weight_covariance) @ np.ones(4)
    assert hypot(*parts) == pytest.approx(sqrt(variance) / sum(calibration.weights), rel=1e-6)
    # Steps of the exposure time are the same for all planes: they add up to one share.
    assert row(rows, "exposure time").u_rel == pytest.approx(5e-5)


def test_intercepts_of_planes_add_with_their_signs_in_the_budget(calibration):
    intercepts = dict(zip(PLANES, (0.1, -0.1, -0.1, 0.1), strict=True))
    planes = [
        replace(one, responsivity=replace(one.responsivity, glare_cd_m2=intercepts[one.state.plane]))
        for one in calibration.planes
    ]
    offset = replace(calibration, planes=tuple(planes))
    exposure_s = budget_exposure_s(offset, 10.0)
    observations, _ = colour_bench(lambda plane, name: 10.0, ["P"], None, exposures_s=(exposure_s,))
    patch = colour_patch_luminance(offset, observations)
    whole = budget(offset, 10.0, exposure_s, 400, 4)
    assert whole.u_rel == pytest.approx(hypot(patch.random_rel, patch.common_rel), rel=0.01)
