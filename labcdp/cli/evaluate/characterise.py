"""Command characterise: a camera's gain, noise and linearity after EMVA 1288."""

from __future__ import annotations

from pathlib import Path

import typer

from ...calibration.emva import INDEX_NAME, Characterisation, index_path
from ...core.errors import InputError
from ...core.result import InputFile
from ...evaluate.bench.session_result import session_input
from ...evaluate.camera.characterise import characterise_index, characterise_session
from ...evaluate.camera.result import result, write_characterisation
from ...session import Session
from ..output import Results
from ..terminal import progress_bars


def characterise(
    context: typer.Context,
    results: Results,
    path: Path = typer.Argument(help="Folder of a recorded session, or text file or folder of an EMVA 1288 data set."),
) -> None:
    """Measure a camera's gain, noise, dark current, non-uniformity and linearity after EMVA 1288.

    Uses the dark frames and patches of a session, or an EMVA 1288 data set: images and a text file whose lines state
    bits and size (n 12 640 480), exposure in ns and photons per pixel (b 40000 120), exposure of dark images (d 40000)
    and image files (i a.png).
    """
    if not path.exists():
        raise InputError(f"{path} does not exist: give a session, or the index of a data set")
    source = path if path.is_dir() else path.resolve().parent
    with results.folder(context, source) as folder:
        characterised, inputs, title = _characterised(path)
        found = result(characterised, title, inputs)
        write_characterisation(characterised, found, folder)
    results.show(found, folder)


def _characterised(path: Path) -> tuple[Characterisation, list[InputFile], str]:
    """Return what was found, what it was made from, and its title."""
    index = index_path(path)
    with progress_bars() as bars:
        if index is not None:
            found = characterise_index(index, lambda done, total: bars.update("Reading", done, total))
            return found, [InputFile.of("index", index)], index.resolve().parent.name
        if not (path / "session.toml").exists():
            raise InputError(f"{path} contains neither a session nor {INDEX_NAME}: give a session or a data set")
        with Session.open(path) as session:
            found = characterise_session(session, lambda done, total: bars.update("Reading", done, total))
            return found, [session_input(session)], session.configuration.name
