"""A pulsed lamp seen by several captures at different times, against Poisson counts over the phases in plain NumPy."""

import numpy as np
import pytest

import labcdp
from labcdp.chain import CaptureTime, PulsedLamp
from labcdp.core.errors import InputError
from labcdp.core.photometry import electron_radiance_per_cd_m2

#: Frequency, share of the period, light in between.
FREQUENCY_HZ, DUTY, OFF = 90.0, 0.2, 0.02
LAMP_CD_M2, AROUND_CD_M2 = 2000.0, 900.0
SENSOR = {"pixel_pitch_m": 3.45e-6, "quantum_efficiency": 0.5, "full_well_e": 30_000, "k_dn_per_e": 0.1,
          "read_noise_e": 3.0, "dark_current_e_s": 5.0, "bits": 12, "black_level_dn": 16}  # fmt: skip
#: Exposure time, start, share of light, DN per electron and full well of each capture.
CAPTURES = ((0.004, 0.0, 1.0, 0.1, 30_000), (0.011, 0.0, 0.02, 0.4, 8000), (0.0005, 0.0111, 1.0, 0.1, 30_000))
SPLIT = SENSOR | {
    "photodiodes": [{"name": "small", "light_share": 0.02, "full_well_e": 8000}],
    "captures": [
        {"name": "long"},
        {"name": "small", "photodiode": "small", "exposure_s": 0.011, "k_dn_per_e": 0.4},
        {"name": "late", "exposure_s": 0.0005, "start_s": 0.0111},
    ],
}


def lamp_chain(method, sensor=SENSOR, exposure_s=0.004, **scene):
    return labcdp.Chain.from_document(
        {
            "name": "lamp",
            "spectrum": "monochromatic 555 nm",
            "scene": {"type": "lamp", "width": 48, "height": 36, "luminance_cd_m2": LAMP_CD_M2,
                      "background_cd_m2": AROUND_CD_M2, "side_px": 20, "frequency_hz": FREQUENCY_HZ, "duty": DUTY,
                      "off_level": OFF, **scene},
            "optics": {"f_number": 2.0, "transmittance": 0.9},
            "exposure": {"exposure_s": exposure_s},
            "sensor": sensor,
            **({"hdr": {"method": method}} if method else {}),
        }
    )  # fmt: skip


def lamp_cd_m2(exposure_s, start_s, phase):
    """Luminance of the lamp during an exposure, by the overlap with each pulse."""
    begin, end = (phase / FREQUENCY_HZ + time for time in (start_s, start_s + exposure_s))
    pulses = (np.arange(5)[:, None] / FREQUENCY_HZ + np.array([0, DUTY / FREQUENCY_HZ])).T[..., None]
    lit_s = np.clip(np.minimum(end, pulses[1]) - np.maximum(begin, pulses[0]), 0, None).sum(axis=0)
    return LAMP_CD_M2 * (OFF + (1 - OFF) * lit_s / exposure_s) / (OFF + (1 - OFF) * DUTY)


def counted_dn(luminance_cd_m2, capture, rng):
    """DN above the black level of one pixel in each frame."""
    exposure_s, _, share, k_dn_per_e, full_well_e = capture
    per_cd_m2 = electron_radiance_per_cd_m2("monochromatic 555 nm", 0.5) * 3.45e-6**2 * np.pi * 0.9 / (4 * 2.0**2)
    electrons = np.minimum(rng.poisson((luminance_cd_m2 * per_cd_m2 * share + 5.0) * exposure_s), full_well_e)
    dn = np.rint(k_dn_per_e * rng.normal(electrons, 3.0) + 16)
    return np.clip(dn, 0, 4095) - 16


def merged(method, captures_dn, captures):
    """Merge as the methods are described, on the scale of the first capture."""
    ends = [min(4095, 16 + k * (full_well_e - 18)) - 16 for _, _, _, k, full_well_e in captures]
    sensitivities = [exposure_s * share * k for exposure_s, _, share, k, _ in captures]
    dark = [5.0 * exposure_s * k for exposure_s, _, _, k, _ in captures]
    ratios = [sensitivities[0] / sensitivity for sensitivity in sensitivities]
    net = [dn - (level - dark[0] / ratio) for dn, level, ratio in zip(captures_dn, dark, ratios, strict=True)]
    ends = [end - (level - dark[0] / ratio) for end, level, ratio in zip(ends, dark, ratios, strict=True)]
    if method == "most-sensitive":
        value = net[-1] * ratios[-1]
        for dn, end, ratio in list(zip(net, ends, ratios, strict=True))[-2::-1]:
            share = np.clip((end - dn) / (0.1 * end), 0, 1)
            value = share * dn * ratio + (1 - share) * value
        return value
    count, total = 0, 0.0
    usable = np.ones(net[0].shape, bool)
    for dn, end, ratio in list(zip(net, ends, ratios, strict=True))[::-1]:
        usable &= dn < end
        total, count = total + usable * dn * ratio, count + usable
    return np.where(count > 0, total / np.maximum(count, 1), ends[-1] * ratios[-1])


