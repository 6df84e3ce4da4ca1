"""The wire transcript: what the driver writes, and what the reader makes of whole, torn and foreign files."""

import json
import logging
import time
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from importlib.metadata import version

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from labcdp.drivers.meter import MeterNotFoundError, MeterTimeoutError
from labcdp.drivers.minolta_ls import MinoltaLS110
from labcdp.drivers.simulated.meter import Fault, PtyMeter, SimulatedLS
from labcdp.drivers.wire_transcript import (
    PortSettings,
    Transcript,
    TranscriptHeader,
    WireEntry,
    parse_transcript,
    read_transcript,
)
from labcdp.errors import InputError

TIMEOUT_S = 0.4
SETTINGS = PortSettings(4800, 7, "E", 2, False)
HEADER = TranscriptHeader("LS-110", "/dev/ttyUSB0", SETTINGS, 6.0, datetime(2026, 3, 2, tzinfo=UTC), "0.1")
OPENING = [
    *(("sent", b"MDS,00\r\n"), ("received", b"OK00\r\n"), ("sent", b"MDS,04\r\n"), ("received", b"OK00\r\n")),
    *(("sent", b"MDS,06\r\n"), ("received", b"OK00\r\n"), ("sent", b"MDS,09\r\n"), ("received", b"OK00\r\n")),
]


@contextmanager
def opened(path, **options):
    with (
        PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port,
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=path, **options) as meter,
    ):
        yield port, meter


def wire(path):
    return [(entry.direction, entry.data) for entry in read_transcript(path).entries]


# --- Written by the driver ----------------------------------------------------------------------------------------


def test_every_byte_is_written_as_it_happens(tmp_path):
    path = tmp_path / "wire.jsonl"
    before = datetime.now(UTC)
    with opened(path, rtscts=True) as (port, meter):
        assert wire(path) == OPENING
        meter.measure()
        assert wire(path)[8:] == [("sent", b"MES\r\n"), ("received", b"OK00,CcPH 83.02\r\n")]
        header = read_transcript(path).header
        assert header.port == port.port
    assert (header.meter, header.timeout_s, header.labcdp) == ("LS-110", TIMEOUT_S, version("labcdp"))
    assert header.settings == PortSettings(baudrate=4800, bytesize=7, parity="E", stopbits=2, rtscts=True)
    assert before <= header.started <= datetime.now(UTC)
    times = [entry.t_s for entry in read_transcript(path).entries]
    assert times == sorted(times)


def test_the_lines_are_those_of_the_format(tmp_path):
    path = tmp_path / "wire.jsonl"
    with opened(path):
        pass
    first, second, third, *_ = path.read_text().splitlines()
    assert list(json.loads(first))[:3] == ["format", "meter", "port"]
    assert json.loads(second) == {"t_s": json.loads(second)["t_s"], "sent": "MDS,00\r\n"}
    assert json.loads(third) == {"t_s": json.loads(third)["t_s"], "received": "OK00\r\n"}


