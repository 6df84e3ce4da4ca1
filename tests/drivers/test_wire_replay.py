"""A recorded wire played back to the driver: the same outcomes, and no other commands."""

import json
from contextlib import suppress

import pytest

from labcdp.drivers.meter import MeterError
from labcdp.drivers.minolta_ls import MeterMode, MinoltaLS110
from labcdp.drivers.simulated.meter import Fault, PtyMeter, SimulatedLS
from labcdp.drivers.wire_replay import RecordedMeter, WireMismatchError, driver_of, play
from labcdp.drivers.wire_test_file import pytest_file_text, unwrapped
from labcdp.drivers.wire_transcript import Transcript, WireEntry, parse_transcript, read_transcript
from labcdp.errors import InputError

from .test_wire_transcript import HEADER

pytestmark = pytest.mark.timeout(60)

TIMEOUT_S = 0.4
OPENING = [(mode, b"OK00\r\n") for mode in (b"MDS,00\r\n", b"MDS,04\r\n", b"MDS,06\r\n", b"MDS,09\r\n")]


def transcript_of(*exchanges, late_s=0.1, header=HEADER):
    entries = []
    for number, (command, reply) in enumerate(exchanges):
        entries.append(WireEntry(10.0 * number, "sent", command))
        if reply:
            entries.append(WireEntry(10.0 * number + late_s, "received", reply))
    return Transcript(header, tuple(entries))


def played(transcript):
    recorded = RecordedMeter(transcript, TIMEOUT_S)
    with PtyMeter(recorded, response_time_s=0) as port:
        return play(recorded, driver_of(transcript, port.port, TIMEOUT_S))


def record(path, scenario, *faults, **options):
    """Let a scenario run on the simulated meter, which begins with the faults once it is open."""
    values = iter(range(1, 1000))
    with (
        PtyMeter(SimulatedLS(lambda: next(values)), response_time_s=0) as port,
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=path, **options) as meter,
    ):
        port.inject(*faults)
        scenario(meter)
    return read_transcript(path)


def told(outcomes):
    """Return what each call gave, in a word."""
    return [outcome.get("error") or (outcome["result"] or {}).get("value") for outcome in outcomes]


def measure_all(n):
    def scenario(meter):
        for _ in range(n):
            with suppress(MeterError):
                meter.measure()

    return scenario


def test_every_command_is_played(tmp_path):
    def scenario(meter):
        meter.measure()
        meter.read_held()
        meter.set_mode(MeterMode.SLOW)
        meter.store_full_scale()
        meter.read_full_scale()
        meter.write_full_scale(40)
        meter.write_user_reference(51.24)
        meter.read_user_reference()
        meter.write_colour_factor(0.98)
        meter.read_colour_factor()
        meter.clear_memory()

    outcomes = played(record(tmp_path / "wire.jsonl", scenario))
    assert [
        (outcome["call"], outcome["result"]) for outcome in outcomes if outcome["call"] not in ("measure", "read_held")
    ] == [
        ("open", None),
        ("set_mode(SLOW)", None),
        ("store_full_scale", None),
        ("read_full_scale", {"value": 1.0, "unit": "cd/m2"}),
        ("write_full_scale(40.0)", 40.0),
        ("write_user_reference(51.24)", 51.24),
        ("read_user_reference", {"value": 51.24, "unit": "cd/m2"}),
        ("write_colour_factor(0.98)", 0.98),
        ("read_colour_factor", 0.98),
        ("clear_memory", None),
    ]
    assert [outcome["result"]["raw"] for outcome in outcomes[1:3]] == 2 * ["OK00,CcPH  1.00"]


def test_faults_are_played_as_they_came(tmp_path):
    faults = (
        *(Fault(reply=b"ER10\r\n"), Fault(reply=b""), Fault(n_bytes=9), Fault(reply=b"\xff\x00?\r\n")),
        *(Fault(delay_s=1.5 * TIMEOUT_S), Fault(reply=b"U" * 100), Fault()),
    )
    transcript = record(tmp_path / "wire.jsonl", measure_all(7), *faults)
    outcomes = played(transcript)
    assert told(outcomes) == [
        None,
        "MeterReportedError",
        "MeterTimeoutError",
        "MeterTimeoutError",
        "MeterProtocolError",
        "MeterTimeoutError",
        "MeterProtocolError",
        7.0,
    ]
    assert outcomes[3]["text"].startswith("the answer to MES broke off after 9 bytes (b'OK00,CcPH')")


def test_what_was_recorded_with_recovery_is_played_call_by_call(tmp_path):
    transcript = record(
        tmp_path / "wire.jsonl", measure_all(2), Fault(reply=b""), Fault(), Fault(n_bytes=3), attempts=3
    )
    assert told(played(transcript)) == [None, "MeterTimeoutError", 2.0, "MeterTimeoutError", 4.0]


