"""What every meter on a port promises, on a pseudo-terminal and in this process: readings, errors and recovery."""

import socket
import threading
from contextlib import contextmanager, suppress

import pytest

from labcdp.core.clock import SimulatedClock
from labcdp.core.errors import InputError
from labcdp.core.reading import SERIAL_MODELS, MeterIdentity
from labcdp.drivers import open_meter
from labcdp.drivers.meter import (
    MeterLostError,
    MeterNotFoundError,
    MeterProtocolError,
    MeterReportedError,
    MeterTimeoutError,
)
from labcdp.drivers.minolta.models import DRIVERS
from labcdp.drivers.simulated.meter import SimulatedCS100A, SimulatedLS, SimulatedProgram
from labcdp.drivers.simulated.port import Fault, InProcessPort
from labcdp.drivers.simulated.pty import PtyMeter

TIMEOUT_S, LONG_S = 2.0, 60.0
XY = (0.4476, 0.4074)


def engine_of(model, luminance=lambda: 83.02):
    """The simulated meter of a model; those with a C in the name measure the colour of illuminant A."""
    sheet = DRIVERS[model].data_sheet
    if model.startswith("LS-1") and model.endswith("0") and model[3:] in ("100", "110"):
        return SimulatedLS(luminance, sheet)
    kind = SimulatedCS100A if model == "CS-100A" else SimulatedProgram
    return kind(luminance, sheet, chromaticity=(lambda: XY) if model.startswith("CS") else None)


@pytest.fixture(params=SERIAL_MODELS)
def model(request):
    return request.param


@contextmanager
def on_a_terminal(model, luminance=lambda: 83.02, **options):
    engine = engine_of(model, luminance)
    with PtyMeter(engine, response_time_s=0) as served:
        identity = MeterIdentity(model, "4711")
        with DRIVERS[model].configured(served.port, identity, **{"timeout_s": LONG_S} | options) as meter:
            yield engine, served, meter


def test_a_reading_has_luminance_accuracy_identity_and_the_colour_of_a_chroma_meter(model):
    with on_a_terminal(model) as (_, _, meter):
        reading = meter.measure()
    sheet = DRIVERS[model].data_sheet
    assert abs(reading.luminance_cd_m2 - 83.02) <= reading.resolution / 2
    assert reading.resolution == (0.1 if model == "CS-100A" else 0.01)
    assert reading.digits_half_width >= reading.resolution
    assert (reading.scale_half_width_rel, reading.unit) == (sheet.scale_half_width_rel, "cd/m2")
    assert reading.meter == MeterIdentity(model, "4711")
    assert reading.chromaticity == (XY if model.startswith("CS") else None)
    assert type(reading).from_dict(reading.to_dict()) == reading


def test_it_says_that_it_is_simulated(model):
    with PtyMeter(engine_of(model), response_time_s=0) as served, open_meter(served.port, model) as meter:
        assert meter.identity.simulated
        assert meter.measure().meter.simulated


@pytest.mark.parametrize(
    ("fault", "error"),
    [
        *((Fault(delay_s=delay_s), MeterTimeoutError) for delay_s in (1.5 * TIMEOUT_S, 2.2 * TIMEOUT_S)),
        *((fault, MeterTimeoutError) for fault in (Fault(reply=b""), Fault(n_bytes=1), Fault(n_bytes=9))),
        *((Fault(reply=reply), MeterProtocolError) for reply in (b"\x00?!\r\n", b"U" * 600, b"OK00\r\n")),
    ],
)
@pytest.mark.parametrize("attempts", [1, 2])
def test_no_reading_is_the_late_answer_to_an_earlier_command(model, fault, error, attempts):
    values = iter(range(10, 90))
    port = InProcessPort(engine_of(model, lambda: next(values)), SimulatedClock(), 0)
    with DRIVERS[model].configured(port, timeout_s=TIMEOUT_S, attempts=attempts) as meter:
        assert meter.measure().value == 10
        port.inject(fault)
        failed, seen = [], [10.0]
        for _ in range(4):
            try:
                seen.append(meter.measure().value)
            except (MeterTimeoutError, MeterProtocolError) as raised:
                failed.append(type(raised))
        assert len(failed) <= 1 + (fault.delay_s > 2 * TIMEOUT_S)
        assert len(seen) >= 3
        assert seen == sorted(set(seen))
        assert failed[:1] == ([error] if attempts == 1 else failed[:1])
        assert meter.incidents[0].kind == ("error" if attempts == 1 else "asked again")


