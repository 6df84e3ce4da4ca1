import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import serial

from labcdp.chain import load
from labcdp.clock import SimulatedClock
from labcdp.drivers.aravis_camera import AravisCamera
from labcdp.drivers.camera import CameraError, CameraSettingError
from labcdp.drivers.minolta_ls import MinoltaLS110
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.errors import ConfigurationError
from labcdp.session import SessionConfiguration, example_configuration
from labcdp.vignetting import Cos4Vignetting

SHAPE = (400, 480)


@pytest.fixture
def bench(small_configuration):
    return SimulatedBench(small_configuration, BenchDevices.standard(seed=3), SHAPE)


def test_camera_and_meter_agree_on_the_target(aravis, bench, small_configuration):
    """What the chain says a patch of that luminance gives is what arrives over GigE Vision, within noise."""
    specimen = load("manta-g505").camera()
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


def test_the_lens_cap_makes_it_dark(aravis, bench):
    with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        camera.configure(exposure_s=0.002)
        assert camera.snap().dn.max() > 1000
        bench.cover_lens()
        dark = camera.snap()
        bench.uncover_lens()
        assert camera.snap().dn.max() > 1000
    # Black level 64 DN, dark noise 0.6 * 10 e- = 6 DN: eight standard deviations.
    assert dark.dn.max() < 64 + 8 * 7
    assert dark.dn.mean() == pytest.approx(64, abs=0.1)


def test_frames_differ_by_noise_and_repeat_by_seed(bench, small_configuration):
    with bench.in_process_camera() as camera:
        first, second = camera.snap(), camera.snap()
    assert (first.dn != second.dn).any()
    again = SimulatedBench(small_configuration, BenchDevices.standard(seed=3), SHAPE)
    with again.in_process_camera() as camera:
        np.testing.assert_array_equal(camera.snap().dn, first.dn)


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


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"exposure_s": 100.0}, "exposure_s is 100 s: the camera takes 2.1e-05 to 60 s"),
        ({"gain_db": 30.0}, "gain_db is 30 dB: the camera takes 0 to 26 dB"),
        ({"pixel_format": "Mono8"}, "no pixel format 'Mono8': choose Mono12"),
    ],
)
def test_the_camera_in_this_process_refuses_what_the_other_refuses(bench, settings, message):
    with bench.in_process_camera() as camera, pytest.raises(CameraSettingError, match=message):
        camera.configure(**settings)


def test_a_closed_camera_in_this_process_says_so(bench):
    with pytest.raises(CameraError, match="not open: use it as a context manager"):
        bench.in_process_camera().snap()


def test_a_second_camera_on_the_same_address_is_refused(aravis, bench):
    with (
        bench.gige_camera(),
        pytest.raises(CameraError, match=r"cannot use 127\.0\.0\.1, UDP port 3956 .*end the other simulated camera"),
    ):
        bench.gige_camera().start()


def test_an_address_of_no_interface_is_refused(aravis, bench):
    with pytest.raises(CameraError, match=r"cannot use 10\.1\.2\.3"):
        bench.gige_camera("10.1.2.3").start()


def test_a_patch_outside_the_sensor_is_refused(small_configuration):
    with pytest.raises(
        ConfigurationError, match=r"patch '.*' reaches x \d+, y \d+, the simulated sensor has 200 x 100"
    ):
        SimulatedBench(small_configuration, BenchDevices.standard(), (100, 200))


def moved(configuration, rois):
    """The configuration with the first patches at other places, and no others."""
    patches = [
        patch.model_copy(update={"roi": roi}) for patch, roi in zip(configuration.target.patches, rois, strict=False)
    ]
    target = configuration.target.model_copy(update={"patches": tuple(patches)})
    return configuration.model_copy(update={"target": target, "contrasts": ()})


