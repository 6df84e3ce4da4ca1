"""Sweeps: CDP and its relatives over any parameters of a chain, simulated or predicted, as a labelled array."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from importlib.metadata import version
from math import nan, prod
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from ...core.cluster import Workers
from ...core.computer import Threads
from ...core.disk import validated_as
from ...core.disk.journal import LineJournal
from ...core.errors import InputError
from ...core.quantity import Quantity
from ...metrics.contrast import each_contrast
from ...output import Destination, results_journal
from .maps.axes import TO_DETECT, UNITS, VARIABLES
from .plan import Axis, Sweep, is_scene_parameter
from .simulation.evaluation import evaluate_pair
from .simulation.rows import PairRow, StageLuminance

if TYPE_CHECKING:
    from xarray import Dataset

#: Variables that depend on the contrast to be detected.
_OF_CONTRAST = ("cdp", "standard_error", "below", "above")


def map_title(chain_name: str, stage: str | None) -> str:
    """Return the title of a map of a chain."""
    return f"{chain_name}: CDP after {stage}"


def labelled(sweep: Sweep, values: NDArray[np.float64]) -> Dataset:
    """Label the values of all cells, shape (cells, variables)."""
    from xarray import Dataset

    names = [axis.parameter for axis in sweep.dimensions]
    several = names[-1] == TO_DETECT
    variables = {}
    for (name, column), cells in zip(VARIABLES.items(), values.T.reshape(-1, *sweep.shape), strict=True):
        described = {"unit": "1", "long_name": f"{column.meaning[0].lower()}{column.meaning[1:-1]}"}
        alike = several and name not in _OF_CONTRAST
        variables[name] = (names[:-1], cells[..., 0], described) if alike else (names, cells, described)
    coordinates = {
        axis.parameter: ([axis.parameter], np.array(axis.values), _described(axis)) for axis in sweep.dimensions
    }
    scalar_contrast = (
        {} if several else {"contrast": _scene_contrast(sweep) if sweep.contrast is None else sweep.contrast}
    )
    attributes: Mapping[str, Any] = {
        "title": map_title(sweep.chain.name or "chain", sweep.stage),
        "chain_name": sweep.chain.name or "chain",
        **scalar_contrast,
        "epsilon": sweep.epsilon,
        "method": "exact" if sweep.exact else "simulated",
        "stage": sweep.stage,
        "position": "optical axis" if sweep.exact else "whole frame",
        "seed": sweep.seed,
        "labcdp_version": version("labcdp"),
        "chain": sweep.chain.to_toml(),
    }
    return Dataset(variables, coordinates, attributes)


def _scene_contrast(sweep: Sweep) -> float:
    """Contrast of the scene if it is the same in all cells, else nan."""
    if any(
        is_scene_parameter(sweep.chain, axis.parameter) and axis.parameter != "scene.luminance_cd_m2"
        for axis in sweep.axes
    ):
        return float("nan")
    return float(getattr(sweep.chain.scene, "contrast", float("nan")))


def _described(axis: Axis) -> dict[str, str]:
    """Return unit and description of a parameter, by the end of its name, as attributes of its coordinate."""
    ending = max((ending for ending in UNITS if axis.parameter.endswith(ending)), key=len, default="")
    table, _, key = axis.parameter.removesuffix(ending).partition(".")
    words = "target contrast" if axis.parameter == TO_DETECT else f"{'' if key == table else table} {key}"
    unit = UNITS.get(ending, "1") if axis.numeric else ""
    return {"unit": unit, "long_name": words.replace("_", " ").strip()}


#: Name of the journal in the folder of the results.
JOURNAL = "sweep.jsonl"
#: Cells predicted at once: a table is made for each block, so a map of usual size is a single block, which takes under
#: a minute.
_BLOCK = 20_000

#: Share of saturated pixels from which a region has no SNR: what clipping takes from the noise is no signal.
_CLIPPED = 0.01

#: Packages on which results depend to the last bit.
_PACKAGES = ("labcdp", "numpy", "numba", "scipy")


class _Block(BaseModel):
    """Finished cells as the journal keeps them, those from `first` on."""

    model_config = ConfigDict(extra="forbid")
    first: int = Field(ge=0)
    values: list[Annotated[list[float], Field(min_length=len(VARIABLES), max_length=len(VARIABLES))]] = Field(
        min_length=1
    )


def run_sweep(
    sweep: Sweep,
    folder: Destination | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: Workers | None = None,
) -> Dataset:
    """Run a sweep, or what is left of it.

    Parameters
    ----------
    sweep : Sweep
        The sweep to run.
    folder : path, ResultsFolder or None
        Where finished cells are kept in a journal; the same sweep started again resumes there. None keeps nothing.
    progress : callable or None
        Called with the number of cells done and in total.
    workers : Workers or None
        Workers that calculate the cells; None for a thread a core. Results are the same with any.

    Returns
    -------
    xarray.Dataset
        The variables of `VARIABLES` over the axes, CDP also over several contrasts to be detected.

    Raises
    ------
    InputError
        If the folder holds another sweep or cannot be written, a cell cannot be calculated, or the cluster cannot be
        reached.
    """
    n_cells = prod(sweep.shape)
    values = np.full((n_cells, len(VARIABLES)), np.nan)
    done = np.zeros(n_cells, bool)
    with ExitStack() as stack:
        journal = None
        if folder is not None:
            journal = stack.enter_context(results_journal(folder, "sweep", JOURNAL, sweep.identity(), "sweep"))
        for first, block in () if journal is None else _recorded(journal, n_cells):
            values[first : first + len(block)] = block
            done[first : first + len(block)] = True
        packages = {name: version(name) for name in _PACKAGES}
        run = stack.enter_context((workers or Workers()).opened(Threads[range], None, packages))
        for cells, values_of_cells, error in run.run(
            _predicted if sweep.exact else _simulated, _blocks(sweep, done), sweep
        ):
            if values_of_cells is None:
                raise error or InputError("no cell was calculated")
            values[cells.start : cells.stop] = values_of_cells
            done[cells.start : cells.stop] = True
            if journal is not None:
                journal.add({"first": cells.start, "values": values_of_cells.tolist()})
            if progress is not None:
                progress(int(done.sum()), n_cells)
    return labelled(sweep, values)


def _recorded(journal: LineJournal, n_cells: int) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Blocks that are in a journal: number of the first cell, and values of shape (cells, variables)."""
    for row in journal.rows():
        block = validated_as(_Block, row)
        if block.first + len(block.values) > n_cells:
            raise InputError(
                f"{journal.path} contains a cell that does not belong to this sweep: remove the file and start again"
            )
        yield block.first, np.array(block.values)


