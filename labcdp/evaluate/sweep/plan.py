"""Plan of a sweep: a chain, the parameters that are varied with their values, and the contrasts to detect."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from hashlib import sha256
from importlib.metadata import version
from math import prod
from typing import Any

import numpy as np

from ...chain import Chain, ImageScene
from ...chain.scene.spectra import spectra_of
from ...core.disk.files import shown
from ...core.disk.text import results_json
from ...core.errors import InputError
from ...core.percent import plain_fraction
from ...core.result import Finding, info
from ...metrics.contrast import TargetContrasts
from .maps.axes import TO_DETECT

Value = float | int | str

_HOW = "give NAME=a,b,c or NAME=start:stop:count or NAME=start:stop:count:log, for example scene.contrast=10%:100%:50"

#: Most values of an axis; more are probably a typing error.
_MOST_VALUES = 100_000


@dataclass(frozen=True)
class Axis:
    """One parameter of a chain and the values it takes.

    Parameters
    ----------
    parameter : str
        Table and key, for example ``scene.luminance_cd_m2``.
    values : sequence or array of float, int or str
        At least one, no two equal; all numbers or all text. Held as a tuple.

    Raises
    ------
    InputError
        If there is no value, two are equal, or they are not all numbers or all text.
    """

    parameter: str
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        given: Any = self.values
        given = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
        is_list = isinstance(given, Sequence) and not isinstance(given, str)
        values = (
            tuple(plain_fraction(value.item() if isinstance(value, np.generic) else value) for value in given)
            if is_list
            else (None,)
        )
        if not all(isinstance(value, int | float | str) for value in values):
            raise InputError(f"{self.parameter} is {shown(given)}: give a list of numbers or texts")
        object.__setattr__(self, "values", values)
        if not self.values:
            raise InputError(f"{self.parameter} has no values: {_HOW}")
        if len(set(self.values)) < len(self.values):
            raise InputError(f"{self.parameter} has a value twice: give each value once")
        if any(isinstance(value, bool) for value in self.values):
            raise InputError(f"{self.parameter} has true or false among its values: give numbers or text")
        if len({isinstance(value, str) for value in self.values}) > 1:
            raise InputError(f"{self.parameter} mixes numbers and text: give one or the other")

    @property
    def numeric(self) -> bool:
        """Whether the values are numbers."""
        return not isinstance(self.values[0], str)


def parse_axis(text: str) -> Axis:
    """Read an axis as typed: a list of values, or start, stop and count of evenly spaced ones.

    Parameters
    ----------
    text : str
        ``NAME=a,b,c``, ``NAME=start:stop:count`` or ``NAME=start:stop:count:log``. Numbers may have a percent sign.

    Raises
    ------
    InputError
        If it is none of these.
    """
    parameter, equals, given = (part.strip() for part in text.partition("="))
    if not (parameter and equals and given):
        raise InputError(f"{shown(text)} is not an axis: {_HOW}")
    if ":" in given:
        return Axis(parameter, _spaced(parameter, given))
    items = [item.strip() for item in given.split(",")]
    if "" in items:
        raise InputError(f"{shown(text)} has an empty value: {_HOW}")
    return Axis(parameter, tuple(parse_value(item) for item in items))


def parse_value(text: str) -> Value:
    """Read true, false, a whole number, a number, a percentage as a fraction, or else text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        return plain_fraction(text)  # type: ignore[no-any-return]


def _spaced(parameter: str, given: str) -> tuple[Value, ...]:
    parts = [parse_value(part.strip()) for part in given.split(":")]
    logarithmic = parts[-1] == "log"
    numbers = parts[:-1] if logarithmic else parts
    if len(numbers) != 3 or any(isinstance(number, str) for number in numbers):
        raise InputError(f"{parameter}={given} is not an axis: {_HOW}")
    start, stop, count = (float(number) for number in numbers)
    if not (np.isfinite([start, stop]).all() and count.is_integer() and 2 <= count <= _MOST_VALUES and start != stop):
        raise InputError(
            f"{parameter}={given}: give two different finite ends and a whole count of 2 to {_MOST_VALUES}"
        )
    if logarithmic and not (start > 0 and stop > 0):
        raise InputError(f"{parameter}={given}: a logarithmic axis needs ends above 0")
    values = (np.geomspace if logarithmic else np.linspace)(start, stop, int(count))
    # Parameters such as bits take whole numbers only.
    whole = not logarithmic and all(isinstance(number, int) for number in numbers[:2]) and (values % 1 == 0).all()
    return tuple(map(int if whole else float, values))


#: Most cells of a map.
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
    contrast : float, tuple of float or None
        Weber contrast to be detected, a fraction; of several, the result has a last dimension; None for that of each
        cell's scene.
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
    contrast: TargetContrasts = None
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
        """Number of values of each dimension."""
        return tuple(len(axis.values) for axis in self.dimensions)

    @property
    def dimensions(self) -> tuple[Axis, ...]:
        """The axes, and behind them several contrasts to be detected."""
        return (*self.axes, Axis(TO_DETECT, self.contrast)) if isinstance(self.contrast, tuple) else self.axes

    def findings(self) -> tuple[Finding, ...]:
        """Return the findings about the map."""
        return on_axis(self.chain) if self.exact else ()

    def identity(self) -> dict[str, Any]:
        """Return all that decides the results."""
        scene = self.chain.scene
        return {
            "chain": sha256(results_json(self.chain.document).encode()).hexdigest(),
            # What a file holds is not in the chain.
            "image": sha256(scene.luminance_map().tobytes()).hexdigest() if isinstance(scene, ImageScene) else None,
            "emissions": [spectrum.light for spectrum in spectra_of(scene) if spectrum.emission_path is not None],
            "axes": {axis.parameter: list(axis.values) for axis in self.axes},
            "exact": self.exact,
            "stage": self.stage,
            "contrast": list(self.contrast) if isinstance(self.contrast, tuple) else self.contrast,
            "epsilon": self.epsilon,
            "seed": self.seed,
            "labcdp": version("labcdp"),
        }


def on_axis(chain: Chain) -> tuple[Finding, ...]:
    """Return a finding that a prediction is for the optical axis, if the lens has vignetting."""
    lens = any(getattr(part, "focal_length_m", None) for _, part in chain.before)
    return (info("map-on-axis"),) if lens else ()


def is_scene_parameter(chain: Chain, parameter: str) -> bool:
    """Whether a parameter is one of the scene that needs no new chain."""
    table, _, key = parameter.partition(".")
    return table == "scene" and key in {field.name for field in fields(chain.scene)} - {"width", "height"}  # type: ignore[arg-type]
