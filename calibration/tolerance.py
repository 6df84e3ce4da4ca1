"""U of a calibration itself, which is the tolerance of its verification where none is stated."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt
from typing import Protocol, TypeAlias

from ..core.result import Finding, warning
from .camera import CalibratedCamera
from .setup import LensIdentity, MeterScale
from .uncertainty import effective_dof, expanded_rel

#: A variance and its degrees of freedom.
Part: TypeAlias = tuple[float, float]
#: U (95 %) above which a calibration is of no use: guessed parameters of a camera are about as good. A judgement.
_NO_USE_REL = 0.2


def expanded_with_scales(scales: Sequence[MeterScale], parts: Sequence[Part]) -> float:
    """Return the relative U (95 %) of parts and the scales of meters."""
    return expanded_rel(scales, sqrt(sum(variance for variance, _ in parts)), effective_dof(parts))


class _Calibration(Protocol):
    """Members of calibrations of any kind."""

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
    @property
    def range_cd_m2(self) -> tuple[float, float]: ...
    @property
    def weights(self) -> tuple[float, ...]: ...
    @property
    def planes(self) -> tuple[CalibratedCamera, ...]: ...


def own_tolerance_rel(calibration: _Calibration, other_rel: float = 0.0) -> float:
    """Relative U (95 %) of a calibration without a patch's noise; `other_rel` is by vignetting there, or by glare."""
    of_time = calibration.lens.refocus_rel**2 + calibration.stability_rel**2
    others = of_time + other_rel**2 + calibration.field_rel**2
    return expanded_with_scales([calibration.meter_scale], [calibration.fit_part, (others, inf)])


def useless_calibration_findings(calibration: _Calibration) -> list[Finding]:
    """Warn of a calibration whose U in the middle of its range, glare included, is so large that it is of no use."""
    middle_cd_m2 = sqrt(calibration.range_cd_m2[0] * calibration.range_cd_m2[1])
    # Each plane sees its part of the luminance.
    of_plane_cd_m2 = middle_cd_m2 / sum(calibration.weights)
    glare_rel = max(abs(plane.responsivity.glare_cd_m2) for plane in calibration.planes) / of_plane_cd_m2
    expanded = own_tolerance_rel(calibration, glare_rel)
    limits = {"expanded_rel": expanded, "limit_rel": _NO_USE_REL, "luminance_cd_m2": middle_cd_m2}
    return [warning("calibration-of-no-use", **limits)] if expanded > _NO_USE_REL else []
