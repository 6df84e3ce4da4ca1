"""Requirements: the lowest CDP over the luminances is that of a sweep, and what limits it is what was made bad."""

from dataclasses import replace
from math import sqrt

import pytest

from labcdp import Chain
from labcdp.core.errors import ConfigurationError, InputError
from labcdp.evaluate.compare.compare import Question, compare_subjects
from labcdp.evaluate.compare.page import comparison_files
from labcdp.evaluate.compare.requirement import TYPICAL, judged, luminances
from labcdp.evaluate.compare.result import compare_result
from labcdp.evaluate.requirement import Requirement

REQUIRED = Requirement(contrast=0.8, luminance_cd_m2=(5.0, 50.0), temperature_c=60.0, cdp_limit=0.9)


@pytest.fixture(scope="module")
def chain():
    return Chain.load("split-pixel").with_(scene__width=32, scene__height=24, scene__square_px=4)


def lowest(chain, requirement):
    """The lowest CDP by a sweep of the same chain, and its luminance."""
    changes = {"scene__contrast": requirement.contrast, "exposure__temperature_c": requirement.temperature_c}
    chain = chain.with_(**changes, windscreen__glare_cd_m2=requirement.glare_cd_m2)
    axis = luminances(requirement)
    found = chain.sweep(scene__luminance_cd_m2=axis.values, exact=True)["cdp"]
    return float(found.min()), axis.values[int(found.values.argmin())]


@pytest.mark.parametrize(
    ("changes", "required", "limit"),
    [
        ({}, {"glare_cd_m2": 5.0}, "glare"),
        ({"windscreen__glare_fraction": 0.8}, {}, "glare"),
        ({"sensor__read_noise_e": 60.0}, {}, "read noise"),
        pytest.param({"sensor__prnu_rel": 0.1}, {}, "non-uniformity", marks=pytest.mark.long),
        ({"sensor__dark_current_e_s": 20000.0}, {"luminance_cd_m2": (0.5, 1.0)}, "dark current"),
        ({"sensor__read_noise_e": 0.0}, {"luminance_cd_m2": (0.01, 1.0), "temperature_c": -40.0}, "photon noise"),
        ({}, {"luminance_cd_m2": (1e5, 1e6)}, "saturation"),
    ],
)
def test_the_lowest_cdp_and_what_limits_it(chain, changes, required, limit):
    changed, requirement = chain.with_(**changes), REQUIRED.model_copy(update=required)
    found = judged("a", changed, requirement)
    cdp, luminance = lowest(changed, requirement)
    assert (found.cdp, found.luminance_cd_m2) == (pytest.approx(cdp), pytest.approx(luminance))
    assert found.margin == pytest.approx(cdp - 0.9)
    assert found.limit == limit


@pytest.mark.long
def test_the_uncertainty_of_parameters_decides_near_the_limit(chain):
    """U is twice the root of the sum of squares of what each parameter does; half of it is not enough."""
    noisy = chain.with_(sensor__read_noise_e=40.0)
    own = dict.fromkeys(TYPICAL, 1e-9) | {"sensor.read_noise_e": 0.1, "sensor.prnu_rel": 0.5}
    requirement = REQUIRED.model_copy(update={"uncertainty_rel": own})
    cdp, luminance = lowest(noisy, requirement)
    noisy_at = noisy.with_(scene__contrast=0.8, exposure__temperature_c=60.0)

    def change(key, value, u_rel):
        ends = (noisy_at.with_(**{key: value * (1 + sign * u_rel)}) for sign in (1, -1))
        high, low = (float(one.sweep(scene__luminance_cd_m2=[luminance], exact=True)["cdp"][0]) for one in ends)
        return (high - low) / 2

    changes = change("sensor.read_noise_e", 40.0, 0.1), change("sensor.prnu_rel", 0.01, 0.5)
    expanded = 2 * sqrt(sum(one**2 for one in changes))
    found = judged("a", noisy, requirement)
    assert found.expanded_cdp == pytest.approx(expanded, rel=1e-3)
    assert found.dominant == "sensor.read_noise_e"
    for limit, verdict in (
        (cdp - 1.1 * expanded, "met"),
        (cdp - 0.5 * expanded, "undecided"),
        (cdp + 0.5 * expanded, "undecided"),
        (cdp + 1.1 * expanded, "not met"),
    ):
        assert judged("a", noisy, requirement.model_copy(update={"cdp_limit": limit})).verdict == verdict


@pytest.mark.parametrize(
    ("preset", "changed", "message"),
    [
        ("imx250", {"glare_cd_m2": 1.0}, "imx250: the chain has no windscreen"),
        ("imx250", {"uncertainty_rel": {"sensor.noise": 0.1}}, "uncertainty_rel names sensor.noise"),
    ],
)
def test_a_requirement_that_a_chain_cannot_be_judged_by(preset, changed, message):
    chain = Chain.load(preset).with_(scene__width=32, scene__height=24, scene__square_px=4)
    with pytest.raises(InputError, match=message):
        judged(preset, chain, REQUIRED.model_copy(update=changed))


def test_a_chain_alone_is_judged_as_beside_another(chain):
    question = Question.by(REQUIRED)
    alone, beside = (compare_subjects([chain] * n, question) for n in (1, 2))
    assert alone.judged == (replace(beside.judged[0], name="split-pixel"),)
    result = compare_result(alone)
    assert result.title == "split-pixel"
    assert "compare-equal" not in {finding.code for finding in result.findings}
    assert {"report.html", "results.xlsx"} <= set(comparison_files(alone, result))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("luminance_cd_m2 = [1.0, 2.0]", "contrast is missing"),
        ("contrast = 50\nluminance_cd_m2 = [1.0, 2.0]", "contrast is 50, which would be 5000 %"),
        ('contrast = "50%"\nluminance_cd_m2 = [2.0, 1.0]', "wrong order"),
    ],
)
def test_wrong_files_are_refused(tmp_path, text, message):
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=message):
        Requirement.load(tmp_path / "r.toml")
