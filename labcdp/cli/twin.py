"""Command twin: a camera's simulated twin, compared with the camera."""

from __future__ import annotations

from pathlib import Path
from shlex import quote

import typer

from .terminal import JSON_OPTION, fraction_of_percent, print_json, print_table, progress_bars, say

#: More rows are left to the page.
_MOST_ROWS = 30


def twin(
    session: Path = typer.Argument(help="Folder of the session."),
    calibration: Path | None = typer.Option(
        None, help="Calibration file of this camera; default: calibrate with this session."
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="SESSION-twin"
    ),
    without: list[str] = typer.Option([], "--without", help="Patch to leave out; may be given several times."),
    contrast: str | None = typer.Option(
        None, help="Contrast to detect between all pairs, for example 100%; default: each pair's own by the meter."
    ),
    epsilon: str = typer.Option("50%", help="Tolerance of the contrast."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Make a simulated twin of a session's camera and compare the CDP it predicts with the measured one.

    Finds the parameters of the camera, predicts frames and CDP of all pairs of patches from the meter's readings, and
    tells for each pair whether the two agree and which parameter matters. Writes chain.toml, which labcdp simulate
    takes, report.html, results.xlsx and results.json.
    """
    from ..calibration import load
    from ..evaluate import calibrate_session, characterise_session, observe_session
    from ..evaluate.corrections import Corrections, PlaneCorrections
    from ..evaluate.twin import twin_session
    from ..evaluate.twin_parameters import require_monochrome
    from ..report import place_for_results
    from ..report.twin_results import write_twin
    from ..report.twin_tables import pair_table
    from ..report.twin_wording import twin_notes, twin_results, twin_warnings
    from ..session import Session

    asked = None if contrast is None else fraction_of_percent(contrast, "--contrast")
    tolerance = fraction_of_percent(epsilon, "--epsilon")
    loaded = None if calibration is None else load(calibration)
    opened = Session.open(session)
    require_monochrome(opened)
    path = opened.path.resolve()
    folder = output or path.with_name(f"{path.name}-twin")
    with place_for_results(folder):
        with progress_bars() as bars:
            corrections: PlaneCorrections | None = None if loaded is None else {None: Corrections.of(loaded)}
            observed = observe_session(
                opened, without, lambda done, total: bars.update("Reading", done, total), corrections
            )
            calibrated = calibrate_session(observed) if loaded is None else loaded
            found = characterise_session(opened, lambda done, total: bars.update("Characterising", done, total))
            result = twin_session(
                opened,
                observed,
                calibrated,
                found,
                asked,
                tolerance,
                lambda done, total: bars.update("Predicting", done, total),
            )
        write_twin(result, folder)
    if as_json:
        print_json({"output": str(folder), **result.to_dict()})
        return
    for note in (*twin_notes(result), *twin_warnings(result)):
        say(f"Note: {note}")
    table = pair_table(result)
    if len(table.rows) <= _MOST_ROWS:
        print_table("Contrast detection probability", *table)
    for sentence in twin_results(result):
        say(sentence)
    for pair in result.pairs:
        if pair.differs:
            say(f"{pair.asked.bright} / {pair.asked.dark}: {pair.verdict}")
    say(f"Report: {folder / 'report.html'}")
    say(f"Next: labcdp simulate {quote(str(folder / 'chain.toml'))}")
