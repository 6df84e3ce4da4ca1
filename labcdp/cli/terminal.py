"""Messages, progress bars and tables on the terminal; JSON on standard output."""

from __future__ import annotations

import json
import logging
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from rich.console import Console, RenderableType
from rich.live import Live as Display
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from ..core.clock import exposure_text
from ..core.errors import printable
from .commands import as_json

if TYPE_CHECKING:
    from ..acquire import LiveStatistics, PatchNumbers
    from ..acquire import Progress as AcquisitionProgress
    from ..core.result import Result
    from ..web.server import Address

#: Loggers whose warnings are shown at once; those of the calibration are in its result.
_SHOWN = ("labcdp.acquire", "labcdp.drivers", "labcdp.files", "labcdp.session")
#: Width in characters to which texts in a table may be wrapped.
_TEXT_WIDTH = 24
#: Rows of a table that are printed.
_MOST_ROWS = 40


def live_line(live: LiveStatistics) -> str:
    """Sum up an exposure: the extremes of its patches, with their names."""
    parts = [f"{live.role} {exposure_text(live.exposure_s)}"]
    if live.patches:
        dark, bright = _extremes(live, lambda n: n.mean_dn)
        noise = max((n.temporal_noise_dn or 0.0 for n in live.patches), default=0.0)
        low, high = f"{dark.mean_dn:.1f}", f"{bright.mean_dn:.1f}"
        parts.append(f"mean {low} DN" if low == high else f"mean {low} ({dark.patch}) to {high} DN ({bright.patch})")
        _, saturated = _extremes(live, lambda n: n.saturated_share)
        where = f" ({saturated.patch})" if saturated.saturated_share else ""
        parts.append(f"saturated {saturated.saturated_share:.2%}{where}")
        parts.append(f"noise {noise:.2f} DN")
        # The brightest unsaturated patch shows drift best; in dark patches noise hides it.
        steady = [n for n in live.patches if not n.saturated_share and n.drift_rel is not None]
        if steady:
            best = max(steady, key=lambda n: n.mean_dn)
            parts.append(f"drift {best.drift_rel:+.2%} ({best.patch})")
    if live.temperature_c is not None:
        parts.append(f"{live.temperature_c:.1f} °C")
    return ", ".join(parts)


def live_table(live: LiveStatistics) -> Table:
    """Make a rich table, one row a patch."""
    table = Table("patch", "mean DN", "saturated", "noise DN", "drift", box=None, padding=(0, 2, 0, 0))
    for column in table.columns[1:]:
        column.justify = "right"
    for n in live.patches:
        noise = "" if n.temporal_noise_dn is None else f"{n.temporal_noise_dn:.2f}"
        drift = "" if n.drift_rel is None else f"{n.drift_rel:+.2%}"
        table.add_row(n.patch, f"{n.mean_dn:.1f}", f"{n.saturated_share:.2%}", noise, drift)
    return table


def _extremes(live: LiveStatistics, key: Callable[[PatchNumbers], float]) -> tuple[PatchNumbers, PatchNumbers]:
    return min(live.patches, key=key), max(live.patches, key=key)


