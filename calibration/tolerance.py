"""U of a calibration itself, which is the tolerance of its verification where none is stated."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import Protocol, TypeAlias

from ..core.result import Finding, warning
from .setup import LensIdentity, MeterScale
from .uncertainty import effective_dof, expanded_rel

#: A variance and its degrees of freedom.
Part: TypeAlias = tuple[float, float]
#: U (95 %) above which a calibration is of no use: guessed parameters of a camera are about as good. A judgement.
_NO_USE_REL = 0.2


def expanded_of_scales(scales: Sequence[MeterScale], parts: Sequence[Part]) -> float:
    """Return the relative U (95 %) of parts and the scales of meters."""
    return expanded_rel(scales, sqrt(sum(variance for variance, _ in parts)), effective_dof(parts))


class _Calibration(Protocol):
    """What a calibration of any kind has."""

    @property
    def lens(self) -> LensIdentity: ...
    @property
    def stability_rel(self) -> float: ...
    @property
    def meter_scale(self) -> MeterScale: ...
    @property
    def field_rel(self) -> float: ...
    @property
    def fit_part(self) -> Part: ...


def own_tolerance_rel(calibration: _Calibration, of_place_rel: float = 0.0) -> float:
    """Relative U (95 %) of a calibration without a patch's noise; `of_place_rel` is by an assumed vignetting there."""
    of_time = calibration.lens.refocus_rel**2 + calibration.stability_rel**2
    others = of_time + of_place_rel**2 + calibration.field_rel**2
    return expanded_of_scales([calibration.meter_scale], [calibration.fit_part, (others, inf)])


def of_no_use(calibration: _Calibration) -> list[Finding]:
    """Warn of a calibration whose U is so large that it is of no use."""
    expanded = own_tolerance_rel(calibration)
    limits = {"expanded_rel": expanded, "limit_rel": _NO_USE_REL}
    return [warning("calibration-of-no-use", **limits)] if expanded > _NO_USE_REL else []
