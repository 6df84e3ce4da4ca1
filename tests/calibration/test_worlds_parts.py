"""Light, lens, camera and meter of the worlds against closed forms, and what the table makes of findings."""

import tomllib
from dataclasses import replace
from importlib.resources import files
from math import exp

import numpy as np
import pytest
from worlds.bench import QUANTITIES, Outcome
from worlds.camera import curved, expose, lagging, make_device, straightened, warming
from worlds.catalogue import WORLDS
from worlds.causes import NAMED_BY, causes_of, false, right
from worlds.lamp import light_of_lamp, mean_of_wave
from worlds.meter import read_patches
from worlds.optics import spread
from worlds.table import summarise
from worlds.world import FULL_SCALE_DN, HEIGHT, WARM_UP_S, WIDTH, World

PULSES = World(ripple_rel=0.2)
RIPPLE = World(ripple_rel=0.03, ripple="sine", ripple_hz=100.0)


@pytest.fixture
def rng():
    return np.random.default_rng(20261129)


@pytest.mark.parametrize("world", [PULSES, RIPPLE])
@pytest.mark.parametrize("exposure_s", [1e-3, 1e-2, 0.0123])
@pytest.mark.parametrize("begins", [0.0, 0.3, 0.9])
def test_light_of_a_periodic_lamp_is_the_mean_of_its_wave(world, exposure_s, begins):
    phase = (begins + world.ripple_hz * exposure_s * (np.arange(100_000) + 0.5) / 100_000) % 1
    wave = np.sin(2 * np.pi * phase) if world.ripple == "sine" else np.where(phase < 0.5, 1.0, -1.0)
    assert mean_of_wave(world, begins, exposure_s) == pytest.approx(wave.mean(), abs=1e-4)


def test_a_rectifier_s_ripple_is_nothing_in_whole_periods_and_all_of_it_in_short_exposures(rng):
    assert light_of_lamp(RIPPLE, 0.01, rng) == pytest.approx(1, abs=1e-12)
    short = np.array([light_of_lamp(RIPPLE, 1e-6, rng) for _ in range(4000)])
    assert short.max() == pytest.approx(1.03, abs=1e-4)
    assert short.std() == pytest.approx(0.03 / np.sqrt(2), rel=0.05)


def test_frames_at_one_phase_are_alike_and_others_are_not(rng):
    assert len({light_of_lamp(PULSES, 1e-3, rng, 0.2) for _ in range(5)}) == 1
    assert len({light_of_lamp(PULSES, 1e-3, rng) for _ in range(5)}) > 1


def test_a_disc_takes_light_over_an_edge_as_its_segment_beyond_it():
    radius, step = 5.0, np.where(np.arange(60) < 30, 0.0, 1.0) * np.ones((40, 1))
    seen = spread(step, World(blur_px=radius))[20]
    # The share of a disc at a distance d of its centre from a straight edge.
    d = np.clip(29.5 - np.arange(60), -radius, radius)
    segment = (radius**2 * np.arccos(d / radius) - d * np.sqrt(radius**2 - d**2)) / (np.pi * radius**2)
    assert seen == pytest.approx(segment, abs=0.01)
    assert seen[:24] == pytest.approx(0, abs=1e-9)


def test_a_halo_keeps_the_light_and_gives_its_share_away():
    point = np.zeros((101, 121))
    point[50, 60] = 1.0
    seen = spread(point, World(halo_rel=0.05, halo_px=4.0))
    assert seen.sum() == pytest.approx(1)
    of_halo = 0.05 * np.exp(-(6**2 + 3**2) / (2 * 4.0**2)) / (2 * np.pi * 4.0**2)
    assert seen[53, 66] == pytest.approx(of_halo, rel=0.03)
    assert spread(np.ones((20, 30)), World(halo_rel=0.05)) == pytest.approx(1)


def test_companding_keeps_black_and_full_scale_and_is_inverted():
    world = World(knees=((0.1, 0.5), (0.3, 0.25)))
    linear = np.linspace(0, FULL_SCALE_DN, 500)
    dn = curved(linear, world)
    assert curved(np.array([world.black_dn, FULL_SCALE_DN]), world) == pytest.approx([world.black_dn, FULL_SCALE_DN])
    assert straightened(dn, world) == pytest.approx(linear)
    slopes = np.diff(dn) / np.diff(linear)
    # 0.1 + 0.2 * 0.5 + 0.7 * 0.25 of the range without the factor that makes it all of it.
    assert slopes[[0, 100, 499 - 1]] * 0.375 == pytest.approx([1, 0.5, 0.25])


def test_a_frame_has_a_share_of_the_one_before():
    world = World(image_lag_rel=0.02)
    assert lagging(np.array([100.0]), np.array([1000.0]), world) == pytest.approx(118)
    # Of full pixels a full well is left.
    assert lagging(np.array([100.0]), np.array([1e6]), world) == pytest.approx(98 + 0.02 * world.full_well_e)


def test_image_lag_shows_in_frames_of_a_scene(rng):
    world = World(image_lag_rel=0.02, black_dn=200.0)
    device = make_device(world, rng)
    before, steady = (expose(device, 2.0, 0.01, rng, before_s=s).mean() - 200 for s in (0.1, 0.01))
    assert before / steady == pytest.approx(0.98 + 0.02 * 10, rel=0.01)


