"""What a camera must detect, and whether chains do: the lowest CDP over the luminances, with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import hypot
from os import PathLike
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from ...chain import Chain
from ...core.disk import read_toml
from ...core.errors import InputError, naming
from ...core.table import Column, Table
from ...session.tables import Contrast, Format, Fraction, NotNegative, Number, Positive, Text
from ...session.tables import Table as Described
from ...session.validation import validated
from ..sweep.plan import Axis, Sweep
from ..sweep.run import run_sweep

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

Verdict = Literal["met", "not met", "undecided"]


class Requirement(Described):
    """What must be detected: a contrast, over a range of luminances, at a temperature and behind a veil."""

    format: Format = Field(1, description="1, the format this labcdp knows, or update labcdp")
    name: Text = Field("requirement", description="a name as text")
    contrast: Contrast = Field(description='a Weber contrast above 0, as "50%" or as a fraction')
    epsilon: Fraction = Field(0.5, description='"50%", or a fraction above 0, up to 1')
    luminance_cd_m2: tuple[Positive, Positive] = Field(
        description="[lowest, highest] luminance of the darker region above 0 cd/m2"
    )
    temperature_c: Number | None = Field(None, description="a temperature of the sensor in °C")
    glare_cd_m2: NotNegative = Field(0.0, description="a veil of at least 0 cd/m2")
    cdp_limit: Fraction = Field(0.9, description='"90%", or a probability above 0, up to 1')
    # By table and key of a chain, such as "sensor.read_noise_e"; others have a typical one.
    uncertainty_rel: dict[str, Fraction] = Field(
        {}, description='standard uncertainties by parameter, such as "sensor.read_noise_e" = "10%"'
    )

    @model_validator(mode="after")
    def _rising(self) -> Self:
        if self.luminance_cd_m2[0] >= self.luminance_cd_m2[1]:
            raise ValueError("luminance_cd_m2 is in the wrong order: give [lowest, highest]")
        return self

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Requirement:
        """Read a requirement from a TOML file; raises ConfigurationError if a key or value is wrong."""
        return validated(cls, read_toml(path, "a requirement"), str(path))

    @property
    def axis(self) -> Axis:
        """The luminances."""
        return Axis("scene.luminance_cd_m2", tuple(np.geomspace(*self.luminance_cd_m2, _POINTS).tolist()))

    def applied(self, chain: Chain) -> Chain:
        """Return a chain in the scene and conditions of the requirement; raises InputError if it has no such ones."""
        changes: dict[str, Any] = {"scene.contrast": self.contrast}
        if self.temperature_c is not None:
            changes["exposure.temperature_c"] = self.temperature_c
        if "windscreen" in chain.document:
            changes["windscreen.glare_cd_m2"] = self.glare_cd_m2
        elif self.glare_cd_m2 > 0:
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
        What the CDP there is limited by.
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
        applied = requirement.applied(chain)
        return _judged(name, applied, requirement)


def _judged(name: str, applied: Chain, requirement: Requirement) -> Judged:
    found = run_sweep(Sweep(applied, (requirement.axis,), True, None, None, requirement.epsilon))
    worst = int(np.argmin(found["cdp"].values))
    luminance, cdp = requirement.axis.values[worst], float(found["cdp"].values[worst])

    def at_worst(changes: Mapping[str, Any]) -> float:
        one = Axis(requirement.axis.parameter, (luminance,))
        sweep = Sweep(applied.with_(**changes), (one,), True, None, None, requirement.epsilon)
        return float(run_sweep(sweep)["cdp"].values[0])

    errors = _errors(applied.document, requirement, cdp, at_worst)
    expanded = _K * hypot(*errors.values())
    margin = cdp - requirement.cdp_limit
    verdict: Verdict = "met" if margin >= expanded else "not met" if margin < -expanded else "undecided"
    saturated = max(float(found[key].values[worst]) for key in found if str(key).startswith("saturated"))
    limit = "saturation" if saturated > _LEAST_SATURATED else _limit(applied.document, cdp, at_worst)
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
        ends = [_known(cdp, {parameter: _scaled(value, 1 + sign * u_rel)}) for sign in (1, -1)]
        there = [one for one in ends if one is not None]
        # Where one end is no value that the parameter can have, the other one counts from the value itself.
        errors[parameter] = (
            abs(there[0] - there[1]) / 2 if len(there) == 2 else max((abs(one - nominal) for one in there), default=0.0)
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


def _scaled(value: Any, factor: float) -> Any:
    """Return a value times a factor; of a table, the second of each pair."""
    return [[key, one * factor] for key, one in value] if isinstance(value, list) else float(value * factor)


def _limit(document: Mapping[str, Any], cdp: float, without: Callable[[Mapping[str, Any]], float]) -> str:
    """Return what raises the CDP most where it is taken away; else the noise of the light itself."""
    gains = {}
    for name, parameters in _LIMITS.items():
        stated = [one for one in parameters if _stated(document, one) is not None]
        if stated:
            gains[name] = without(dict.fromkeys(stated, 0.0)) - cdp
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
    low, high = requirement.luminance_cd_m2
    contrast, within, veil = 100 * requirement.contrast, 100 * requirement.epsilon, requirement.glare_cd_m2
    note = (
        f"Required: CDP of at least {requirement.cdp_limit:g} for a contrast of {contrast:g} % within {within:g} % of "
        f"it, from {low:g} to {high:g} cd/m², behind a veil of {veil:g} cd/m²."
    )
    return Table.of_items("requirement", requirement.name, columns, rows, note)
