import sys
from dataclasses import replace
from importlib.util import module_from_spec, spec_from_file_location
from math import sqrt
from pathlib import Path

import numpy as np
import pytest

from labcdp.calibration.dark.library import DarkLibrary, dark_library
from labcdp.calibration.emva.result import Quantity
from labcdp.calibration.frames.measure import measure_whole
from labcdp.chain import Chain, ExposureSettings
from labcdp.chain.camera_model import CameraModel
from labcdp.core.errors import CalibrationError, InputError
from labcdp.core.finding import info
from labcdp.core.response import Response
from labcdp.core.vignetting import FlatField
from labcdp.evaluate.twin.chain import twin_chain_text
from labcdp.evaluate.twin.corrected import CorrectedTwin
from labcdp.evaluate.twin.evaluate import twin_session
from labcdp.evaluate.twin.noise import noise_of_characterisation
from labcdp.evaluate.twin.pair import SAMPLING, sampling_variance
from labcdp.evaluate.twin.parameters import require_monochrome, twin_parameters
from labcdp.evaluate.twin.prediction import TwinRegion, predict_regions
from labcdp.evaluate.twin.report.result import twin_result
from labcdp.evaluate.twin.report.verdict import signal_findings, verdict
from labcdp.evaluate.twin.signal import KINDS, predicted_signal
from labcdp.metrics import Distribution, cdp
from labcdp.metrics.interval import TargetContrast
from labcdp.metrics.pairs import tally_pairs
from labcdp.session import Session

BENCHMARK = Path(__file__).parents[3] / "benchmarks" / "twin_coverage.py"


@pytest.fixture(scope="module")
def truth():
    """The camera of the example's bench."""
    return Chain.load("manta-g505").camera()


def test_the_parameters_are_those_of_the_simulated_camera(twin, truth):
    """Each within 4 of its standard uncertainties; a chance of 6e-5 for each of six."""
    found = twin.parameters.quantities
    sensor = truth.sensor
    for name in ("k_dn_per_e", "read_noise_e", "black_level_dn", "prnu_rel", "dsnu_e"):
        expected = getattr(sensor, name)
        assert abs(found[name].value - expected) < 4 * found[name].standard_uncertainty, name
    current = found["dark_current_e_s"]
    assert abs(current.value - sensor.dark_current_at(35.0)) < 4 * current.standard_uncertainty
    assert found["row_dsnu_e"].value < 0.2


def test_the_chain_has_the_calibrated_responsivity_and_dark_signal(twin, calibration):
    chain = Chain.from_toml(twin_chain_text(twin), "chain.toml")
    conversion = chain.camera().conversion(temperature_c=chain.settings.temperature_c)
    assert conversion.responsivity_dn_s_cd_m2 == pytest.approx(
        calibration.responsivity.responsivity_dn_s_cd_m2, rel=1e-5
    )
    for exposure_s in (0.002, 0.032):
        assert conversion.dark_dn(exposure_s) == pytest.approx(calibration.dark.mean_dn(exposure_s), abs=1e-4)


def test_the_chain_simulates_the_patches_that_were_measured(twin, observed):
    """Mean and noise of each patch in the twin's frame, within the noise and 3 % for the meter's readings."""
    chain = Chain.from_toml(twin_chain_text(twin), "chain.toml")
    run = chain.run(seed=1)
    dn = run[chain.stage_names[-1]].values
    exposure_s = chain.settings.exposure_s[0]
    for patch in observed.configuration.target.patches:
        simulated = patch.region().select(dn).astype(float)
        (o,) = (o for o in observed.patches[patch.name] if o.exposure_s == exposure_s)
        net = o.net_dn_at_pixel(64.0)
        scatter = sqrt(o.temporal_variance_dn2 / simulated.size)
        assert simulated.mean() - 64 == pytest.approx(net, abs=0.03 * net + 5 * scatter), patch.name


