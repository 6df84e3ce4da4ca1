"""Comparisons against themselves, the API's sweeps, closed forms and published examples."""

import re
from copy import deepcopy
from dataclasses import replace
from itertools import product
from math import hypot, inf, nan, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

import labcdp
from labcdp.calibration.uncertainty import expanded_rel
from labcdp.core.errors import InputError
from labcdp.core.table import Z_95
from labcdp.evaluate.bench.session_result import session_result
from labcdp.evaluate.compare.compare import compare_subjects
from labcdp.evaluate.compare.grid import Uncertain, difference
from labcdp.evaluate.compare.result import compare_result
from labcdp.evaluate.compare.rows import values_of
from labcdp.evaluate.compare.subject import read_subjects
from labcdp.report.files import envelope

from ...conftest import valid

LUMINANCES = np.geomspace(0.5, 300, 12)


def written(content):
    """Results as they are read from a file."""
    return SimpleNamespace(to_dict=lambda: content)


@pytest.fixture(scope="module")
def chains():
    camera = labcdp.Chain.load("manta-g505")
    return camera, camera.with_(optics__f_number=3.7)


@pytest.fixture(scope="module")
def results(evaluation):
    return envelope(session_result(evaluation))


def symmetric(value, u, **common):
    return Uncertain(value, Z_95 * u, Z_95 * u, common)


def wilson(hits, n):
    """Interval of E. B. Wilson for a share of independent trials."""
    p = hits / n
    middle, half = p + Z_95**2 / (2 * n), Z_95 * sqrt(p * (1 - p) / n + Z_95**2 / (4 * n * n))
    low, high = ((middle + sign * half) / (1 + Z_95**2 / n) for sign in (-1, 1))
    return Uncertain(p, p - low, high - p)


@pytest.mark.parametrize(
    ("first", "second", "interval"),
    [
        # Newcombe, Statistics in Medicine 17, 873 (1998), table II, method 10; first minus second.
        ((56, 70), (48, 80), (0.0524, 0.3339)),
        ((9, 10), (3, 10), (0.1705, 0.8090)),
        ((10, 10), (0, 20), (0.6791, 1.0)),
    ],
)
def test_shares_differ_by_the_published_intervals(first, second, interval):
    found = difference(wilson(*second), wilson(*first))
    assert (found.low, found.high) == pytest.approx(interval, abs=5e-5)
    assert found.significant


@pytest.mark.parametrize(
    ("first", "second", "z"),
    [
        # With a = x + c and b = y + c, the variance of b - a is that of x and y alone, here 0.3 and 0.4.
        (symmetric(1.0, hypot(0.3, 1.2), meter=1.2 / hypot(0.3, 1.2)),
         symmetric(2.0, hypot(0.4, 1.2), meter=1.2 / hypot(0.4, 1.2)), 1 / 0.5),
        # Of unequal sensitivity to the common error, the difference of the sensitivities is left.
        (symmetric(1.0, 0.3, meter=1.0), symmetric(2.0, 0.5, meter=1.0), 1 / 0.2),
        # Errors of different meters are independent.
        (symmetric(1.0, 0.3, meter=1.0), symmetric(2.0, 0.4, other=1.0), 1 / 0.5),
        (symmetric(3.0, 0.1, data=1.0), symmetric(3.0, 0.1, data=1.0), 0),
        # Rounding is no difference; what has no uncertainty differs by any, and the unknown by none.
        (Uncertain(0.3), Uncertain(0.1 + 0.2), 0),
        (Uncertain(1.0), Uncertain(0.5), -inf),
        (Uncertain(1.0, nan, nan), symmetric(2.0, 0.1), nan),
    ],
)  # fmt: skip
def test_common_errors_cancel_by_the_law_of_propagation(first, second, z):
    found = difference(first, second)
    assert found.z == pytest.approx(z, nan_ok=True)
    assert found.significant == (abs(z) > Z_95)