def test_a_failed_opening_is_played():
    outcomes = played(transcript_of((b"MDS,00\r\n", b"ER30\r\n"), *OPENING, (b"MES\r\n", b"OK00,CcPH 83.02\r\n")))
    assert told(outcomes) == ["MeterReportedError", None, 83.02]
    assert [outcome["call"] for outcome in outcomes] == ["open", "open", "measure"]


def test_the_recorded_time_out_tells_what_was_late():
    reading = b"OK00,CcPH 83.02\r\n"
    for late_s, expected in ((5.9, 83.02), (6.1, "MeterTimeoutError")):
        transcript = transcript_of(*OPENING, late_s=0.1)
        slow = transcript_of((b"MES\r\n", reading), late_s=late_s)
        assert told(played(Transcript(HEADER, transcript.entries + slow.entries))) == [None, expected]


def test_two_answers_to_one_command_are_played_together():
    double = b"OK00,CcPH 83.02\r\nOK00,CcPH 84.00\r\n"
    outcomes = played(transcript_of(*OPENING, (b"MES\r\n", double), (b"MES\r\n", b"OK00,CcPH 85.00\r\n")))
    assert told(outcomes) == [None, 83.02, 85.0]


def test_another_command_is_a_mismatch():
    recorded = RecordedMeter(transcript_of(*OPENING, (b"DSR\r\n", b"OK00,CcPH 83.02\r\n")), TIMEOUT_S)
    with (
        PtyMeter(recorded, response_time_s=0) as port,
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S) as meter,
        pytest.raises(MeterError, match="no answer to MES"),
    ):
        meter.measure()
    with pytest.raises(
        WireMismatchError, match=r"command 5 is b'MES\\r\\n', the transcript has b'DSR\\r\\n': the driver"
    ):
        recorded.check(finished=False)


def test_a_command_too_many_is_a_mismatch():
    recorded = RecordedMeter(transcript_of(), TIMEOUT_S)
    assert recorded.answer(b"MES\r\n") == b""
    with pytest.raises(WireMismatchError, match=r"command 1 is b'MES\\r\\n', the transcript has nothing more"):
        recorded.check(finished=True)


def test_exchanges_left_over_are_a_mismatch():
    recorded = RecordedMeter(transcript_of(*OPENING), TIMEOUT_S)
    recorded.answer(b"MDS,00\r\n")
    recorded.check(finished=False)
    with pytest.raises(WireMismatchError, match=r"3 of 4 exchanges are left, next is b'MDS,04\\r\\n'"):
        recorded.check(finished=True)


def test_a_transcript_the_driver_would_not_send_is_a_mismatch():
    # The driver opens with PRESET; a recorded program that does not cannot be played to it.
    with pytest.raises(WireMismatchError, match=r"command 1 is b'MDS,00\\r\\n', the transcript has b'MES\\r\\n'"):
        played(transcript_of((b"MES\r\n", b"OK00,CcPH 83.02\r\n")))


@pytest.mark.parametrize("command", [b"XYZ\r\n", b"MDS,11\r\n", b"CMW,abc\r\n", b"MES,1\r\n", b"\xff\r\n"])
def test_commands_the_driver_does_not_have_are_named(command):
    with pytest.raises(InputError, match="which the driver does not send") as caught:
        played(transcript_of(*OPENING, (command, b"OK00\r\n")))
    assert repr(command) in str(caught.value)


def test_a_number_the_driver_refuses_is_an_input_error():
    with pytest.raises(InputError, match=r"colour correction factor is 0\.0: give"):
        played(transcript_of(*OPENING, (b"CCW,0.000\r\n", b"OK00\r\n")))


def test_another_model_has_no_driver():
    header = parse_transcript(transcript_of().to_text().replace("LS-110", "CS-100")).header
    with pytest.raises(InputError, match=r"the transcript is of a meter 'CS-100': give one of LS-100 or LS-110"):
        driver_of(Transcript(header, ()), "/dev/no-such-port")


def test_the_test_file_holds_transcript_and_outcomes(tmp_path):
    transcript = transcript_of(*OPENING, (b"MES\r\n", bytes(range(256)) + b'"""\\\r\n'))
    outcomes = [{"call": "measure", "error": "MeterProtocolError", "text": '"""\\' + 40 * " x" + 60 * " "}]
    names = {}
    text = pytest_file_text(transcript, outcomes)
    exec(text, names)
    assert parse_transcript(unwrapped(names["TRANSCRIPT"])) == transcript
    assert [json.loads(line) for line in unwrapped(names["EXPECTED"]).splitlines()] == outcomes
    assert max(map(len, text.splitlines())) <= 100
    assert not any(line.endswith(" ") for line in text.splitlines())