def test_silence_late_cut_and_unasked_bytes_are_written(tmp_path):
    path = tmp_path / "wire.jsonl"
    with opened(path) as (port, meter):
        port.inject(
            Fault(reply=b""), Fault(n_bytes=7), Fault(delay_s=1.5 * TIMEOUT_S), Fault(reply=b"\xff?\r\nOK00\r\n")
        )
        for _ in range(4):
            with suppress(Exception):
                meter.measure()
        # Bytes that nobody waits for are taken from the port with the next command.
        time.sleep(0.1)
        meter.measure()
    late = read_transcript(path).exchanges[6]
    assert wire(path)[8:] == [
        ("sent", b"MES\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"OK00,Cc"),
        ("sent", b"MES\r\n"),
        ("received", b"OK00,CcPH 83.02\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"\xff?\r\n"),
        ("received", b"OK00\r\n"),
        ("sent", b"MES\r\n"),
        ("received", b"OK00,CcPH 83.02\r\n"),
    ]
    assert late.received[0].t_s - late.command.t_s > TIMEOUT_S


def test_a_transcript_goes_on_when_its_meter_is_opened_again(tmp_path):
    path = tmp_path / "wire.jsonl"
    with opened(path, patience_s=5) as (port, meter):
        meter.close()
        meter.open()
        port.unplug()
        port.plug_in()
        meter.measure()
    assert wire(path)[:24] == 3 * OPENING
    assert path.read_text().count("format") == 1


def test_an_existing_file_is_not_overwritten_and_the_port_is_free(tmp_path):
    path = tmp_path / "wire.jsonl"
    path.write_text("mine")
    with PtyMeter(SimulatedLS(lambda: 1.0), response_time_s=0) as port:
        with pytest.raises(InputError, match=r"wire\.jsonl exists already: give the transcript another name"):
            MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=path).open()
        serial.Serial(port.port, exclusive=True).close()
    assert path.read_text() == "mine"


def test_a_folder_that_is_not_there_is_named(tmp_path):
    with (
        PtyMeter(SimulatedLS(lambda: 1.0), response_time_s=0) as port,
        pytest.raises(InputError, match=r"no/wire\.jsonl cannot be written \(No such file"),
    ):
        MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript=tmp_path / "no" / "wire.jsonl").open()


def test_a_port_that_cannot_be_opened_leaves_no_file(tmp_path):
    with pytest.raises(MeterNotFoundError):
        MinoltaLS110("/dev/no-such-port", transcript=tmp_path / "wire.jsonl").open()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_ends_the_transcript_and_not_the_readings(caplog):
    with PtyMeter(SimulatedLS(lambda: 83.02), response_time_s=0) as port:
        meter = MinoltaLS110(port.port, timeout_s=TIMEOUT_S, transcript="/dev/full")
        # The device exists before the driver does, as no transcript may.
        meter._line._transcript._started_s = 0.0
        with meter, caplog.at_level(logging.WARNING):
            assert meter.measure().value == 83.02
    assert [record.getMessage() for record in caplog.records] == [
        "/dev/full cannot be written (No space left on device): the transcript ends here"
    ]


def test_a_transcript_that_cannot_go_on_is_no_reason_to_lose_the_meter(tmp_path, caplog):
    folder = tmp_path / "wires"
    folder.mkdir()
    with opened(folder / "wire.jsonl", patience_s=5) as (port, meter):
        port.unplug()
        port.plug_in()
        (folder / "wire.jsonl").unlink()
        folder.rmdir()
        assert meter.measure().value == 83.02
    assert "wire.jsonl cannot be written (No such file or directory): the transcript ends here" in caplog.text


def test_without_a_path_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with opened(None) as (port, meter):
        port.inject(Fault(reply=b""))
        with pytest.raises(MeterTimeoutError):
            meter.measure()
    assert list(tmp_path.iterdir()) == []


# --- Read ---------------------------------------------------------------------------------------------------------

ENTRIES = st.lists(
    st.builds(
        WireEntry, st.floats(0, 1e5).map(lambda t: round(t, 6)), st.sampled_from(["sent", "received"]), st.binary()
    ),
    max_size=8,
).map(tuple)


@given(ENTRIES)
def test_what_is_written_is_read(entries):
    transcript = Transcript(HEADER, entries)
    assert parse_transcript(transcript.to_text()) == transcript


@given(ENTRIES, st.data())
def test_a_torn_last_line_is_left_out(entries, data):
    text = Transcript(HEADER, (*entries, WireEntry(1.0, "sent", b"MES\r\n"))).to_text()
    last = text.rindex("\n", 0, -1) + 1
    cut = data.draw(st.integers(last, len(text) - 1))
    assert parse_transcript(text[:cut]).entries == entries


