"""A test made of a wire transcript: it plays the recorded meter to its driver and compares what the driver says."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Final

from .wire_transcript import Transcript

_LONGEST_LINE: Final = 88
_TEST: Final = '''"""Play the recorded wire of a luminance meter to its driver; made by labcdp meter-test.

Recorded from the {meter} on {started}.
A line that begins with a blank goes on the one before.
"""

import json

from labcdp.drivers.simulated.meter_pty import PtyMeter
from labcdp.drivers.wire_replay import RecordedMeter, driver_of, play
from labcdp.drivers.wire_test_file import unwrapped
from labcdp.drivers.wire_transcript import parse_transcript

TRANSCRIPT = r"""
{transcript}"""

# What each call of the driver returned or raised, in order.
EXPECTED = r"""
{expected}"""


def test_the_driver_reads_the_recorded_wire_as_before():
    """Every command must be the recorded one, every outcome the expected one."""
    transcript = parse_transcript(unwrapped(TRANSCRIPT))
    recorded = RecordedMeter(transcript)
    with PtyMeter(recorded, response_time_s=0) as port:
        outcomes = play(recorded, driver_of(transcript, port.port))
    assert outcomes == [json.loads(line) for line in unwrapped(EXPECTED).splitlines()]
'''


def pytest_file_text(transcript: Transcript, outcomes: Sequence[dict[str, Any]]) -> str:
    """Write a pytest file that stands alone.

    Parameters
    ----------
    transcript : Transcript
        The transcript.
    outcomes : sequence of dict
        What `labcdp.drivers.wire_replay.play` returned for it.
    """
    # JSON has no three quotes in a row, and each of its lines ends in a brace: a raw string can hold it.
    expected = "".join(f"{json.dumps(outcome)}\n" for outcome in outcomes)
    return _TEST.format(
        meter=transcript.header.meter,
        started=f"{transcript.header.started:%Y-%m-%d at %H:%M %Z}",
        transcript=_wrapped(transcript.to_text()),
        expected=_wrapped(expected),
    )


def unwrapped(text: str) -> str:
    """Undo the wrapping of the lines in a test's raw string, and drop the line break it begins with."""
    return text.removeprefix("\n").replace("\n ", "")


def _wrapped(text: str) -> str:
    """Wrap lines of JSON: none begins with a blank, so one that does can be told to go on the one before."""
    return "".join(f"{piece}\n" for line in text.splitlines() for piece in _pieces(line))


def _pieces(line: str) -> list[str]:
    pieces = []
    while len(line) > _LONGEST_LINE:
        # A piece must not end in a blank, which editors cut off.
        end = len(line[:_LONGEST_LINE].rstrip())
        pieces.append(line[:end])
        line = f" {line[end:]}"
    return [*pieces, line]
