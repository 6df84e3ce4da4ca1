"""Vignetting that is assumed, as the patches show it."""

from __future__ import annotations

from dataclasses import replace
from math import sqrt

from ...core.quantity import Quantity
from ...core.vignetting import AnyVignetting, Cos4Vignetting
from ..camera import VIGNETTING
from .design import Array, Design
from .problem import Solution

#: Least width of the error that is left, of its prior one.
_LEAST = 1e-6


def seen_vignetting(solution: Solution) -> tuple[Quantity, Array | float]:
    """Return what a fit says of the error of an assumed vignetting; nothing of a response that is given.

    Of a normal prior and the observations it is normal; the errors of the parameters follow it by regression (C. R.
    Rao, Linear Statistical Inference and Its Applications, 4a.11). The weights of a given response leave the vignetting
    out.

    Returns
    -------
    Quantity
        Its amplitude in units of its prior width; 0 with u = 1 where nothing shows it.
    ndarray of float, shape (n,), or float
        What it changes in the luminances of the observations.
    """
    numbers = [
        k for k, error in enumerate(solution.design.shared) if error.source == VIGNETTING and error.pattern is not None
    ]
    if len(numbers) != 1 or solution.candidate.bracket is not None:
        return Quantity(0.0, 1.0), 0.0
    column = solution.design.patterns(solution.level, solution.slope)[numbers[0]]
    pull = column @ solution.left
    mean = float(pull @ solution.residual)
    return Quantity(mean, sqrt(max(1 - float(pull @ column), _LEAST**2))), mean * column


def vignetting_after(prior: AnyVignetting | None, amplitude: Quantity) -> AnyVignetting | None:
    """Return a vignetting as the patches show it, by the amplitude of `seen_vignetting`."""
    if not isinstance(prior, Cos4Vignetting) or not prior.corner_rel:
        return prior
    log_corner = prior.log_corner - amplitude.value * prior.corner_rel
    return replace(prior, corner_rel=amplitude.u * prior.corner_rel, log_corner=log_corner)


def with_wider_vignetting(
    design: Design, vignetting: AnyVignetting | None, factor: float
) -> tuple[Design, AnyVignetting | None]:
    """Return a design and its vignetting with a wider prior of its error."""
    shared = tuple(
        replace(error, relative=factor * error.relative) if error.source == VIGNETTING else error
        for error in design.shared
    )
    if isinstance(vignetting, Cos4Vignetting):
        vignetting = replace(vignetting, corner_rel=factor * vignetting.corner_rel)
    return replace(design, shared=shared), vignetting
