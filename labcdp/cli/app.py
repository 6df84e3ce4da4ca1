"""The command ``labcdp``: its subcommands, and what an error looks like to a person."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from io import TextIOWrapper

import typer

from ..errors import LabcdpError
from . import (
    acquire,
    bench,
    characterise,
    contrast_map,
    demo,
    devices,
    doctor,
    history,
    image,
    import_files,
    luminance,
    meter,
    rois,
    session,
    simulation,
    spectra,
    twin,
    verify,
    video,
)
from .ending import EndedBySignal, unwinding, what_is_left
from .terminal import log_to_terminal, say

#: Exit status of a program ended by Ctrl-C: 128 and the number of SIGINT.
_INTERRUPTED = 130

app = typer.Typer(
    help="Measure how probable it is that a driver-assistance camera still sees a contrast.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("devices")(devices.devices)
app.command("doctor")(doctor.doctor)
app.command("snap")(devices.snap)
app.command("meter")(meter.meter)
app.command("meter-test")(meter.meter_test)
app.command("acquire")(acquire.acquire)
app.command("import")(import_files.import_files)
app.command("calibrate")(session.calibrate)
app.command("evaluate")(session.evaluate)
app.command("replay")(session.replay)
app.command("luminance")(luminance.luminance)
app.command("characterise")(characterise.characterise)
app.command("verify")(verify.verify)
app.command("twin")(twin.twin)
app.command("history")(history.history)
app.command("rois")(rois.rois)
app.command("image")(image.image)
app.command("image-map")(contrast_map.image_map)
app.command("video")(video.video)
app.command("simulate-bench")(bench.simulate_bench)
app.command("spectra")(spectra.spectra)
app.command("presets")(simulation.presets)
app.command("simulate")(simulation.simulate)
app.command("sweep")(simulation.sweep)
app.command("reproduce")(simulation.reproduce)


class _Chosen:
    """The command that is run, once it is known."""

    command: str | None = None


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"labcdp {version('labcdp')}")
        raise typer.Exit


@app.callback()
def _options(
    context: typer.Context,
    verbose: bool = typer.Option(False, "--verbose", "-v", help="Also tell what the devices do."),
    _: bool = typer.Option(False, "--version", help="Tell the version and stop.", is_eager=True, callback=_version),
) -> None:
    log_to_terminal(verbose)
    if isinstance(context.obj, _Chosen):
        context.obj.command = context.invoked_subcommand


def main() -> None:
    """Run the command; an error is one line on standard error and exit status 1."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A terminal that does not know a character such as a superscript 2 shows a question mark.
            stream.reconfigure(errors="replace")
    chosen = _Chosen()
    try:
        with unwinding():
            app(obj=chosen)
        sys.stdout.flush()
    except MemoryError:
        say("labcdp: there is not enough memory for this: give fewer pixels or fewer values")
        sys.exit(1)
    except LabcdpError as error:
        say(f"labcdp: {' '.join(str(error).split())}")
        sys.exit(1)
    except SystemExit as end:
        # Typer turns Ctrl-C into this status without a word.
        if end.code == _INTERRUPTED:
            say(what_is_left(chosen.command))
        raise
    except EndedBySignal as ended:
        with suppress(OSError):  # the terminal may be gone
            say(what_is_left(chosen.command))
        sys.exit(128 + ended.number)
    except BrokenPipeError:
        # The reader of a pipe went away, for example `head`.
        sys.stderr.close()
        sys.exit(141)
    except OSError as error:
        if error.filename is not None:
            raise
        say(f"labcdp: the output cannot be written ({error.strerror}): make room where it goes")
        # What is left in the buffer would fail again at exit.
        os._exit(1)
