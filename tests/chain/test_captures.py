"""Sensors with several captures, against brute force in plain NumPy that shares no code with the chain."""

from dataclasses import replace

import numpy as np
import pytest

import labcdp
from labcdp import Chain
from labcdp.chain import CameraModel, CaptureSettings, ExposureSettings, Hdr, Photodiode, PiecewiseLinear, Sensor
from labcdp.chain.hdr import CaptureLadder, Method
from labcdp.chain.predict.chain import known_transitions
from labcdp.chain.predict.prediction import PatchRates, predict
from labcdp.core.errors import InputError
from labcdp.evaluate.compare.requirement import _changed

PIXELS = 20_000
SENSOR = Sensor(
    pixel_pitch_m=2.8e-6,
    width=64,
    height=48,
    quantum_efficiency=0.5,
    full_well_e=22000.0,
    k_dn_per_e=0.7,
    read_noise_e=0.83,
    dark_current_e_s=25.6,
    bits=12,
    black_level_dn=64.0,
    prnu_rel=0.01,
    dsnu_e=0.5,
)
LOW = CaptureSettings("low gain", k_dn_per_e=0.175, read_noise_e=3.05)
SMALL = Photodiode("small", light_share=0.01, full_well_e=7900.0, dark_current_e_s=4.2)
SENSORS = {
    "dual gain": replace(SENSOR, captures=(CaptureSettings("high gain"), LOW)),
    "overflow": replace(
        SENSOR, captures=(CaptureSettings("high gain"), replace(LOW, full_well_e=120_000.0, k_dn_per_e=0.033))
    ),
    "split pixel": replace(
        SENSOR,
        photodiodes=(SMALL,),
        captures=(CaptureSettings("high gain"), LOW, CaptureSettings("small", "small", k_dn_per_e=0.5)),
    ),
    "three times": replace(
        SENSOR,
        k_dn_per_e=0.18,
        captures=(
            CaptureSettings("long"),
            CaptureSettings("middle", exposure_s=0.7e-3),
            CaptureSettings("short", exposure_s=40e-6),
        ),
    ),
}
TIME_S = 11e-3
#: K, read noise, full well, light, time, dark current, charge, photodiode and readout, as they follow from the above.
FACTS = {
    "dual gain": [(0.7, 0.83, 22000, 1, TIME_S, 25.6, 0, 0, 0), (0.175, 3.05, 22000, 1, TIME_S, 25.6, 0, 0, 1)],
    "overflow": [(0.7, 0.83, 22000, 1, TIME_S, 25.6, 0, 0, 0), (0.033, 3.05, 120000, 1, TIME_S, 25.6, 0, 0, 1)],
    "split pixel": [
        (0.7, 0.83, 22000, 1, TIME_S, 25.6, 0, 0, 0),
        (0.175, 3.05, 22000, 1, TIME_S, 25.6, 0, 0, 1),
        (0.5, 0.83, 7900, 0.01, TIME_S, 4.2, 1, 1, 2),
    ],
    "three times": [
        (0.18, 0.83, 22000, 1, TIME_S, 25.6, 0, 0, 0),
        (0.18, 0.83, 22000, 1, 0.7e-3, 25.6, 1, 0, 0),
        (0.18, 0.83, 22000, 1, 40e-6, 25.6, 2, 0, 0),
    ],
}


