import re
import signal
import subprocess
from dataclasses import replace
from itertools import combinations, pairwise, product

import numpy as np
import pytest

from labcdp.calibration.frames.measure import split
from labcdp.chain import Chain
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera_settings import FREE_RUN, SOFTWARE_TRIGGER
from labcdp.drivers.minolta.ls import MinoltaLS110
from labcdp.drivers.simulated.bench import SimulatedBench, SimulatedDevices
from labcdp.drivers.simulated.devices import SimulatedBenchFile
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera
from labcdp.drivers.simulated.noise_kernel import QUANTILES, draw_exposure
from labcdp.session import SessionConfiguration, example_configuration

from ..conftest import SMALL, Ramp

SHAPE = (400, 480)


@pytest.fixture
def bench(small_configuration):
    return SimulatedBench(small_configuration, SimulatedDevices.standard(seed=3), SHAPE)


@pytest.mark.parametrize(("exposure_s", "gain_db"), [(0.002, 0.0), (0.001, 6.0)])
def test_camera_and_meter_agree_on_the_target_on_the_wire_and_in_this_process(
    aravis, bench, small_configuration, exposure_s, gain_db
):
    """What the chain says a patch of that luminance gives is what arrives over GigE Vision, within noise."""
    specimen = Chain.load("manta-g505").camera()
    chain = replace(specimen, sensor=replace(specimen.sensor, width=480, height=400))
    vignetting = Cos4Vignetting(6e-3, 3.45e-6).relative_illuminance(SHAPE)
    again = SimulatedBench(small_configuration, SimulatedDevices.standard(seed=3), SHAPE)
    with bench.gige_camera(), AravisCamera("127.0.0.1") as wire, again.in_process_camera() as local:
        for camera in (wire, local):
            camera.configure(exposure_s=exposure_s, gain_db=gain_db)
        frame, same = wire.snap(), local.snap()
    np.testing.assert_array_equal(frame.dn, same.dn)
    assert frame.camera == same.camera
    with bench.pty_meter(0) as pty, MinoltaLS110(pty.port) as meter:
        for patch in small_configuration.target.patches:
            bench.point_meter(patch.name)
            true_cd_m2 = bench.luminance_cd_m2[patch.name]
            # 0.6 % scale, four times 0.1 % repeatability, and half a unit of the last of four digits.
            digit = 10.0 ** max(-2, np.floor(np.log10(true_cd_m2)) - 3)
            near = pytest.approx(1.006 * true_cd_m2, rel=0.004, abs=0.5 * digit + 1e-9)
            assert meter.measure().luminance_cd_m2 == near
            region = patch.region()
            gained_s = 10 ** (gain_db / 20) * exposure_s
            light = chain.responsivity_dn_s_cd_m2() * gained_s * true_cd_m2 * region.select(vignetting).mean()
            values = region.select(frame.dn).astype(float)
            # Noise of the mean, and 1 % PRNU and 2 e- DSNU averaged over the pixels.
            tolerance = 4 * (values.std() + 0.02) / np.sqrt(values.size)
            dark_dn = chain.dark_dn(exposure_s, temperature_c=35)
            assert values.mean() == pytest.approx(dark_dn + light, abs=tolerance)


@pytest.mark.parametrize(("n", "trigger"), [(8, SOFTWARE_TRIGGER), pytest.param(300, FREE_RUN, marks=pytest.mark.long)])
def test_no_frame_of_full_size_is_lost(aravis, n, trigger):
    """2452 x 2056, Mono12, triggered once the one before has come, or at 15 frames/s.

    A computer that is busy otherwise may lose packets; what counts is that it says which frames it took again.
    """
    configuration, sent = SessionConfiguration.from_toml(example_configuration(), "example"), []
    with SimulatedBench(configuration, SimulatedDevices.standard()).gige_camera(), AravisCamera("127.0.0.1") as camera:
        camera.configure(exposure_s=0.002, pixel_format="Mono12", trigger=trigger)
        for frame in camera.grab(n, on_refused=lambda error: sent.append(error.frame_id)):
            sent.append(frame.frame_id)
            assert frame.shape == (2056, 2452)
    # GigE Vision frame ids are 16 bit and leave out 0.
    assert all(after == before % 0xFFFF + 1 for before, after in pairwise(sent))
    assert n <= len(sent) <= n + n // 4