def test_all_pairs_are_compared_and_agree(twin):
    """The example's 123 pairs; the twin was told none of its bench's parameters."""
    names = {(pair.asked.bright, pair.asked.dark) for pair in twin.pairs}
    (alike,) = (one.values["pairs"] for one in twin.findings if one.code == "pairs-alike")
    assert len(names) == 16 * 15 / 2 - len(alike)
    assert twin.count("agree") >= 0.93 * len(twin.pairs)
    asked = [
        (pair.asked.bright, pair.asked.contrast) for pair in twin.pairs[: len(twin.observed.configuration.contrasts)]
    ]
    assert asked == [(one.bright, one.contrast) for one in twin.observed.configuration.contrasts]


def test_the_measured_cdp_is_that_of_the_calibrated_frame(twin, recorded, calibration):
    pair = twin.pairs[0]
    frame = recorded.load(next(r for r in recorded.frames() if r.number == pair.frame_number))
    regions = {p.name: p.region() for p in twin.observed.configuration.target.patches}
    seen = calibration.to_luminance(frame)
    expected = cdp(seen.select(regions[pair.asked.bright]), seen.select(regions[pair.asked.dark]), pair.asked.contrast)
    assert pair.measured.cdp == expected.cdp
    assert pair.measured.confidence_interval == expected.interval


def test_the_prediction_is_the_mean_of_many_simulated_frames(twin, truth):
    """Exact distributions against random numbers: a sensor of the twin's parameters, pixels with fall-off."""
    exposure_s, v = 0.008, np.linspace(0.93, 0.97, 40_000)
    parameters = twin.parameters
    regions = [TwinRegion(name, value, 0.0, 0.0, v, 0.0, 0.0) for name, value in (("b", 9.0), ("d", 4.0))]
    predicted = predict_regions(parameters, regions, exposure_s, Response())
    sensor = parameters.sensor((200, 200), exposure_s)
    r, dark_dn = parameters.responsivity.value, parameters.dark_dn(exposure_s)
    drawn = []
    for index, region in enumerate(regions):
        rate = r * v * region.luminance_cd_m2 / parameters.noise.k_dn_per_e.value
        dn = replace(sensor, device_seed=index).expose(
            rate.reshape(200, 200), exposure_s, temperature_c=parameters.temperature_c, seed=index, exposure_index=0
        )
        drawn.append((dn.ravel() - dark_dn) / (r * exposure_s * v))
    for contrast, epsilon in ((1.25, 0.5), (1.25, 0.05), (2.0, 0.3)):
        asked = TargetContrast(contrast, epsilon, "weber")
        exact = tally_pairs(predicted["b"].best, predicted["d"].best, asked.low, asked.high)
        simulated = cdp(*drawn, contrast, epsilon)
        assert exact.inside == pytest.approx(simulated.cdp, abs=5 * simulated.u)


def test_the_scatter_of_a_small_region_is_that_of_the_u_statistic():
    """Variance of the CDP of 30 and 50 pixels over 3000 draws; a variance is known to sqrt(2 / 3000) = 2.6 %."""
    rng = np.random.default_rng(5)
    bright, dark = Distribution.normal(100, 12), Distribution.normal(60, 9)
    asked = TargetContrast(0.8, 0.3, "weber")
    tally = tally_pairs(bright, dark, asked.low, asked.high)
    expected = sampling_variance(tally, bright, dark, m=30, n=50)
    drawn = [cdp(rng.normal(100, 12, 50), rng.normal(60, 9, 30), 0.8, 0.3).cdp for _ in range(3000)]
    assert np.var(drawn) == pytest.approx(expected, rel=4 * sqrt(2 / 3000))
    assert np.mean(drawn) == pytest.approx(tally.inside, abs=4 * sqrt(expected / 3000))


@pytest.fixture(scope="module")
def few(observed):
    """Fewer patches than the session has, which are quicker."""
    kept = ("P01", "P02", "P04", "P06", "P09", "P12", "upper left")
    patches = {name: observed.patches[name] for name in kept}
    return replace(observed, planes={None: replace(observed.monochrome, patches=patches)})


def times(quantity, factor):
    return None if quantity is None else replace(quantity, value=factor * quantity.value)