def test_chains_equal_the_sweep_of_each(chains):
    contrasts = (0.8, 1.0)
    found = labcdp.compare(*chains, scene__luminance_cd_m2=LUMINANCES, contrast=contrasts, epsilon=0.6)
    dataset = found.to_dataset()
    sweeps = [
        one.sweep(exact=True, scene__luminance_cd_m2=LUMINANCES, contrast=contrasts, epsilon=0.6) for one in chains
    ]
    for values, sweep in zip(dataset["value"].values, sweeps, strict=True):
        assert np.array_equal(values, sweep["cdp"].values.T)
    expected = (sweeps[1]["cdp"].values - sweeps[0]["cdp"].values).T
    assert dataset["difference"].values[1] == pytest.approx(expected, abs=1e-12)
    rows = found.to_dict()["tables"]["usable_ranges"]["rows"]
    for (chain, contrast), row in zip(product(chains, contrasts), rows, strict=True):
        assert row["contrast"] == contrast

        def excess(luminance, chain=chain, contrast=contrast):
            one = chain.sweep(exact=True, scene__luminance_cd_m2=[luminance], contrast=contrast, epsilon=0.6)
            return one["cdp"].item() - 0.9

        for end in ("low", "high"):
            if row[f"{end}_end"] == "CDP crosses":
                assert row[end] == pytest.approx(brentq(excess, 0.99 * row[end], 1.01 * row[end], rtol=1e-5), rel=1e-4)
    (setting,) = found.to_dict()["tables"]["settings"]["rows"]
    assert list(setting.values()) == ["optics.f_number", "2.6", "3.7"]
    other = compare_result(labcdp.compare(*chains, scene__luminance_cd_m2=[1.0], contrast=[0.4, 1.0]).comparison)
    assert [one.values["asked"] for one in other.findings if one.code == "compare-scene-contrast"] == [[0.4], [0.4]]


@pytest.mark.parametrize(
    ("first", "second", "lows"),
    [
        # Usable from 2, not from 5 to 6, and from 2.5; the widest interval is that from 6.
        ([0.85, 0.95, 0.95, 0.95, 0.9, 0.8, 1.0, 1.0], [0.8, 0.85, 0.95, 1.0, 1.0, 1.0, 1.0, 0.8],
         [["1.5", "5", "6.5"], ["2.5", "1.7"]]),
        ([1.0] * 8, [0.85] + [0.95] * 7, [["≤ 1"], ["1.5"]]),
        # Where CDP rises by more than 0.2 the end is anywhere up to the grid point.
        ([0.0, *[1.0] * 7], [0.0] * 8, [["≤ 2"], []]),
    ],
)  # fmt: skip
def test_the_darkest_is_that_of_the_lowest_end(chains, first, second, lows):
    sweep = chains[0].sweep(exact=True, scene__luminance_cd_m2=np.arange(1.0, 9.0))
    maps = [sweep.assign(cdp=sweep["cdp"].copy(data=np.array(cdp))) for cdp in (first, second)]
    maps = [one.assign_attrs(title=name) for name, one in zip("ab", maps, strict=True)]
    (said, *_) = compare_result(compare_subjects(maps)).findings
    assert [re.findall(r"(?:≤ )?[\d.]+", one) for one in said.values["lows"]] == lows


def test_anything_compared_with_itself_has_no_difference(chains, results, evaluation):
    same = characterised(3.0, "0" * 64)
    for subject in (chains[0], written(results), evaluation.calibration, same):
        found = compare_subjects([subject, subject])
        differences = [row.difference for row in found.rows] + list(found.grid.differences if found.grid else ())
        assert differences
        for one in differences:
            assert np.all(one.value == 0)
            assert not np.any(one.significant)
        result = compare_result(found)
        valid(envelope(result))
        assert result.findings[0].code == "compare-equal"


def test_calibrations_with_one_meter_differ_by_the_fit_alone(evaluation):
    """R of the second is 0.3 % higher: the meter's 2 % cancel, but not those of two meters."""
    first = evaluation.calibration
    fit, meter = first.responsivity, first.meter_scale
    changed = replace(fit, responsivity_dn_s_cd_m2=1.003 * fit.responsivity_dn_s_cd_m2)
    provenance = replace(first.provenance, input_sha256="1" * 64)
    second = replace(first, responsivity=changed, provenance=provenance)
    found = compare_subjects([first, second])
    (difference,) = found.grid.differences
    assert difference.value == pytest.approx(np.full(101, 0.003))
    net_dn = found.grid.axes[-1].values
    u_fit = [hypot(*(np.interp(n, one.net_dn, one.relative) for one in first.fit_errors)) for n in net_dn]
    # The rectangular error of the meter is most of U, so that of the fit is its share of the variance.
    share = [u / hypot(u, meter.common_rel) for u in u_fit]
    own = [part * expanded_rel((meter,), u) for part, u in zip(share, u_fit, strict=True)]
    assert np.log1p(difference.high) - np.log1p(difference.value) == pytest.approx(np.sqrt(2) * np.array(own))
    assert difference.significant.all()
    other = replace(second, meter_scale=replace(meter, meter=replace(meter.meter, serial="2")))
    assert not compare_subjects([first, other]).grid.differences[0].significant.any()


