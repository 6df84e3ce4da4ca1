"""How well a template fits where it is put, compiled: see `labcdp.tracking.alignment`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from .level_kernel import Bounds, Pixels, first_light, nothing_seen, sample
from .outline_kernel import Edges, heights_of
from .select_kernel import median
from .step_kernel import improve

#: Most steps in the smaller size of a template, and in its own.
_COARSE_STEPS, _FINE_STEPS = 8, 5

#: Residual of a pixel that is still found again: times the noise, and in parts of the structure.
_AGREES_NOISE, _AGREES_STRUCTURE = 2.5, 0.25
#: Deviation of a region's own pixels from which on they are covered: times the noise, and in parts of the structure.
_COVERED_NOISE, _COVERED_STRUCTURE = 5.0, 0.2
#: Own pixels below which none is said to be covered.
_OWN_LEAST = 4

#: Place in the view and in the image, gain, offset, quality, covered, in_image, agrees and heights: see
#: `labcdp.tracking.alignment.Fit`.
Aligned = tuple[
    NDArray[np.float64], NDArray[np.float64], float, float, float, float, float,
    NDArray[np.float32], NDArray[np.float64],
]  # fmt: skip

#: Factors and corner of a view, and shape of the image: see `labcdp.tracking.view.View`.
ViewFrame = tuple[tuple[float, float], tuple[int, int], tuple[int, int]]


@compiled
def align(
    image: NDArray[np.float32], frame: ViewFrame, coarse: Pixels, fine: Pixels, to_view: NDArray[np.float64],
    light: tuple[float, float], own: tuple[NDArray[np.float32], NDArray[np.bool_]], edges: Edges,
) -> Aligned:  # fmt: skip
    """Improve a guess in both sizes and say how well it fits.

    Parameters
    ----------
    image : ndarray of float32, shape (h, w)
        The view, smoothed.
    frame : ((float, float), (int, int), (int, int))
        Factors and corner of the view and shape of the image: see `labcdp.tracking.view.View`.
    coarse, fine : Pixels
        The template in a smaller size, and in its own of n pixels.
    light : (float, float)
        Guess of gain and offset; nan if none is known.
    own : (ndarray of float32, ndarray of bool), each of shape (n,)
        Structure that each template pixel carries, and which ones are the region's own.

    Returns
    -------
    Aligned
        Its gain is 0 if the guess leads nowhere, or hardly any of the template is in the image.
    """
    (across, down), (x, y), (height, width) = frame
    bounds = (-across * x, -down * y, across * (width - x), down * (height - y))
    guesses = np.full((1 if np.isnan(light[0]) else 2, 2), np.nan)
    if guesses.shape[0] == 2:
        guesses[0, 0], guesses[0, 1] = light
    place = to_view
    for size in range(2):
        # One place where it is called keeps the time to compile short.
        place, gain, offset = improve(
            image, bounds, coarse if size == 0 else fine, place, _COARSE_STEPS if size == 0 else _FINE_STEPS, guesses
        )
        if not gain > 0:
            break
        guesses = np.array([[gain, offset]])
    if gain > 0:
        gain, offset, quality, covered, in_image, agrees, values = judge(
            image, bounds, fine, place, guesses, own[0], own[1]
        )
        if gain > 0:
            heights = heights_of(values, agrees, gain, edges)
            to_image = place.copy()
            for column in range(3):
                to_image[0, column] = place[0, column] / across + x * place[2, column]
                to_image[1, column] = place[1, column] / down + y * place[2, column]
            return place, to_image, gain, offset, quality, covered, in_image, agrees, heights
    return place, place, 0.0, 0.0, 0.0, 0.0, 0.0, np.empty(0, np.float32), np.empty(0)


@compiled
def trust_learnt(
    trust: NDArray[np.float32], least: NDArray[np.float32], agrees: NDArray[np.float32], learnt: int
) -> NDArray[np.float32]:
    """Trust in each pixel from that of `learnt` frames, this one included, and how far it agrees now; shape (n,).

    It is at least `least`, and stays where nan agrees.
    """
    changed = np.empty_like(trust)
    each = np.float32(learnt)
    for i in range(trust.size):
        new = max(trust[i] + (agrees[i] - trust[i]) / each, least[i])
        changed[i] = trust[i] if np.isnan(agrees[i]) else new
    return changed


@compiled
def judge(
    image: NDArray[np.float32], bounds: Bounds, pixels: Pixels, to_view: NDArray[np.float64],
    guesses: NDArray[np.float64], carries: NDArray[np.float32], inside: NDArray[np.bool_],
) -> tuple[float, float, float, float, float, NDArray[np.float32], NDArray[np.float32]]:  # fmt: skip
    """Say how well the pixels fit at `to_view`.

    Parameters
    ----------
    carries : ndarray of float32, shape (n,)
        Structure that each pixel carries.
    inside : ndarray of bool, shape (n,)
        Which pixels are the region's own.

    Returns
    -------
    gain, offset, quality, covered, in_image : float
        See `labcdp.tracking.alignment.Fit`; gain 0 if nothing is found.
    agrees : ndarray of float32, shape (n,)
        How far each pixel is found again; nan outside the image.
    values : ndarray of float32, shape (n,)
        The view under each pixel.
    """
    n = pixels.trust.size
    seen = nothing_seen(n)
    sample(image, bounds, to_view, pixels, seen)
    agrees = seen.robust
    light = first_light(pixels, seen, guesses)
    gain = light[0]
    if gain == 0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, agrees, seen.values
    structure, noise = pixels.structure, pixels.noise * np.sqrt(1 + 1 / gain**2)
    over = np.float32(1 / np.hypot(_AGREES_NOISE * noise, _AGREES_STRUCTURE * structure))
    one = np.float32(1)
    whole = found = 0.0
    n_seen = 0
    for i in range(n):
        ratio = seen.residuals[i] * over
        squared = ratio * ratio
        agrees[i] = one / (one + squared * squared)
        whole += carries[i] * pixels.trust[i]
        found += carries[i] * seen.trusted[i] * agrees[i]
        if seen.trusted[i] == 0:
            agrees[i] = np.nan
        else:
            n_seen += 1
    # Whatever there is agrees with noise as strong as the structure.
    quality = found / max(whole, 1e-9) * min(1.0, (structure / max(_AGREES_NOISE * noise, 1e-9)) ** 2)
    most = np.hypot(_COVERED_NOISE * noise, _COVERED_STRUCTURE * structure)
    covered = _share_off(seen.residuals, agrees, inside, most)
    return gain, light[1], quality, covered, n_seen / n, agrees, seen.values


@compiled
def _share_off(
    residuals: NDArray[np.float32], agrees: NDArray[np.float32], inside: NDArray[np.bool_], most: float
) -> float:
    """Share of a region's own pixels in the image that are more than `most` off their median."""
    own = np.empty_like(residuals)
    n = 0
    for i in range(residuals.size):
        if inside[i] and not np.isnan(agrees[i]):
            own[n] = residuals[i]
            n += 1
    if n < _OWN_LEAST:
        return 0.0
    own = own[:n]
    middle = median(own)
    off = 0
    for i in range(n):
        off += abs(own[i] - middle) > most
    return off / n