def brute_force(method, captures, phase, contrast, seed):
    """Share of pairs of a pixel of the lamp and one around it whose contrast is within half of the target one."""
    rng = np.random.default_rng(seed)
    lamp, around = (
        merged(method, [counted_dn(light(capture), capture, rng) for capture in captures], captures)
        for light in (
            lambda capture: lamp_cd_m2(*capture[:2], phase),
            lambda capture: np.full(phase.shape, AROUND_CD_M2),
        )
    )
    zero = 5.0 * captures[0][0] * captures[0][3]
    bright, dark = (np.maximum(lamp, around), np.minimum(lamp, around))
    weber = np.divide(bright - zero, dark - zero, out=np.full(phase.shape, np.inf), where=dark > zero) - 1
    return float(np.mean((weber >= contrast / 2) & (weber <= contrast * 1.5)))


@pytest.mark.parametrize(
    ("method", "captures", "chain"),
    [
        ("most-sensitive", CAPTURES, lamp_chain("most-sensitive", SPLIT)),
        ("linear", CAPTURES[::2], lamp_chain("linear", SENSOR | {"captures": SPLIT["captures"][::2]})),
        # Exposures follow one another as they are stated: the long one begins last.
        ("linear", ((0.004, 0.0005, 1.0, 0.1, 30_000), (0.0005, 0.0, 1.0, 0.1, 30_000)),
         lamp_chain("linear", exposure_s=[0.0005, 0.004])),
    ],
)  # fmt: skip
def test_all_phases_are_those_of_poisson_counts(method, captures, chain):
    n = 100_000
    phase = np.random.default_rng(1).uniform(size=n)
    for contrast in (1.0, 2.0):
        counted = brute_force(method, captures, phase, contrast, seed=2)
        exact = float(chain.sweep(exact=True, contrast=contrast, scene__duty=[DUTY])["cdp"][0])
        assert 0.02 < counted < 0.98
        # The phases that stand for all err by less than 1e-3.
        assert abs(exact - counted) < 3.5 * np.sqrt(counted * (1 - counted) / n) + 1e-3


def test_phases_are_those_of_poisson_counts_and_of_the_simulation():
    chain, phases = lamp_chain("most-sensitive", SPLIT), [0.05, 0.1, 0.195, 0.6, 0.85]
    exact = chain.sweep(exact=True, contrast=1.5, scene__phase=phases)["cdp"].values
    simulated = chain.sweep(contrast=1.5, scene__phase=phases)
    error = simulated["standard_error"].values
    assert np.abs(simulated["cdp"].values - exact).max() < 4 * error.max() + 1e-3
    n = 50_000
    for phase, expected in zip(phases, exact, strict=True):
        counted = brute_force("most-sensitive", CAPTURES, np.full(n, phase), 1.5, seed=3)
        assert abs(expected - counted) < 3.5 * np.sqrt(max(counted * (1 - counted), 1 / n) / n) + 2e-4


def test_each_capture_sees_the_lamp_at_its_own_time():
    chain = lamp_chain("most-sensitive", SPLIT, phase=0.15)
    run = chain.run(4)
    for name, capture in zip(("long", "small", "late"), CAPTURES, strict=True):
        seen = run[f"sensor {name}"].luminance_cd_m2[10:26, 16:32].mean()
        expected = float(lamp_cd_m2(*capture[:2], np.array([0.15]))[0])
        # Light of 256 pixels, and rounding.
        assert seen == pytest.approx(expected, rel=0.05, abs=20)
        alone = chain.sweep(exact=True, contrast=1.0, stage=f"sensor {name}", scene__phase=[0.15])
        simulated = chain.sweep(contrast=1.0, stage=f"sensor {name}", scene__phase=[0.15])
        z = (simulated["cdp"] - alone["cdp"]) / np.maximum(simulated["standard_error"], 2e-3)
        assert abs(float(z[0])) < 3.5