@pytest.mark.parametrize("pattern", ["RG", pytest.param("GB", marks=pytest.mark.long)])
def test_a_colour_camera_sends_the_target_behind_its_filters(aravis, small_configuration, pattern):
    """In each format the planes see the light that a colour lets through, more red in that of an incandescent lamp."""
    region, in_light_of = small_configuration.target.patches[10].region().divided(2), {}
    devices = SimulatedBenchFile(seed=3, camera={"colour_filter": pattern}).devices()
    for spectrum in ("D65", "A"):
        source, means = small_configuration.source.model_copy(update={"spectrum": spectrum}), {}
        bench = SimulatedBench(small_configuration.model_copy(update={"source": source}), devices, SHAPE)
        with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
            for suffix, scale in (("12", 1), ("12Packed", 1), ("16", 16), ("8", 1 / 16)):
                camera.configure(exposure_s=0.004, pixel_format=f"Bayer{pattern}{suffix}")
                frame = camera.snap()
                assert (frame.camera.model, frame.colour_filter) == ("Manta_G-505C", pattern)
                means[suffix] = [region.select(plane.dn).mean() / scale for plane in split(frame).values()]
        # Noise of 900 pixels, and of 8 bits what is cut off.
        for other in ("12Packed", "16", "8"):
            np.testing.assert_allclose(means[other], means["12"], rtol=0.005, atol=2 + 16 * (other == "8"))
        in_light_of[spectrum] = np.array(means["12"]) - 64
    balance = {spectrum: values / values[1] for spectrum, values in in_light_of.items()}
    red, _, other_green, blue = balance["A"] / balance["D65"]
    assert red > 1.3
    assert blue < 0.8
    assert other_green == pytest.approx(1, rel=0.03)


# The camera as Aravis' own programs see it


def test_what_is_compiled_for_the_first_frame_is_there_before_the_camera_answers(aravis):
    source, answered = Ramp(), []
    source.expose = lambda *how: answered.append(gvcp.announce("127.0.0.1") is not None) or Ramp.expose(source, *how)
    with SimulatedGigECamera(SMALL, source), AravisCamera("127.0.0.1") as camera:
        camera.snap()
    assert answered[:2] == [False, True]


def arv_tool(*words):
    done = subprocess.run(["arv-tool-0.8", *words], check=True, capture_output=True, text=True, timeout=300)
    return done.stdout


