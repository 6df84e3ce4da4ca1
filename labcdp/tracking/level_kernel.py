"""A view looked up under a template, and its light, compiled: see `labcdp.tracking.level`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import compiled
from ..sum_kernel import pairwise_sum
from .matrix_kernel import multiply
from .select_kernel import kth_smallest

#: Residuals from which on pixels count little, in standard deviations of the residuals.
_ROBUST = 2.5
#: Residual that is always allowed, in parts of the template's structure: interpolation, blur.
_ALLOWED = 0.06
#: Pixels without which nothing is said.
_PIXELS_LEAST = 6
#: Factor by which residuals must be smaller for a light that was not expected.
_CHANGED = 0.75
#: Least and most change of the light between the first frame and this one.
_GAIN_LEAST, _GAIN_MOST = 0.05, 12.0
#: Pixels that are summed up in single precision before what they give is added to the rest in double precision.
BLOCK = 1024
#: Pixels from which on only every fourth one goes into a median.
_MANY = 800


class Pixels(NamedTuple):
    """What is known of a template in one size before anything is looked at.

    Parameters
    ----------
    jacobian : ndarray of float32, shape (m + 2, n)
        Change of each of the n pixels along each of m generators; the pixels themselves; and ones.
    trust : ndarray of float32, shape (n,)
        How far each pixel counts, above 0.
    generators : ndarray of float64, shape (m, 3, 3)
        Ways the target may move.
    damping : ndarray of float64, shape (m + 2,)
        By which each of the unknowns is held back.
    to_template, centred, from_centred : ndarray of float64, shape (3, 3)
        Pixels of this size to those of the template, these to coordinates of about -1 to 1, and back.
    columns : int
        Pixels of a row.
    middle, structure, noise : float
        Mean and standard deviation of the pixels, and standard deviation of their noise.
    still : float
        Step in centred coordinates after which no other one is made.
    """

    jacobian: NDArray[np.float32]
    trust: NDArray[np.float32]
    generators: NDArray[np.float64]
    damping: NDArray[np.float64]
    to_template: NDArray[np.float64]
    centred: NDArray[np.float64]
    from_centred: NDArray[np.float64]
    columns: int
    middle: float
    structure: float
    noise: float
    still: float


class Seen(NamedTuple):
    """What is seen under the pixels; arrays that each step writes anew.

    Parameters
    ----------
    values : ndarray of float32, shape (n,)
        The view there.
    trusted : ndarray of float32, shape (n,)
        How far each pixel counts; 0 outside the image.
    residuals : ndarray of float32, shape (n,)
        What is left of the view, in the template's DN.
    robust : ndarray of float32, shape (n,)
        How far each pixel fits.
    """

    values: NDArray[np.float32]
    trusted: NDArray[np.float32]
    residuals: NDArray[np.float32]
    robust: NDArray[np.float32]


#: Gain, offset, the gain that was expected (nan: none), and the standard deviation of most residuals; gain 0: no light.
Light = tuple[float, float, float, float]
#: Left, top, right and bottom end of the image in the view.
Bounds = tuple[float, float, float, float]


@compiled
def nothing_seen(n: int) -> Seen:
    """Make the arrays for `n` pixels."""
    return Seen(np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32), np.empty(n, np.float32))


@compiled
def sample(
    image: NDArray[np.float32], bounds: Bounds, to_view: NDArray[np.float64], pixels: Pixels, seen: Seen
) -> None:
    """Write the values of the view under each pixel, and how far it counts.

    Beyond the view its last pixels go on.
    """
    left, top, right, bottom = bounds
    place = np.empty((3, 3))
    multiply(to_view, pixels.to_template, place)
    a, b, c = place[0, 0], place[0, 1], place[0, 2]
    d, e, f = place[1, 0], place[1, 1], place[1, 2]
    g, h, k = place[2, 0], place[2, 1], place[2, 2]
    columns = pixels.columns
    # Of each pixel of a row the one of the view left above it, and how far it is from there.
    first = np.empty(columns, np.uint32)
    across, down = np.empty(columns, np.float32), np.empty(columns, np.float32)
    wide, last_x, last_y = image.shape[1], np.int32(image.shape[1] - 2), np.int32(image.shape[0] - 2)
    view = image.reshape(image.size)
    for row in range(seen.values.size // columns):
        v, start = row + 0.5, row * columns
        trust, trusted = pixels.trust[start : start + columns], seen.trusted[start : start + columns]
        # The corner of the first pixel is at 0, its middle at 0.5.
        for column in range(columns):
            u = column + 0.5
            w = 1 / (g * u + h * v + k)
            x, y = (a * u + b * v + c) * w, (d * u + e * v + f) * w
            inside = (x > left) & (x < right) & (y > top) & (y < bottom) & (w > 0)
            trusted[column] = trust[column] if inside else np.float32(0)
            x = min(x - 0.5, last_x + 1.0) if x > 0.5 else 0.0
            y = min(y - 0.5, last_y + 1.0) if y > 0.5 else 0.0
            m, n = min(np.int32(x), last_x), min(np.int32(y), last_y)
            across[column], down[column] = x - m, y - n
            first[column] = n * wide + m
        values = seen.values[start : start + columns]
        for column in range(columns):
            here, below = first[column], first[column] + np.uint32(wide)
            upper = view[here] + across[column] * (view[here + np.uint32(1)] - view[here])
            lower = view[below] + across[column] * (view[below + np.uint32(1)] - view[below])
            values[column] = upper + down[column] * (lower - upper)


@compiled
def first_light(pixels: Pixels, seen: Seen, guesses: NDArray[np.float64]) -> Light:
    """Gain and offset of the view, starting from each guess; the best fit, whose residuals are written.

    A large bright thing in front of the target spoils a start from all pixels, but not one from the frame before.

    Parameters
    ----------
    guesses : ndarray of float64, shape (k, 2)
        Gain and offset of each; nan for a start from all pixels alike.
    """
    best = (0.0, 0.0, np.nan, 0.0)
    least = max(pixels.noise, _ALLOWED * pixels.structure)
    written = False
    for number in range(guesses.shape[0]):
        if best[0] > 0 and _CHANGED * best[3] <= least:
            break
        expected = guesses[number, 0]
        if np.isnan(expected):
            for i in range(seen.robust.size):
                seen.robust[i] = np.float32(1)
        else:
            _compare(pixels, seen, expected, guesses[number, 1])
        light = next_light(pixels, seen, expected)
        for _ in range(2):
            if light[0] > 0:
                light = next_light(pixels, seen, expected)
        # A guess is kept unless the light has clearly changed.
        written = light[0] > 0 and (best[0] == 0 or light[3] < _CHANGED * best[3])
        if written:
            best = light
    if best[0] > 0 and not written:
        _compare(pixels, seen, best[0], best[1])
    return best


@compiled
def next_light(pixels: Pixels, seen: Seen, expected: float) -> Light:
    """Gain and offset by weighted least squares, from how far pixels fit until now; writes how far they do with it.

    An `expected` gain counts as much as the whole template: a patch and changing surroundings tell little of it.
    """
    template = pixels.jacobian[-2]
    n = template.size
    # Less their mean, so that sums of squares lose no digits.
    middle = np.float32(pixels.middle)
    total = deviated = squared = viewed = product = 0.0
    room = np.empty((5, min(BLOCK, n)), np.float32)
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        trusted, robust = seen.trusted[start:stop], seen.robust[start:stop]
        values, known = seen.values[start:stop], template[start:stop]
        some_total, some_deviated, some_squared = (
            room[0, : stop - start],
            room[1, : stop - start],
            room[2, : stop - start],
        )
        some_viewed, some_product = room[3, : stop - start], room[4, : stop - start]
        for i in range(trusted.size):
            weight = trusted[i] * robust[i]
            value, deviation = values[i] - middle, known[i] - middle
            some_total[i] = weight
            some_deviated[i] = weight * deviation
            some_squared[i] = weight * deviation * deviation
            some_viewed[i] = weight * value
            some_product[i] = weight * deviation * value
        total += pairwise_sum(some_total)
        deviated += pairwise_sum(some_deviated)
        squared += pairwise_sum(some_squared)
        viewed += pairwise_sum(some_viewed)
        product += pairwise_sum(some_product)
    if not total >= _PIXELS_LEAST:
        return 0.0, 0.0, expected, 0.0
    mean_t, mean_v = deviated / total, viewed / total
    power = squared - mean_t * deviated
    gain = (product - mean_t * viewed) / power if power > 0 else 0.0
    if not np.isnan(expected):
        whole = pixels.structure**2 * n
        gain = (power * gain + whole * expected) / (power + whole)
    if not _GAIN_LEAST < gain < _GAIN_MOST:
        return 0.0, 0.0, expected, 0.0
    offset = mean_v + pixels.middle - gain * (pixels.middle + mean_t)
    return gain, offset, expected, _compare(pixels, seen, gain, offset)


@compiled
def _compare(pixels: Pixels, seen: Seen, gain: float, offset: float) -> float:
    """Write the residuals of a light and how far each pixel fits; the standard deviation of most residuals.

    That is at least what noise and interpolation explain.
    """
    template = pixels.jacobian[-2]
    n = template.size
    each, less = np.float32(1 / gain), np.float32(offset / gain)
    for i in range(n):
        seen.residuals[i] = seen.values[i] * each - template[i] - less
    every = 4 if n > _MANY else 1
    some = np.empty((n + every - 1) // every, np.float32)
    for i in range(some.size):
        some[i] = abs(seen.residuals[i * every])
    spread: float = max(
        1.4826 * kth_smallest(some, some.size // 2),
        pixels.noise * np.sqrt(1 + 1 / gain**2),
        _ALLOWED * pixels.structure,
    )
    over = np.float32(1 / (_ROBUST * spread))
    one = np.float32(1)
    for i in range(n):
        ratio = seen.residuals[i] * over
        lower = one + ratio * ratio
        seen.robust[i] = one / (lower * lower)
    return spread
