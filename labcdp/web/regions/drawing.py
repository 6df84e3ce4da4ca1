"""Immutable drawings of regions on an image, and their history."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from itertools import count

from ...core.disk.text import numbered
from ...core.errors import InputError
from ...core.roi import Roi
from ...regions import ImageSize, Shape, rois_of

#: Number of changes that can be undone.
_MOST_STEPS = 500
#: Regions in a box of more pixels are not checked for being empty, which would take too long at each change.
_SMALL = 10_000


@dataclass(frozen=True)
class Drawing:
    """Regions of an image, unconfirmed proposals, and the pair of regions whose contrast is shown.

    Parameters
    ----------
    size : (int, int)
        Width and height of the image in pixels.
    shapes : tuple of Shape
        Confirmed shapes.
    proposals : tuple of Shape
        Shapes found automatically, to be confirmed.
    pair : (str or None, str or None)
        Names of two regions, None where none is chosen.
    """

    size: ImageSize
    shapes: tuple[Shape, ...] = ()
    proposals: tuple[Shape, ...] = ()
    pair: tuple[str | None, str | None] = (None, None)

    @classmethod
    def of(cls, size: ImageSize, shapes: Iterable[Shape]) -> Drawing:
        """Drawing of shapes, with their first two regions as the pair.

        Raises
        ------
        InputError
            As for `added`.
        """
        return cls(size)._with(tuple(shapes))

    @property
    def rois(self) -> tuple[Roi, ...]:
        """Regions of the shapes; a grid has several."""
        return tuple(roi for shape in self.shapes for roi in shape.rois())

    @property
    def pair_rois(self) -> tuple[Roi, ...]:
        """Regions of the pair that are chosen, in their order."""
        rois = {roi.name: roi for roi in self.rois}
        return tuple(rois[name] for name in self.pair if name is not None)

    def shape(self, name: str) -> Shape:
        """Shape or proposal of a name; raises InputError if there is none."""
        for shape in (*self.shapes, *self.proposals):
            if shape.name == name:
                return shape
        raise InputError(f"there is no region {name!r}: choose another")

    def is_proposal(self, name: str) -> bool:
        """Whether a proposal has this name."""
        return any(shape.name == name for shape in self.proposals)

    def new_name(self) -> str:
        """Return an unused name."""
        taken = {shape.name for shape in (*self.shapes, *self.proposals)} | {roi.name for roi in self.rois}
        return next(name for name in (f"region {number}" for number in count(1)) if name not in taken)

    def added(self, shape: Shape) -> Drawing:
        """Return the drawing with one more shape.

        Raises
        ------
        InputError
            If its name is taken, its edges cross, it lies outside the image or contains no pixel.
        """
        return self._with((*self.shapes, shape))

    def changed(self, name: str, change: Callable[[Shape], Shape]) -> Drawing:
        """Return the drawing with one shape, or proposal, changed.

        Raises
        ------
        InputError
            If there is none of that name, or as `added`.
        """
        old = self.shape(name)
        new = change(old)
        if self.is_proposal(name):
            self._check((new,))
            return replace(self, proposals=tuple(new if shape is old else shape for shape in self.proposals))
        return self._with(tuple(new if shape is old else shape for shape in self.shapes))

    def renamed(self, name: str, to: str) -> Drawing:
        """Return the drawing with a shape renamed; raises InputError as `changed`, or if the name is taken."""
        if to != name and any(shape.name == to for shape in (*self.shapes, *self.proposals)):
            raise InputError(f"there is a region {to!r} already: choose another name")
        before = [roi.name for roi in self.shape(name).rois()]
        renamed = self.changed(name, lambda shape: replace(shape, name=to))
        names = dict(zip(before, (roi.name for roi in renamed.shape(to).rois()), strict=True))
        first, second = (None if old is None else names.get(old, old) for old in self.pair)
        return replace(renamed, pair=(first, second)) if not self.is_proposal(name) else renamed

    def deleted(self, name: str) -> Drawing:
        """Return the drawing without a shape or proposal; raises InputError if there is none of that name."""
        gone = self.shape(name)
        without = replace(self, proposals=tuple(shape for shape in self.proposals if shape is not gone))
        return without._with(tuple(shape for shape in self.shapes if shape is not gone))

    def proposed(self, proposals: Iterable[Shape]) -> Drawing:
        """Return the drawing with new proposals; those whose name is taken are renamed.

        Raises
        ------
        InputError
            If one lies outside the image, contains no pixel, or crosses itself.
        """
        taken = {shape.name for shape in self.shapes} | {roi.name for roi in self.rois}
        named: list[Shape] = []
        for shape in proposals:
            names = (f"{shape.name}{ending}" for ending in numbered(" ({})"))
            free = next(name for name in names if name not in taken)
            taken.add(free)
            named.append(shape if free == shape.name else replace(shape, name=free))
        self._check(named)
        return replace(self, proposals=tuple(named))

    def accepted(self, names: Iterable[str] | None = None) -> Drawing:
        """Return the drawing with proposals confirmed, by name or all of them.

        Raises
        ------
        InputError
            If there is no such proposal, or a name is taken.
        """
        wanted = {shape.name for shape in self.proposals} if names is None else set(names)
        confirmed = tuple(shape for shape in self.proposals if shape.name in wanted)
        if not confirmed:
            raise InputError("there is no such proposal: press Propose first")
        rest = tuple(shape for shape in self.proposals if shape.name not in wanted)
        return replace(self, proposals=rest)._with((*self.shapes, *confirmed))

    def paired(self, first: str | None, second: str | None) -> Drawing:
        """Return the drawing with another pair of regions; raises InputError if there are none of these names."""
        known = {roi.name for roi in self.rois}
        for name in (first, second):
            if name is not None and name not in known:
                raise InputError(f"there is no region {name!r}: choose another")
        return replace(self, pair=(first, second))

    def _with(self, shapes: tuple[Shape, ...]) -> Drawing:
        if shapes:
            rois_of(shapes)
            known = set(map(id, self.shapes))
            self._check([shape for shape in shapes if id(shape) not in known])
        return replace(self, shapes=shapes)._with_valid_pair()

    def _check(self, shapes: Iterable[Shape]) -> None:
        width, height = self.size
        for shape in shapes:
            for roi in rois_of((shape,)):
                rows, columns = roi.window((height, width))
                if (rows.stop - rows.start) * (columns.stop - columns.start) <= _SMALL:
                    roi.mask((height, width))

    def _with_valid_pair(self) -> Drawing:
        """Drop names that no longer exist, and fill the pair with the first regions."""
        names = [roi.name for roi in self.rois]
        known = set(names)
        kept = [name if name in known else None for name in self.pair]
        for at, name in enumerate(kept):
            if name is None:
                kept[at] = next((candidate for candidate in names if candidate not in kept), None)
        return replace(self, pair=(kept[0], kept[1]))


@dataclass(frozen=True)
class History:
    """A drawing with those before it and those undone.

    Parameters
    ----------
    present : Drawing
        Current drawing.
    past, future : tuple of Drawing
        Drawings reached by undo and redo, the nearest last.
    """

    present: Drawing
    past: tuple[Drawing, ...] = field(default=())
    future: tuple[Drawing, ...] = field(default=())

    def changed(self, drawing: Drawing) -> History:
        """Return the history with a new drawing; undone drawings are discarded."""
        if drawing == self.present:
            return self
        return History(drawing, (*self.past, self.present)[-_MOST_STEPS:])

    def undone(self) -> History:
        """Return the history one step back; raises InputError if there is none."""
        if not self.past:
            raise InputError("there is nothing to undo")
        return History(self.past[-1], self.past[:-1], (*self.future, self.present))

    def redone(self) -> History:
        """Return the history one step forward again; raises InputError if there is none."""
        if not self.future:
            raise InputError("there is nothing to redo")
        return History(self.future[-1], (*self.past, self.present), self.future[:-1])

    def resized(self, size: ImageSize) -> History:
        """Return the history for an image of another size; regions that are outside stay."""
        past, future = (tuple(replace(drawing, size=size) for drawing in some) for some in (self.past, self.future))
        return History(replace(self.present, size=size), past, future)