def wrong_responsivity(calibration, found):
    fit = calibration.responsivity
    wrong = replace(fit, responsivity_dn_s_cd_m2=1.1 * fit.responsivity_dn_s_cd_m2)
    return replace(calibration, responsivity=wrong), found


def wrong_black_level(calibration, found):
    return replace(calibration, dark=replace(calibration.dark, offset_dn=calibration.dark.offset_dn + 2)), found


def wrong_noise(factor, *names):
    return lambda calibration, found: (
        calibration,
        replace(found, **{name: times(getattr(found, name), factor) for name in names}),
    )


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        ("mean", wrong_responsivity),
        (None, wrong_black_level),
        ("temporal noise", wrong_noise(2, "dark_noise_e")),
        ("temporal noise", wrong_noise(1.1, "k_dn_per_e")),
        ("fixed pattern", wrong_noise(2, "prnu_rel", "prnu_pixel_rel")),
        ("fixed pattern", wrong_noise(4, "dsnu_e", "dsnu_pixel_e")),
    ],
    ids=["responsivity", "black level", "read noise", "K", "PRNU", "DSNU"],
)
def test_a_wrong_parameter_shows_in_the_signal_it_determines(recorded, few, calibration, characterisation, kind, wrong):
    """Means of bright patches hardly depend on the black level, but pairs of dim ones do at a tolerance of 10 %."""
    result = twin_session(recorded, few, *wrong(calibration, characterisation), epsilon=0.1)
    assert kind is None or kind in [one.subject for one in signal_findings(result)]
    assert verdict(result).code in ("twin-differs", "twin-signals-differ")


def test_a_wrong_reading_is_named(recorded, observed, calibration, characterisation):
    """One patch read 20 % too low: pairs with it differ, and it is the one whose mean is not as predicted."""
    readings = dict(observed.readings)
    readings["P05"] = [replace(one, value=0.8 * one.value) for one in readings["P05"]]
    result = twin_session(recorded, replace(observed, readings=readings), calibration, characterisation, 1.0, 0.5)
    differing = [pair for pair in result.pairs if pair.judgement == "differ"]
    touched = [pair for pair in differing if "P05" in (pair.asked.bright, pair.asked.dark)]
    assert len(touched) >= 3
    assert len(differing) - len(touched) <= 0.07 * len(result.pairs)
    means = next(one for one in signal_findings(result) if one.subject == "mean")
    assert means.values["patches"] == ["P05"]


def test_noise_and_mean_under_strong_vignetting_are_those_of_simulated_pixels(twin):
    """V from 0.4 to 0.8 over 40 000 pixels in 40 frames: by the harmonic mean the photons would be 4 % too few."""
    parameters, exposure_s, v = twin.parameters, 0.008, np.linspace(0.4, 0.8, 40_000)
    region = TwinRegion("P", 90.0, 0.0, 0.0, v, 0.0, 0.0)
    predicted = predicted_signal(parameters, region, exposure_s, Response())
    rng, n, noise = np.random.default_rng(6), 40, parameters.noise
    k, dark_dn = noise.k_dn_per_e.value, parameters.dark_dn(exposure_s)
    electrons = parameters.responsivity.value * exposure_s * 90.0 * v / k
    dark_e = parameters.dark_current_e_s.value * exposure_s
    frames = k * rng.poisson(electrons + dark_e, (n, v.size)) + rng.normal(0, noise.read_noise_dn.value, (n, v.size))
    frames = np.rint(frames + dark_dn - k * dark_e)
    assert frames.var(axis=0, ddof=1).mean() == pytest.approx(
        predicted["temporal_dn"][0] ** 2, rel=4 * sqrt(2 / (v.size * (n - 1)))
    )
    mean = (frames / v).mean() / (1 / v).mean()
    assert mean == pytest.approx(predicted["mean_dn"][0], abs=4 * predicted["temporal_dn"][0] / sqrt(v.size * n) * 1.1)


