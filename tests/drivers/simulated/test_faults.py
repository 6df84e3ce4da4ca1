"""The language of faults."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labcdp.core.errors import ConfigurationError
from labcdp.drivers.simulated.commands import EXAMPLES, Command, parse_command, parse_schedule


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("lose 5% for 20 s", Command("lose", 0.05, 20)),
        ("lose 12.5 %", Command("lose", 0.125)),
        ("vanish for 1.5 min", Command("vanish", 0, 90)),
        ("WRONG  IDS for 250ms", Command("wrong ids", 0, 0.25)),
        ("  second controller for 1 h ", Command("second controller", 0, 3600)),
        ("stall", Command("stall")),
        ("temperature +8 C in 10 min", Command("temperature", 8, 600)),
        ("temperature -2.5 c", Command("temperature", -2.5)),
        ("light -5% in 1 h", Command("light", -0.05, 3600)),
        ("meter er19", Command("meter", "ER19")),
        ("meter truncate 7", Command("meter truncate", 7)),
        ("meter delay 3 s", Command("meter delay", 0, 3)),
        ("meter unit fL", Command("meter unit", "fL")),
        ("meter drop", Command("meter drop")),
        ("meter unplug for 2 s", Command("meter unplug", 0, 2)),
    ],
)
def test_what_each_command_means(text, command):
    assert parse_command(text) == command


def test_every_example_is_understood():
    assert all(example.startswith(parse_command(example).kind) for example in EXAMPLES)


def test_a_schedule_is_sorted_by_time_and_may_have_comments():
    text = "# a bad night\nat 1 min vanish for 5 s\n\nat 10 s lose 5% for 20 s  # the switch\nmeter ER10\n"
    assert parse_schedule(text) == (
        Command("meter", "ER10"),
        Command("lose", 0.05, 20, at_s=10),
        Command("vanish", 0, 5, at_s=60),
    )


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("lose 5 for 20 s", "'lose 5 for 20 s' is not a known fault: write for example 'lose 5% for 20 s'"),
        ("at 10 lose 5%", "'at 10 lose 5%' has no time after 'at': write for example 'at 10 s lose 5% for 20 s'"),
        ("lose 120%", "'lose 120%': 120 is out of range .0 to 100.: write for example 'lose 5% for 20 s'"),
        ("light -101% in 1 h", "-101 is out of range .*: write for example 'light -5% in 1 h'"),
        ("light 5%", "'light 5%' is not a known fault.* example 'light -5% in 1 h'"),
        ("temperature +900 C", r"900 is out of range \(-80 to 80\)"),
        ("wrong sise", "example 'wrong size for 2 s'"),
        ("meter ER12", "'meter ER12' is not a known fault.* example 'meter ER10'"),
        ("vanish for -5 s", "example 'vanish for 5 s'"),
        ("at 1 min dance", "'dance' is not a known fault: write for example"),
    ],
)
def test_errors_name_line_fault_and_remedy(line, message):
    with pytest.raises(ConfigurationError, match=rf"^night\.txt, line 2: .*{message}") as raised:
        parse_schedule(f"stall for 1 s\n{line}\n", "night.txt")
    assert "\n" not in str(raised.value)


@given(st.text(max_size=40) | st.text(alphabet="at 0123456789.%+-smhlosevanighfrzectolr", max_size=30))
def test_any_text_is_understood_or_refused_in_one_line(text):
    refusal = ""
    try:
        parse_schedule(text)
    except ConfigurationError as error:
        refusal = str(error)
    assert not refusal or "write for example" in refusal
    assert len(refusal.splitlines()) <= 1
