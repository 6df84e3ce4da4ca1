"""Steps that align a template with a view, compiled: they are many, and small."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.computer.compiled import compiled

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
#: Pixels from which on only every fourth one goes into a median.
_MANY = 800


class Pattern(NamedTuple):
    """A template in one size.

    Parameters
    ----------
    values, trust : ndarray of float32, shape (height, width)
        Its pixels, and how far each counts.
    jacobian : ndarray of float32, shape (m + 2, height * width)
        Change of each pixel along each generator, deviations of the pixels, and ones.
    generators : ndarray of float, shape (m, 3, 3)
        Ways it may move.
    damping : ndarray of float, shape (m + 2,)
        How each is held back.
    to_template, centred, from_centred : ndarray of float, shape (3, 3)
        Its pixels to those of the template; these to coordinates of about -1 to 1, and back.
    middle, structure, noise, still : float
        Mean and standard deviation of its pixels, that of their noise, and the step after which no other one is made.
    """

    values: NDArray[np.float32]
    trust: NDArray[np.float32]
    jacobian: NDArray[np.float32]
    generators: NDArray[np.float64]
    damping: NDArray[np.float64]
    to_template: NDArray[np.float64]
    centred: NDArray[np.float64]
    from_centred: NDArray[np.float64]
    middle: float
    structure: float
    noise: float
    still: float


class Seen(NamedTuple):
    """What a view shows under a pattern.

    Parameters
    ----------
    known : bool
        Whether enough of it lies in the image, in a possible light; else nothing else here counts.
    values, trusted : ndarray of float32, shape (n,)
        The view there, and how far each pixel counts: 0 outside the image.
    gain, offset : float
        Light: DN = gain * DN of the first frame + offset.
    expected : float
        Gain that was expected; nan if none was.
    residuals, robust : ndarray of float32, shape (n,)
        What is left of the view in the template's DN, and how far each pixel fits.
    spread : float
        Standard deviation of most residuals.
    """

    known: bool
    values: NDArray[np.float32]
    trusted: NDArray[np.float32]
    gain: float
    offset: float
    expected: float
    residuals: NDArray[np.float32]
    robust: NDArray[np.float32]
    spread: float


@compiled
def _sampled(
    view: NDArray[np.float32], bounds: NDArray[np.float64], place: NDArray[np.float64], pattern: Pattern
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Values of a view under a pattern, interpolated, and how far they count."""
    height, width = pattern.values.shape
    rows, columns = view.shape
    values, trusted = np.empty(height * width, np.float32), np.zeros(height * width, np.float32)
    m = place @ pattern.to_template
    for v in range(height):
        for u in range(width):
            at = v * width + u
            x = m[0, 0] * (u + 0.5) + m[0, 1] * (v + 0.5) + m[0, 2]
            y = m[1, 0] * (u + 0.5) + m[1, 1] * (v + 0.5) + m[1, 2]
            w = m[2, 0] * (u + 0.5) + m[2, 1] * (v + 0.5) + m[2, 2]
            if not w > 0:
                values[at] = 0
                continue
            x, y = x / w, y / w
            if bounds[0] < x < bounds[2] and bounds[1] < y < bounds[3]:
                trusted[at] = pattern.trust[v, u]
            x, y = min(max(x - 0.5, 0.0), columns - 1.0), min(max(y - 0.5, 0.0), rows - 1.0)
            left, top = min(int(x), columns - 2), min(int(y), rows - 2)
            x, y = x - left, y - top
            upper = view[top, left] * (1 - x) + view[top, left + 1] * x
            lower = view[top + 1, left] * (1 - x) + view[top + 1, left + 1] * x
            values[at] = upper * (1 - y) + lower * y
    return values, trusted


@compiled
def _middle(values: NDArray[np.float32]) -> float:
    """Upper median by Hoare's selection, which reorders the values; np.partition takes seconds to compile."""
    wanted, low, high = values.size // 2, 0, values.size - 1
    while low < high:
        pivot, left, right = values[wanted], low, high
        while left <= right:
            while values[left] < pivot:
                left += 1
            while pivot < values[right]:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left, right = left + 1, right - 1
        if right < wanted:
            low = left
        if wanted < left:
            high = right
    return float(values[wanted])


@compiled
def _compared(
    values: NDArray[np.float32],
    trusted: NDArray[np.float32],
    light: tuple[float, float],
    expected: float,
    pattern: Pattern,
) -> Seen:
    """Compare a view with a pattern in a light."""
    gain, offset = light
    own, n = pattern.values.ravel(), values.size
    residuals, robust = np.empty(n, np.float32), np.empty(n, np.float32)
    scale, shift = np.float32(1 / gain), np.float32(offset / gain)
    for at in range(n):
        residuals[at] = values[at] * scale - own[at] - shift
    spread = max(
        1.4826 * _middle(np.abs(residuals[:: 4 if n > _MANY else 1])),
        pattern.noise * (1 + 1 / gain**2) ** 0.5,
        _ALLOWED * pattern.structure,
    )
    per_spread, one = np.float32(1 / (_ROBUST * spread)), np.float32(1)
    for at in range(n):
        part = residuals[at] * per_spread
        part = one + part * part
        robust[at] = one / (part * part)
    return Seen(True, values, trusted, gain, offset, expected, residuals, robust, spread)


