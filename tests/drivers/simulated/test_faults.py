"""The language of faults."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import ConfigurationError
from labcdp.drivers.simulated.faults.commands import (
    CameraFault,
    Drift,
    MeterRemote,
    MeterReplyFault,
    MeterUnit,
    MeterUnplug,
    Recover,
    Scheduled,
)
from labcdp.drivers.simulated.faults.schedule_file import EXAMPLES, METER_CODES, parse_command, parse_schedule

LASTING = ("freeze", "stall", "vanish", "wrong ids", "wrong size", "second controller")


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("lose 5% for 20 s", CameraFault("lose", 20, 0.05)),
        ("lose 12.5 %", CameraFault("lose", None, 0.125)),
        ("vanish for 1.5 min", CameraFault("vanish", 90)),
        ("WRONG  IDS for 250ms", CameraFault("wrong ids", 0.25)),
        ("  second controller for 1 h ", CameraFault("second controller", 3600)),
        ("stall", CameraFault("stall")),
        ("temperature +8 C in 10 min", Drift("temperature", 8, 600)),
        ("temperature -2.5 c", Drift("temperature", -2.5)),
        ("light -5% in 1 h", Drift("light", -0.05, 3600)),
        ("meter er19", MeterReplyFault("code", "ER19")),
        ("meter truncate 7", MeterReplyFault("truncate", n_bytes=7)),
        ("meter delay 3 s", MeterReplyFault("delay", delay_s=3)),
        ("meter garble", MeterReplyFault("garble")),
        ("meter unit fL", MeterUnit("fL")),
        ("meter unit cd/m2", MeterUnit("cd/m2")),
        ("meter drop", MeterRemote(False)),
        ("meter remote", MeterRemote(True)),
        ("meter unplug for 2 s", MeterUnplug(2)),
        ("meter unplug", MeterUnplug()),
        ("recover", Recover()),
    ],
)
def test_what_each_command_means(text, command):
    assert parse_command(text) == command


@pytest.mark.parametrize("example", EXAMPLES)
def test_every_example_is_understood_and_said_again(example):
    command = parse_command(example)
    assert parse_command(str(command)) == command


def test_a_schedule_is_sorted_by_time_and_may_have_comments():
    text = "# a bad night\nat 1 min vanish for 5 s\n\nat 10 s lose 5% for 20 s  # the switch\nmeter ER10\n"
    assert parse_schedule(text) == (
        Scheduled(0, MeterReplyFault("code", "ER10")),
        Scheduled(10, CameraFault("lose", 20, 0.05)),
        Scheduled(60, CameraFault("vanish", 5)),
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("lose 5 for 20 s", "'lose 5 for 20 s' is not a known fault: write for example 'lose 5% for 20 s'"),
        ("at 10 lose 5%", "'at 10 lose 5%' has no time after 'at': write for example 'at 10 s lose 5% for 20 s'"),
        ("at 10 s", "'at 10 s' has no time after 'at'"),
        ("lose 120%", "'lose 120%': 120% is more than all packets: write for example 'lose 5% for 20 s'"),
        ("light -101% in 1 h", "-101% leaves no light: write for example 'light -5% in 1 h'"),
        ("light 5%", "'light 5%' is not a known fault.* example 'light -5% in 1 h'"),
        ("temperature +900 C", r"900 C is out of range \(at most 80 C\)"),
        ("wrong sise", "example 'wrong size for 2 s'"),
        ("meter ER12", "'meter ER12' is not a known fault.* example 'meter ER10'"),
        ("meter", "'meter' is not a known fault.* example 'meter"),
        ("vanish for -5 s", "example 'vanish for 5 s'"),
        ("vanish for nan s", "example 'vanish for 5 s'"),
        ("at 1 min dance", "'dance' is not a known fault: write for example"),
    ],
)
def test_errors_name_line_fault_and_remedy(line, message):
    with pytest.raises(ConfigurationError, match=rf"^night\.txt, line 2: .*{message}") as raised:
        parse_schedule(f"stall for 1 s\n{line}\n", "night.txt")
    assert "\n" not in str(raised.value)


TIMES = st.integers(0, 10**9).map(lambda milliseconds: milliseconds / 1000)
MAYBE = st.none() | TIMES
SHARES = st.integers(0, 10**4).map(lambda parts: parts / 10**4)
COMMANDS = st.one_of(
    st.builds(CameraFault, st.sampled_from(LASTING), MAYBE),
    st.builds(CameraFault, st.just("lose"), MAYBE, SHARES),
    st.builds(Drift, st.just("temperature"), st.integers(-800, 800).map(lambda tenths: tenths / 10), TIMES),
    st.builds(Drift, st.just("light"), st.integers(-1000, 5000).map(lambda parts: parts / 1000), TIMES),
    st.builds(MeterReplyFault, st.just("code"), st.sampled_from(METER_CODES)),
    st.builds(MeterReplyFault, st.just("truncate"), n_bytes=st.integers(0, 99)),
    st.builds(MeterReplyFault, st.just("delay"), delay_s=TIMES),
    st.builds(MeterUnit, st.sampled_from(["cd/m2", "fL"])),
    st.builds(MeterRemote, st.booleans()),
    st.builds(MeterUnplug, MAYBE),
)


def near(a, b):
    """The same command, but for the last digits of its numbers."""
    return type(a) is type(b) and all(
        value == pytest.approx(vars(b)[name], rel=1e-9, abs=1e-9)
        if isinstance(value, float)
        else value == vars(b)[name]
        for name, value in vars(a).items()
    )


@given(COMMANDS)
def test_what_is_said_is_understood(command):
    assert near(parse_command(str(command)), command)


@given(st.lists(st.builds(Scheduled, TIMES, COMMANDS), max_size=8))
def test_a_schedule_written_is_the_schedule_read(items):
    read = parse_schedule("\n".join(map(str, items)))
    wanted = sorted(items, key=lambda item: item.at_s)
    assert len(read) == len(wanted)
    for a, b in zip(read, wanted, strict=True):
        assert a.at_s == pytest.approx(b.at_s, abs=1e-9)
        assert near(a.command, b.command)


@given(st.text(max_size=40) | st.text(alphabet="at 0123456789.%+-smhlosevanighfrzectolr", max_size=30))
def test_any_text_is_understood_or_refused_in_one_line(text):
    refusal = ""
    try:
        parse_schedule(text)
    except ConfigurationError as error:
        refusal = str(error)
    assert not refusal or "write for example" in refusal
    assert len(refusal.splitlines()) <= 1