@pytest.mark.parametrize(
    ("predicted", "uncertainty", "measured", "judgement"),
    [
        (1.0, 1.22, 1.0, "undecided"),
        (1.0, 1.22, 0.0, "undecided"),
        (0.5, 0.21, 0.5, "undecided"),
        (0.0, 0.41, 1.0, "undecided"),
        (0.5, 0.19, 0.5, "agree"),
        (1.0, 0.4, 1.0, "agree"),
        (1.0, 0.4, 0.1, "differ"),
    ],
)
def test_a_pair_with_which_nearly_any_cdp_would_agree_is_undecided(twin, predicted, uncertainty, measured, judgement):
    """80 % of 0 to 1: with 1.96 standard uncertainties, from 0.204 on in the middle and from 0.408 on at an end."""
    pair = replace(
        twin.pairs[0],
        measured=replace(twin.pairs[0].measured, cdp=measured),
        predicted=predicted,
        u_predicted=uncertainty,
        u_pixels=1e-3,
    )
    assert pair.judgement == judgement
    (row,) = twin_result(replace(twin, pairs=(pair,))).table("summary").rows()
    counts = [row[one] for one in ("agreeing", "differing", "undecided")]
    assert counts == [judgement == one for one in ("agree", "differ", "undecided")]


def library_of(noise_dn, pattern_dn):
    """A library whose noise is all in the offset, and whose pattern is all in the rate."""
    none = np.zeros((2, 2))
    return DarkLibrary(none, none, ((noise_dn**2, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, pattern_dn**2)), None, None, 4)


def test_the_noise_of_a_dark_library_stands_in_for_the_dsnu_where_it_is_taken_off(twin):
    """The pattern is 8 DN a second: above the library's noise of 2 DN from 0.25 s on."""
    corrected = CorrectedTwin(twin.parameters, library_of(2.0, 8.0))
    assert corrected.at(0.2) is twin.parameters
    noise = corrected.at(0.5).noise
    assert (noise.dsnu_dn.value, noise.dsnu_dn.standard_uncertainty) == (2.0, 0.0)
    assert (noise.row_dsnu_dn.value, noise.column_dsnu_dn.value, noise.dsnu_dn_s.value) == (0, 0, 0)
    assert noise.prnu_rel == twin.parameters.noise.prnu_rel
    assert corrected.findings([0.2, 0.5]) == [info("twin-dark-library", exposures_s=[0.5])]
    assert corrected.findings([0.2]) == []


def test_the_noise_of_a_flat_field_stands_in_for_the_prnu(twin):
    field = FlatField(np.ones((2, 2)), random_rel=0.003, slow_rel=0.0, n_frames=16)
    corrected = CorrectedTwin(twin.parameters, None, field)
    assert corrected.at(0.01).noise.prnu_rel.value == 0.003
    assert corrected.at(0.01).noise.dsnu_dn == twin.parameters.noise.dsnu_dn
    assert corrected.findings([0.01]) == [info("twin-flat-field")]


def test_the_pattern_that_a_dark_library_leaves_is_predicted(twin, recorded):
    """Against 40 000 simulated pixels and a library of 2 x 2 frames; a variance is known to sqrt(2 / 40 000)."""
    parameters, shape, n = twin.parameters, (200, 200), 50
    sensor = replace(parameters.sensor(shape), device_seed=5, dsnu_e=8.0)
    template = recorded.load(recorded.frames("dark")[0])

    def darks(exposure_s, first, count):
        return [
            replace(
                template,
                exposure_s=exposure_s,
                dn=sensor.expose(
                    np.zeros(shape),
                    exposure_s,
                    temperature_c=parameters.temperature_c,
                    seed=3,
                    exposure_index=first + i,
                ),
            )
            for i in range(count)
        ]

    library = dark_library([measure_whole(darks(0.002, 0, 2)), measure_whole(darks(0.032, 2, 2))])
    seen = measure_whole(darks(0.008, 10, n)).statistics.image_dn - library.pattern_dn(shape, 0.008)
    noise = CorrectedTwin(parameters, library).at(0.008).noise
    of_mean_dn2 = (noise.read_noise_dn.value**2 + 1 / 12) / n
    assert seen.var() == pytest.approx(noise.dsnu_dn.value**2 + of_mean_dn2, rel=4 * sqrt(2 / 40_000) + 0.03)


