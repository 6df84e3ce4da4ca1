"""Command characterise: a camera's gain, noise and linearity after EMVA 1288."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, print_json, print_table, progress_bars, say

if TYPE_CHECKING:
    from ..calibration.emva import Characterisation


def characterise(
    path: Path = typer.Argument(
        help="Folder of a recorded session; or the index of an EMVA 1288 data set, or the folder it is in."
    ),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="PATH-characterisation"
    ),
    as_json: bool = JSON_OPTION,
) -> None:
    """Tell a camera's gain, noise, dark current, non-uniformity and linearity after EMVA 1288; write a report.

    A session gives what its dark frames and patches tell. A data set has a text file that names, line by line, bits and
    size (n 12 640 480), exposure in ns and photons (b 40000 120), exposure of darkness (d 40000) and images (i a.png).
    """
    from ..report import characterisation_table, characterisation_values, place_for_results, write_characterisation
    from ..report.characterise_tables import plain_words

    if not path.exists():
        raise InputError(f"{path} does not exist: give a session, or the index of a data set")
    folder = output or _results_folder(path)
    with place_for_results(folder):
        result = _characterised(path)
        written = write_characterisation(result, folder)
    if as_json:
        print_json({"output": str(folder), **characterisation_values(result)})
        return
    for flag in result.flags:
        say(f"Warning: {flag}")
    print_table("Characterisation after EMVA 1288", *characterisation_table(result))
    for sentence in plain_words(result):
        say(sentence)
    if result.simulated:
        say(f"Simulated: camera {result.camera}")
    say(f"Report: {next(file for file in written if file.suffix == '.html')}")


def _characterised(path: Path) -> Characterisation:
    from ..calibration.emva import INDEX_NAME, index_path
    from ..evaluate import characterise_index, characterise_session
    from ..session import Session

    index = index_path(path)
    with progress_bars() as bars:
        if index is not None:
            return characterise_index(index, lambda done, total: bars.update("reading", done, total))
        if not (path / "session.toml").exists():
            raise InputError(f"{path} holds neither a session nor {INDEX_NAME}: give a session or a data set")
        with Session.open(path) as session:
            return characterise_session(session, lambda done, total: bars.update("reading", done, total))


def _results_folder(path: Path) -> Path:
    whole = path.resolve()
    source = whole if whole.is_dir() else whole.parent
    return source.with_name(f"{source.name}-characterisation")
