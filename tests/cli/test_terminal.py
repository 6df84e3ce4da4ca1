"""What stays on the terminal beside bars that are drawn again and again."""

import io
import logging
import re

from labcdp.acquire import CheckFinding, Control, Progress
from labcdp.cli.bench.operators import Console, ConsoleOperator, Keys
from labcdp.cli.terminal import log_to_terminal, progress_bars, say
from labcdp.core.reading import MeterIdentity
from labcdp.drivers.manual import MeterAccuracy, typed_reading


def screen(written):
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


def test_questions_findings_and_readings_stay_above_the_bars(capsys, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setattr("sys.stdin", io.StringIO("\n" * 10))
    meter = MeterAccuracy(0.02, 0.001, 1), MeterIdentity("meter", "1")
    with progress_bars() as bars:
        operator = ConsoleOperator(Console(bars, Keys(Control())))
        bars.acquisition(Progress("light frames", 4, 4))
        assert not operator.repeat("light frames", [CheckFinding("flicker", "the light flickers", 0.1, 0.01)])
        for n in range(2):
            operator.point_meter(f"P{n}")
            bars.acquisition(Progress("meter readings", n + 1, 2, reading=(f"P{n}", typed_reading(f"{n}.25", *meter))))
        say("the last words")
    shown = screen(capsys.readouterr().err)
    asked = ("repeat the light frames?", "centre of patch P0", "centre of patch P1")
    places = []
    for words in ("the light flickers", "P0: 0.25", "P1: 1.25", "the last words", *asked):
        (place,) = (at for at, line in enumerate(shown) if words in line)
        places.append(place)
    # Each bar once, and below all of that.
    bar_places = [at for at, line in enumerate(shown) if "━" in line]
    assert len(bar_places) == 2
    assert min(bar_places) > max(places)


def test_warnings_are_shown_once_however_often_commands_ran(capsys, caplog):
    log_to_terminal(verbose=True)
    log_to_terminal(verbose=False)
    logging.getLogger("labcdp.drivers.camera").warning("camera lost")
    logging.getLogger("labcdp.drivers.camera").info("camera found")
    logging.getLogger("labcdp.calibration").warning("part of the result")
    assert capsys.readouterr().err == "labcdp: camera lost\n"
    assert "camera lost" in caplog.messages
