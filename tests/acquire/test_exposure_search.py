"""The exposure search against brute force, a camera in closed form, and the simulated bench."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.acquire.search import (
    HIGHEST_SHARE,
    LOWEST_SHARE,
    PatchLevel,
    PatchRate,
    SearchFrame,
    choose_exposures,
    measure_rates,
)
from labcdp.core.errors import DeviceError

RANGE_S = (1e-5, 1.0)


@given(st.lists(st.floats(-0.5, 4.9).map(lambda exponent: 10.0**exponent), min_size=1, max_size=6))
def test_every_patch_is_well_exposed_with_the_fewest_exposures(shares_per_s):
    found = choose_exposures([PatchRate(str(n), share) for n, share in enumerate(shares_per_s)], RANGE_S)
    assert all(any(LOWEST_SHARE <= r * t <= HIGHEST_SHARE for t in found.exposures_s) for r in shares_per_s)
    assert found.findings == ()
    # Whatever serves a patch can be moved to the upper end of some patch's range: fewer of these do not serve all.
    for fewer in combinations([HIGHEST_SHARE / r for r in shares_per_s], len(found.exposures_s) - 1):
        # The search leaves a margin of 2 % at both ends; brute force gets none, and both ends narrower.
        assert not all(any(0.21 / 0.85 <= t * r / 0.85 <= 0.98 for t in fewer) for r in shares_per_s)


def test_patches_out_of_the_cameras_range_are_named_and_the_bright_part_of_a_patch_decides():
    rates = [PatchRate("a", 100.0), PatchRate("b", None), PatchRate("c", 2e5), PatchRate("d", 0.05)]
    found = choose_exposures(rates, RANGE_S)
    assert [finding.check for finding in found.findings] == ["saturation", "saturation", "darkness"]
    assert (found.exposures_s[-1], found.findings[2].value) == (1.0, pytest.approx(0.05))
    with pytest.raises(DeviceError, match="every patch is saturated"):
        choose_exposures(rates[1:2], RANGE_S)
    (exposure_s,) = choose_exposures([PatchRate("a", 10.0, high_ratio=2.0)], RANGE_S).exposures_s
    assert exposure_s * 10.0 * 2.0 <= 0.95


@given(
    st.dictionaries(st.sampled_from("abcdef"), st.floats(0.5, 7.5).map(lambda e: 10.0**e), min_size=1),
    st.floats(0, 300),
)
def test_rates_of_a_linear_camera_are_found_in_few_frames(rates_dn_s, black_dn):
    looks = []

    def look(exposure_s):
        """Take a frame of mean = black + rate t, cut off at saturation, with an exposure in whole microseconds."""
        looks.append(round(exposure_s, 6))
        means = {name: min(black_dn + rate * looks[-1], 4095.0) for name, rate in rates_dn_s.items()}
        return SearchFrame(looks[-1], {name: PatchLevel(mean, mean) for name, mean in means.items()}, 4095.0)

    found = measure_rates(look, list(rates_dn_s), RANGE_S)
    assert len(looks) <= 5 + 4 * len(rates_dn_s)
    for rate in found:
        if rate.share_per_s is None:
            assert rates_dn_s[rate.patch] * RANGE_S[0] > 0.94 * 4095 - black_dn
        elif rate.share_per_s * RANGE_S[1] > LOWEST_SHARE:
            assert rate.share_per_s * (4095.0 - black_dn) == pytest.approx(rates_dn_s[rate.patch], rel=0.02)


def test_each_patch_of_the_bench_lies_between_black_and_saturation(changed, on_bench):
    with on_bench(changed(plan={"exposures_s": None})) as on:
        on.acquire()
        exposures_s, (event,) = on.session.exposures_s, on.events("exposures")
        assert (event["exposures_s"], event["findings"]) == (list(exposures_s), [])
        # 0.5 to 412 cd/m^2 are a factor 824: five exposures at a factor 4.1 are needed, and 1 s is long enough.
        assert len(exposures_s) <= 5
        frames = [on.session.load(record) for record in on.session.frames("light")]
        for patch in on.session.configuration.target.patches:
            values = [patch.region().select(frame.dn) for frame in frames]
            shares = [(dn.mean() - 64) / (4095 - 64) for dn in values if np.mean(dn >= 4095) < 0.001]
            # The search frame's mean of 3600 pixels is exact to about 1 %; drifts of black add a little.
            assert max(share for share in shares if share < 0.87) > 0.19
        assert len(on.session.frames("dark")) == 2 * len(exposures_s)
