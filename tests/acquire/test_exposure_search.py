"""The exposure search against brute force, a camera in closed form, and the simulated bench."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labcdp.acquire.search import HIGHEST_SHARE, LOWEST_SHARE, Level, Look, PatchRate, choose_exposures, measure_rates
from labcdp.core.errors import DeviceError

RANGE_S = (1e-5, 1.0)
# From a patch that fills the span in the shortest exposure to one that needs 30 of the longest.
RATES = st.floats(-1.5, 5).map(lambda exponent: 10.0**exponent)


def well_exposed(rate, exposure_s):
    return LOWEST_SHARE <= rate.share_per_s * exposure_s <= HIGHEST_SHARE


@given(st.lists(RATES.filter(lambda r: 0.3 < r < 0.8e5), min_size=1, max_size=6))
def test_every_patch_is_well_exposed_with_the_fewest_exposures(shares_per_s):
    rates = [PatchRate(str(n), share) for n, share in enumerate(shares_per_s)]
    found = choose_exposures(rates, RANGE_S)
    assert all(any(well_exposed(rate, t) for t in found.exposures_s) for rate in rates)
    assert found.findings == ()
    # Whatever serves a patch can be moved to the upper end of some patch's range: fewer of these do not serve all.
    candidates = [HIGHEST_SHARE / rate.share_per_s for rate in rates]
    for fewer in combinations(candidates, len(found.exposures_s) - 1):
        # The search leaves a margin of 2 % at both ends; brute force gets none, and both ends narrower.
        assert not all(any(0.21 / 0.85 <= t * rate.share_per_s / 0.85 <= 0.98 for t in fewer) for rate in rates)


def test_a_patch_too_dark_for_the_longest_exposure_is_named():
    found = choose_exposures([PatchRate("a", 100.0), PatchRate("b", 0.05)], RANGE_S)
    assert found.exposures_s[-1] == 1.0
    (finding,) = found.findings
    assert finding.check == "darkness"
    assert str(finding) == ("patch 'b' reaches 5.0% of the camera's range at 1 s, not 20%: open the lens, or add light")
    assert finding.value == pytest.approx(0.05)


def test_a_patch_too_bright_for_the_shortest_exposure_is_named():
    found = choose_exposures([PatchRate("a", 100.0), PatchRate("b", None), PatchRate("c", 2e5)], RANGE_S)
    assert [finding.check for finding in found.findings] == ["saturation", "saturation"]
    assert str(found.findings[0]).startswith("patch 'b' is too bright even for the shortest exposure, 1e-05 s")


def test_all_patches_too_bright_is_an_error():
    with pytest.raises(DeviceError, match=r"every patch is saturated at the shortest exposure, 1e-05 s: stop the lens"):
        choose_exposures([PatchRate("b", None)], RANGE_S)


def test_the_bright_part_of_a_non_uniform_patch_decides():
    (exposure_s,) = choose_exposures([PatchRate("a", 10.0, high_ratio=2.0)], RANGE_S).exposures_s
    assert exposure_s * 10.0 * 2.0 <= 0.95


class LinearCamera:
    """mean = black + rate t, cut off at saturation."""

    def __init__(self, rates_dn_s, black_dn=70.0, step_s=1e-6):
        self.rates_dn_s, self.black_dn, self.step_s = rates_dn_s, black_dn, step_s
        self.exposures_s = []

    def __call__(self, exposure_s):
        applied_s = round(exposure_s / self.step_s) * self.step_s
        self.exposures_s.append(applied_s)
        means = {n: min(self.black_dn + r * applied_s, 4095.0) for n, r in self.rates_dn_s.items()}
        levels = {n: Level(mean, mean) for n, mean in means.items()}
        return Look(applied_s, levels, 4095.0)


@settings(max_examples=200)
@given(
    st.dictionaries(st.text("abcdef", min_size=1, max_size=1), st.floats(0.5, 7.5).map(lambda e: 10.0**e), min_size=1),
    st.floats(0, 300),
)
def test_rates_of_a_linear_camera_are_found_in_few_frames(rates_dn_s, black_dn):
    camera = LinearCamera(rates_dn_s, black_dn)
    found = measure_rates(camera, list(rates_dn_s), RANGE_S)
    span_dn = 4095.0 - black_dn
    assert len(camera.exposures_s) <= 5 + 4 * len(rates_dn_s)
    for rate in found:
        if rate.share_per_s is None:
            assert rates_dn_s[rate.patch] * RANGE_S[0] > 0.94 * 4095 - black_dn
        elif rate.share_per_s * RANGE_S[1] > LOWEST_SHARE:
            assert rate.share_per_s * span_dn == pytest.approx(rates_dn_s[rate.patch], rel=0.02)


def test_each_patch_of_the_bench_lies_between_black_and_saturation(changed, on_bench):
    configuration = changed(plan={"exposures_s": None})
    with on_bench(configuration) as on:
        notes = []
        on.acquire(report=lambda progress: notes.append(progress.note))
        exposures_s = on.session.exposures_s
        assert on.events("exposures")[0]["exposures_s"] == list(exposures_s)
        assert [n for n in notes if n] == [f"Exposures found: {', '.join(f'{t:.3g}' for t in exposures_s)} s"]
        # 0.5 to 412 cd/m^2 are a factor 824: five exposures at a factor 4.1 are needed, and 1 s is long enough.
        assert len(exposures_s) <= 5
        assert on.events("exposures")[0]["frames"] <= 12
        assert on.events("exposures")[0]["findings"] == []
        shares = {patch.name: [] for patch in configuration.target.patches}
        for record in on.session.frames("light"):
            frame = on.session.load(record)
            for patch in configuration.target.patches:
                dn = patch.region().select(frame.dn)
                if np.mean(dn >= frame.saturation_dn) < 0.001:
                    share = (dn.mean() - 64) / (frame.saturation_dn - 64)
                    shares[patch.name].append(share)
        for found in shares.values():
            # The search frame's mean of 3600 pixels is exact to about 1 %; drifts of black add a little.
            assert max(s for s in found if s < 0.87) > 0.19
        assert len(on.session.frames("dark")) == 2 * len(exposures_s)