def test_a_colour_filter_in_front_of_a_pulsed_lamp():
    planes = [{"name": name, "quantum_efficiency": value} for name, value in (("R", 0.1), ("C", 0.6))]
    sensor = SENSOR | {"colour_filter": "RCCC", "planes": planes}
    for chain in (lamp_chain(None, sensor), lamp_chain("linear", sensor, exposure_s=[0.004, 0.0005])):
        phases = [0.1, 0.15]
        exact = chain.sweep(exact=True, contrast=1.0, scene__phase=phases)["cdp"].values
        simulated = chain.sweep(contrast=1.0, scene__phase=phases)
        z = (simulated["cdp"].values - exact) / np.maximum(simulated["standard_error"].values, 2e-3)
        assert np.abs(z).max() < 3.5


def test_light_is_linear_between_phases():
    lamp, captures = PulsedLamp(FREQUENCY_HZ, DUTY, OFF), [CaptureTime(0.004), CaptureTime(0.0005, 0.0111)]
    phases = lamp.phase_nodes(captures, 48)
    assert (phases[-1] - phases[0], np.diff(phases).min() > 0) == (pytest.approx(1.0, abs=1e-12), True)
    for exposure_s, start_s in captures:
        ends, middles = (
            lamp.collected(exposure_s, at + start_s * FREQUENCY_HZ) for at in (phases, (phases[1:] + phases[:-1]) / 2)
        )
        assert middles == pytest.approx((ends[1:] + ends[:-1]) / 2, abs=1e-12)
    # The light of a lamp that is always on does not change.
    assert PulsedLamp(FREQUENCY_HZ, 1.0).phase_nodes(captures, 48).size < 10


def test_flicker_of_merged_captures():
    # Where no capture saturates, the merged light is the mean of that of the captures, in closed form.
    sensor = SENSOR | {"captures": SPLIT["captures"][::2]}
    chain = lamp_chain("linear", sensor, luminance_cd_m2=100.0, background_cd_m2=50.0)
    seen = chain.flicker(scene__duty=[0.2, 0.5])
    for number, duty in enumerate((0.2, 0.5)):
        noise_rel = float(seen["noise_rel"][number])
        expected = PulsedLamp(FREQUENCY_HZ, duty, OFF).flicker(
            [0.004, 0.0005], start_s=[0.0, 0.0111], noise_rel=noise_rel
        )
        for name in ("fmi", "mmp", "fdi"):
            assert float(seen[name][number]) == pytest.approx(getattr(expected, name), abs=2e-3)
        # Of pixels: noise of 400 pixels around the phases' means, by the simulation of one phase.
        steady = chain.with_(scene__phase=0.1).run(1)["hdr"].values[8:28, 14:34]
        assert 0.3 < noise_rel / (steady.std() / 20 / steady.mean()) < 3
    # Readouts of one charge see one light, also behind a rolling shutter.
    gains = SENSOR | {"full_well_e": 60_000, "captures": [{"name": "high"}, {"name": "low", "k_dn_per_e": 0.03}]}
    rolling = lamp_chain("most-sensitive", gains, luminance_cd_m2=100.0, background_cd_m2=50.0)
    rows = PulsedLamp(FREQUENCY_HZ, DUTY, OFF).flicker(0.004, n_rows=20, row_time_s=2e-4)
    assert float(rolling.flicker(row_time_s=2e-4)["fmi"]) == pytest.approx(rows.fmi)
    # Where the long capture saturates, as the mean signal of frames over the phase.
    chain = lamp_chain("most-sensitive", SPLIT, luminance_cd_m2=3000.0)
    phases = [(number + 0.5) / 40 for number in range(40)]
    frames = [chain.with_(scene__phase=phase).run(1)["hdr"] for phase in phases]
    means = np.array([frame.luminance_cd_m2[8:28, 14:34].mean() for frame in frames])
    measured, predicted = (means.max() - means.min()) / (means.max() + means.min()), float(chain.flicker()["fmi"])
    assert predicted == pytest.approx(measured, abs=0.02)


@pytest.mark.parametrize("scene", [{"width": 20, "height": 20}, {"background_cd_m2": LAMP_CD_M2}])
def test_a_lamp_without_surroundings_that_differ_has_no_contrast(scene):
    chain = lamp_chain("most-sensitive", SPLIT, **scene)
    for exact in (True, False):
        with pytest.raises(InputError, match="the scene has no two regions"):
            chain.sweep(exact=exact, contrast=1.0, scene__phase=[0.1])


def test_exposures_follow_one_another():
    chain = lamp_chain("linear", exposure_s=[0.0005, 0.004])
    ((_, sensor),) = chain.sensors
    assert chain.capture_times(sensor) == ((0.0005, 0.0), (0.004, 0.0005))
    with pytest.raises(InputError, match="give one time"):
        lamp_chain("linear", SPLIT, exposure_s=[0.0005, 0.004])