def test_columns_of_two_converters_differ_by_their_gains(rng):
    device = make_device(World(converters="columns", converters_rel=0.01, darkest_cd_m2=1.0), rng)
    frames = np.mean([expose(device, 40.0, 0.01, rng) for _ in range(20)], axis=0) - device.world.black_dn
    assert frames[:, ::2].mean() / frames[:, 1::2].mean() == pytest.approx(1.005 / 0.995, abs=1e-3)
    halves = make_device(World(converters="halves", converters_rel=0.01), rng).gain
    assert halves[0, [0, WIDTH // 2 - 1, WIDTH // 2, -1]] == pytest.approx([1.005, 1.005, 0.995, 0.995])


def test_a_camera_that_warms_up_ends_as_it_stays(rng):
    device = make_device(World(warm_up_k=7.0, warm_up_rel=0.01, dark_current_e_s=100.0), rng)
    first, third, last = (warming(device, s) for s in (0.0, WARM_UP_S, 1e6))
    assert (first.world.dark_current_e_s, first.world.temperature_c) == (50.0, 23.0)
    assert first.responsivity_e_s_cd_m2 == pytest.approx(1.01 * device.responsivity_e_s_cd_m2)
    assert third.world.dark_current_e_s == pytest.approx(100 * 2 ** -exp(-1))
    assert last.responsivity_e_s_cd_m2 == pytest.approx(device.responsivity_e_s_cd_m2)


def test_light_frames_alone_have_their_black_level(rng):
    device = make_device(World(light_offset_dn=3.0), rng)
    lit, covered = (expose(device, light, 1e-3, rng).mean() for light in (1e-9, 0.0))
    assert lit - covered == pytest.approx(3.0, abs=4 * 1.7 * np.sqrt(2 / (HEIGHT * WIDTH)))


def test_a_lagging_meter_shows_a_tenth_of_the_reading_before(rng):
    world = replace(World(), meter_lag_rel=0.1, repeatability_rel=0.0, resolution_cd_m2=1e-9)
    shown = read_patches(world, {"a": 100.0, "b": 1.0}, (0.0, 0.0), rng, 0.0, 1.0)
    assert [one.value_cd_m2 for one in shown] == pytest.approx([100, 100, 100, 10.9, 1.99, 1.099])


def test_a_noisy_meter_scatters_as_much_more_as_it_says(rng):
    world = World(noisier=2.5, readings=4000)
    shown = [one.value_cd_m2 for one in read_patches(world, {"a": 100.0}, (0.0, 0.0), rng, 0.0, 1.0)]
    assert np.std(shown) == pytest.approx(0.5, rel=0.05)


def test_findings_that_name_causes_exist():
    """One that is renamed would no longer be counted."""
    folder = files("labcdp") / "data" / "findings"
    codes = {code for path in folder.iterdir() for code in tomllib.loads(path.read_text(encoding="utf-8"))}
    assert [begin for begin in NAMED_BY if not any(code.startswith(begin) for code in codes)] == []


def test_causes_of_worlds_are_known():
    known = {cause for causes in NAMED_BY.values() for cause in causes}
    assert {cause for world in WORLDS for cause in world.causes} <= known
    assert len({world.name for world in WORLDS}) == len(WORLDS)


def test_a_finding_is_right_or_false_by_the_causes_of_the_world():
    assert causes_of("dark-current-differs") == ("dark signal", "temperature")
    assert causes_of("no-intercept") == ()
    found = (("warning", "intercept"), ("info", "drift"), ("warning", "few-patches"), ("warning", "patches-scatter"))
    assert right(found, ("glare",))
    assert right(found, ("dark signal",))
    assert not right(found, ("drift",))
    assert false(found, ("glare",)) == ()
    assert false(found, ("flicker",)) == ("intercept",)


def outcome(error, *codes):
    return Outcome(
        error=dict.fromkeys(QUANTITIES, error),
        expanded=dict.fromkeys(QUANTITIES, 0.02),
        inside=dict.fromkeys(QUANTITIES, abs(error) < 0.02),
        findings=tuple(("warning", code) for code in codes),
    )


@pytest.mark.parametrize(
    ("codes", "verdict"),
    [
        (("flicker",), "named"),
        (("flicker", "drift"), "named, false cause"),
        ((), "too low"),
        (("drift",), "too low, false cause"),
    ],
)
def test_the_table_tells_right_causes_from_false_ones(codes, verdict):
    summary = summarise(World(causes=("flicker",)), [outcome(0.04, *codes)] * 100)
    assert summary.verdict == verdict
    assert summary.false_cause == ("drift" in codes)
    assert summary.of_error == (dict.fromkeys(QUANTITIES, 0.5) if "flicker" in codes else {})


def test_an_interval_that_is_named_and_wide_is_not_right():
    outcomes = [outcome(0.001, "flicker")] * 80 + [outcome(0.03, "flicker")] * 20
    summary = summarise(World(causes=("flicker",)), outcomes)
    assert summary.verdict == "named, U too wide"
    assert summary.of_error["luminance"] == pytest.approx(20)
    assert summarise(World(), [outcome(0.01)] * 40).verdict == "holds"
    assert summarise(World(), [Outcome(refused="no light")]).verdict == "refused"


def test_refusals_of_one_kind_are_counted_together():
    refused = [Outcome(refused=f"patch 'P0{i}' reads {i}.5 cd/m²: measure again") for i in range(3)]
    assert summarise(World(), refused).reasons == {"patch 'P..' reads .. cd/m²": 3}
