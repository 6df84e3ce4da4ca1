"""The simulated GigE Vision camera as Aravis' own programs see it."""

import re
import signal
import subprocess

from labcdp.drivers.aravis import gvcp
from labcdp.drivers.aravis.camera import AravisCamera
from labcdp.drivers.simulated.bench import BenchDevices, SimulatedBench
from labcdp.drivers.simulated.gige_camera import SimulatedGigECamera
from labcdp.session import SessionConfiguration, example_configuration

from ..conftest import SMALL, Ramp


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
    bench = SimulatedBench(SessionConfiguration.from_toml(example_configuration(), "x"), BenchDevices.standard())
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
