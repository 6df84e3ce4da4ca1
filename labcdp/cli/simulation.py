"""Commands presets, simulate, sweep and reproduce: the imaging chain without a bench."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated

import typer

from ..chain import Chain, ImageScene, preset_names, preset_text
from ..chain.scene.spectra import spectra_of
from ..core.errors import InputError
from ..core.result import InputFile, Result
from ..core.table import Column, Table
from ..evaluate.sweep.maps.map import analyse_map
from ..evaluate.sweep.maps.page import map_files
from ..evaluate.sweep.maps.result import result as sweep_result
from ..evaluate.sweep.plan import Axis, Sweep, parse_axis
from ..evaluate.sweep.run import run_sweep
from ..evaluate.sweep.simulation.evaluation import evaluate_run
from ..evaluate.sweep.simulation.page import prediction_files, simulation_files
from ..evaluate.sweep.simulation.result import predicted_result
from ..evaluate.sweep.simulation.result import result as simulation_result
from ..evaluate.sweep.thesis import reproduce_thesis
from ..evaluate.sweep.thesis_report import thesis_files, thesis_result
from .commands import As, as_json
from .options import Changes, ClusterOptions, Contrasts, Results, Seconds, Seed, Tolerance, one_or_all
from .terminal import print_result, progress_bar

ChainName = Annotated[str, As("Name of a preset (see labcdp presets), or chain file.")]
#: Parameters of a chain and their values.
Axes = Annotated[tuple[Axis, ...], As(parse=lambda texts, _: tuple(map(parse_axis, texts)), many=True)]


@dataclass(frozen=True)
class ChainOptions:
    """Options of simulations: what is changed in a chain, and what is computed.

    Parameters
    ----------
    exact
        Compute the distribution of DN instead of simulating: on the optical axis, for one pair of regions and an EMVA
        1288 sensor.
    contrast
        Target contrasts: 100%, a list such as 50%,100%, or a range START:STOP:COUNT[:log] such as 10%:200%:20. May
        be repeated; default: that of the scene.
    changes
        Set a parameter, for example exposure.exposure_s=0.01; may be repeated.
    """

    exact: bool = False
    contrast: Contrasts = None
    epsilon: Tolerance = 0.5
    changes: Changes = ()
    seed: Seed = 0


def presets(name: str | None = None) -> None:
    """List the imaging chains that ship with labcdp, or print one.

    Parameters
    ----------
    name
        Preset to print; default: list all.
    """
    if name is not None and not as_json():
        typer.echo(preset_text(name), nl=False)
        return
    chains = {preset: Chain.load(preset) for preset in (preset_names() if name is None else (name,))}
    columns = (Column("name", "name"), Column("description", "what it is"))
    data = {"name": list(chains), "description": [chain.description for chain in chains.values()]}
    documents = {} if name is None else {"chain": chains[name].document}
    table = Table("presets", "Presets", columns, data)
    following = "Next: labcdp simulate NAME, or labcdp init chain my.toml --preset NAME to change one"
    print_result(Result("presets", name or "presets", (table,), (), (), documents), following)


def simulate(options: ChainOptions, results: Results, chain: ChainName) -> None:
    """Simulate an imaging chain; compute signal, contrast and CDP after each stage."""
    loaded, targets = Chain.load(chain).with_(**dict(options.changes)), (one_or_all(options.contrast), options.epsilon)
    with results.folder(chain) as folder:
        if options.exact:
            result = predicted_result(loaded, *targets, _inputs(chain, loaded))
            folder.add(prediction_files(result, loaded))
        else:
            evaluation = evaluate_run(loaded.run(options.seed), *targets)
            result = simulation_result(evaluation, _inputs(chain, loaded))
            folder.add(simulation_files(result, evaluation))
    results.show(result, folder)


def sweep(
    options: ChainOptions,
    where: ClusterOptions,
    results: Results,
    chain: ChainName,
    *,
    over: Axes,
    stage: str | None = None,
    flicker: bool = False,
    row_time: Seconds | None = None,
) -> None:
    """Map the CDP over parameters of an imaging chain; resume an interrupted sweep.

    Writes NetCDF, a picture, an interactive page and a spreadsheet.

    Parameters
    ----------
    over
        Parameter and its values: NAME=a,b,c or NAME=START:STOP:COUNT[:log], for example scene.contrast=10%:100%:50; may
        be repeated.
    stage
        Stage to evaluate, for example sensor or hdr; default: the last.
    flicker
        Map FMI, MMP and FDI of the pulsed lamp in a scene of type lamp, computed without random numbers, instead of
        CDP.
    row_time
        Time by which each row of a rolling shutter begins later, for example 15us, for --flicker.
    """
    from ..chain.predict.chain import known_transitions

    if flicker:
        _flicker_map(options, results, chain, over, stage, row_time or 0.0)
        return
    if row_time is not None:
        raise InputError("--row-time needs --flicker: CDP has no rolling shutter")
    loaded = Chain.load(chain).with_(**dict(options.changes))
    wanted = Sweep(loaded, over, options.exact, stage, one_or_all(options.contrast), options.epsilon, options.seed)
    with results.folder(chain) as folder:
        with progress_bar("Cells") as report:
            dataset = run_sweep(wanted, folder, report, where.chosen_workers())
        analysis = analyse_map(dataset, expected=known_transitions(loaded, wanted.stage))
        result = sweep_result(dataset, analysis, _inputs(chain, loaded), wanted.findings())
        folder.add(map_files(result, dataset, analysis))
    results.show(result, folder)


def _flicker_map(
    options: ChainOptions, results: Results, name: str, over: Axes, stage: str | None, row_time_s: float
) -> None:
    """Map the flicker of the pulsed lamp in a scene."""
    from ..evaluate.flicker.predicted import map_files as flicker_files
    from ..evaluate.flicker.predicted import map_result, predict_flicker

    if options.contrast is not None:
        raise InputError("--flicker compares no regions: leave --contrast out")
    loaded = Chain.load(name).with_(**dict(options.changes))
    with results.folder(name) as folder:
        dataset = predict_flicker(loaded, over, stage=stage, row_time_s=row_time_s)
        result = map_result(dataset, _inputs(name, loaded))
        folder.add(flicker_files(result, dataset))
    results.show(result, folder)


def reproduce(results: Results, what: str, *, seeds: Annotated[int, As(least=5)] = 30) -> None:
    """Reproduce the published values of the 2018 thesis, with its physics and with corrected physics.

    Parameters
    ----------
    what
        What to reproduce: thesis.
    seeds
        Number of random seeds.
    """
    if what != "thesis":
        raise InputError(f"cannot reproduce {what!r}: give thesis")
    with results.folder(what) as folder:
        with progress_bar("Settings") as report:
            result = thesis_result(reproduce_thesis(seeds, report))
        folder.add(thesis_files(result))
    results.show(result, folder)


def _inputs(name: str, chain: Chain) -> list[InputFile]:
    """Return the chain file, or the preset, and the picture that its scene reads."""
    if name in preset_names() and not Path(name).is_file():
        inputs = [InputFile("preset", name, sha256(preset_text(name).encode()).hexdigest())]
    else:
        inputs = [InputFile.of("chain", name)]
    pictures = [InputFile.of("picture", chain.scene.path)] if isinstance(chain.scene, ImageScene) else []
    emissions = [spectrum.emission_path for spectrum in spectra_of(chain.scene)]
    return inputs + pictures + [InputFile.of("emission", path) for path in emissions if path is not None]