@pytest.mark.parametrize("seed", range(6))
def test_garbage_is_never_a_reading_and_is_overcome(model, seed):
    port = InProcessPort(engine_of(model), SimulatedClock(), 0)
    with DRIVERS[model].configured(port, timeout_s=TIMEOUT_S, attempts=3) as meter:
        port.inject(Fault.garbled(seed))
        assert abs(meter.measure().value - 83.02) < 0.1


def test_a_pulled_cable_is_waited_for_and_the_meter_set_up_again(model):
    with on_a_terminal(model, patience_s=LONG_S) as (engine, served, meter):
        meter.measure()
        served.unplug()
        engine.connected = False
        timer = threading.Timer(0.3, served.plug_in)
        timer.start()
        assert abs(meter.measure().value - 83.02) < 0.1
        timer.join()
        assert [incident.kind for incident in meter.incidents] == ["lost and back"]


def test_a_cable_that_stays_pulled_ends_in_one_line(model):
    with on_a_terminal(model, patience_s=0.3) as (_, served, meter):
        served.unplug()
        with pytest.raises(MeterLostError, match=r"did not come back within 0\.3 s, last: .*no such serial port"):
            meter.measure()


def test_too_much_light_is_reported_and_does_not_end_the_connection(model):
    light = [1e9, 50.0]
    with on_a_terminal(model, lambda: light.pop(0)) as (_, _, meter):
        with pytest.raises(MeterReportedError):
            meter.measure()
        assert meter.measure().value == 50.0


def test_slow_response_is_set_and_corrections_of_others_refused(model):
    with on_a_terminal(model, response="slow") as (_, _, meter):
        assert meter.measure().value == pytest.approx(83, rel=0.001)
    if model not in ("LS-100", "LS-110"):
        with pytest.raises(InputError, match=rf"meter.correction is 'colour': a computer sets the {model} to 'preset'"):
            DRIVERS[model].configured("nowhere", correction="colour")


def test_no_port(model):
    with pytest.raises(MeterNotFoundError, match="there is no such serial port"):
        open_meter("/dev/no-such-port", model)


def test_each_model_has_a_driver():
    assert {name: driver.data_sheet.model for name, driver in DRIVERS.items()} == {name: name for name in SERIAL_MODELS}


# A port of the network


@contextmanager
def listening(engine, n_answers=1000):
    """A program on a port of the network, which hangs up after some answers and listens again."""
    server = socket.create_server(("127.0.0.1", 0))
    server.settimeout(LONG_S)

    def serve():
        with suppress(OSError):
            while True:
                client, _ = server.accept()
                with client, client.makefile("rwb", 0) as lines:
                    for _, line in zip(range(n_answers), lines, strict=False):
                        lines.write(engine.answer(line))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"socket://127.0.0.1:{server.getsockname()[1]}"
    finally:
        server.shutdown(socket.SHUT_RDWR)
        server.close()
        thread.join()


def test_a_program_of_the_network_is_a_meter_and_one_that_hangs_up_is_reached_again():
    engine = engine_of("CS-150")
    with (
        listening(engine, 4) as port,
        DRIVERS["CS-150"].configured(port, timeout_s=LONG_S, patience_s=LONG_S) as meter,
    ):
        readings = [meter.measure() for _ in range(3)]
    assert [reading.chromaticity for reading in readings] == [XY] * 3
    assert [incident.kind for incident in meter.incidents] == ["lost and back"]


def test_a_program_that_lost_its_meter_is_set_up_again_or_said_in_one_line():
    engine = engine_of("LS-160")
    with listening(engine) as port:
        with DRIVERS["LS-160"].configured(port, timeout_s=LONG_S, patience_s=LONG_S) as meter:
            engine.connected = False
            assert meter.measure().value == 83.02
        with DRIVERS["LS-160"].configured(port, timeout_s=LONG_S) as meter:
            engine.connected = False
            with pytest.raises(MeterLostError, match=r"^the program has no meter: check the cable"):
                meter.measure()


@pytest.mark.parametrize(
    ("port", "problem"),
    [
        ("socket://127.0.0.1:1", "nothing can be reached there .*start the program"),
        ("socket://127.0.0.1", "nothing can be reached there"),
        ("rfc2217://127.0.0.1:1", "rfc2217:// is not known, give socket://HOST:PORT"),
    ],
)
def test_a_port_of_the_network_without_a_program(port, problem):
    with pytest.raises(MeterNotFoundError, match=problem):
        open_meter(port, "LS-150")
