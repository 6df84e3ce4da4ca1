"""Verification of a camera with colour filters: nothing, one plane, all planes or a dark level has changed."""

from dataclasses import replace

import numpy as np
import pytest

from labcdp.calibration import fit_colour
from labcdp.calibration.record import load_verification, save_verification
from labcdp.calibration.setup import meter_scale
from labcdp.calibration.verify.history import histories
from labcdp.calibration.verify.verify import verify
from labcdp.core.errors import CalibrationError
from labcdp.core.frame import PLANES

EXPOSURES = (0.001, 0.004, 0.016)
RESPONSIVITIES = dict(zip(PLANES, (700.0, 1200.0, 1180.0, 800.0), strict=True))
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


@pytest.fixture(scope="module")
def measured(camera, camera_class, meter_class):
    """Measure patches; `changes` are factors on the responsivity, and `dark_dn` what is added to the dark level."""

    def measure(seed, names=AGAIN, changes=None, dark_dn=None, meter=None):
        rng = np.random.default_rng(seed)
        meter = meter or meter_class(true_scale_error_rel=0.008)
        observations, darks = {}, {}
        for plane, responsivity in RESPONSIVITIES.items():
            one = camera_class(
                responsivity_dn_s_cd_m2=responsivity * (changes or {}).get(plane, 1.0),
                dark_offset_dn=64.0 + (dark_dn or {}).get(plane, 0.0),
                state=replace(camera.state, plane=plane),
            )
            colour = "RGB".index(plane[0])
            observations[plane] = [one.observe(n, COLOURS[n][colour], t, rng) for n in names for t in EXPOSURES]
            darks[plane] = [one.dark(t, rng) for t in EXPOSURES]
        readings = {n: [meter.read(luminance(n), rng, second) for second in range(3)] for n in names}
        return observations, darks, readings, meter_scale(readings)

    return measure


@pytest.fixture(scope="module")
def calibrated(measured, setup):
    def calibrate(seed):
        return fit_colour(*measured(seed, tuple(COLOURS))[:3], setup)

    return calibrate


@pytest.fixture(scope="module")
def calibration(calibrated):
    return calibrated(3)


def codes(one):
    """Codes of what was found."""
    return {finding.code for finding in one.findings}


def test_nothing_changed(calibration, measured):
    result = verify(calibration, *measured(4))
    assert result.verdict == "conform"
    assert [row.patch for row in result.patches] == list(AGAIN)
    assert abs(result.mean_rel) < result.mean_expanded_rel < 0.01
    assert [plane.plane for plane in result.planes] == list(PLANES)
    for plane, truth in zip(result.planes, RESPONSIVITIES.values(), strict=True):
        assert plane.drift.responsivity_dn_s_cd_m2 == pytest.approx(truth / 1.008, rel=0.01)
    assert {"colour-balance-kept", "dark-level-kept"} <= codes(result)
    assert [(row.plane, row.exposure_s) for row in result.darks] == [(p, t) for p in PLANES for t in EXPOSURES]


@pytest.mark.parametrize("planes", [("B",), ("R",), ("Gr", "Gb")])
def test_a_colour_that_lost_five_percent_is_named(calibration, measured, planes):
    result = verify(calibration, *measured(5, changes=dict.fromkeys(planes, 0.95)))
    changed = {one.plane: one for one in result.planes}
    weights = dict(zip(PLANES, calibration.weights, strict=True))
    lost = sum(0.05 * weights[plane] for plane in planes)
    for name, one in changed.items():
        truth = (0.95 if name in planes else 1.0) / (1 - lost) - 1
        # Four standard uncertainties.
        assert one.balance_rel == pytest.approx(truth, abs=2 * one.balance_expanded_rel)
        assert one.balance_expanded_rel < 0.01
    (found,) = [one for one in result.findings if one.code == "colour-balance-changed"]
    largest = max(abs(one.balance_rel) for one in changed.values())
    odd = {name[0] for name, one in changed.items() if abs(one.balance_rel) > largest - one.balance_expanded_rel}
    assert found.subject[0] in odd
    assert result.mean_rel == pytest.approx(-lost, abs=2 * result.mean_expanded_rel)


def test_a_balance_that_matters_does_not_conform(calibration, measured):
    # Red gains what green loses in the luminance of grey patches: only coloured ones are wrong.
    w = dict(zip(PLANES, calibration.weights, strict=True))
    up = 1 + 0.05 * (w["Gr"] + w["Gb"]) / w["R"]
    result = verify(calibration, *measured(7, changes={"R": up, "Gr": 0.95, "Gb": 0.95}))
    assert {row.verdict for row in result.patches} == {"conform"}
    assert (result.verdict, result.findings[0].code) == ("not conform", "verification-not-conform-colours")
    (found,) = [one for one in result.findings if one.code == "colour-balance-changed"]
    assert found.subject == "R"
    assert found.values["change_rel"] > 0


def test_a_dark_level_that_moved_in_one_plane(calibration, measured):
    result = verify(calibration, *measured(9, dark_dn={"B": 30.0}))
    (found,) = [one for one in result.findings if one.code == "dark-level-moved"]
    assert found.subject == "plane B"
    assert found.values["difference_dn"] == pytest.approx(30, abs=0.5)
    moved = [row for row in result.darks if row.moved]
    assert {row.plane for row in moved} == {"B"}
    for row in moved:
        lowest_dn_s = calibration.range_cd_m2[0] * calibration.planes[3].responsivity.responsivity_dn_s_cd_m2
        assert row.effect_rel == pytest.approx(calibration.weights[3] * 30.0 / (lowest_dn_s * 0.016), rel=0.05)


def test_refusals(calibration, measured):
    observations, darks, *read = measured(4)
    with pytest.raises(CalibrationError, match="there is no patch to verify the calibration with"):
        verify(calibration, {}, darks, *read)
    with pytest.raises(CalibrationError, match="there are no dark frames of plane Gb"):
        verify(calibration, observations, darks | {"Gb": []}, *read)
    with pytest.raises(CalibrationError, match="there are no observations of plane B: observe all planes"):
        verify(calibration, {p: o for p, o in observations.items() if p != "B"}, darks, *read)
    other = {p: [replace(d, state=replace(d.state, black_level_dn=32.0)) for d in group] for p, group in darks.items()}
    with pytest.raises(CalibrationError, match=r"black level of the calibration is 64, but .*plane R.* has 32"):
        verify(calibration, observations, other, *read)


def test_files_and_history(calibration, measured, tmp_path):
    lost = verify(calibration, *measured(5, changes={"B": 0.95}))
    coloured = verify(calibration, *measured(11, names=("cyan",)))
    assert [plane.drift for plane in coloured.planes] == [None] * 4
    assert "colour-balance-unknown" in codes(coloured)
    for number, result in enumerate((lost, coloured)):
        save_verification(result, tmp_path / f"{number}.json")
        assert load_verification(tmp_path / f"{number}.json") == result
    late = replace(lost, measured=lost.measured.replace(year=2020))
    last = replace(coloured, measured=coloured.measured.replace(year=2021))
    found = histories({"c": calibration}, {"last": last, "late": late})
    assert [one.plane for one in found] == list(PLANES)
    for one, weight in zip(found, calibration.weights, strict=True):
        assert [point.source for point in one.points] == ["c", "late", "last"]
        assert [point.weight for point in one.points] == [weight, None, None]
        # The last one had no grey patch, so it tells the darkness only.
        assert one.points[2].responsivity is None
        change, half_width = one.change_rel
        assert change == pytest.approx(-0.05 if one.plane == "B" else 0.0, abs=2 * half_width)
        assert half_width < 0.015