def test_close_patches_keep_their_luminance(small_configuration):
    close = moved(small_configuration, [(100.0, 100.0, 60.0, 60.0), (162.0, 100.0, 60.0, 60.0)])
    bench = SimulatedBench(close, BenchDevices.standard(), SHAPE)
    scene = bench._source.scene().luminance_map()
    for patch in close.target.patches:
        assert set(patch.region().select(scene)) == {np.float32(bench.luminance_cd_m2[patch.name])}


def test_overlapping_patches_are_refused(small_configuration):
    overlapping = moved(small_configuration, [(100.0, 100.0, 60.0, 60.0), (159.0, 100.0, 60.0, 60.0)])
    with pytest.raises(ConfigurationError, match=r"patches 'P01' and 'P07' overlap, .*move one"):
        SimulatedBench(overlapping, BenchDevices.standard(), SHAPE)


def test_an_unknown_patch_is_refused(bench):
    with pytest.raises(ConfigurationError, match="no patch 'P99': choose one of P01"):
        bench.point_meter("P99")


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
        streamed = subprocess.run(
            ["arv-camera-test-0.8", "--duration=6"], check=True, capture_output=True, text=True
        ).stdout
    assert "image width            = 2452" in streamed
    counters = {name: int(n) for name, n in re.findall(r"(n_\w+) *= (\d+)", streamed)}
    # 15 frames/s for 6 s; the first takes time to render.
    assert counters["n_completed_buffers"] >= 25
    assert counters["n_failures"] == counters["n_missing_packets"] == 0


def test_no_frame_of_300_is_lost(aravis):
    """15 frames/s, 2452 x 2056, Mono12."""
    configuration = SessionConfiguration.from_toml(example_configuration(), "example")
    bench = SimulatedBench(configuration, BenchDevices.standard())
    with bench.gige_camera(), AravisCamera("127.0.0.1") as camera:
        assert camera.configure(exposure_s=0.002, pixel_format="Mono12").width == 2452
        ids = np.array([frame.frame_id for frame in camera.grab(300)])
    assert ids.size == 300
    # GigE Vision frame ids are 16 bit and leave out 0.
    steps = np.diff(ids)
    assert np.all((steps == 1) | ((ids[:-1] == 65535) & (ids[1:] == 1)))


def test_any_serial_program_gets_protocol_answers(bench):
    bench.point_meter("upper left")
    with (
        bench.pty_meter(0) as meter,
        serial.Serial(meter.port, 4800, bytesize=7, parity="E", stopbits=2, timeout=2) as port,
    ):
        port.write(b"MES\r\n")
        assert re.fullmatch(rb"OK00,Cc[PLKT ][MH]358\.\d \r\n|OK00,Cc[PLKT ][MH] 3\d\d\.\d\r\n", port.readline())


# --- Patches one by one -------------------------------------------------------------------------------------------


@pytest.fixture
def one_by_one(small_configuration):
    """Three patches at the same place."""
    same = moved(small_configuration, [(100.0, 100.0, 60.0, 60.0)] * 3)
    target = same.target.model_copy(update={"presentation": "one by one"})
    return same.model_copy(update={"target": target})


def test_only_the_shown_patch_is_before_the_camera(one_by_one):
    bench = SimulatedBench(one_by_one, BenchDevices.standard(), SHAPE)
    lowest = min(bench.luminance_cd_m2.values())
    for patch in one_by_one.target.patches:
        bench.show_patch(patch.name)
        scene = bench._source.scene().luminance_map()
        shown = np.float32(bench.luminance_cd_m2[patch.name])
        assert set(patch.region().select(scene)) == {shown}
        assert set(np.unique(scene)) == {shown, np.float32(4 * lowest)}
        assert bench.pointed_at == patch.name


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


def test_showing_does_nothing_where_all_are_there(bench, small_configuration):
    before = bench._source.scene().luminance_map()
    bench.show_patch("P11")
    np.testing.assert_array_equal(bench._source.scene().luminance_map(), before)
    assert bench.pointed_at == "P11"


def test_a_part_is_repeated_once(bench):
    assert [bench.repeat(what, []) for what in ("P01", "P01", "P07", "P01", "P07")] == [True, False, True, False, False]