def brute_force(name: str, method: Method, rate: float, rng: np.random.Generator) -> np.ndarray:
    """Merged values of pixels at a rate of the sensor's own photodiode, drawn one quantity after the other."""
    facts = FACTS[name]
    black, offset_e, prnu = 64.0, 0.5, 0.01
    gains = [1 + prnu * rng.standard_normal(PIXELS) for _ in range(2)]
    offsets = [offset_e * rng.standard_normal(PIXELS) for _ in range(3)]
    charges: dict[int, np.ndarray] = {}
    scale = [k * light * time for k, _, _, light, time, *_ in facts]
    dn, ends = [], []
    for k, read, well, light, time, dark, charge, diode, readout in facts:
        if charge not in charges:
            charges[charge] = rng.poisson(np.minimum(rate * light * gains[diode] + dark, 4e6 / time) * time)
        held = np.minimum(charges[charge], well)
        value = k * (held + offsets[readout] + read * rng.standard_normal(PIXELS)) + black
        # What the dark signal has too much for the scale of the first capture is known to a sensor's dark pixels.
        zero = black + k * dark * time - facts[0][0] * facts[0][5] * facts[0][4] * scale[len(dn)] / scale[0]
        dn.append(np.clip(np.round(value), 0, 4095) - zero)
        ends.append(min(4095.0, black + k * (well - 6 * np.hypot(read, offset_e))) - zero)
    ratios = [scale[0] / own for own in scale]
    merged = dn[-1] * ratios[-1]
    if method == "most-sensitive":
        for i in reversed(range(len(dn) - 1)):
            share = np.clip((ends[i] - dn[i]) / (0.1 * ends[i]), 0, 1)
            merged = share * dn[i] * ratios[i] + (1 - share) * merged
    elif method == "linear":
        usable, total, count = np.ones(PIXELS), np.zeros(PIXELS), np.zeros(PIXELS)
        for i in reversed(range(len(dn))):
            usable = usable * (dn[i] < ends[i])
            total, count = total + usable * dn[i] * ratios[i], count + usable
        merged = np.where(count > 0, total / np.maximum(count, 1), ends[-1] * ratios[-1])
    elif method == "normal":
        merged = np.floor(np.minimum(dn[-1] * ratios[-1], 2**24 - 1) + 1e-9)
        for i in reversed(range(len(dn) - 1)):
            taken = (dn[i] * ratios[i] <= 2 ** (24 / len(dn) * (i + 1))) & (dn[i] < ends[i])
            merged = np.where(taken, np.floor(dn[i] * ratios[i] + 1e-9), merged)
    return merged


def simulated_cdp(dark: np.ndarray, bright: np.ndarray, zero: float, contrast: float) -> tuple[float, float]:
    """CDP over all pairs, counted by sorting, and its standard error from pixels of either patch."""
    dark, bright = dark - zero, np.sort(bright - zero)
    low, high = 1 + 0.5 * contrast, 1 + 1.5 * contrast
    seen = np.searchsorted(bright, high * dark, "right") - np.searchsorted(bright, low * dark, "left")
    of_dark = np.where(dark > 0, seen, 0) / bright.size
    ordered = np.sort(dark[dark > 0])
    of_bright = (
        np.searchsorted(ordered, bright / low, "right") - np.searchsorted(ordered, bright / high, "left")
    ) / dark.size
    return of_dark.mean(), np.sqrt(of_dark.var() / dark.size + of_bright.var() / bright.size)