def test_a_pattern_taken_off_coarse_values_spreads_them_between_the_steps_of_the_converter(twin):
    """CDP of two dim patches on a camera of little noise, against 2 x 40 000 simulated pixels.

    Values one DN apart, as frames have them before the pattern is taken off, would give another CDP.
    """
    exposure_s, noise, shape = 0.008, twin.parameters.noise, 40_000

    def exactly(quantity, value):
        return replace(quantity, value=value, standard_uncertainty=0.0)

    wanted = {"k_dn_per_e": 0.05, "read_noise_dn": 0.35, "dsnu_dn": 0.2, "prnu_rel": 0.0}
    wanted |= dict.fromkeys(("row_dsnu_dn", "column_dsnu_dn", "dsnu_dn_s"), 0.0)
    changes = {name: exactly(getattr(noise, name), value) for name, value in wanted.items()}
    coarse = replace(
        twin.parameters.with_noise(replace(noise, **changes)),
        dark_current_e_s=exactly(twin.parameters.dark_current_e_s, 0.0),
        pattern_taken_off_dn=0.5,
    )
    per_dn, dark_dn = 1 / (coarse.responsivity.value * exposure_s), coarse.dark_dn(exposure_s)
    net_dn = {"b": 6.2, "d": 1.7}
    regions = [TwinRegion(name, net * per_dn, 0.0, 0.0, np.ones(9), 0.0, 0.0) for name, net in net_dn.items()]
    rng, drawn = np.random.default_rng(4), []
    for net in net_dn.values():
        pattern = 0.5 * rng.normal(size=shape)
        dn = np.rint(dark_dn + pattern + 0.05 * rng.poisson(net / 0.05, shape) + 0.35 * rng.normal(size=shape))
        drawn.append((dn - dark_dn - pattern - 0.2 * rng.normal(size=shape)) * per_dn)
    asked, simulated = TargetContrast(3.0, 0.3, "weber"), cdp(*drawn, 3.0, 0.3)

    def predicted(parameters):
        found = predict_regions(parameters, regions, exposure_s, Response())
        return tally_pairs(found["b"].best, found["d"].best, asked.low, asked.high).inside

    assert predicted(coarse) == pytest.approx(simulated.cdp, abs=5 * simulated.u)
    assert abs(predicted(replace(coarse, pattern_taken_off_dn=0.0)) - simulated.cdp) > 20 * simulated.u


def test_the_patches_signals_agree(twin):
    """Mean, temporal noise and fixed pattern: 48 comparisons, of which 5 % may lie beyond 1.96 and none beyond 4.5."""
    z = np.array([list(patch.z.values()) for patch in twin.patches])
    assert z.shape == (16, len(KINDS))
    assert np.abs(z).max() < 4.5
    assert list(signal_findings(twin)) == []
    assert np.mean(np.abs(z) > 1.96) < 0.05 + 4 * sqrt(0.05 * 0.95 / z.size)


def test_the_intervals_hold_on_benches_with_random_cameras(tmp_path, monkeypatch):
    """Three benches of the benchmark, where 98 % of the pairs agree, with a scatter of 3.5 % from bench to bench.

    A dark library is taken off in the last one. No parameter of any is wrong, and none may be said to be.
    """
    spec = spec_from_file_location("twin_coverage", BENCHMARK)
    benchmark = module_from_spec(spec)
    # Its dataclasses look their module up there.
    monkeypatch.setitem(sys.modules, spec.name, benchmark)
    spec.loader.exec_module(benchmark)
    results = [benchmark.compare(seed, tmp_path) for seed in (0, 3, 505)]
    share = sum(result.count("agree") for result in results) / sum(len(result.pairs) for result in results)
    assert share > 0.98 - 2 * 0.035 / sqrt(3)
    assert [list(signal_findings(result)) for result in results] == [[], [], []]
    assert "twin-dark-library" in [one.code for one in results[2].findings]
    decided = [pair.largest == SAMPLING for result in results for pair in result.pairs]
    assert 0.5 < np.mean(decided) <= 1


