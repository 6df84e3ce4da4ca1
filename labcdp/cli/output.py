"""Output options and paths of the commands, checked before any work starts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from .terminal import JSON_OPTION, print_result, say

if TYPE_CHECKING:
    from ..core.result import Result
    from ..output import ResultsFolder

#: Parameters of commands that name what is written.
_WRITTEN = {"output", "preview", "transcript"}

FORCE_OPTION = typer.Option(
    False, "--force", help="Replace earlier results of the same command, or an existing output file; never an input."
)

OPEN_OPTION = typer.Option(False, "--open", help="Open the page in the browser.")


def show_page(path: Path, wanted: bool) -> None:
    """Open a page in the browser, if that is wanted."""
    if wanted:
        typer.launch(str(path))


def output_option(shown: str) -> Any:
    """Return the option for the folder of results; `shown` is its default, for the help."""
    return typer.Option(None, "--output", "-o", help="New folder for the results.", show_default=shown)


@dataclass(frozen=True)
class Results:
    """Options of commands that write a folder of results with a page."""

    output: Path | None = typer.Option(
        None, "--output", "-o", help="New folder for the results.", show_default="INPUT-COMMAND"
    )
    force: bool = FORCE_OPTION
    open_page: bool = OPEN_OPTION
    as_json: bool = JSON_OPTION

    def folder(self, context: typer.Context, source: str | Path, *, resume: bool = False) -> ResultsFolder:
        """Return the folder of the results; see `results_folder`."""
        return results_folder(context, source, self.output, self.force, resume=resume)

    def show(self, result: Result, folder: ResultsFolder, page: str = "report.html", also: str = "") -> None:
        """Print a result and where its page is, and open the page if that is wanted."""
        print_result(result, self.as_json)
        if not self.as_json:
            say(f"Report: {folder.folder / page}{also}")
        show_page(folder.folder / page, self.open_page and page.endswith(".html"))


def results_folder(
    context: typer.Context, source: str | Path, output: Path | None, force: bool, *, resume: bool = False
) -> ResultsFolder:
    """Return the folder of a command's results: ``NAME-COMMAND`` in the current directory, or as given.

    Entering it refuses, before any work, a folder with anything that must not be replaced.

    Parameters
    ----------
    context : typer.Context
        Of the command that runs; its arguments are never replaced.
    source : str or Path
        What the results are of; a file gives its name without suffix, a folder its name.
    output : Path or None
        Folder given by the user.
    force : bool
        Whether results of the same command are replaced.
    resume : bool
        Whether finished results are completed.
    """
    from ..output import ResultsFolder

    command = str(context.info_name)
    folder = default_folder(source, command) if output is None else output
    return ResultsFolder(folder, command, force=force, resume=resume, inputs=_inputs(context, "--output"))


def default_folder(source: str | Path, command: str) -> Path:
    """Return the folder in which a command writes its results unless another one is given."""
    path = Path(source)
    # The name of "." or ".." is that of the folder it stands for.
    name = path.resolve().name if path.is_dir() else path.stem
    return Path(f"{name or 'root'}-{command}")


def output_file(context: typer.Context, path: Path, force: bool, option: str = "--output") -> Path:
    """Check, before any work, that a file can be written and is no input of the command; see `check_file`."""
    from ..output import check_file

    return check_file(path, force=force, inputs=_inputs(context, option), option=option)


def _inputs(context: typer.Context, option: str) -> Iterator[Path]:
    """Files and folders that a command was given to read, and texts that may name one; not what `option` names."""
    written = _WRITTEN | {option.lstrip("-").lower()}
    for name, value in context.params.items():
        for one in value if isinstance(value, list | tuple) else (value,):
            if name not in written and isinstance(one, str | Path) and str(one):
                yield Path(one)