@pytest.mark.parametrize(
    ("name", "method"),
    [(name, "most-sensitive") for name in SENSORS]
    + [("split pixel", "linear"), ("split pixel", "normal"), ("split pixel", "weighted"), ("dual gain", "weighted")],
)
@pytest.mark.parametrize("n", [15, pytest.param(50, marks=pytest.mark.long)])
def test_prediction_is_that_of_brute_force(name: str, method: Method, n: int):
    """Luminances over 120 dB with 20,000 pixels in each patch: CDP within 3.5 sigma, SNR within 5 sigma."""
    rates = np.geomspace(500.0, 5e8, n)
    contrast = 0.1
    camera = CameraModel(SENSORS[name], ExposureSettings(TIME_S), Hdr(method, bits=24))
    predicted = predict(camera, PatchRates(rates, rates * (1 + contrast)), contrast)
    rng = np.random.default_rng(5)
    if method == "weighted":
        # The weights are the chain's own; their rule is tested in test_hdr. Here, the fixed joint draws are.
        merge = camera.hdr.merge

        def values(rate):
            return _merged_captures(camera, merge, rate, rng)
    else:

        def values(rate):
            return brute_force(name, method, rate, rng)

    scores, ratios = [], []
    for index, rate in enumerate(rates):
        dark, bright = values(rate), values(rate * (1 + contrast))
        cdp, error = simulated_cdp(dark, bright, camera.dark_dn, contrast)
        scores.append((predicted.cdp[index] - cdp) / max(error, 2 / PIXELS))
        snr = (dark.mean() - camera.dark_dn) / max(dark.std(), 1e-12)
        # Pixels that are all full have no noise.
        if dark.std() > 0 and snr < 1e5 and predicted.snr_dark[index] < 1e5:
            ratios.append(predicted.snr_dark[index] / snr - 1)
    assert np.abs(scores).max() < 3.5
    # A few photons in 20,000 pixels: the mean has an error, too.
    assert np.abs(ratios[n // 5 :]).max() < 5 / np.sqrt(PIXELS)
    assert len(ratios) > n / 2


def _merged_captures(camera, merge, rate, rng):
    """Merge captures that are drawn as in `brute_force`, by `Hdr.merge`."""
    charges, gains, captures = {}, 1 + 0.01 * rng.standard_normal((2, PIXELS)), []
    offsets = 0.5 * rng.standard_normal((3, PIXELS))
    for model in camera.captures:
        sensor = model.sensor
        light_e_s = np.minimum(rate * model.light_share * gains[model.photodiode], 4e6 / model.exposure_s)
        mean_e = light_e_s * model.exposure_s + model.dark_e
        electrons = charges.setdefault(model.charge, rng.poisson(mean_e))
        signal_e = np.minimum(electrons, sensor.full_well_e) + sensor.read_noise_e * rng.standard_normal(PIXELS)
        dn = np.clip(np.rint(sensor.k_dn_per_e * (signal_e + offsets[model.readout]) + 64.0), 0, 4095)
        captures.append(model.described(dn[None], "D65"))
    return merge(captures).dn[0]


def test_exposures_of_the_settings_are_captures_too():
    times, rates = (TIME_S, 0.7e-3, 40e-6), np.geomspace(1e4, 3e8, 20)
    plain = replace(SENSORS["three times"], captures=())
    one, other = (
        predict(CameraModel(sensor, ExposureSettings(s), Hdr("most-sensitive")), PatchRates(rates, 1.1 * rates), 0.1)
        for sensor, s in ((plain, times), (SENSORS["three times"], TIME_S))
    )
    assert np.array_equal(one.cdp, other.cdp)


@pytest.mark.parametrize("name", SENSORS)
def test_where_one_capture_counts_the_prediction_is_that_of_a_single_exposure(name):
    camera = CameraModel(SENSORS[name], ExposureSettings(TIME_S), Hdr("most-sensitive"))
    ladder = camera.ladder
    for number, capture in enumerate(camera.captures):
        previous = 0.0 if number == 0 else ladder.saturations_dn[number - 1] * ladder.ratios[number - 1]
        own = ladder.saturations_dn[number] * ladder.ratios[number]
        rate = np.array([max(1.4 * previous, 0.1 * own)]) / camera.dn_per_e_s
        assert rate[0] * 1.1 < 0.75 * own / camera.dn_per_e_s, "no light at which it is alone"
        merged = predict(camera, PatchRates(rate, 1.1 * rate), 0.1)
        alone = CameraModel(capture.sensor, capture.settings)
        share = capture.light_share
        single = predict(alone, PatchRates(share * rate, share * 1.1 * rate), 0.1)
        assert merged.cdp == pytest.approx(single.cdp, abs=2e-6)
        assert merged.snr_dark == pytest.approx(single.snr_dark, rel=1e-6)


def test_captures_of_one_charge_share_their_electrons():
    """Without other noise, high and low gain of one charge are the same count, those of two charges are not."""
    quiet = replace(SENSOR, read_noise_e=0.0, prnu_rel=0.0, dsnu_e=0.0, dark_current_e_s=0.0, k_dn_per_e=1.0)
    captures = [CaptureSettings("high gain"), CaptureSettings("low gain", k_dn_per_e=0.5)]
    later = CaptureSettings("later", k_dn_per_e=0.25, start_s=0.02)
    scene = {"type": "flat", "width": 64, "height": 48, "luminance_cd_m2": 5.0}
    chain = Chain.from_document(
        {
            "name": "shared",
            "scene": scene,
            "optics": {"f_number": 2.0, "transmittance": 0.9},
            "exposure": {"exposure_s": 0.01},
            "sensor": {"type": "emva1288"} | _fields(quiet),
        }
    )
    chain = replace(chain, sensors=(("sensor", replace(quiet, captures=(*captures, later))),))
    run = chain.run(seed=1)
    high, low, other = (run[f"sensor {name}"].values - 64.0 for name in ("high gain", "low gain", "later"))
    assert np.abs(low - high / 2).max() <= 0.5
    correlation = np.corrcoef(high.ravel(), other.ravel())[0, 1]
    assert abs(correlation) < 4 / np.sqrt(high.size)


def _fields(sensor):
    names = ("pixel_pitch_m", "quantum_efficiency", "full_well_e", "k_dn_per_e", "read_noise_e", "dark_current_e_s")
    return {name: getattr(sensor, name) for name in (*names, "bits", "black_level_dn")}


def test_snr_falls_at_a_hand_over_to_less_light_only():
    """Two gains share the photons: SNR loses the read noise only. A photodiode of 1 % of the light has few photons."""
    camera = CameraModel(SENSORS["split pixel"], ExposureSettings(TIME_S), Hdr("most-sensitive"))
    ladder = camera.ladder
    ends = [end * ratio for end, ratio in zip(ladder.saturations_dn, ladder.ratios, strict=True)]
    rates = np.array([[0.8 * end, 1.3 * end] for end in ends[:2]]).ravel() / camera.dn_per_e_s
    snr = predict(camera, PatchRates(rates, 1.1 * rates), 0.1).snr_dark
    assert snr[1] > snr[0]
    # Shot noise of N and of N / 100 electrons with 1 % PRNU, by hand.
    before, after = rates[2] * TIME_S, rates[3] * TIME_S / 100
    for electrons, read_e, k, value in ((before, 3.05, 0.175, snr[2]), (after, 0.83, 0.5, snr[3])):
        dark_e = (25.6 if value == snr[2] else 4.2) * TIME_S
        rest = 0.25 + 1 / 12 / k**2
        by_hand = electrons / np.sqrt(electrons + dark_e + read_e**2 + rest + (0.01 * electrons) ** 2)
        assert value == pytest.approx(by_hand, rel=1e-3)
    assert snr[3] < 0.3 * snr[2]


def test_a_chain_file_holds_captures_and_simulates_what_is_predicted(tmp_path):
    chain = Chain.load(_split_file(tmp_path))
    assert chain.stage_names[2:] == ("sensor high gain", "sensor low gain", "sensor small", "hdr", "isp")
    chain.save(tmp_path / "again.toml")
    assert Chain.load(tmp_path / "again.toml") == chain
    luminances = np.geomspace(1, 1e4, 12)
    exact, simulated = (chain.sweep(scene__luminance_cd_m2=luminances, **way) for way in ({"exact": True}, {"seed": 3}))
    error = np.maximum(simulated["standard_error"].values, 1e-3)
    assert np.abs((exact["cdp"].values - simulated["cdp"].values) / error).max() < 3.5
    assert len(known_transitions(chain)) == 2
    capture = chain.sweep(exact=True, stage="sensor small", scene__luminance_cd_m2=[5000.0])
    assert capture["cdp"].values[0] > 0.5


def _split_file(folder):
    path = folder / "split.toml"
    path.write_text(
        """
[scene]
type = "checkerboard"
width = 96
height = 96
square_px = 16
luminance_cd_m2 = 10.0
contrast = 0.3
[optics]
f_number = 1.8
transmittance = 0.9
[exposure]
exposure_s = 0.011
[sensor]
type = "emva1288"
pixel_pitch_m = 2.8e-6
quantum_efficiency = 0.5
full_well_e = 22000
k_dn_per_e = 0.7
read_noise_e = 0.83
dark_current_e_s = 25.6
bits = 12
black_level_dn = 64
[[sensor.photodiodes]]
name = "small"
light_share = 0.01
full_well_e = 7900
[[sensor.captures]]
name = "high gain"
[[sensor.captures]]
name = "low gain"
k_dn_per_e = 0.175
read_noise_e = 3.05
[[sensor.captures]]
name = "small"
photodiode = "small"
k_dn_per_e = 0.5
[hdr]
method = "most-sensitive"
[isp]
type = "pwl"
codes = [0, 1024, 2048, 4000]
values = [-100, 1024, 65536, 4000000]
bits = 12
"""
    )
    return path


def test_a_companded_merge_is_that_of_brute_force():
    curve = PiecewiseLinear(codes=(0, 1024, 2048, 4000), values=(-100, 1024, 65536, 4_000_000))
    camera = CameraModel(SENSORS["split pixel"], ExposureSettings(TIME_S), Hdr("most-sensitive"), curve)
    rates, rng = np.geomspace(1e4, 2e8, 10), np.random.default_rng(2)
    predicted = predict(camera, PatchRates(rates, 1.2 * rates), 0.2)
    knees = (0, 1024, 2048, 4000), (-100, 1024, 65536, 4_000_000)
    for index, rate in enumerate(rates):
        patches = []
        for at in (rate, 1.2 * rate):
            codes = np.rint(np.interp(brute_force("split pixel", "most-sensitive", at, rng), knees[1], knees[0]))
            patches.append(np.interp(codes, *knees))
        cdp, error = simulated_cdp(*patches, camera.dark_dn, 0.2)
        assert abs(predicted.cdp[index] - cdp) < 3.5 * max(error, 2 / PIXELS)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"captures": (CaptureSettings("a"), CaptureSettings("a", k_dn_per_e=0.1))}, "captures has 'a' twice"),
        ({"captures": (CaptureSettings("a", "small"),)}, "capture 'a' has the photodiode 'small': give none"),
        ({"captures": ("a",)}, r"captures is \('a',\): give a list"),
        ({"photodiodes": (SMALL, SMALL)}, "photodiodes has 'small' twice"),
        ({"captures": (CaptureSettings("a", bits=4),)}, "capture 'a': black_level_dn is 64"),
    ],
)
def test_captures_that_do_not_fit_are_refused(changes, message):
    with pytest.raises(InputError, match=message):
        replace(SENSOR, **changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: CaptureSettings(""), "name is ''"),
        (lambda: CaptureSettings("a", k_dn_per_e=0.0), "k_dn_per_e is 0.0"),
        (lambda: Photodiode("a", light_share=1.5), "light_share is 1.5"),
        (lambda: Photodiode("a", full_well_e=1.0), "full_well_e is 1.0"),
        (lambda: Hdr("most-sensitive", overlap=2.0), "overlap is 2.0"),
        (lambda: CaptureLadder((2.0, 1.0), (100.0, 40.0), (1, 1), (1, 1), (0, 0)), "number 2 saturates at less light"),
        (
            lambda: SENSORS["dual gain"].capture_models(ExposureSettings((0.01, 0.02)), "D65"),
            "exposure_s has 2 times and the sensor captures of its own",
        ),
    ],
)
def test_values_out_of_range_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


