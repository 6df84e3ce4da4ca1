"""Commands presets, simulate, sweep and reproduce: the imaging chain without a bench."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from ..errors import InputError
from .terminal import JSON_OPTION, fraction_of_percent, print_json, print_table, progress_bars, say

if TYPE_CHECKING:
    from ..chain import Chain

#: A longer table of usable ranges is left to the page.
_MOST_ROWS = 20

CHAIN_ARGUMENT = typer.Argument(help="Name of a preset (see labcdp presets), or a chain file.")
CONTRAST_OPTION = typer.Option(None, help="Contrast to detect, for example 100%; default: that of the scene.")
EPSILON_OPTION = typer.Option("50%", help="Tolerance of the contrast.")
SEED_OPTION = typer.Option(0, help="Of the noise.", min=0)
SET_OPTION = typer.Option(
    [], "--set", help="Another value for a parameter, for example exposure.exposure_s=0.01; may be repeated."
)


def presets(
    name: str | None = typer.Argument(None, help="Preset to show; default: list all."),
    output: Path | None = typer.Option(None, "--output", "-o", help="Write it to this new file."),
    as_json: bool = JSON_OPTION,
) -> None:
    """List the chains that ship with labcdp, or write one as a file to start from."""
    from ..chain import load, preset_names, preset_text

    if name is None:
        if output is not None:
            raise InputError("--output needs the name of a preset: give one of " + ", ".join(preset_names()))
        chains = {known: load(known).description for known in preset_names()}
        if as_json:
            print_json(chains)
        else:
            print_table("Presets", ("name", "what it is"), list(chains.items()))
            say("Next: labcdp simulate NAME, or labcdp presets NAME --output my.toml to change one")
        return
    text = preset_text(name)
    if output is None:
        if as_json:
            print_json(dict(load(name).document))
        else:
            typer.echo(text, nl=False)
        return
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError:
        raise InputError(f"{output} exists: give the name of a new file") from None
    except OSError as error:
        raise InputError(f"{output} cannot be written ({error.strerror}): give another file") from error
    say(f"Written: {output}")
    say(f"Next: labcdp simulate {output}")


def simulate(
    chain: str = CHAIN_ARGUMENT,
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="CHAIN-simulation"
    ),
    contrast: str | None = CONTRAST_OPTION,
    epsilon: str = EPSILON_OPTION,
    changes: list[str] = SET_OPTION,
    seed: int = SEED_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Send a scene through the imaging chain; tell signal, contrast and detection probability behind each stage."""
    from ..evaluate import evaluate_run
    from ..report import detection_table, signal_table, simulation_values, write_simulation

    loaded = _chain(chain, changes)
    asked, tolerance = _asked(contrast), fraction_of_percent(epsilon, "--epsilon")
    run = loaded.run(seed)
    evaluation = evaluate_run(run, asked, tolerance)
    folder = output or Path(f"{Path(chain).stem if chain.endswith('.toml') else chain}-simulation")
    write_simulation(evaluation, run, folder)
    if as_json:
        print_json({"output": str(folder), **simulation_values(evaluation)})
        return
    for warning in evaluation.warnings:
        say(f"Warning: {warning}")
    print_table("Signal and noise", *signal_table(evaluation))
    if evaluation.stages[0].pairs:
        print_table("Contrast detection probability", *detection_table(evaluation))
    say(f"Report: {folder / 'report.html'}")


