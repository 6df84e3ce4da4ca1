"""Verification of a camera with colour filters: nothing, one plane, all planes or a dark level has changed."""

from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from labcdp.calibration import fit_colour
from labcdp.calibration.history import histories
from labcdp.calibration.verification_file import load_verification, save_verification
from labcdp.calibration.verify_colour import verify_colour
from labcdp.errors import CalibrationError
from labcdp.frame import PLANES
from labcdp.reading import MeterIdentity

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
        return observations, darks, {n: [meter.read(luminance(n), rng, second) for second in range(3)] for n in names}

    return measure


@pytest.fixture(scope="module")
def calibrated(measured, setup):
    def calibrate(seed):
        return fit_colour(*measured(seed, tuple(COLOURS)), setup)

    return calibrate


@pytest.fixture(scope="module")
def calibration(calibrated):
    return calibrated(3)


def test_nothing_changed(calibration, measured):
    result = verify_colour(calibration, *measured(4))
    assert result.verdict == "valid"
    assert [row.patch for row in result.patches] == list(AGAIN)
    assert abs(result.drift_rel) < result.drift_half_width_95_rel < 0.01
    assert [plane.plane for plane in result.planes] == list(PLANES)
    for plane, truth in zip(result.planes, RESPONSIVITIES.values(), strict=True):
        assert plane.drift.responsivity_dn_s_cd_m2 == pytest.approx(truth / 1.008, rel=0.01)
    assert "the colour balance is where it was" in result.findings
    assert "the dark level is where it was" in result.findings
    assert [(row.plane, row.exposure_s) for row in result.darks] == [(p, t) for p in PLANES for t in EXPOSURES]


@pytest.mark.parametrize(
    ("planes", "odd", "against"),
    [(("B",), "blue", "green"), (("R",), "red", "green"), (("Gr", "Gb"), "green", "red and blue")],
)
def test_a_colour_that_lost_five_percent_is_named(calibration, measured, planes, odd, against):
    result = verify_colour(calibration, *measured(5, changes=dict.fromkeys(planes, 0.95)))
    assert result.verdict != "valid"
    balance = result.balance
    assert (balance.odd, balance.against) == (odd, against)
    # The half widths are of 95 %: four standard uncertainties are about twice as wide.
    assert balance.half_width_95_rel < 0.01
    assert balance.change_rel == pytest.approx(-0.05, abs=2 * balance.half_width_95_rel)
    assert any(
        text.startswith(f"the colour balance has changed: {odd} has lost ")
        and f" against {against}: the light, a filter" in text
        for text in result.findings
    )
    weights = dict(zip(PLANES, calibration.weights, strict=True))
    expected = sum(-0.05 * weights[plane] for plane in planes)
    assert result.drift_rel == pytest.approx(expected, abs=2 * result.drift_half_width_95_rel)


def test_a_balance_that_matters_little_makes_doubt(calibration, measured):
    result = verify_colour(calibration, *measured(6, changes={"B": 0.99}))
    assert result.verdict == "doubtful"
    assert (
        "is doubtful: the colour balance has changed, so luminances of coloured patches may be wrong"
        in (result.findings[0])
    )


def test_a_balance_that_matters_is_not_valid(calibration, measured):
    # Red gains what green loses in the luminance of grey patches: only coloured ones are wrong.
    w = dict(zip(PLANES, calibration.weights, strict=True))
    up = 1 + 0.05 * (w["Gr"] + w["Gb"]) / w["R"]
    result = verify_colour(calibration, *measured(7, changes={"R": up, "Gr": 0.95, "Gb": 0.95}))
    assert result.verdict == "not valid"
    assert result.drift_rel == pytest.approx(0.0, abs=2 * result.drift_half_width_95_rel)
    assert result.findings[0].endswith(
        "because the colour balance has changed, and with it the luminance of coloured patches: calibrate again"
    )
    assert any("red has gained " in text for text in result.findings)


def test_all_planes_that_lost_five_percent(calibration, measured):
    result = verify_colour(calibration, *measured(8, changes=dict.fromkeys(PLANES, 0.95)))
    assert result.verdict == "not valid"
    assert result.drift_rel == pytest.approx(-0.05, abs=2 * result.drift_half_width_95_rel)
    assert "the camera has drifted by -" in result.findings[0]
    assert "the colour balance is where it was" in result.findings
    for plane in result.planes:
        assert plane.drift.relative == pytest.approx(-0.05, abs=2 * plane.drift.half_width_95_rel)


def test_a_dark_level_that_moved_in_one_plane_is_no_change_of_colour(calibration, measured):
    result = verify_colour(calibration, *measured(9, dark_dn={"B": 30.0}))
    assert result.verdict != "valid"
    assert any("the dark level has moved by +30 DN" in text and "in plane B" in text for text in result.findings)
    assert "the colour balance is where it was" in result.findings
    moved = [row for row in result.darks if abs(row.z) > 5]
    assert {row.plane for row in moved} == {"B"}
    weight = calibration.weights[3]
    for row in moved:
        lowest_dn_s = calibration.range_cd_m2[0] * calibration.planes[3].responsivity.responsivity_dn_s_cd_m2
        assert row.effect_rel == pytest.approx(weight * 30.0 / (lowest_dn_s * 0.016), rel=0.05)


