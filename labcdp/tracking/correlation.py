"""A correlation filter that tells an object from its surroundings by the directions of its edges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from .frame import GreyFrame, View, view_around
from .geometry import Matrix, scaling, shift
from .settings import SETTINGS
from .template import Template

#: Samples along each side of the filter's window, cells of features along it, and directions of edges.
_SAMPLES, _CELLS, _DIRECTIONS = 64, 32, 8
#: Samples around one in which contrast is made the same: of edges, and of brightness.
_EDGES_LOCAL, _LIGHT_LOCAL = (17, 17), (33, 33)
#: Weight of the brightness against the edges.
_LIGHT_WEIGHT = 0.15
_Spectrum = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Response:
    """How a filter answers at a position.

    Parameters
    ----------
    to_image : ndarray of float, shape (3, 3)
        Template pixels to pixels of the frame.
    first : float
        Answer of the filter learned in the first frame: about 1 there, 0 for anything else.
    recent : float
        Answer of the one that has learned since.
    inner : float
        Correlation of the features of the region alone, without its surroundings, with those of the first frame.
    """

    to_image: Matrix
    first: float
    recent: float
    inner: float


class CorrelationFilter:
    """Finds a region that changes its looks, and says how surely it is the one of the first frame.

    Parameters
    ----------
    frame : GreyFrame
        The first frame.
    template : Template
        The region.

    Notes
    -----
    The filter whose answer to the window around the region is a narrow peak at its middle, by least squares: D. S.
    Bolme et al., Visual object tracking using adaptive correlation filters, CVPR 2010, for several features after
    M. Danelljan et al., Accurate scale estimation for robust visual tracking, BMVC 2014. Features are histograms of the
    directions of edges of equal local contrast (N. Dalal and B. Triggs, CVPR 2005), which light changes little.
    """

    def __init__(self, frame: GreyFrame, template: Template) -> None:
        low, high = template.corners.min(axis=0), template.corners.max(axis=0)
        self._middle = (low + high) / 2
        sides = np.maximum(SETTINGS.filter_window * (high - low), high - low + SETTINGS.filter_margin_template_px)
        self._step = sides / _SAMPLES
        self._to_template = shift(*(self._middle - sides / 2)) @ scaling(*self._step)
        self._template, self._reach_px = template, float(sides.max()) / 2 / template.reduction
        view = self._view(frame, template.to_image)
        assert view is not None
        cells = self._cells(view, template.to_image)
        self._first = self._recent = _filter_for(_spectrum(cells))
        sides_cells = np.clip(np.rint(_CELLS * (high - low) / sides), 4, _CELLS - 2).astype(int)
        left, top = (_CELLS - sides_cells) // 2
        self._inner = slice(top, top + sides_cells[1]), slice(left, left + sides_cells[0])
        self._inner_first = cells[:, *self._inner]

    def locate(self, frame: GreyFrame, to_image: Matrix) -> Response | None:
        """Find the region near a position, of about the size there; None if that is outside the image."""
        view = self._view(frame, to_image)
        if view is None:
            return None
        position, _ = self._moved(view, to_image)
        sizes = [
            self._moved(view, position @ shift(*self._middle) @ scaling(size) @ shift(*-self._middle))
            for size in (1.0, 1 / SETTINGS.filter_size_step, SETTINGS.filter_size_step)
        ]
        position, _ = max(sizes, key=lambda size: size[1] * (1.0 if size is sizes[0] else SETTINGS.filter_size_worth))
        return self._respond(view, position)

    def glance(self, frame: GreyFrame, to_image: Matrix) -> Response | None:
        """Find the region near a position, of the size there; None if that is outside the image."""
        view = self._view(frame, to_image)
        return None if view is None else self._respond(view, self._moved(view, to_image)[0])

    def respond(self, frame: GreyFrame, to_image: Matrix) -> Response | None:
        """Judge a position; None if it is outside the image."""
        view = self._view(frame, to_image)
        return None if view is None else self._respond(view, to_image)

    def learn(self, frame: GreyFrame, to_image: Matrix) -> Response | None:
        """Learn how the region looks where it was confirmed, and say how that compares with what was known."""
        view = self._view(frame, to_image)
        if view is None:
            return None
        cells = self._cells(view, to_image)
        response = self._compare(cells, to_image)
        new, rate = _filter_for(_spectrum(cells)), SETTINGS.filter_rate
        (numerator, power), (new_numerator, new_power) = self._recent, new
        self._recent = numerator + rate * (new_numerator - numerator), power + rate * (new_power - power)
        return response

    def _view(self, frame: GreyFrame, to_image: Matrix) -> View | None:
        return view_around(frame, self._template.shape, to_image, self._reach_px)

    def _cells(self, view: View, to_image: Matrix) -> NDArray[np.float32]:
        values = view.under(to_image @ self._to_template, (_SAMPLES, _SAMPLES))
        return _cells(values.reshape(_SAMPLES, _SAMPLES))

    def _moved(self, view: View, to_image: Matrix) -> tuple[Matrix, float]:
        """Position of the highest answer of the recent filter around one, and this answer."""
        answer = _answer(self._recent, _spectrum(self._cells(view, to_image)))
        x, y, highest = _peak(answer)
        cell = _SAMPLES / _CELLS
        return to_image @ shift(x * cell * self._step[0], y * cell * self._step[1]), highest

    def _respond(self, view: View, to_image: Matrix) -> Response:
        return self._compare(self._cells(view, to_image), to_image)

    def _compare(self, cells: NDArray[np.float32], to_image: Matrix) -> Response:
        spectrum, near = _spectrum(cells), np.ix_((-1, 0, 1), (-1, 0, 1))
        first, recent = (float(_answer(one, spectrum)[near].max()) for one in (self._first, self._recent))
        rows, columns = self._inner
        inner = max(
            _correlation(
                self._inner_first,
                cells[:, rows.start + down : rows.stop + down, columns.start + right : columns.stop + right],
            )
            for down in (-1, 0, 1)
            for right in (-1, 0, 1)
        )
        return Response(to_image, first, recent, inner)


@cache
def _taper() -> NDArray[np.float32]:
    return np.asarray(np.outer(np.hanning(_CELLS), np.hanning(_CELLS)), np.float32)


@cache
def _wanted() -> _Spectrum:
    """Spectrum of the answer that is wanted: a peak of a tenth of the region."""
    y, x = (np.mgrid[:_CELLS, :_CELLS] + _CELLS // 2) % _CELLS - _CELLS // 2
    width = _CELLS / SETTINGS.filter_window / 10
    return np.fft.rfft2(np.exp(-0.5 * (x * x + y * y) / width**2))


def _cells(image: NDArray[np.float32]) -> NDArray[np.float32]:
    """Directions of edges and the brightness in each cell, with their local contrast made the same."""
    import cv2

    dx, dy = (cv2.Sobel(image, cv2.CV_32F, *order, None, 1) for order in ((1, 0), (0, 1)))
    height = cv2.magnitude(dx, dy)
    weight = 1 / (np.maximum(height, np.float32(1e-3)) * (height + cv2.blur(height, _EDGES_LOCAL) + np.float32(2)))
    parts = []
    for angle in np.arange(_DIRECTIONS, dtype=np.float32) * np.float32(2 * np.pi / _DIRECTIONS):
        along = np.maximum(dx * np.cos(angle) + dy * np.sin(angle), 0)
        parts.append(cv2.resize(along * along * weight, (_CELLS, _CELLS), interpolation=cv2.INTER_AREA))
    deviation = image - cv2.blur(image, _LIGHT_LOCAL)
    deviation *= np.float32(_LIGHT_WEIGHT) / (cv2.blur(np.abs(deviation), _LIGHT_LOCAL) + np.float32(4))
    parts.append(cv2.resize(deviation, (_CELLS, _CELLS), interpolation=cv2.INTER_AREA))
    return np.stack(parts)


def _spectrum(cells: NDArray[np.float32]) -> _Spectrum:
    return np.fft.rfft2((cells - cells.mean(axis=(1, 2), keepdims=True)) * _taper())


def _correlation(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    """Correlation of features, each without its mean."""
    a, b = (one - one.mean(axis=(1, 2), keepdims=True) for one in (a, b))
    power = float(np.vdot(a, a)) * float(np.vdot(b, b))
    return float(np.vdot(a, b)) / power**0.5 if power > 0 else 0.0


def _filter_for(features: _Spectrum) -> tuple[_Spectrum, NDArray[np.float64]]:
    return np.conj(_wanted()) * features, np.square(np.abs(features)).sum(axis=0)


def _answer(learned: tuple[_Spectrum, NDArray[np.float64]], features: _Spectrum) -> NDArray[np.float64]:
    numerator, power = learned
    spectrum = (np.conj(numerator) * features).sum(axis=0) / (power + SETTINGS.filter_regular * power.mean() + 1e-6)
    return np.fft.irfft2(spectrum, s=(_CELLS, _CELLS))


def _peak(answer: NDArray[np.float64]) -> tuple[float, float, float]:
    """Position of the highest answer in cells from the middle, by a parabola along each axis, and the answer."""
    row, column = divmod(int(answer.argmax()), _CELLS)
    highest = float(answer[row, column])

    def refined(at: int, before: float, after: float) -> float:
        curvature = before - 2 * highest + after
        beside = 0.0 if curvature == 0 else 0.5 * (before - after) / curvature
        return (at + beside + _CELLS / 2) % _CELLS - _CELLS / 2

    x = refined(column, answer[row, column - 1], answer[row, (column + 1) % _CELLS])
    y = refined(row, answer[row - 1, column], answer[(row + 1) % _CELLS, column])
    # The last digits depend on where the arrays lie in memory.
    return round(x, 4), round(y, 4), round(highest, 6)
