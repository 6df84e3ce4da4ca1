"""The command ``labcdp``: its subcommands and its error messages."""

from __future__ import annotations

import errno
import gc
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from itertools import pairwise
from types import FrameType

import typer

from ..core.disk.files import reason, shortened
from ..core.errors import InputError, LabcdpError, short_words
from .commands import Commands
from .terminal import log_to_terminal, say

#: Commands that can be resumed.
_RESUMED = ("acquire", "import", "sweep", "video")


class EndedBySignal(BaseException):
    """The process received a signal to end; error handlers must not catch this.

    Parameters
    ----------
    number : int
        Of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def unwinding() -> Iterator[None]:
    """Let SIGTERM and SIGHUP unwind the process, as Ctrl-C does, so that temporary files are removed.

    Raises
    ------
    EndedBySignal
        When one comes.
    """
    owner = os.getpid()

    def end(number: int, _frame: FrameType | None) -> None:
        if os.getpid() != owner:
            # A forked process has nothing to clean up.
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)
            return
        raise EndedBySignal(number)

    # Not all systems have SIGHUP; nohup ignores it.
    known = [signal.Signals[name] for name in ("SIGTERM", "SIGHUP") if name in signal.Signals.__members__]
    numbers = [number for number in known if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def what_is_left() -> str:
    """Return a message on what an interrupted command leaves."""
    command = next((argument for argument in sys.argv[1:] if not argument.startswith("-")), "")
    if command in _RESUMED:
        return "labcdp: stopped; recorded data are safe, and the same command resumes"
    return "labcdp: stopped; the same command starts again from the beginning"


#: Exit status of a program ended by Ctrl-C: 128 and the number of SIGINT.
_INTERRUPTED = 130

app = typer.Typer(
    cls=Commands,
    help="Measure the contrast detection probability (CDP) of cameras.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

#: Errors without a file name that come of writing the output and of nothing else; a device, too, gives EIO.
_OUTPUT_ERRORS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
#: Extras of the package, by the library that only they bring; see pyproject.toml.
_EXTRAS = {"av": "video", "distributed": "cluster", "panel": "web", "plotly": "web"}
#: A library that is there is not loaded where a limit of memory is too low.
_NO_LIBRARY = "raise the memory limit (ulimit -v), or reinstall labcdp"


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"labcdp {version('labcdp')}")
        raise typer.Exit


@app.callback()
def _options(
    verbose: bool = typer.Option(False, "--verbose", "-v", help="Also log device and file events."),
    _: bool = typer.Option(False, "--version", help="Show the version and exit.", is_eager=True, callback=_version),
) -> None:
    log_to_terminal(verbose)


def _require_no_empty_argument() -> None:
    """Refuse an empty argument, as of a shell variable that is not set: as a path it would be the current folder."""
    for before, argument in pairwise(sys.argv):
        if not argument or (argument.startswith("--") and argument.endswith("=")):
            raise InputError(f"the argument after {shortened(before)} is empty: give a value, or leave it out")


def _open_standard_streams() -> None:
    """Open the standard streams that are closed, or the next file would get their number and what is printed."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # The lowest free number is given.
            os.open(os.devnull, os.O_RDWR)
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


def main() -> None:
    """Run the command; an error is one line on standard error and exit status 1.

    Examples
    --------
    >>> import sys
    >>> from labcdp.cli import main
    >>> sys.argv = ["labcdp", "--version"]
    >>> try:
    ...     main()
    ... except SystemExit as end:
    ...     print(end.code)
    labcdp 0.2.0
    0
    """
    _open_standard_streams()
    # Figures are drawn into files only: whatever a notebook or a desktop sets is of no use here.
    os.environ["MPLBACKEND"] = "agg"
    # Imports make many objects that stay; looking through them again and again takes a twentieth of a short command.
    gc.set_threshold(10_000, 10, 10)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A terminal that does not know a character such as a superscript 2 shows a question mark; JSON has escapes.
            stream.reconfigure(errors="replace")
    try:
        _require_no_empty_argument()
        with unwinding():
            app()
        sys.stdout.flush()
    except MemoryError:
        say("labcdp: not enough memory: use fewer pixels or fewer values")
        sys.exit(1)
    except LabcdpError as error:
        say(f"labcdp: {error}")
        sys.exit(1)
    except SystemExit as end:
        # Typer turns Ctrl-C into this status without a message.
        if end.code == _INTERRUPTED:
            say(what_is_left())
        raise
    except EndedBySignal as ended:
        with suppress(OSError):  # the terminal may be gone
            say(what_is_left())
        sys.exit(128 + ended.number)
    except BrokenPipeError:
        # The reader of a pipe went away, for example `head`.
        sys.stderr.close()
        sys.exit(141)
    except ImportError as error:
        library = (error.name or "").partition(".")[0]
        if isinstance(error, ModuleNotFoundError) and library in _EXTRAS:
            extra = _EXTRAS[library]
            say(f"labcdp: this needs {library}, which is not installed: pip install 'labcdp[{extra}]', or [all]")
            sys.exit(1)
        say(f"labcdp: a library cannot be loaded ({reason(error)}): {_NO_LIBRARY}")
        sys.exit(1)
    except OSError as error:
        if error.filename is not None:
            name = short_words(os.fsdecode(error.filename))
            say(f"labcdp: {name} cannot be used ({reason(error)}): check name, folder and permissions")
            sys.exit(1)
        if error.errno not in _OUTPUT_ERRORS:
            advice = "check network, devices and limits such as memory (ulimit -v), then repeat"
            say(f"labcdp: the system refuses ({reason(error)}): {advice}")
            sys.exit(1)
        say(f"labcdp: the output cannot be written ({error.strerror}): free some disk space")
        # What is left in the buffer would fail again at exit.
        os._exit(1)
