"""The drawing that all tabs of the page share: what changes it, what is kept of it, and what is measured in it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..regions import Shape, new_shapes
from ..roi import Roi
from .drawing import Drawing, History
from .files import DrawingFiles
from .lane import Lane, RunElsewhere
from .measurements import Evaluated, Means, Measurements
from .messages import change


@dataclass(frozen=True)
class Notice:
    """What the page tells a person.

    Parameters
    ----------
    text : str
        One sentence.
    kind : {'info', 'done', 'warning'}
        How it is shown.
    """

    text: str
    kind: str = "info"


@dataclass(frozen=True)
class Start:
    """What there is to begin with.

    Parameters
    ----------
    history : History
        The drawing.
    saved : tuple of Shape
        What the output already holds; empty if there is none.
    read : tuple of Shape
        What another file held that was read to begin with: safe there as long as it is not changed.
    proposals : tuple of Shape
        What was found and waits for a person.
    stored : str
        Fingerprint of the output as it was read; empty if there was none.
    """

    history: History
    saved: tuple[Shape, ...] = ()
    read: tuple[Shape, ...] = ()
    proposals: tuple[Shape, ...] = ()
    stored: str = ""


class Workspace:
    """A drawing on one image, with its history and files; tabs of the page look at it and ask it for changes.

    Parameters
    ----------
    measurements : Measurements
        What measures regions of the image.
    files : DrawingFiles
        Where the drawing is saved and kept.
    start : Start
        What there is to begin with.
    run_elsewhere : RunElsewhere
        Runs what takes long.
    """

    def __init__(
        self,
        measurements: Measurements,
        files: DrawingFiles,
        start: Start,
        run_elsewhere: RunElsewhere,
    ) -> None:
        self.image = measurements.image
        self.files = files
        self.history = start.history
        self.selected: str | None = None
        self.means: dict[Roi, Means] = {}
        self.evaluated = Evaluated()
        self.notice = Notice("")
        #: Files written in this run, in their order.
        self.written: list[Path] = []
        #: File that somebody else changed, and its fingerprint: it is replaced only if a person confirms it.
        self.in_the_way: tuple[Path, str] | None = None
        #: Fingerprints of the files of this drawing as they were read or written here.
        self._stored = {files.output: start.stored}
        self._saved, self._read, self._proposals = start.saved, start.read, start.proposals
        self._lanes = (
            Lane(run_elsewhere, measurements.means, self._take_means),
            Lane(run_elsewhere, measurements.evaluations, self._take_evaluated),
        )
        self._listeners: list[Callable[[], None]] = []
        self._kept = ""

    @property
    def drawing(self) -> Drawing:
        """The drawing as it is."""
        return self.history.present

    @property
    def unsaved(self) -> bool:
        """Whether the drawing differs from what was saved last."""
        shapes = self.drawing.shapes
        return shapes != self._saved and (not shapes or shapes != self._read)

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` after each change; returns what ends that."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def do(self, message: dict[str, Any]) -> bool:
        """Carry out what mouse, keys or buttons ask for; what cannot be done leaves all as it is and says why.

        Parameters
        ----------
        message : dict
            As `messages.change` takes it; and ``undo``, ``redo``, ``select`` (name or None), ``save`` (file name or
            None), ``replace`` (the file in the way), ``accept all``, ``discard``, ``pair`` (names).

        Returns
        -------
        bool
            Whether it was done.
        """
        try:
            self._do(message)
        except InputError as error:
            self._tell(Notice(_sentence(str(error)), "warning"))
            return False
        return True

    def begin(self) -> None:
        """Measure what there is, and show the proposals there are."""
        if self._proposals:
            self.propose(self._proposals, "Found")
        else:
            self.measure()

    def propose(self, proposals: Iterable[Shape], what: str) -> None:
        """Show proposals to be confirmed; `what` says where they come from."""
        found = tuple(proposals)
        new = new_shapes(found, self.drawing.shapes)
        n, n_known = len(new), len(found) - len(new)
        there = f" {n_known} more {'are' if n_known > 1 else 'is'} there already." if n_known else ""
        text = f"{n} region{'s' if n > 1 else ''} proposed. They count once you accept them.{there}"
        if not new:
            text = f"all {n_known} regions found are there already." if n_known > 1 else "the region is there already."
        self._change(self.drawing.proposed(new), self.selected, Notice(f"{what}: {text}"))

    def warn(self, error: Exception) -> None:
        """Tell what could not be done."""
        self._tell(Notice(_sentence(str(error)), "warning"))

    def measure(self) -> None:
        """Begin to measure the drawing; called after each change."""
        for lane in self._lanes:
            lane.start(self.drawing)

    def last_words(self) -> list[str]:
        """Return what to tell when the page ends: what was saved, and what was not."""
        lines = [f"Saved: {path}" for path in dict.fromkeys(self.written)]
        n = len(self.drawing.shapes)
        if not self.unsaved:
            return lines or ["Nothing was changed"]
        if not self.drawing.shapes:
            return [*lines, "Not saved: all regions were deleted; the file is as it was"]
        what = f"Not saved: the drawing of {n} region{'s' if n > 1 else ''}"
        if not self._kept:
            return [*lines, f"{what}; it is kept in {self.files.unsaved}, and the same command goes on with it"]
        return [*lines, f"{what}; it is lost, since it could not be kept: {self._kept}"]

    def _do(self, message: dict[str, Any]) -> None:
        what = message["do"]
        history = self.history
        if what == "select":
            self._select(message.get("name"))
        elif what == "save":
            self._save(message.get("name"))
        elif what == "replace":
            if self.in_the_way is None:
                raise InputError("there is no file to replace: save the drawing")
            self._save(self.in_the_way[0].name, replace=True)
        elif what in ("undo", "redo"):
            self.history = history.undone() if what == "undo" else history.redone()
            self._after_change(self.selected, Notice(f"{what.capitalize()}: done"))
        elif what == "accept all":
            n = len(self.drawing.proposals)
            self._change(self.drawing.accepted(), self.selected, Notice(f"{n} proposals accepted", "done"))
        elif what == "discard":
            self._change(self.drawing.proposed(()), self.selected, Notice("Proposals discarded"))
        elif what == "pair":
            first, second = (message.get(key) for key in ("first", "second"))
            self._change(self.drawing.paired(first, second), self.selected, Notice(""))
        else:
            drawing, selected = change(self.drawing, message)
            self._change(drawing, selected, Notice(""))

    def _select(self, name: object) -> None:
        if name is not None:
            if not isinstance(name, str):
                raise InputError("the page sent no name: reload it")
            name = self._shape_of(name)
        self.selected = name
        self._tell(Notice(""))

    def _shape_of(self, name: str) -> str:
        """Name of the shape that a region is of."""
        for shape in self.drawing.shapes:
            if any(roi.name == name for roi in shape.rois()):
                return shape.name
        return self.drawing.shape(name).name

    def _save(self, name: object, replace: bool = False) -> None:
        if not self.drawing.shapes:
            raise InputError("there is no region to save: draw one first, or accept a proposal")
        path = self.files.output if name is None else self.files.other(str(name))
        there = self.files.fingerprint(path)
        if there and path not in self._stored:
            raise InputError(f"{path} is there already: give another name")
        if there not in ("", self._stored.get(path)) and not (replace and self.in_the_way == (path, there)):
            self.in_the_way = (path, there)
            raise InputError(
                f"{path} was changed by somebody else since it was read, and is not replaced: save under another name, "
                "or confirm with Replace"
            )
        self._stored[path] = self.files.save(path, self.drawing.shapes)
        self.in_the_way = None
        self.written.append(path)
        self._saved = self.drawing.shapes
        n = len(self.drawing.shapes)
        self._keep()
        self._tell(Notice(f"Saved: {n} region{'s' if n > 1 else ''} in {path}", "done"))

    def _change(self, drawing: Drawing, selected: str | None, notice: Notice) -> None:
        self.history = self.history.changed(drawing)
        self._after_change(selected, notice)

    def _after_change(self, selected: str | None, notice: Notice) -> None:
        names = {shape.name for shape in (*self.drawing.shapes, *self.drawing.proposals)}
        self.selected = selected if selected in names else None
        self._keep()
        self.measure()
        self._tell(notice)

    def _keep(self) -> None:
        try:
            if self.unsaved:
                self.files.keep(self.drawing.shapes)
            else:
                self.files.forget()
        except InputError as error:
            self._kept = str(error)
        else:
            self._kept = ""

    def _take_means(self, means: dict[Roi, Means]) -> None:
        self.means = means
        self._listen()

    def _take_evaluated(self, evaluated: Evaluated) -> None:
        self.evaluated = evaluated
        self._listen()

    def _tell(self, notice: Notice) -> None:
        if self._kept:
            notice = Notice(f"What you draw cannot be kept: {self._kept}. Save it under another name.", "warning")
        self.notice = notice
        self._listen()

    def _listen(self) -> None:
        for listener in tuple(self._listeners):
            listener()


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] if text[:1].islower() and not text.startswith("/") else text