def test_one_dark_exposure_leaves_the_dark_current_open(observed, calibration, characterisation, recorded):
    one = replace(calibration, dark=replace(calibration.dark, exposures_s=(0.002,)))
    parameters = twin_parameters(recorded, observed, one, characterisation)
    assert parameters.dark_current_e_s.value == 0
    assert info("twin-dark-current-unknown") in parameters.findings


def test_an_efficiency_above_one_is_refused(observed, calibration, characterisation, recorded):
    camera = observed.configuration.camera.model_copy(update={"pixel_pitch_m": 1e-6})
    configuration = observed.configuration.model_copy(update={"camera": camera})
    with pytest.raises(
        CalibrationError, match=r"would be 4\.\d+, more than 1: check the f-number \(f/2\.6\), the pixel"
    ):
        twin_parameters(recorded, replace(observed, configuration=configuration), calibration, characterisation)


def test_a_response_that_bends_is_predicted_and_reported(observed, calibration, characterisation, recorded):
    """The chain cannot hold it; the prediction follows it, so that the mean luminance is that of the meter."""
    bent = Response("quadratic", (0.0, 4000.0), (0.0, 4400.0))
    parameters = twin_parameters(recorded, observed, replace(calibration, response=bent), characterisation)
    assert info("twin-response-not-linear", response="quadratic") in parameters.findings
    region = TwinRegion("P", 80.0, 0.0, 0.0, np.ones(9), 0.0, 0.0)
    found = predict_regions(parameters, [region], 0.008, bent)["P"].best
    assert found.mean == pytest.approx(80.0, rel=2e-4)


def test_what_the_characterisation_lacks_is_none(characterisation):
    lacking = replace(characterisation, dsnu_e_s=None, prnu_rel=None, prnu_pixel_rel=None, dsnu_row_e=None)
    noise = noise_of_characterisation(lacking)
    assert (noise.prnu_rel.value, noise.dsnu_dn_s.value, noise.row_dsnu_dn.value) == (0, 0, 0)
    assert noise.prnu_rel.note == "not known"


def test_bright_and_dark_the_wrong_way_round_are_left_out(recorded, observed, calibration, characterisation):
    pair = observed.configuration.contrasts[0]
    observed = replace(
        observed,
        planes={None: replace(observed.monochrome, patches={n: observed.patches[n] for n in (pair.bright, pair.dark)})},
    )
    turned = pair.model_copy(update={"bright": pair.dark, "dark": pair.bright})
    configuration = observed.configuration.model_copy(update={"contrasts": (turned,)})
    result = twin_session(recorded, replace(observed, configuration=configuration), calibration, characterisation)
    assert (result.findings[0].code, result.findings[0].values["pairs"]) == (
        "pairs-reversed",
        [f"{pair.dark} / {pair.bright}"],
    )


def test_contrast_and_tolerance_out_of_range_are_refused(recorded, observed, calibration, characterisation):
    with pytest.raises(InputError, match="contrast"):
        twin_session(recorded, observed, calibration, characterisation, contrast=-1.0)
    with pytest.raises(InputError, match="epsilon"):
        twin_session(recorded, observed, calibration, characterisation, contrast=1.0, epsilon=2.0)


def test_patches_saturated_at_every_exposure_are_left_out(recorded, observed, calibration, characterisation):
    saturated = {
        name: [replace(o, saturated_share=0.5) for o in group] if name != "P01" else group
        for name, group in observed.patches.items()
    }
    planes = {None: replace(observed.monochrome, patches=saturated)}
    with pytest.raises(CalibrationError, match=r"no two patches can be compared: .*saturated at every exposure"):
        twin_session(recorded, replace(observed, planes=planes), calibration, characterisation)


