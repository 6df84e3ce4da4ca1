import re
import signal
import subprocess
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from labcdp.calibration.frames.measure import split
from labcdp.chain import Chain
from labcdp.core.clock import SimulatedClock
from labcdp.core.vignetting import Cos4Vignetting
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.camera_settings import SOFTWARE_TRIGGER
from labcdp.drivers.minolta_ls.meter import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.devices import SimulatedBenchFile
from labcdp.session import SessionConfiguration, example_configuration

SHAPE = (400, 480)


@pytest.fixture
def bench(small_configuration):
    return SimulatedBench(small_configuration, BenchDevices.standard(seed=3), SHAPE)


def test_camera_and_meter_agree_on_the_target(aravis, bench, small_configuration):
    """What the chain says a patch of that luminance gives is what arrives over GigE Vision, within noise."""
    specimen = Chain.load("manta-g505").camera()
    conversion = replace(specimen, sensor=replace(specimen.sensor, width=480, height=400)).conversion(temperature_c=35)
    vignetting = Cos4Vignetting(6e-3, 3.45e-6).relative_illuminance(SHAPE)
    with (
        bench.gige_camera(),
        AravisCamera("127.0.0.1") as camera,
        bench.pty_meter(0) as pty,
        MinoltaLS110(pty.port) as meter,
    ):
        camera.configure(exposure_s=0.002)
        frame = camera.snap()
        for patch in small_configuration.target.patches:
            bench.point_meter(patch.name)
            true_cd_m2 = bench.luminance_cd_m2[patch.name]
            # 0.6 % scale, four times 0.1 % repeatability, and half a unit of the last of four digits.
            digit = 10.0 ** max(-2, np.floor(np.log10(true_cd_m2)) - 3)
            assert meter.measure().luminance_cd_m2 == pytest.approx(
                1.006 * true_cd_m2, rel=0.004, abs=0.5 * digit + 1e-9
            )
            region = patch.region()
            expected = conversion.dark_dn(0.002) + conversion.responsivity_dn_s_cd_m2 * 0.002 * true_cd_m2 * (
                region.select(vignetting).mean()
            )
            values = region.select(frame.dn).astype(float)
            # Noise of the mean, and 1 % PRNU and 2 e- DSNU averaged over the pixels.
            tolerance = 4 * (values.std() + 0.02) / np.sqrt(values.size)
            assert values.mean() == pytest.approx(expected, abs=tolerance)


def test_exposure_and_gain_are_those_of_the_registers(aravis, bench, small_configuration):
    region = next(p.region() for p in small_configuration.target.patches if p.name == "P11")

    def signal(camera, **settings):
        """Mean above the black level, and its variance."""
        camera.configure(**settings)
        values = region.select(camera.snap().dn).astype(float) - 64
        return values.mean(), values.var() / values.size

    with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        short = signal(camera, exposure_s=0.001, gain_db=0.0)
        long = signal(camera, exposure_s=0.004)
        gained = signal(camera, exposure_s=0.001, gain_db=20 * np.log10(2))
    # The register keeps tenths of a decibel: 6.0 dB are a factor of 1.995.
    for (mean, variance), factor in ((long, 4.0), (gained, 10 ** (6.0 / 20))):
        ratio = mean / short[0]
        sigma = ratio * np.sqrt(variance / mean**2 + short[1] / short[0] ** 2)
        # The dark current adds 0.03 DN at 4 ms.
        assert ratio == pytest.approx(factor, abs=5 * sigma + 0.001)


def test_the_camera_in_this_process_gives_the_pixels_of_the_one_on_the_wire(aravis, bench, small_configuration):
    with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        camera.configure(exposure_s=0.004)
        wire = camera.snap()
    again = SimulatedBench(small_configuration, BenchDevices.standard(seed=3), SHAPE)
    with again.in_process_camera() as camera:
        camera.configure(exposure_s=0.004)
        local = camera.snap()
    np.testing.assert_array_equal(wire.dn, local.dn)
    assert wire.camera == local.camera


def test_aravis_own_tools_see_and_stream_it(aravis_tools):
    """At its full size, through Debian's arv-tool and arv-camera-test with their default options."""
    configuration = SessionConfiguration.from_toml(example_configuration(), "example")
    bench = SimulatedBench(configuration, BenchDevices.standard())
    with bench.gige_camera():
        seen = subprocess.run(["arv-tool-0.8"], check=True, capture_output=True, text=True).stdout
        assert "Allied Vision Technologies-Manta_G-505B-SIM-503363706 (127.0.0.1)" in seen
        values = subprocess.run(
            ["arv-tool-0.8", "control", "DeviceTemperature", "ExposureTimeAbs=2000", "Width", "PixelFormat"],
            check=True,
            capture_output=True,
            text=True,
        ).stdout
        assert "DeviceTemperature = 35 C" in values
        assert "ExposureTimeAbs = 2000 us min:21 max:6e+07" in values
        assert "Width = 2452" in values
        assert "PixelFormat = Mono12" in values
        with subprocess.Popen(
            ["stdbuf", "--output=L", "arv-camera-test-0.8"], stdout=subprocess.PIPE, text=True
        ) as streaming:
            streamed, seen = "", 0
            while seen < 8:
                line = streaming.stdout.readline()
                assert line, streamed
                streamed += line
                seen += sum(map(int, re.findall(r"^ *(\d+) frames?/s", line)))
            streaming.send_signal(signal.SIGINT)
            streamed += streaming.stdout.read()
    assert "image width            = 2452" in streamed
    counters = {name: int(n) for name, n in re.findall(r"(n_\w+) *= (\d+)", streamed)}
    assert counters["n_completed_buffers"] >= 8


