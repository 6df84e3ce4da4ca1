"""Vignetting that is assumed, as the patches show it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import sqrt

from ...core.vignetting import AnyVignetting, Cos4Vignetting
from ..converter import VIGNETTING
from .design import Array, Design
from .problem import Solution

#: Least width of the error that is left, of its prior one.
_LEAST = 1e-6


@dataclass(frozen=True, eq=False)
class SeenVignetting:
    """Amplitude of the error of an assumed vignetting, in units of its prior width.

    Of a normal prior and the observations it is normal, with this mean and standard deviation; the errors of the
    parameters follow it by regression (C. R. Rao, Linear Statistical Inference and Its Applications, 4a.11).

    Parameters
    ----------
    mean, width : float
        0 and 1 where nothing shows it.
    moved : ndarray of float, shape (n,), or float
        What it changes in the luminances of the observations.
    """

    mean: float = 0.0
    width: float = 1.0
    moved: Array | float = 0.0

    @classmethod
    def of(cls, solution: Solution) -> SeenVignetting:
        """Return that of a fit; nothing of a response that is given, whose weights leave the vignetting out."""
        own = [
            k for k, one in enumerate(solution.design.shared) if one.source == VIGNETTING and one.pattern is not None
        ]
        if len(own) != 1 or solution.candidate.bracket is not None:
            return cls()
        column = solution.design.patterns(solution.level, solution.slope)[own[0]]
        pull = column @ solution.left
        mean = float(pull @ solution.residual)
        return cls(mean, sqrt(max(1 - float(pull @ column), _LEAST**2)), mean * column)

    def after(self, prior: AnyVignetting | None) -> AnyVignetting | None:
        """Return a vignetting as the patches show it."""
        if not isinstance(prior, Cos4Vignetting) or not prior.corner_rel:
            return prior
        log_corner = prior.log_corner - self.mean * prior.corner_rel
        return replace(prior, corner_rel=self.width * prior.corner_rel, log_corner=log_corner)


def with_wider_vignetting(
    design: Design, vignetting: AnyVignetting | None, factor: float
) -> tuple[Design, AnyVignetting | None]:
    """Return a design and its vignetting with a wider prior of its error."""
    shared = tuple(
        replace(one, relative=factor * one.relative) if one.source == VIGNETTING else one for one in design.shared
    )
    if isinstance(vignetting, Cos4Vignetting):
        vignetting = replace(vignetting, corner_rel=factor * vignetting.corner_rel)
    return replace(design, shared=shared), vignetting