@given(ENTRIES)
def test_every_entry_after_the_first_command_belongs_to_one_exchange(entries):
    exchanges = Transcript(HEADER, entries).exchanges
    commands = [entry for entry in entries if entry.direction == "sent"]
    assert [exchange.command for exchange in exchanges] == commands
    first = entries.index(commands[0]) if commands else len(entries)
    assert sum(1 + len(exchange.received) for exchange in exchanges) == len(entries) - first


def test_a_torn_line_is_noticed(caplog):
    parse_transcript(Transcript(HEADER, ()).to_text() + '{"t_s": 1, "se', "night.jsonl")
    assert "night.jsonl: line 2 was not written to its end and is left out" in caplog.text


ENTRY = '{"t_s": 0.5, "sent": "MES\\r\\n"}'


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("MES", "it cannot be read as JSON: MES"),
        ("[1, 2]", r"it is no JSON object: \[1, 2\]"),
        ("{}", "an entry has t_s and either sent or received"),
        ('{"t_s": 1}', "an entry has t_s and either sent or received"),
        ('{"t_s": 1, "sent": "", "received": ""}', "an entry has t_s and either sent or received"),
        ('{"t_s": 1, "sent": "", "by": "me"}', "an entry has t_s and either sent or received"),
        ('{"t_s": "1", "sent": ""}', "t_s is '1', not of type float"),
        ('{"t_s": true, "sent": ""}', "t_s is True, not of type float"),
        ('{"t_s": -1, "sent": ""}', "t_s is -1.0, not a number of seconds of at least 0"),
        ('{"t_s": NaN, "sent": ""}', "t_s is nan, not a number"),
        ('{"t_s": 1' + 400 * "0" + ', "sent": ""}', "cannot be read as JSON"),
        ('{"t_s": 1, "sent": 5}', "sent is 5, not of type str"),
        ('{"t_s": 1, "sent": "\\u2126"}', "sent has characters that are no bytes"),
        (100 * "[", r"\[\.\.\.$"),
        (100_000 * "[", r"\[\.\.\.$"),
    ],
)
def test_errors_in_a_line_name_it(line, message):
    text = f"{Transcript(HEADER, ()).to_text()}{ENTRY}\n{line}\n{ENTRY}\n"
    with pytest.raises(InputError, match=rf"^night\.jsonl, line 3: .*{message}") as caught:
        parse_transcript(text, "night.jsonl")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": None}, "it is not the header of a wire transcript"),
        ({"format": 2}, "format 2 is not known, this version reads format 1"),
        ({"meter": None}, "meter is missing"),
        ({"baudrate": "4800"}, "baudrate is '4800', not of type int"),
        ({"rtscts": 0}, "rtscts is 0, not of type bool"),
        ({"started": "yesterday"}, "started is 'yesterday', not an ISO time"),
        ({"started": "2026-03-02T12:00:00"}, "started is '2026-03-02T12:00:00', without a time zone"),
        ({"timeout_s": 0}, "timeout_s is 0.0, not a positive number"),
    ],
)
def test_errors_in_the_header_are_told(changes, message):
    values = {key: value for key, value in (HEADER.to_dict() | changes).items() if value is not None}
    with pytest.raises(InputError, match=f"^transcript, line 1: {message}"):
        parse_transcript(json.dumps(values) + "\n")


@pytest.mark.parametrize("text", ["", '{"format": 1'])
def test_a_file_without_a_whole_line_is_no_transcript(text):
    with pytest.raises(InputError, match="transcript has no whole line: give a wire transcript"):
        parse_transcript(text)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(InputError, match=r"no\.jsonl cannot be read \(No such file or directory\)"):
        read_transcript(tmp_path / "no.jsonl")
    (tmp_path / "image").write_bytes(b"II*\x00\xff")
    with pytest.raises(InputError, match="image is no wire transcript: byte 4 is not ASCII"):
        read_transcript(tmp_path / "image")


@given(st.text(max_size=60))
def test_arbitrary_text_raises_nothing_but_input_errors(text):
    for start in ("", Transcript(HEADER, ()).to_text()):
        with suppress(InputError):
            parse_transcript(start + text + "\n")