class _Say(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        if record.name.startswith(_SHOWN):
            say(f"labcdp: {record.getMessage()}")


_SAY = _Say()
_SILENT = logging.NullHandler()


def log_to_terminal(verbose: bool) -> None:
    """Show the warnings, or with `verbose` all messages, of the parts that work with devices and files."""
    # labcdp reports damaged files itself. The handlers are module constants, so that none is added twice.
    for name in ("imagecodecs", "roifile", "tifffile"):
        logging.getLogger(name).addHandler(_SILENT)
    _SAY.setLevel(logging.INFO if verbose else logging.WARNING)
    library = logging.getLogger("labcdp")
    library.setLevel(_SAY.level)
    library.addHandler(_SAY)


def say(text: str) -> None:
    """Print a message on standard error; standard output is for results.

    Control characters quoted from files, names and devices are made harmless.
    """
    # While bars are shown they stand in for standard error, and print above themselves; they erase what others print.
    print("\n".join(printable(line) for line in text.split("\n")), file=sys.stderr, flush=True)


def print_result(result: Result, *following: str) -> None:
    """Print a result as JSON on standard output; or its tables, and say its findings and the `following` lines."""
    if as_json():
        from ..report.files import envelope_json

        text = envelope_json(result)
        try:
            text.encode(sys.stdout.encoding or "utf-8")
        except UnicodeEncodeError:
            # Escapes, which JSON has for all characters, and not question marks.
            text = json.dumps(json.loads(text), indent=2) + "\n"
        sys.stdout.write(text)
        return
    from ..report.text import finding_lines, is_number, text_table

    for table in result.tables:
        if table.detail or not len(table):
            continue
        heads, rows = text_table(table.select(range(min(len(table), _MOST_ROWS))))
        numbers = [is_number(table[column.name]) for column in table.columns if column.shown]
        _print_table(table.title, heads, rows, numbers)
        if len(table) > _MOST_ROWS:
            say(f"{len(table) - _MOST_ROWS} more rows are in the files")
    if result.simulated:
        say("Simulated data, not a measurement")
    for severity, line in finding_lines(result.findings):
        say(f"{severity}: {line}")
    for line in following:
        # A name in it may hold a line break.
        say(printable(line))


def _print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[bool]) -> None:
    """Print a table; columns of numbers are right aligned.

    Long texts are wrapped. On a narrow terminal each row is printed as a list, so that no number is split.
    """
    console = Console(highlight=False)
    if not console.is_terminal:
        # A file or a pipe has no width of its own, and a table should not be folded to a guessed one.
        console = Console(highlight=False, width=200)
    widths = [max((len(row[index]) for row in rows), default=0) for index in range(len(columns))]
    widths = [width if number else min(width, _TEXT_WIDTH) for width, number in zip(widths, numbers, strict=True)]
    # Three characters between two cells, and the frame.
    if sum(widths) + 3 * len(columns) + 1 > console.width:
        console.print(_text(title, "bold"))
        for row in rows:
            console.print(_text(f"  {row[0]}"))
            for column, cell in zip(columns[1:], row[1:], strict=True):
                console.print(_text(f"    {column}: {cell}"))
        return
    table = Table(title=_text(title), title_justify="left", title_style="bold")
    for column, is_right, width in zip(columns, numbers, widths, strict=True):
        # Words of a head may be wrapped, numbers not.
        least = max([width, *map(len, column.split())]) if is_right else min(width, _TEXT_WIDTH)
        table.add_column(_text(column), justify="right" if is_right else "left", overflow="fold", min_width=least)
    for row in rows:
        table.add_row(*map(_text, row))
    console.print(table)


def _text(text: str, style: str = "") -> Text:
    return Text(printable(text), style)


class Bars(Progress):
    """Progress bars by name, created at their first update, and below them the numbers of the frames being taken."""

    def __init__(self) -> None:
        columns = (TextColumn("{task.description:<16}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        self._numbers: LiveStatistics | None = None
        self._ids: dict[str, TaskID] = {}
        super().__init__(*columns, console=Console(stderr=True))

    def get_renderables(self) -> Iterable[RenderableType]:
        """Give what is shown."""
        yield self.make_tasks_table(self.tasks)
        if self._numbers is not None:
            yield Text(live_line(self._numbers))
            # Room for its heading, the bars and some earlier lines.
            if len(self._numbers.patches) + 10 <= self.console.height:
                yield live_table(self._numbers)

    def set(self, name: str, done: int, total: int) -> None:
        """Set a bar."""
        if not self._ids:
            # Started late, so that an earlier error does not follow an empty line.
            self.start()
        if name not in self._ids:
            self._ids[name] = self.add_task(name, total=total)
        self.update(self._ids[name], completed=done, total=total)

    def acquisition(self, progress: AcquisitionProgress) -> None:
        """Set the bar of a step of an acquisition, and show its live numbers below the bars."""
        if progress.note is not None:
            say(progress.note)
        if progress.reading is not None:
            from ..report.text import significant

            patch, reading = progress.reading
            say(f"{patch}: {significant(reading.luminance_cd_m2)} cd/m²")
        if progress.live is not None:
            if self.console.is_terminal:
                self._numbers = progress.live
            elif progress.live.finished:
                say(live_line(progress.live))
        self.set(progress.step, progress.done, progress.total)
        if progress.live is not None and progress.live.finished:
            # Shown however soon the next step follows.
            self.refresh()

    def end(self) -> None:
        """Leave the bars as they are, without live numbers."""
        self._numbers = None
        if self.live.is_started:
            self.stop()

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Hide the bars during a question to the operator."""
        started = self.live.is_started
        if started:
            self.live.transient = True
            self.stop()
        try:
            yield
        finally:
            if started:
                # A display that is started again would first erase as many lines as it had: the question and findings.
                get = self.get_renderable
                self.live = Display(console=self.console, refresh_per_second=10, get_renderable=get)
                self.start()


def say_where(page: Address) -> None:
    """Say how a page in the browser is opened and ended."""
    say(f"Open: {page.url}")
    if page.loopback:
        say(f"On another computer, first run: {page.tunnel}")
    else:
        say("warning: the page is reachable over the network and not encrypted: others can intercept its address")
    say("Ctrl-C ends the page")


@contextmanager
def progress_bars() -> Iterator[Bars]:
    """Show progress bars on standard error while the context lasts."""
    bars = Bars()
    try:
        yield bars
    finally:
        bars.end()


@contextmanager
def progress_bar(name: str) -> Iterator[Callable[[int, int], None]]:
    """Show one progress bar while the context lasts; yields what sets it."""
    with progress_bars() as bars:
        yield partial(bars.set, name)
