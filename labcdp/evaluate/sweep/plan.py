"""What a sweep is: a chain, the parameters that are varied, and what is evaluated."""

from __future__ import annotations

from dataclasses import dataclass, fields
from hashlib import sha256
from importlib.metadata import version
from math import prod
from typing import Any

from ...chain import Chain, ImageScene
from ...core.disk.json_text import results_json
from ...core.errors import InputError
from ...core.finding import Finding, info
from .axis import Axis

#: Cells of a map that a computer holds and the user reads.
_MOST_CELLS = 1_000_000


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
                self.chain.with_(**{axis.parameter: value})
        stages = self.chain.stage_names
        if self.stage is None:
            object.__setattr__(self, "stage", stages[-1])
        elif self.stage not in stages:
            raise InputError(f"stage is {self.stage!r}: give one of {', '.join(stages)}")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis.values) for axis in self.axes)

    def findings(self) -> tuple[Finding, ...]:
        """Return what a user of the map should know."""
        lens = any(getattr(part, "focal_length_m", None) for _, part in self.chain.before)
        return (info("map-on-axis"),) if self.exact and lens else ()

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


def of_scene(chain: Chain, parameter: str) -> bool:
    """Whether a parameter is one of the scene that needs no new chain."""
    table, _, key = parameter.partition(".")
    return table == "scene" and key in {field.name for field in fields(chain.scene)} - {"width", "height"}  # type: ignore[arg-type]