def shapes_of_all_frames(camera, n):
    """The shapes of n whole frames, after a check that every frame was taken or reported, and that most were taken."""
    sent, shapes = [], set()
    for frame in camera.grab(n, on_refused=lambda error: sent.append(error.frame_id)):
        sent.append(frame.frame_id)
        shapes.add(frame.shape)
    # GigE Vision frame ids are 16 bit and leave out 0.
    assert all(after == before % 0xFFFF + 1 for before, after in pairwise(sent))
    assert n <= len(sent) <= n + n // 4
    assert camera.statistics.completed >= n
    return shapes


@pytest.mark.parametrize("n", [12, pytest.param(60, marks=pytest.mark.long)])
def test_no_frame_of_full_size_is_lost(aravis, n):
    """2452 x 2056, Mono12. Each is triggered once the one before has come, so few computers are too slow for them.

    A computer that is busy otherwise may lose packets; what counts is that it says which frames it took again.
    """
    configuration = SessionConfiguration.from_toml(example_configuration(), "example")
    bench = SimulatedBench(configuration, BenchDevices.standard())
    with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        camera.configure(exposure_s=0.002, pixel_format="Mono12", trigger=SOFTWARE_TRIGGER)
        assert shapes_of_all_frames(camera, n) == {(2056, 2452)}


@pytest.mark.long
def test_no_frame_of_300_is_lost(aravis):
    """15 frames/s, 2452 x 2056, Mono12: each frame comes whole, or is reported."""
    configuration = SessionConfiguration.from_toml(example_configuration(), "example")
    bench = SimulatedBench(configuration, BenchDevices.standard())
    with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        camera.configure(exposure_s=0.002, pixel_format="Mono12")
        assert shapes_of_all_frames(camera, 300) == {(2056, 2452)}


@pytest.fixture
def one_by_one(small_configuration):
    """Three patches at the same place."""
    patches = [p.model_copy(update={"roi": (100.0, 100.0, 60.0, 60.0)}) for p in small_configuration.target.patches[:3]]
    target = small_configuration.target.model_copy(update={"patches": tuple(patches), "presentation": "one by one"})
    return small_configuration.model_copy(update={"target": target, "contrasts": ()})


def test_camera_and_meter_see_the_shown_patch(one_by_one):
    bench = SimulatedBench(one_by_one, BenchDevices.standard(), SHAPE, SimulatedClock())
    region = one_by_one.target.patches[0].region()
    seen = []
    with bench.in_process_camera() as camera, bench.in_process_meter() as meter:
        for patch in one_by_one.target.patches:
            bench.show_patch(patch.name)
            true_cd_m2 = bench.luminance_cd_m2[patch.name]
            assert meter.measure().luminance_cd_m2 == pytest.approx(1.006 * true_cd_m2, rel=0.006, abs=0.006)
            seen.append((region.select(camera.snap().dn).mean() - 64) / true_cd_m2)
    # One responsivity for all; 3600 pixels with 6 DN of dark noise at 0.5 cd/m^2, the darkest patch.
    dark_sigma = 6 / 60 / min(bench.luminance_cd_m2.values())
    np.testing.assert_allclose(seen, seen[-1], rtol=0.01, atol=5 * dark_sigma)


@pytest.mark.parametrize("pattern", ["RG", "GB"])
def test_a_colour_camera_sends_the_target_behind_its_filters(aravis, small_configuration, pattern):
    """In each format the planes see the light that a colour lets through, more red in that of an incandescent lamp."""
    in_light_of = {}
    for spectrum in ("D65", "A"):
        source = small_configuration.source.model_copy(update={"spectrum": spectrum})
        devices = SimulatedBenchFile(seed=3, camera={"colour_filter": pattern}).devices()
        bench = SimulatedBench(small_configuration.model_copy(update={"source": source}), devices, SHAPE)
        region = next(p.region() for p in small_configuration.target.patches if p.name == "P11")
        with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
            means = {}
            for suffix, scale in (("12", 1), ("12Packed", 1), ("16", 16), ("8", 1 / 16)):
                camera.configure(exposure_s=0.004, pixel_format=f"Bayer{pattern}{suffix}")
                frame = camera.snap()
                assert (frame.camera.model, frame.colour_filter) == ("Manta_G-505C", pattern)
                planes = split(frame)
                means[suffix] = [region.divided(2).select(plane.dn).mean() / scale for plane in planes.values()]
        # Noise of 900 pixels, and of 8 bits what is cut off.
        for other in ("12Packed", "16", "8"):
            np.testing.assert_allclose(means[other], means["12"], rtol=0.005, atol=2 + 16 * (other == "8"))
        in_light_of[spectrum] = np.array(means["12"]) - 64
    balance = {spectrum: values / values[1] for spectrum, values in in_light_of.items()}
    red, _, other_green, blue = balance["A"] / balance["D65"]
    assert red > 1.3
    assert blue < 0.8
    assert other_green == pytest.approx(1, rel=0.03)
