"""Whether chains meet a requirement: the lowest CDP over the luminances, with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import hypot
from typing import Any

import numpy as np

from ...chain import Chain
from ...core.errors import InputError, naming
from ...core.table import Column, Table
from ..judgement import VERDICTS, Verdict, required_text
from ..requirement import Requirement
from ..sweep.plan import Axis, Sweep
from ..sweep.run import run_sweep
from ..verdict import cdp_verdict

#: Luminances of the range at which chains are predicted.
_POINTS = 41
#: Coverage factor of U.
_K = 2.0
#: Relative standard uncertainty of parameters whose uncertainty the requirement does not state. A judgement: data
#: sheets state typical values, from which single cameras differ by as much.
TYPICAL = {
    "sensor.quantum_efficiency": 0.1,
    "sensor.full_well_e": 0.1,
    "sensor.read_noise_e": 0.2,
    "sensor.dark_current_e_s": 0.5,
    "sensor.prnu_rel": 0.3,
    "sensor.dsnu_e": 0.3,
    "sensor.dsnu_e_s": 0.3,
    "optics.transmittance": 0.05,
}
#: What could limit a camera, and the parameters without which it would not.
_LIMITS: dict[str, tuple[str, ...]] = {
    "glare": ("windscreen.glare_cd_m2", "windscreen.glare_fraction"),
    "read noise": ("sensor.read_noise_e",),
    "dark current": ("sensor.dark_current_e_s", "sensor.dsnu_e_s"),
    "non-uniformity": ("sensor.prnu_rel", "sensor.dsnu_e"),
}
#: Least gain of CDP for which something counts as the limit, and least share of saturated pixels.
_LEAST_GAIN, _LEAST_SATURATED = 1e-3, 1e-3


def luminances(requirement: Requirement) -> Axis:
    """Return the luminances at which chains are predicted."""
    values = tuple(np.geomspace(*requirement.luminance_cd_m2, _POINTS).tolist())
    return Axis("scene.luminance_cd_m2", values)


def applied(requirement: Requirement, chain: Chain) -> Chain:
    """Return a chain in the scene and conditions of a requirement; raises InputError if it has no windscreen."""
    changes: dict[str, Any] = {"scene.contrast": requirement.contrast}
    if requirement.temperature_c is not None:
        changes["exposure.temperature_c"] = requirement.temperature_c
    if "windscreen" in chain.document:
        changes["windscreen.glare_cd_m2"] = requirement.glare_cd_m2
    elif requirement.glare_cd_m2 > 0:
        raise InputError("the chain has no windscreen, but the requirement a veil: add a table [windscreen]")
    return chain.with_(**changes)


@dataclass(frozen=True)
class Judged:
    """Whether a chain meets a requirement.

    Parameters
    ----------
    name : str
        The chain.
    verdict : {'met', 'not met', 'undecided'}
        Met where the lowest CDP is above the limit by more than U, not met where it is below it by more.
    luminance_cd_m2 : float
        Luminance of the lowest CDP.
    cdp, expanded_cdp : float
        The lowest CDP, and its U by the uncertainty of the chain's parameters.
    margin : float
        CDP minus the limit.
    limit : str
        Noise or loss that limits the CDP there.
    dominant : str
        Parameter whose uncertainty counts most.
    """

    name: str
    verdict: Verdict
    luminance_cd_m2: float
    cdp: float
    expanded_cdp: float
    margin: float
    limit: str
    dominant: str


def judged(name: str, chain: Chain, requirement: Requirement) -> Judged:
    """Predict a chain over the luminances of a requirement; raises InputError as `Sweep`."""
    with naming(name):
        return _judged(name, applied(requirement, chain), requirement)


def _judged(name: str, chain: Chain, requirement: Requirement) -> Judged:
    axis = luminances(requirement)
    swept = run_sweep(Sweep(chain, (axis,), True, None, None, requirement.epsilon))
    worst = int(np.argmin(swept["cdp"].values))
    luminance, cdp = axis.values[worst], float(swept["cdp"].values[worst])

    def at_worst(changes: Mapping[str, Any]) -> float:
        luminance_axis = Axis(axis.parameter, (luminance,))
        sweep = Sweep(chain.with_(**changes), (luminance_axis,), True, None, None, requirement.epsilon)
        return float(run_sweep(sweep)["cdp"].values[0])

    errors = _errors(chain.document, requirement, cdp, at_worst)
    expanded = _K * hypot(*errors.values())
    margin = cdp - requirement.cdp_limit
    verdict = VERDICTS[cdp_verdict(cdp, (cdp - expanded, cdp + expanded), requirement.cdp_limit)]
    saturated = max(float(swept[key].values[worst]) for key in swept if str(key).startswith("saturated"))
    limit = "saturation" if saturated > _LEAST_SATURATED else _limit(chain.document, cdp, at_worst)
    dominant = max(errors, key=lambda key: errors[key]) if expanded > 0 else ""
    return Judged(name, verdict, float(luminance), cdp, expanded, margin, limit, dominant)


def _errors(
    document: Mapping[str, Any], requirement: Requirement, nominal: float, cdp: Callable[[Mapping[str, Any]], float]
) -> dict[str, float]:
    """Return the standard uncertainty of the CDP by each parameter that the chain states."""
    errors = {}
    for parameter, u_rel in (TYPICAL | requirement.uncertainty_rel).items():
        value = _stated(document, parameter)
        if value is None:
            if parameter in requirement.uncertainty_rel:
                raise InputError(f"uncertainty_rel names {parameter}, no number of the chain: correct the name")
            continue
        ends = [_known(cdp, _changed(document, (parameter,), 1 + sign * u_rel)) for sign in (1, -1)]
        there = [end for end in ends if end is not None]
        # Where one end is no value that the parameter can have, the other one counts from the value itself.
        errors[parameter] = (
            abs(there[0] - there[1]) / 2 if len(there) == 2 else max((abs(end - nominal) for end in there), default=0.0)
        )
    return errors


def _stated(document: Mapping[str, Any], parameter: str) -> Any:
    """Value of a parameter that is a number or a table of them; None if there is none, or it is 0."""
    table, _, key = parameter.partition(".")
    held = document.get(table)
    value = held.get(key) if isinstance(held, Mapping) else None
    return value if isinstance(value, int | float | list) and not isinstance(value, bool) and value else None


def _known(cdp: Callable[[Mapping[str, Any]], float], changes: Mapping[str, Any]) -> float | None:
    try:
        return cdp(changes)
    except InputError:
        return None


def _changed(document: Mapping[str, Any], parameters: Sequence[str], factor: float) -> dict[str, Any]:
    """Return parameters times a factor, those of a sensor with what its photodiodes and captures state of them."""
    changes = {parameter: _scaled(_stated(document, parameter), factor) for parameter in parameters}
    keys = {key for table, _, key in (parameter.partition(".") for parameter in parameters) if table == "sensor"}
    for name in ("photodiodes", "captures") if keys else ():
        parts = document["sensor"].get(name, [])
        if any(key in part for part in parts for key in keys):
            changes[f"sensor.{name}"] = [
                {key: _scaled(value, factor) if key in keys else value for key, value in part.items()} for part in parts
            ]
    return changes


def _scaled(value: Any, factor: float) -> Any:
    """Return a value times a factor; of a table, the second of each pair."""
    return [[key, part * factor] for key, part in value] if isinstance(value, list) else float(value * factor)


def _limit(document: Mapping[str, Any], cdp: float, without: Callable[[Mapping[str, Any]], float]) -> str:
    """Return the noise or loss whose removal raises the CDP most; without any, the noise of the light itself."""
    gains = {}
    for name, parameters in _LIMITS.items():
        stated = [parameter for parameter in parameters if _stated(document, parameter) is not None]
        if stated:
            gains[name] = without(_changed(document, stated, 0.0)) - cdp
    best = max(gains, key=lambda name: gains[name], default="")
    return best if best and gains[best] > _LEAST_GAIN else "photon noise"


def requirement_table(rows: tuple[Judged, ...], requirement: Requirement) -> Table:
    """Return the verdict on each chain."""
    columns = (
        Column("name", "chain"),
        Column("verdict", "verdict", "", "By the margin and U."),
        Column("luminance_cd_m2", "at", "cd/m²", "Luminance of the darker region at which the CDP is lowest."),
        Column("cdp", "lowest CDP", "", "Over the luminances of the requirement.", decimals=4),
        Column("expanded_cdp", "U", "", "Of the CDP, k = 2, by the chain's parameters, as stated or typical.",
               decimals=4),
        Column("margin", "margin", "", "Lowest CDP minus the limit.", decimals=4),
        Column("limit", "limited by"),
        Column("dominant", "U mostly by"),
    )  # fmt: skip
    return Table.of_items("requirement", requirement.name, columns, rows, required_text(requirement))