def sweep(
    chain: str = CHAIN_ARGUMENT,
    over: list[str] = typer.Option(
        ...,
        help="Parameter and its values: NAME=a,b,c or NAME=start:stop:count or NAME=start:stop:count:log, "
        "for example scene.contrast=10%:100%:50; may be repeated.",
    ),
    exact: bool = typer.Option(
        False,
        "--exact",
        help="Predict without random numbers instead of simulating: on the optical axis, for one pair of uniform "
        "patches behind an EMVA 1288 sensor.",
    ),
    stage: str | None = typer.Option(None, help="Stage to evaluate, for example sensor or hdr; default: the last."),
    output: Path | None = typer.Option(
        None, "--output", "-o", help="Folder for the results.", show_default="CHAIN-sweep"
    ),
    contrast: str | None = CONTRAST_OPTION,
    epsilon: str = EPSILON_OPTION,
    changes: list[str] = SET_OPTION,
    seed: int = SEED_OPTION,
    as_json: bool = JSON_OPTION,
) -> None:
    """Map the detection probability over parameters of a chain; a sweep that was broken off goes on.

    Writes NetCDF, a picture, an interactive page and a spreadsheet.
    """
    from ..evaluate import Sweep, analyse_map, parse_axis, run_sweep
    from ..report import map_notes, map_values, usable_table, write_map

    loaded = _chain(chain, changes)
    axes = tuple(parse_axis(text) for text in over)
    wanted = Sweep(loaded, axes, exact, stage, _asked(contrast), fraction_of_percent(epsilon, "--epsilon"), seed)
    folder = output or Path(f"{Path(chain).stem if chain.endswith('.toml') else chain}-sweep")
    with progress_bars() as bars:
        result = run_sweep(wanted, folder, lambda done, total: bars.update("Cells", done, total))
    if exact and any(getattr(part, "focal_length_m", None) for _, part in loaded.before):
        say("Note: --exact is for the optical axis; the lens' fall-off towards the corners is left out")
    expected = _transitions(loaded, wanted.stage)
    write_map(result, folder, expected=expected)
    analysis = analyse_map(result, expected=expected)
    if as_json:
        print_json({"output": str(folder), **map_values(result, analysis)})
        return
    table = usable_table(result, analysis)
    if 0 < len(table.rows) <= _MOST_ROWS:
        print_table("Usable range", *table)
    for note in map_notes(result, analysis):
        say(note)
    say(f"CDP behind {wanted.stage}, {'predicted' if exact else 'simulated'}")
    say(f"Map: {folder / 'map.html'}; also map.png, map.xlsx, map.nc and map.json")


def reproduce(
    what: str = typer.Argument(help="What to reproduce: thesis."),
    seeds: int = typer.Option(30, help="Number of seeds; few tell little of the scatter.", min=5),
    output: Path = typer.Option(Path("thesis-reproduction"), "--output", "-o", help="Folder for the results."),
    as_json: bool = JSON_OPTION,
) -> None:
    """Compute the published values of the 2018 thesis anew, with its physics and with the correct one."""
    from ..evaluate import reproduce_thesis
    from ..report import figure_table, place_for_results, thesis_table, thesis_values, write_thesis

    if what != "thesis":
        raise InputError(f"there is nothing to reproduce called {what!r}: give thesis")
    # Not after minutes of work.
    with place_for_results(output):
        with progress_bars() as bars:
            result = reproduce_thesis(seeds, lambda done, total: bars.update("Settings", done, total))
        write_thesis(result, output)
    if as_json:
        print_json({"output": str(output), **thesis_values(result)})
        return
    print_table(f"Table 5.3: dark squares; mean ± standard deviation over {seeds} seeds", *thesis_table(result))
    print_table("Figure 3.10", *figure_table(result))
    for row in result.table:
        if row.published.explanation:
            say(f"Row {row.published.label}: {row.published.explanation}")
    say(f"Report: {output / 'report.html'}")


def _chain(name: str, changes: list[str]) -> Chain:
    from ..chain import load, replaced
    from ..evaluate import parse_axis

    values = {}
    for text in changes:
        if "=" not in text:
            raise InputError(f"--set is {text!r}: give NAME=VALUE, for example exposure.exposure_s=0.01")
        axis = parse_axis(text)
        values[axis.parameter] = axis.values[0] if len(axis.values) == 1 else list(axis.values)
    chain = load(name)
    return replaced(chain, values) if values else chain


def _transitions(chain: Chain, stage: str | None) -> tuple[float, ...]:
    """Luminances at which the merge changes exposure, if they can be known."""
    from ..evaluate import transition_luminances

    try:
        return transition_luminances(chain, stage)
    except InputError:
        return ()


def _asked(contrast: str | None) -> float | None:
    return None if contrast is None else fraction_of_percent(contrast, "--contrast")
