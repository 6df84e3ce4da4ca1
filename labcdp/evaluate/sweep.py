"""Sweeps: CDP and its relatives over any parameters of a chain, simulated or predicted, as a labelled array."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, fields
from hashlib import sha256
from importlib.metadata import version
from itertools import product
from math import nan, prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..chain import Chain, ImageScene, replaced
from ..contrast import Estimate
from ..errors import InputError
from ..json_text import results_json
from ..toml_text import toml_text
from .exact_chain import predict_chain
from .simulation import PairRow, RegionRow, evaluate_pair
from .sweep_axis import Axis
from .sweep_journal import SweepJournal

if TYPE_CHECKING:
    from xarray import Dataset

#: Variables of the result, with unit and description.
VARIABLES = {
    "cdp": ("1", "contrast detection probability"),
    "standard_error": ("1", "standard error of the CDP"),
    "below": ("1", "share of pairs with a lower contrast"),
    "above": ("1", "share of pairs with a higher contrast"),
    "mean_contrast": ("1", "mean contrast of the pairs with a dark value above 0"),
    "csnr": ("1", "mean over standard deviation of the contrast"),
    "snr_dark": ("1", "mean over standard deviation of the dark region's luminance"),
    "snr_bright": ("1", "mean over standard deviation of the bright region's luminance"),
    "snr_dark_standard_error": ("1", "standard error of the SNR of the dark region"),
    "snr_bright_standard_error": ("1", "standard error of the SNR of the bright region"),
    "saturated_share": ("1", "saturated share of the bright region"),
}

#: Cells predicted at once: a table is made for each block, so a map of usual size is one; so many take under a minute.
_BLOCK = 20_000

_UNITS = {"_cd_m2": "cd/m^2", "_s": "s", "_c": "degC", "_m": "m", "_db": "dB", "_e": "e-", "_e_s": "e-/s", "_dn": "DN"}

#: Share of saturated pixels from which a region has no SNR: what clipping takes from the noise is no signal.
_CLIPPED = 0.01

#: Cells of a map that a computer holds and a person reads.
_MOST_CELLS = 1_000_000

Cells = Sequence[tuple[Any, ...]]


@dataclass(frozen=True, eq=False)
class Sweep:
    """A sweep to be run.

    Parameters
    ----------
    chain : Chain
        The chain; its parameters are replaced by the axes' values. The first pair of regions of its scene is
        evaluated.
    axes : tuple of Axis
        At least one; the result has a dimension for each.
    exact : bool
        Whether to predict without random numbers instead of simulating.
    stage : str or None
        Stage that is evaluated, None for the last.
    contrast : float or None
        Weber contrast to be detected, a fraction; None for that of each cell's scene.
    epsilon : float
        Its tolerance.
    seed : int
        Of the noise; each cell of a simulated sweep has a seed of its own that follows from it.

    Raises
    ------
    InputError
        If the axes do not fit the chain: unknown parameter, value out of range, parameter twice.
    """

    chain: Chain
    axes: tuple[Axis, ...]
    exact: bool
    stage: str | None = None
    contrast: float | None = None
    epsilon: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        if not self.axes:
            raise InputError("there is nothing to sweep over: give at least one axis")
        if prod(self.shape) > _MOST_CELLS:
            raise InputError(
                f"the map would have {prod(self.shape)} cells: give fewer values, up to {_MOST_CELLS} cells"
            )
        names = [axis.parameter for axis in self.axes]
        if len(set(names)) < len(names):
            raise InputError(f"the axes are {', '.join(names)}: give each parameter once")
        for axis in self.axes:
            for value in axis.values:
                replaced(self.chain, {axis.parameter: value})
        stages = self.chain.stage_names
        if self.stage is None:
            object.__setattr__(self, "stage", stages[-1])
        elif self.stage not in stages:
            raise InputError(f"stage is {self.stage!r}: give one of {', '.join(stages)}")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def identity(self) -> dict[str, Any]:
        """Return all that decides the results."""
        scene = self.chain.scene
        return {
            "chain": sha256(results_json(self.chain.document).encode()).hexdigest(),
            # What a file holds is not in the chain.
            "image": sha256(scene.luminance_map().tobytes()).hexdigest() if isinstance(scene, ImageScene) else None,
            "axes": {axis.parameter: list(axis.values) for axis in self.axes},
            "exact": self.exact,
            "stage": self.stage,
            "contrast": self.contrast,
            "epsilon": self.epsilon,
            "seed": self.seed,
            "labcdp": version("labcdp"),
        }


def run_sweep(sweep: Sweep, folder: Path | None = None, progress: Callable[[int, int], None] | None = None) -> Dataset:
    """Run a sweep, or what is left of it.

    Parameters
    ----------
    sweep : Sweep
        What to run.
    folder : Path or None
        Where finished cells are kept in a journal; the same sweep started again goes on there. None keeps nothing.
    progress : callable or None
        Told how many of how many cells are done.

    Returns
    -------
    xarray.Dataset
        The variables of `VARIABLES` over the axes.

    Raises
    ------
    InputError
        If the folder holds another sweep or cannot be written, or a cell cannot be calculated.
    """
    cells = list(product(*(axis.values for axis in sweep.axes)))
    values = np.full((len(cells), len(VARIABLES)), np.nan)
    done = np.zeros(len(cells), bool)
    journal = None if folder is None else SweepJournal.open(folder, sweep.identity())
    try:
        for first, block in () if journal is None else journal.finished:
            values[first : first + len(block)] = block
            done[first : first + len(block)] = True
        left = _blocks(sweep, done)
        calculate = _predicted if sweep.exact else _simulated
        for first, block in calculate(sweep, cells, left):
            values[first : first + len(block)] = block
            done[first : first + len(block)] = True
            if journal is not None:
                journal.add(first, block)
            if progress is not None:
                progress(int(done.sum()), len(cells))
    finally:
        if journal is not None:
            journal.close()
    return _labelled(sweep, values)


def _blocks(sweep: Sweep, done: NDArray[np.bool_]) -> list[range]:
    """Return the cells that are left in blocks: single cells to simulate, runs of one chain to predict."""
    if not sweep.exact:
        return [range(index, index + 1) for index in np.flatnonzero(~done).tolist()]
    # Axes of the scene at the end of the list need no new chain, so their cells are predicted together.
    trailing = 1
    for axis in reversed(sweep.axes):
        if not _of_scene(sweep.chain, axis.parameter):
            break
        trailing *= len(axis.values)
    blocks = []
    for start in range(0, done.size, trailing):
        for first in range(start, start + trailing, _BLOCK):
            block = range(first, min(first + _BLOCK, start + trailing))
            if not done[block.start : block.stop].all():
                blocks.append(block)
    return blocks


def _of_scene(chain: Chain, parameter: str) -> bool:
    table, _, key = parameter.partition(".")
    return table == "scene" and key in {field.name for field in fields(chain.scene)} - {"width", "height"}  # type: ignore[arg-type]


def _predicted(sweep: Sweep, cells: Cells, blocks: Sequence[range]) -> Iterator[tuple[int, NDArray[np.float64]]]:
    names = [axis.parameter for axis in sweep.axes]
    in_scene = [name for name in names if _of_scene(sweep.chain, name)]
    for block in blocks:
        settings = [dict(zip(names, cells[index], strict=True)) for index in block]
        # A block has one value of each parameter outside the scene; see `_blocks`.
        outside = {name: value for name, value in settings[0].items() if name not in in_scene}
        inside = {name.partition(".")[2]: [cell[name] for cell in settings] for name in in_scene}
        chain = replaced(sweep.chain, outside) if outside else sweep.chain
        found = predict_chain(chain, inside, stage=sweep.stage, contrast=sweep.contrast, epsilon=sweep.epsilon)
        values = {name: getattr(found, name, np.full(len(block), nan)) for name in VARIABLES}
        values["snr_bright"] = np.where(found.saturated_share < _CLIPPED, found.snr_bright, nan)
        values["snr_dark"] = np.where(found.saturated_share_dark < _CLIPPED, found.snr_dark, nan)
        yield block.start, np.stack(list(values.values()), axis=1)


def _simulated(sweep: Sweep, cells: Cells, blocks: Sequence[range]) -> Iterator[tuple[int, NDArray[np.float64]]]:
    names = [axis.parameter for axis in sweep.axes]

    def simulate(index: int) -> tuple[int, NDArray[np.float64]]:
        chain = replaced(sweep.chain, dict(zip(names, cells[index], strict=True)))
        # A seed of its own for each cell, whichever cells are left and in whatever order they finish.
        seed = int(np.random.SeedSequence(sweep.seed, spawn_key=(index,)).generate_state(1)[0])
        run = chain.run(seed, threads=1)
        assert sweep.stage is not None
        return index, _row(*evaluate_pair(run, sweep.stage, sweep.contrast, sweep.epsilon))

    waiting = iter(blocks)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        running: set[Future[tuple[int, NDArray[np.float64]]]] = set()
        try:
            while True:
                while len(running) < 2 * (os.cpu_count() or 1) and (block := next(waiting, None)) is not None:
                    running.add(pool.submit(simulate, block.start))
                if not running:
                    return
                finished, running = wait(running, return_when=FIRST_COMPLETED)
                for future in finished:
                    index, row = future.result()
                    yield index, row[None]
        finally:
            for future in running:
                future.cancel()


def _row(pair: PairRow, dark: RegionRow, bright: RegionRow) -> NDArray[np.float64]:
    """Return the variables of `VARIABLES` for one cell; where no pixel is above 0 cd/m^2, nothing is detected."""
    found = pair.cdp
    shares = (0.0, np.nan, 1.0, 0.0) if found is None else (found.cdp, found.standard_error, found.below, found.above)
    snr = [one.luminance_snr if one.saturated_share < _CLIPPED else Estimate(nan, nan) for one in (dark, bright)]
    values = [one.value for one in snr]
    errors = [one.standard_error for one in snr]
    return np.array([*shares, pair.mean_contrast, pair.csnr.value, *values, *errors, bright.saturated_share])


def _labelled(sweep: Sweep, values: NDArray[np.float64]) -> Dataset:
    from xarray import Dataset

    names = [axis.parameter for axis in sweep.axes]
    variables = {
        name: (names, values[:, column].reshape(sweep.shape), {"unit": unit, "long_name": long_name})
        for column, (name, (unit, long_name)) in enumerate(VARIABLES.items())
    }
    coordinates = {
        axis.parameter: ([axis.parameter], np.array(axis.values), {"unit": _unit(axis), "long_name": _words(axis)})
        for axis in sweep.axes
    }
    asked = float("nan") if sweep.contrast is None else sweep.contrast
    attributes: Mapping[str, Any] = {
        "title": f"{sweep.chain.name or 'chain'}: CDP behind {sweep.stage}",
        "contrast": _scene_contrast(sweep) if sweep.contrast is None else asked,
        "epsilon": sweep.epsilon,
        "method": "exact" if sweep.exact else "simulated",
        "stage": sweep.stage,
        "position": "optical axis" if sweep.exact else "whole frame",
        "seed": sweep.seed,
        "labcdp_version": version("labcdp"),
        "chain": toml_text(sweep.chain.document),
    }
    return Dataset(variables, coordinates, attributes)


def _scene_contrast(sweep: Sweep) -> float:
    """Contrast of the scene if it is the same in all cells, else nan."""
    if any(_of_scene(sweep.chain, axis.parameter) and axis.parameter != "scene.luminance_cd_m2" for axis in sweep.axes):
        return float("nan")
    return float(getattr(sweep.chain.scene, "contrast", float("nan")))


def _unit(axis: Axis) -> str:
    if not axis.numeric:
        return ""
    endings = [ending for ending in _UNITS if axis.parameter.endswith(ending)]
    return _UNITS[max(endings, key=len)] if endings else "1"


def _words(axis: Axis) -> str:
    table, _, key = axis.parameter.partition(".")
    for ending in sorted(_UNITS, key=len, reverse=True):
        if key.endswith(ending):
            key = key[: -len(ending)]
            break
    return f"{table} {key}".replace("_", " ").strip()