def test_arv_tool_and_arv_camera_test_see_and_stream_it_at_its_full_size(aravis_tools):
    bench = SimulatedBench(SessionConfiguration.from_toml(example_configuration(), "x"), SimulatedDevices.standard())
    with bench.gige_camera():
        assert "Allied Vision Technologies-Manta_G-505B-SIM-503363706 (127.0.0.1)" in arv_tool()
        values = arv_tool("control", "DeviceTemperature", "ExposureTimeAbs=2000", "PixelFormat")
        for text in ("DeviceTemperature = 35 C", "= 2000 us min:21 max:6e+07", "PixelFormat = Mono12"):
            assert text in values
        command = ["stdbuf", "--output=L", "arv-camera-test-0.8"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as streaming:
            streamed, seen = "", 0
            while seen < 4:
                line = streaming.stdout.readline()
                assert line, streamed
                streamed += line
                seen += sum(map(int, re.findall(r"^ *(\d+) frames?/s", line)))
            streaming.send_signal(signal.SIGINT)
            streamed += streaming.stdout.read()
    assert "image width            = 2452" in streamed
    assert int(re.search(r"n_completed_buffers *= (\d+)", streamed)[1]) >= 4


# Noise of frames: against the sensor's own model, from frame to frame, and after an interruption


N = 200_000


@pytest.mark.parametrize(
    ("mean_e", "read_noise_e"), [*product([0.0, 0.3, 3.9, 4.1, 20.0, 900.0, 6950.0, 8000.0], [0.0, 10.0])]
)
def test_distribution_is_that_of_poisson_full_well_and_read_noise(mean_e, read_noise_e):
    """Mean, variance and third moment of the counted electrons, which NumPy draws one by one."""
    rng = np.random.default_rng(1)
    theirs = np.minimum(rng.poisson(mean_e, N), 7000) + rng.normal(0, read_noise_e, N)
    flat = np.full((400, N // 400), mean_e, np.float32)
    # Gain 4 keeps steps of single electrons visible.
    dn = draw_exposure(flat, np.zeros_like(flat), (7000.0, 65535.0), read_noise_e, 4.0, 1000.0, 99, QUANTILES)
    ours = (dn.ravel().astype(float) - 1000) / 4
    assert ours.mean() == pytest.approx(theirs.mean(), abs=4 * np.sqrt((mean_e + read_noise_e**2) * 2 / N) + 1e-9)
    # The approximation above 4 electrons is 0.5 % low in variance where no read noise covers it.
    assert ours.var() == pytest.approx(theirs.var(), rel=0.005 + 4 * np.sqrt(4 / N), abs=0.01)
    third = [((values - values.mean()) ** 3).mean() for values in (ours, theirs)]
    assert third[0] == pytest.approx(third[1], abs=5 * np.sqrt(30 / N) * (mean_e + read_noise_e**2) ** 1.5 + 0.02)


def test_pixels_of_one_frame_do_not_depend_on_each_other():
    flat = np.full((512, 512), 1000, np.float32)
    dn = draw_exposure(flat, np.zeros_like(flat), (1e6, 65535.0), 5.0, 1.0, 0.0, 7, QUANTILES).astype(float)
    spectrum = np.abs(np.fft.rfft2((dn - dn.mean()) / dn.std())) ** 2 / dn.size
    power = np.sort(spectrum[1:-1, 1:-1].ravel())
    # White noise: powers are exponential with mean 1; the largest of n is about log(n).
    assert power.mean() == pytest.approx(1, abs=5 / np.sqrt(power.size))
    assert power[-1] < np.log(power.size) + 8


def test_a_series_that_is_continued_on_another_bench_has_the_noise_that_it_would_have_had(small_configuration):
    brightest = max(small_configuration.target.patches, key=lambda patch: patch.nominal_luminance_cd_m2).name

    def taken(series, first, n, n_before=0):
        bench = SimulatedBench(small_configuration, SimulatedDevices.standard(), SHAPE)
        with bench.in_process_camera() as camera, bench.in_process_meter(0) as meter:
            bench.point_meter(brightest)
            camera.configure(exposure_s=0.001)
            # Whatever was taken before.
            _, _ = camera.snap(), meter.measure()
            bench.announce_frames(series, first, n_before)
            frames = [frame.dn for frame in camera.grab(n_before + n)]
            readings = []
            for number in range(first, first + n):
                bench.announce_reading(series, number)
                readings.append(meter.measure().value)
        return np.array(frames), readings

    whole, rest, other = taken("a", 0, 5), taken("a", 2, 3, n_before=2), taken("b", 0, 5)
    np.testing.assert_array_equal(rest[0][2:], whole[0][2:])
    assert rest[1] == whole[1][2:]
    assert len(set(whole[1])) > 1
    seen = np.concatenate([whole[0], rest[0][:2], other[0]])
    for one, another in combinations(seen, 2):
        assert (one != another).mean() > 0.2
