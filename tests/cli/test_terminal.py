"""What stays on the terminal beside bars that are drawn again and again."""

import io
import re

import pytest

from labcdp.acquire import CheckFinding, Control, Progress
from labcdp.cli.bench.operators import Console, ConsoleOperator, Keys
from labcdp.cli.terminal import progress_bars, say
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.manual import MeterAccuracy, typed_reading


def screen(written: str) -> list[str]:
    """Lines that a terminal shows in the end, which obeys the returns, line feeds, and moves up of these bars."""
    lines, row = [""], 0
    for part in re.findall(r"\x1b\[\??[\d;]*[A-Za-z]|\r|\n|[^\x1b\r\n]+", written):
        if part == "\n":
            row += 1
            lines += [""] * (row + 1 - len(lines))
        elif part.endswith("A") and part[0] == "\x1b":
            row -= int(part[2:-1] or 1)
        elif part.endswith("K") and part[0] == "\x1b":
            lines[row] = ""
        elif part[0] not in "\x1b\r":
            lines[row] += part
    return lines


def test_questions_findings_and_readings_stay_above_the_bars(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setattr("sys.stdin", io.StringIO("\n" * 10))
    finding = CheckFinding("flicker", "the light flickers", 0.1, 0.01)
    identity, accuracy = MeterIdentity("meter", "1"), MeterAccuracy(0.02, 0.001, 1)
    with progress_bars() as bars:
        operator = ConsoleOperator(Console(bars, Keys(Control())))
        bars.acquisition(Progress("light frames", 4, 4))
        assert not operator.repeat("light frames", [finding])
        for n in range(3):
            operator.point_meter(f"P{n}")
            reading = typed_reading(f"{n + 1}.25", accuracy, identity)
            bars.acquisition(Progress("meter readings", n + 1, 3, reading=(f"P{n}", reading)))
        say("the last words")
    shown = screen(capsys.readouterr().err)
    for words in (
        "the light flickers",
        "repeat the light frames?",
        "P0: 1.25",
        "P1: 2.25",
        "P2: 3.25",
        "the last words",
    ):
        assert sum(words in line for line in shown) == 1, shown
    for n in range(3):
        assert sum(f"centre of patch P{n}" in line for line in shown) == 1
    # Each bar once, and below all of that.
    places = [at for at, line in enumerate(shown) if "━" in line]
    assert len(places) == 2
    assert min(places) > max(at for at, line in enumerate(shown) if "the last words" in line)