def test_two_patches_are_needed_to_compare(recorded, observed, calibration, characterisation):
    one = replace(observed, planes={None: replace(observed.monochrome, patches={"P01": observed.patches["P01"]})})
    with pytest.raises(CalibrationError, match=r"compared by pairs of patches, and 1 of them is left: leave fewer out"):
        twin_session(recorded, one, calibration, characterisation)


def test_two_patches_that_are_alike_are_refused(recorded, observed, calibration, characterisation):
    patches = {name: observed.patches[name] for name in ("P10", "upper right")}
    two = replace(observed, planes={None: replace(observed.monochrome, patches=patches)})
    with pytest.raises(CalibrationError, match=r"no two .*below 10 % .*P10 / upper right"):
        twin_session(recorded, two, calibration, characterisation)


def test_patches_without_a_reading_are_refused(recorded, observed, calibration, characterisation):
    with pytest.raises(CalibrationError, match="no meter reading"):
        twin_session(recorded, replace(observed, readings={}), calibration, characterisation)


def test_a_session_with_colour_filters_is_refused(recorded, tmp_path):
    frame = recorded.load(recorded.frames("light")[0])
    with Session.create(tmp_path / "s", recorded.configuration) as session:
        session.add_frame(replace(frame, colour_filter="RG", pixel_format="BayerRG12"), "light")
        with pytest.raises(CalibrationError, match=r"colour filter \(RG\): twins of colour cameras are not supported"):
            require_monochrome(session)


def test_a_session_without_light_frames_is_refused(recorded, tmp_path):
    message = "no light frames: go on with the acquisition"
    with (
        Session.create(tmp_path / "s", recorded.configuration) as session,
        pytest.raises(CalibrationError, match=message),
    ):
        require_monochrome(session)


def test_a_calibration_of_another_camera_or_lens_is_refused(recorded, observed, calibration, characterisation):
    camera = replace(calibration.state.camera, serial="other")
    other = replace(calibration, state=replace(calibration.state, camera=camera))
    with pytest.raises(
        CalibrationError, match=r"camera of the calibration is .*other.*: use the same, or calibrate this"
    ):
        twin_session(recorded, observed, other, characterisation)
    lens = replace(calibration.lens, f_number=4.0)
    with pytest.raises(CalibrationError, match=r"f/4\).* calibrate with this lens and f-number"):
        twin_session(recorded, observed, replace(calibration, lens=lens), characterisation)


def test_another_meter_adds_its_scale(recorded, observed, calibration, characterisation):
    """The scale of one meter is in R and in the readings and cancels; that of two does not: 2 % / sqrt 3 each."""
    readings = {
        name: [replace(one, meter=replace(one.meter, serial="another")) for one in group]
        for name, group in observed.readings.items()
    }
    parameters = twin_parameters(recorded, replace(observed, readings=readings), calibration, characterisation)
    rel = parameters.responsivity.standard_uncertainty / parameters.responsivity.value
    assert rel == pytest.approx(sqrt(2 / 3) * 0.02, rel=0.01)
    same = twin_parameters(recorded, observed, calibration, characterisation).responsivity
    assert same.standard_uncertainty / same.value == calibration.responsivity.random_rel


def test_the_sensor_takes_the_dark_mean_of_the_calibration(twin):
    """At each exposure, whatever the dark current."""
    for exposure_s in (0.002, 0.032):
        sensor = twin.parameters.sensor((1, 1), exposure_s)
        settings = ExposureSettings((exposure_s,), temperature_c=twin.parameters.temperature_c)
        assert CameraModel(sensor, settings).dark_dn == pytest.approx(twin.parameters.dark_dn(exposure_s), abs=1e-9)


def test_the_uncertainty_of_k_goes_out_again_in_dn(characterisation):
    k, noise_e = characterisation.k_dn_per_e, characterisation.dark_noise_e
    noise = noise_of_characterisation(characterisation).read_noise_dn
    own_rel, k_rel = noise.standard_uncertainty / noise.value, k.standard_uncertainty / k.value
    assert own_rel**2 + k_rel**2 == pytest.approx((noise_e.standard_uncertainty / noise_e.value) ** 2, rel=1e-9)
    assert isinstance(noise, Quantity)