#: Luminance of the dark squares, and capture by which it is seen, with its K, read noise, share of the light and dark
#: current, as published (IISW 2019, R32, table 1); 0.183 DN/e- are 49 uV/e-, 0.748 are 200 uV/e-.
BY_HAND = [(L, 0.748, 0.83, 1.0, 25.6) for L in (0.02, 0.2, 2.0, 10.0, 25.0)]
BY_HAND += [(L, 0.183, 3.05, 1.0, 25.6) for L in (60.0, 100.0)] + [
    (L, 0.510, 0.83, 0.01, 4.2) for L in (400.0, 1000.0, 3000.0)
]


def test_snr_of_the_published_split_pixel_by_hand():
    """Photons of D65 of ISETCam, lens by pi / (4 N^2), N / sqrt(all variances) of the capture that counts."""
    chain = Chain.load("split-pixel").with_(scene__width=24, scene__height=24, scene__square_px=4)
    flat = chain.with_(sensor__quantum_efficiency=[[400, 0.6], [700, 0.6]])
    snr = flat.sweep(scene__luminance_cd_m2=[row[0] for row in BY_HAND], exact=True)["snr_dark"].values
    # Its integral from 400 to 700 nm by trapezoids of 10 nm, which differs by 0.3 % from that by 1 nm.
    photons = 1.0852e16
    per_cd_m2 = photons * np.pi * 0.9 / (4 * 1.8**2) * (2.8e-6) ** 2 * 0.6 * 11e-3
    for value, (luminance, k, read_e, share, dark_e_s) in zip(snr, BY_HAND, strict=True):
        light_e, dark_e = luminance * per_cd_m2 * share, dark_e_s * 11e-3
        fixed = (0.01 * light_e) ** 2 + 0.3**2 + (dark_e / 4) ** 2
        by_hand = light_e / np.sqrt(light_e + dark_e + read_e**2 + 1 / 12 / k**2 + fixed)
        assert value == pytest.approx(by_hand, rel=4e-3)


def test_requirements_change_what_captures_state_too():
    document = Chain.load("split-pixel").document
    changes = _changed(document, ("sensor.read_noise_e", "sensor.dark_current_e_s"), 0.0)
    assert [part.get("read_noise_e") for part in changes["sensor.captures"]] == [None, 0.0, 0.0]
    assert [part["dark_current_e_s"] for part in changes["sensor.photodiodes"]] == [0.0]
    Chain.load("split-pixel").with_(**changes, sensor__dsnu_e_s=0.0)


def test_presets_with_captures_are_compared_with_their_dips():
    chains = [Chain.load(name).with_(scene__contrast=0.2) for name in ("split-pixel", "dual-gain", "lofic")]
    compared = labcdp.compare(*chains, contrast=0.2)
    rows = compared.to_dict()["tables"]["dips"]["rows"]
    dips = [row for row in rows if row["variable"] == "spatial SNR, dark region"]
    assert [row["name"] for row in dips] == ["split-pixel"]
    # Shot noise of 1 % of the light: 10 dB; PRNU, which is in proportion to the light, has the rest before.
    assert 10 < dips[0]["depth_db"] < 20
    assert dips[0]["expected"] == pytest.approx(known_transitions(chains[0])[1])