def test_what_sessions_have_in_common_cancels_or_is_unknown(results):
    """CDPs by one calibration differ by their pixels alone; the U of contrasts is not stated by source."""

    def changed(cdp, factor, frames, calibration):
        content = deepcopy(results)
        (row, *_) = content["tables"]["contrasts"]["rows"]
        row |= {"cdp": cdp, "cdp_low": cdp - Z_95 * 0.005, "cdp_high": cdp + Z_95 * 0.005}
        row |= {"u_cdp": 0.005, "u_cdp_pixels": 0.003, "camera_contrast": factor * row["camera_contrast"]}
        content["tables"]["contrasts"]["rows"] = [row]
        for item in content["tables"]["provenance"]["rows"]:
            if item["item"].startswith("SHA-256"):
                item["value"] = frames if "frames" in item["item"] else calibration
        return written(content)

    for factor, frames, calibration, u, differs in (
        (1.5, "2", "a", hypot(0.003, 0.003), "unknown"),
        (1.5, "1", "b", hypot(0.004, 0.004), "unknown"),
        (1.5, "2", "b", hypot(0.005, 0.005), "yes"),
        (1.0, "1", "b", hypot(0.004, 0.004), "no"),
    ):
        found = compare_subjects([changed(0.80, 1.0, "1", "a"), changed(0.82, factor, frames, calibration)])
        assert found.rows[0].difference.z == pytest.approx(0.02 / u)
        rows = compare_result(found).table("differences").rows()
        assert [row["differs"] for row in rows if row["quantity"].startswith("contrast")] == [differs]


def characterised(value, sha256):
    pairs = (("read noise", value, 0.2), ("full well", 9000.0, None))
    rows = [{"quantity": name, "value": one, "expanded_value": expanded, "unit": "e⁻"} for name, one, expanded in pairs]
    content = {"kind": "characterise", "title": "c", "simulated": False, "configuration": {}}
    content["inputs"] = [{"role": "data set", "path": "a", "sha256": sha256}]
    return written(content | {"tables": {"characterisation": {"rows": rows}}})


def test_characterisations_side_by_side_with_z():
    found = compare_subjects([characterised(value, sha256) for value, sha256 in ((3.0, "0"), (3.4, "1"), (3.1, "2"))])
    rows = [row for row in compare_result(found).table("differences").rows() if row["quantity"] == "read noise"]
    assert [row["z"] for row in rows] == pytest.approx([0.4 * Z_95 / hypot(0.2, 0.2), 0.1 * Z_95 / hypot(0.2, 0.2)])
    assert [row["differs"] for row in rows] == ["yes", "no"]


def test_what_cannot_be_compared_is_refused_in_a_line(chains, results):
    maps = [chains[0].sweep(exact=True, scene__luminance_cd_m2=[1.0, end]) for end in (2.0, 3.0)]
    for subjects, message in (
        (maps, r"^the maps have different axes, .* \(2 from 1.0 to 2.0\); .* \(2 from 1.0 to 3.0\): sweep both"),
        ([chains[0], written(results)], r"^manta-g505 is a chain, but .* is a session: give several of the same kind$"),
        ([chains[0]], "^there is nothing to compare with: give at least two$"),
        ([written({"kind": "history"}), chains[0]], "holds results of labcdp history, which cannot be compared"),
        ([written(results | {"tables": {}})] * 2, "another version of labcdp: evaluate again$"),
    ):
        with pytest.raises(InputError, match=message):
            compare_subjects(subjects)


def test_no_number_of_results_is_a_truth_value_or_text(results):
    """Wherever a value is read, true and text in its place are refused; what is not read does not matter."""
    for content in (deepcopy(results), characterised(3.0, "0").to_dict()):
        right, places = values_of(read_subjects([written(content)] * 2)[0]), list(numbers(content["tables"]))
        refused = 0
        for row, key in places:
            kept = row[key]
            for wrong in (True, str(kept)):
                row[key] = wrong
                try:
                    found = values_of(read_subjects([written(content)] * 2)[0])
                except InputError:
                    refused += 1
                else:
                    assert repr(found) == repr(right), (key, wrong)
            row[key] = kept
        assert refused >= 2


def numbers(tables):
    """Places of the numbers in tables, as row and key."""
    for table in tables.values():
        for row in table["rows"]:
            yield from ((row, key) for key, value in row.items() if type(value) in (int, float))