@compiled
def _lit(seen: Seen, pattern: Pattern) -> tuple[bool, float, float]:
    """Gain and offset by weighted least squares, and whether they are possible.

    An expected gain counts as much as the whole template: a patch and changing surroundings contain little
    information on it.
    """
    own = pattern.values.ravel()
    total, sum_t, sum_v, sum_tt, sum_tv = 0.0, 0.0, 0.0, 0.0, 0.0
    for at in range(own.size):
        weight = np.float64(seen.trusted[at] * seen.robust[at])
        t, v = own[at] - pattern.middle, seen.values[at] - pattern.middle
        total += weight
        sum_t += weight * t
        sum_v += weight * v
        sum_tt += weight * t * t
        sum_tv += weight * t * v
    if not total >= _PIXELS_LEAST:
        return False, 0.0, 0.0
    mean_t, mean_v = sum_t / total, sum_v / total
    power = sum_tt - mean_t * mean_t * total
    gain = (sum_tv - mean_t * mean_v * total) / power if power > 0 else 0.0
    if not np.isnan(seen.expected):
        whole = pattern.structure**2 * own.size
        gain = (power * gain + whole * seen.expected) / (power + whole)
    if not _GAIN_LEAST < gain < _GAIN_MOST:
        return False, 0.0, 0.0
    return True, gain, mean_v + pattern.middle - gain * (pattern.middle + mean_t)


@compiled
def _in_light(
    values: NDArray[np.float32], trusted: NDArray[np.float32], light: tuple[float, float], pattern: Pattern
) -> Seen:
    """Compare a view in the light that is found in three steps: from a guess, or from all pixels if its gain is nan."""
    ones = np.ones(values.size, np.float32)
    seen = Seen(True, values, trusted, light[0], light[1], light[0], ones, ones, 0.0)
    if not np.isnan(light[0]):
        seen = _compared(values, trusted, light, light[0], pattern)
    for _ in range(3):
        known, gain, offset = _lit(seen, pattern)
        if not known:
            return Seen(False, values, trusted, gain, offset, light[0], ones, ones, 0.0)
        seen = _compared(values, trusted, (gain, offset), light[0], pattern)
    return seen


@compiled
def look(
    view: NDArray[np.float32],
    bounds: NDArray[np.float64],
    place: NDArray[np.float64],
    light: tuple[float, float],
    pattern: Pattern,
) -> Seen:
    """Compare the view at a place with the pattern, starting from a guess of the light, nan for none.

    A large bright thing in front of the target spoils a start from all pixels, but not one from a known light.
    """
    values, trusted = _sampled(view, bounds, place, pattern)
    best = _in_light(values, trusted, light, pattern)
    if np.isnan(light[0]) or (
        best.known and _CHANGED * best.spread <= max(pattern.noise, _ALLOWED * pattern.structure)
    ):
        return best
    seen = _in_light(values, trusted, (np.nan, 0.0), pattern)
    # A guess is kept unless the light has clearly changed.
    return seen if seen.known and (not best.known or seen.spread < _CHANGED * best.spread) else best


@compiled
def _step(seen: Seen, pattern: Pattern) -> NDArray[np.float64]:
    """Gauss-Newton step along each generator, light found along with it."""
    weights = seen.trusted * seen.robust
    weighted = pattern.jacobian * weights
    products = (weighted @ pattern.jacobian.T).astype(np.float64)
    pull = (weighted @ seen.residuals).astype(np.float64)
    scatter, total = 0.0, 0.0
    for at in range(weights.size):
        total += weights[at]
        scatter += weights[at] * seen.residuals[at] * seen.residuals[at]
    least = max(scatter / max(total, 1e-9), pattern.noise**2)
    for k in range(pull.size):
        products[k, k] += pattern.damping[k] * least + 1e-6 * products[k, k] + 1e-9
    steps = np.linalg.solve(products, pull).astype(np.float64)
    return steps[: pattern.generators.shape[0]]


@compiled
def improve(
    view: NDArray[np.float32],
    bounds: NDArray[np.float64],
    place: NDArray[np.float64],
    light: tuple[float, float],
    steps: int,
    pattern: Pattern,
) -> tuple[bool, NDArray[np.float64], float, float]:
    """Make up to `steps` steps from `place`; whether that led anywhere, the place, and the light before the last."""
    seen = look(view, bounds, place, light, pattern)
    for number in range(steps):
        if number:
            values, trusted = _sampled(view, bounds, place, pattern)
            known, gain, offset = _lit(
                Seen(True, values, trusted, 0.0, 0.0, seen.expected, seen.residuals, seen.robust, seen.spread), pattern
            )
            if not known:
                return False, place, 0.0, 0.0
            seen = _compared(values, trusted, (gain, offset), seen.expected, pattern)
        if not seen.known:
            return False, place, 0.0, 0.0
        step = _step(seen, pattern)
        change = np.eye(3)
        for k in range(step.size):
            change += step[k] * pattern.generators[k]
        place = place @ pattern.from_centred @ np.linalg.inv(change) @ pattern.centred
        if not np.isfinite(place).all() or place[2, 2] == 0:
            return False, place, 0.0, 0.0
        place = place / place[2, 2]
        if np.abs(step).max() < pattern.still:
            break
    return True, place, seen.gain, seen.offset