def test_a_dark_level_that_moved_in_all_planes_explains_the_difference(calibration, measured):
    result = verify_colour(calibration, *measured(10, dark_dn=dict.fromkeys(PLANES, 12.0)))
    assert result.verdict == "not valid"
    assert "because the dark level has moved; with the new dark frames camera and meter agree" in result.findings[0]
    darkest = result.patches[-1]
    assert darkest.difference_rel > 5 * abs(darkest.with_new_dark_rel)


def test_false_alarms_are_as_rare_as_stated(calibrated, measured):
    n = 20
    results = [verify_colour(calibrated(100 + seed), *measured(500 + seed)) for seed in range(n)]
    assert [r.verdict for r in results].count("not valid") <= 1
    # z, chi^2, darkness and colours warn by chance with at most the probability of two standard deviations each.
    chance = 4 * 2 * norm.sf(2.0)
    assert [r.verdict for r in results].count("doubtful") <= n * chance + 4 * sqrt(n * chance * (1 - chance))
    one = 2 * norm.sf(2.0)
    assert sum(r.balance.chance < one for r in results) <= n * one + 4 * sqrt(n * one * (1 - one))
    # The standard uncertainties hold the truth: pulls have a standard deviation of about 1, never far above.
    z = np.array([row.z for r in results for row in r.patches])
    assert np.std(z) < 1 + 4 / sqrt(2 * z.size / len(AGAIN))
    pulls = np.array([p.drift.relative / (p.drift.half_width_95_rel / 1.96) for r in results for p in r.planes])
    assert 0.5 < np.std(pulls) < 1 + 4 / sqrt(2 * pulls.size / len(PLANES))


def test_another_meter_brings_its_own_scale(calibration, measured, meter_class):
    other = meter_class(scale_half_width_rel=0.03, identity=MeterIdentity("LS-100", "1"))
    mine, theirs = verify_colour(calibration, *measured(4)), verify_colour(calibration, *measured(4, meter=other))
    assert mine.same_meter
    assert not theirs.same_meter
    for row, before in zip(theirs.patches, mine.patches, strict=True):
        expected = hypot(before.standard_uncertainty_rel, 0.02 / sqrt(3), 0.03 / sqrt(3))
        assert row.standard_uncertainty_rel == pytest.approx(expected, rel=0.02)
    # All planes share the scales: between the colours they cancel.
    assert theirs.balance.half_width_95_rel == pytest.approx(mine.balance.half_width_95_rel, rel=0.05)
    assert theirs.planes[0].drift.half_width_95_rel > 3 * mine.planes[0].drift.half_width_95_rel


def test_a_coloured_patch_alone_says_nothing_of_the_balance(calibration, measured):
    result = verify_colour(calibration, *measured(11, names=("cyan",)))
    assert result.balance is None
    assert [plane.drift for plane in result.planes] == [None] * 4
    assert any("verify with a grey patch that the calibration was made with" in text for text in result.findings)


def test_refusals(calibration, measured):
    observations, darks, readings = measured(4)
    with pytest.raises(CalibrationError, match="there is no patch to verify the calibration with"):
        verify_colour(calibration, {}, darks, readings)
    with pytest.raises(CalibrationError, match="there are no dark frames of plane Gb: split every Bayer frame"):
        verify_colour(calibration, observations, darks | {"Gb": []}, readings)
    with pytest.raises(CalibrationError, match="there are no observations of plane B: observe all planes"):
        verify_colour(calibration, {p: o for p, o in observations.items() if p != "B"}, darks, readings)
    with pytest.raises(CalibrationError, match="patch 'grey 8' has no meter reading"):
        verify_colour(calibration, observations, darks, {k: v for k, v in readings.items() if k != "grey 8"})
    other = {p: [replace(d, state=replace(d.state, black_level_dn=32.0)) for d in group] for p, group in darks.items()}
    with pytest.raises(CalibrationError, match=r"black level of the calibration is 64 DN, but .*plane R.* has 32 DN"):
        verify_colour(calibration, observations, other, readings)


def test_files_and_history(calibration, measured, tmp_path):
    lost = verify_colour(calibration, *measured(5, changes={"B": 0.95}))
    coloured = verify_colour(calibration, *measured(11, names=("cyan",)))
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
        assert one.points[2].responsivity_dn_s_cd_m2 is None
        change, half_width = one.change_rel
        assert change == pytest.approx(-0.05 if one.plane == "B" else 0.0, abs=2 * half_width)
        assert half_width < 0.015
