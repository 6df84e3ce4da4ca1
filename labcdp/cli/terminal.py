"""What a person sees: messages, progress bars and tables on the terminal, JSON on standard output."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError

if TYPE_CHECKING:
    from ..acquire import Live
    from ..acquire import Progress as AcquisitionProgress

#: Loggers whose warnings a person should see at once; the calibration's are in its result.
_SHOWN = ("labcdp.acquire", "labcdp.drivers", "labcdp.session")


class _Say(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        say(f"labcdp: {record.getMessage()}")


def log_to_terminal(verbose: bool) -> None:
    """Show the warnings, or with `verbose` all messages, of the parts that work with devices and files."""
    # Damaged files are reported as errors of ours.
    for name in ("tifffile", "roifile"):
        logging.getLogger(name).addHandler(logging.NullHandler())
        logging.getLogger(name).propagate = False
    library = logging.getLogger("labcdp")
    library.addHandler(logging.NullHandler())
    library.propagate = False
    for name in _SHOWN:
        logger = logging.getLogger(name)
        logger.setLevel(logging.INFO if verbose else logging.WARNING)
        logger.addHandler(_Say())
        logger.propagate = False


def say(text: str) -> None:
    """Tell a person something, on standard error, so that standard output stays for results."""
    from rich.console import Console

    Console(stderr=True, highlight=False, markup=False, soft_wrap=True).print(text)


def print_json(values: Any) -> None:
    """Print a result for machines."""
    from ..json_text import results_json

    sys.stdout.write(results_json(values))


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table; all columns but the first are right aligned.

    A terminal too narrow for the cells gets each row as a list: a number broken in two is no number.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console(highlight=False)
    if not console.is_terminal:
        # A file or a pipe has no width of its own, and a table should not be folded to a guessed one.
        console = Console(highlight=False, width=200)
    widths = [max((len(row[index]) for row in rows), default=0) for index in range(len(columns))]
    # Three characters between two cells, and the frame.
    if sum(widths) + 3 * len(columns) + 1 > console.width:
        console.print(Text(title, style="bold"))
        for row in rows:
            console.print(Text(f"  {row[0]}"))
            for column, cell in zip(columns[1:], row[1:], strict=True):
                console.print(Text(f"    {column}: {cell}"))
        return
    table = Table(title=title, title_justify="left", title_style="bold")
    for index, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if index == 0 else "right", overflow="fold")
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)


class Bars:
    """Progress bars by name, made when first told of."""

    def __init__(self, progress: Any) -> None:
        self._progress = progress
        self._tasks: dict[str, Any] = {}

    def update(self, name: str, done: int, total: int) -> None:
        """Set a bar."""
        if not self._tasks:
            # Not before: an error on the way here should not follow an empty line.
            self._progress.start()
        if name not in self._tasks:
            self._tasks[name] = self._progress.add_task(name, total=total)
        self._progress.update(self._tasks[name], completed=done, total=total)

    def acquisition(self, progress: AcquisitionProgress) -> None:
        """Set the bar of a step of an acquisition, and show its live numbers below the bars."""
        from .live_text import live_line

        if progress.note is not None:
            say(progress.note)
        if progress.live is not None:
            if self._progress.console.is_terminal:
                self._progress.live_numbers = progress.live
            elif progress.live.finished:
                say(live_line(progress.live))
        self.update(progress.step, progress.done, progress.total)

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Take the bars away while a person is asked something."""
        started = self._progress.live.is_started
        if started:
            self._progress.stop()
        try:
            yield
        finally:
            if started:
                self._progress.start()


@contextmanager
def progress_bars() -> Iterator[Bars]:
    """Show progress bars on standard error while the context lasts."""
    progress = _progress()
    try:
        yield Bars(progress)
    finally:
        progress.live_numbers = None
        if progress.live.is_started:
            progress.stop()


def _progress() -> Any:
    from rich.console import Console, RenderableType
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.text import Text

    from .live_text import live_line, live_table

    class WithLiveNumbers(Progress):
        """Progress bars, and below them the numbers of the frames that are being taken."""

        live_numbers: Live | None = None

        def get_renderables(self) -> Iterable[RenderableType]:
            yield self.make_tasks_table(self.tasks)
            live = self.live_numbers
            if live is not None:
                yield Text(live_line(live))
                # Its heading, the bars and some lines of before.
                if len(live.patches) + 10 <= self.console.height:
                    yield live_table(live)

    columns = (TextColumn("{task.description:<16}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return WithLiveNumbers(*columns, console=Console(stderr=True))


def fraction_of_percent(text: str, name: str) -> float:
    """Turn ``1000%`` into 10.0.

    Raises
    ------
    InputError
        If it is not a number with a percent sign.
    """
    try:
        fraction = float(text[:-1].strip()) / 100 if text.endswith("%") else nan
        if not isfinite(fraction):
            raise ValueError
        return fraction
    except ValueError:
        raise InputError(f"{name} is {text!r}: give a number with a percent sign, for example 50%") from None


JSON_OPTION = typer.Option(False, "--json", help="Print the result as JSON.")
