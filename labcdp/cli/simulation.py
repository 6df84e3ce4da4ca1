"""Commands presets, simulate, sweep and reproduce: the imaging chain without a bench."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import typer

from ..chain import Chain, ImageScene, preset_names, preset_text
from ..chain.predict.chain import known_transitions
from ..core.errors import InputError
from ..core.result import InputFile, Result
from ..core.table import Column, Table
from ..evaluate.sweep.maps.map import analyse_map
from ..evaluate.sweep.maps.page import write_map
from ..evaluate.sweep.maps.result import result as sweep_result
from ..evaluate.sweep.plan import Sweep, parse_axis
from ..evaluate.sweep.run import run_sweep
from ..evaluate.sweep.simulation.evaluation import evaluate_run
from ..evaluate.sweep.simulation.page import write_simulation
from ..evaluate.sweep.simulation.predicted import predicted_result, write_prediction
from ..evaluate.sweep.simulation.result import result as simulation_result
from ..evaluate.sweep.thesis import reproduce_thesis
from ..evaluate.sweep.thesis_report import thesis_result, write_thesis
from .options import parse_changes
from .output import Results
from .terminal import JSON_OPTION, fraction_of_percent, print_result, progress_bars, say

CHAIN_ARGUMENT = typer.Argument(help="Name of a preset (see labcdp presets), or chain file.")


@dataclass(frozen=True)
class ChainOptions:
    """Options of simulations: what is changed in a chain, and what is computed."""

    exact: bool = typer.Option(
        False,
        "--exact",
        help="Compute the distribution of DN instead of simulating: on the optical axis, for one pair of regions and "
        "an EMVA 1288 sensor.",
    )
    contrast: str | None = typer.Option(None, help="Contrast to detect, for example 100%; default: that of the scene.")
    epsilon: str = typer.Option("50%", help="Relative tolerance of the contrast.")
    changes: list[str] = typer.Option(
        [], "--set", help="Set a parameter, for example exposure.exposure_s=0.01; may be repeated."
    )
    seed: int = typer.Option(0, help="Random seed of the noise.", min=0)

    def chain(self, name: str) -> Chain:
        """Load a chain with the parameters that are set; raises InputError."""
        return Chain.load(name).with_(**parse_changes(self.changes))

    def asked(self) -> tuple[float | None, float]:
        """Return contrast and tolerance as fractions; raises InputError."""
        contrast = None if self.contrast is None else fraction_of_percent(self.contrast, "--contrast")
        return contrast, fraction_of_percent(self.epsilon, "--epsilon")


def presets(
    name: str | None = typer.Argument(None, help="Preset to print; default: list all."), as_json: bool = JSON_OPTION
) -> None:
    """List the imaging chains that ship with labcdp, or print one."""
    if name is not None and not as_json:
        typer.echo(preset_text(name), nl=False)
        return
    print_result(_presets(name), as_json)
    if not as_json:
        say("Next: labcdp simulate NAME, or labcdp init chain my.toml --preset NAME to change one")


def simulate(context: typer.Context, options: ChainOptions, results: Results, chain: str = CHAIN_ARGUMENT) -> None:
    """Simulate an imaging chain; compute signal, contrast and CDP after each stage."""
    loaded, asked = options.chain(chain), options.asked()
    with results.folder(context, chain) as folder:
        if options.exact:
            found = predicted_result(loaded, *asked, _inputs(chain, loaded))
            write_prediction(found, loaded, folder)
        else:
            run = loaded.run(options.seed)
            evaluation = evaluate_run(run, *asked)
            found = simulation_result(evaluation, _inputs(chain, loaded))
            write_simulation(found, evaluation, run, folder)
    results.show(found, folder)


def sweep(
    context: typer.Context,
    options: ChainOptions,
    results: Results,
    chain: str = CHAIN_ARGUMENT,
    over: list[str] = typer.Option(
        ...,
        help="Parameter and its values: NAME=a,b,c or NAME=START:STOP:COUNT[:log], for example "
        "scene.contrast=10%:100%:50; may be repeated.",
    ),
    stage: str | None = typer.Option(None, help="Stage to evaluate, for example sensor or hdr; default: the last."),
) -> None:
    """Map the CDP over parameters of an imaging chain; resume an interrupted sweep.

    Writes NetCDF, a picture, an interactive page and a spreadsheet.
    """
    loaded = options.chain(chain)
    axes = tuple(parse_axis(text) for text in over)
    wanted = Sweep(loaded, axes, options.exact, stage, *options.asked(), options.seed)
    with results.folder(context, chain) as folder:
        with progress_bars() as bars:
            dataset = run_sweep(wanted, folder, lambda done, total: bars.update("Cells", done, total))
        analysis = analyse_map(dataset, expected=known_transitions(loaded, wanted.stage))
        found = sweep_result(dataset, analysis, _inputs(chain, loaded), wanted.findings())
        write_map(found, dataset, analysis, folder)
    results.show(found, folder)


def reproduce(
    context: typer.Context,
    results: Results,
    what: str = typer.Argument(help="What to reproduce: thesis."),
    seeds: int = typer.Option(30, help="Number of random seeds.", min=5),
) -> None:
    """Reproduce the published values of the 2018 thesis, with its physics and with corrected physics."""
    if what != "thesis":
        raise InputError(f"there is nothing to reproduce called {what!r}: give thesis")
    with results.folder(context, what) as folder:
        with progress_bars() as bars:
            found = thesis_result(reproduce_thesis(seeds, lambda done, total: bars.update("Settings", done, total)))
        write_thesis(found, folder)
    results.show(found, folder)


def _presets(name: str | None) -> Result:
    """Return the list of all presets, or the parameters of one."""
    names = preset_names() if name is None else (name,)
    chains = {one: Chain.load(one) for one in names}
    columns = (Column("name", "name"), Column("description", "what it is"))
    rows = [{"name": one, "description": chain.description} for one, chain in chains.items()]
    documents = {} if name is None else {"chain": chains[name].document}
    return Result(
        "presets", name or "presets", (Table.of_rows("presets", "Presets", columns, rows),), (), (), documents
    )


def _inputs(name: str, chain: Chain) -> list[InputFile]:
    """Return the chain file, or the preset, and the picture that its scene reads."""
    if name in preset_names() and not Path(name).is_file():
        inputs = [InputFile("preset", name, sha256(preset_text(name).encode()).hexdigest())]
    else:
        inputs = [InputFile.of("chain", name)]
    return inputs + ([InputFile.of("picture", chain.scene.path)] if isinstance(chain.scene, ImageScene) else [])