def _blocks(sweep: Sweep, done: NDArray[np.bool_]) -> list[range]:
    """Return the cells that are left in blocks: all contrasts of an image to simulate, runs of one chain to predict."""
    if not sweep.exact:
        n = len(each_contrast(sweep.contrast))
        return [range(first, first + n) for first in range(0, done.size, n) if not done[first]]
    # Contrasts and axes of the scene at the end of the list need no new chain, so their cells are predicted together.
    trailing = 1
    for axis in reversed(sweep.dimensions):
        if axis.parameter != TO_DETECT and not is_scene_parameter(sweep.chain, axis.parameter):
            break
        trailing *= len(axis.values)
    return [
        block
        for start in range(0, done.size, trailing)
        for first in range(start, start + trailing, _BLOCK)
        for block in (range(first, min(first + _BLOCK, start + trailing)),)
        if not done[block.start : block.stop].all()
    ]


def _setting(sweep: Sweep, cell: int) -> dict[str, Any]:
    """Parameters of a cell; the last dimension is the fastest."""
    places = np.unravel_index(cell, sweep.shape)
    return {axis.parameter: axis.values[index] for axis, index in zip(sweep.dimensions, places, strict=True)}


def _predicted(block: range, sweep: Sweep) -> NDArray[np.float64]:
    from ...chain.predict.chain import predict_chain

    settings = [_setting(sweep, cell) for cell in block]
    targets = [cell.pop(TO_DETECT, sweep.contrast) for cell in settings]
    in_scene = [name for name in settings[0] if is_scene_parameter(sweep.chain, name)]
    # A block has one value of each parameter outside the scene; see `_blocks`.
    outside = {name: value for name, value in settings[0].items() if name not in in_scene}
    inside = {name.partition(".")[2]: [cell[name] for cell in settings] for name in in_scene}
    chain = sweep.chain.with_(**outside) if outside else sweep.chain
    prediction = predict_chain(
        chain, inside, stage=sweep.stage, contrast=None if sweep.contrast is None else targets, epsilon=sweep.epsilon
    )
    values = {name: getattr(prediction, name, np.full(len(block), nan)) for name in VARIABLES}
    values["snr_bright"] = np.where(prediction.saturated_share < _CLIPPED, prediction.snr_bright, nan)
    values["snr_dark"] = np.where(prediction.saturated_share_dark < _CLIPPED, prediction.snr_dark, nan)
    return np.stack(list(values.values()), axis=1)


def _simulated(block: range, sweep: Sweep) -> NDArray[np.float64]:
    # A seed of its own for each image, whichever are left and in whatever order they finish.
    seed = int(np.random.SeedSequence(sweep.seed, spawn_key=(block.start // len(block),)).generate_state(1)[0])
    assert sweep.stage is not None
    setting = _setting(sweep, block.start)
    setting.pop(TO_DETECT, None)
    run = sweep.chain.with_(**setting).run(seed, threads=1)
    pairs, *regions = evaluate_pair(run, sweep.stage, sweep.contrast, sweep.epsilon)
    return np.stack([_row(pair, *regions) for pair in pairs])


def _row(pair: PairRow, dark: StageLuminance, bright: StageLuminance) -> NDArray[np.float64]:
    """Return the variables of `VARIABLES` for one cell; where no pixel is above 0 cd/m^2, nothing is detected."""
    cdp = pair.cdp
    shares = (0.0, np.nan, 1.0, 0.0) if cdp is None else (cdp.cdp, cdp.u, cdp.below, cdp.above)
    snr = [
        region.luminance_snr if region.saturated_share < _CLIPPED else Quantity(nan, nan) for region in (dark, bright)
    ]
    values = [ratio.value for ratio in snr]
    errors = [ratio.u for ratio in snr]
    return np.array([*shares, pair.mean_contrast, pair.csnr.value, *values, *errors, bright.saturated_share])
