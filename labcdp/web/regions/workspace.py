"""State common to all tabs of the page: the drawing, its files and its measurements."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ...core.errors import InputError
from ...regions import Shape, load_regions, new_shapes
from ...report.text import capitalised
from .drawing import Drawing
from .files import DrawingFiles, Start
from .measurements import Measured, Measurements, RunElsewhere
from .messages import change
from .page_image import PageImage


@dataclass(frozen=True)
class Notice:
    """A message to the user.

    Parameters
    ----------
    text : str
        One sentence.
    kind : {'info', 'done', 'warning'}
        Display style.
    """

    text: str
    kind: str = "info"


class Workspace:
    """A drawing on one image, with its history and files, common to all tabs of the page.

    Parameters
    ----------
    measurements : Measurements
        Measures regions of the image.
    files : DrawingFiles
        Files of the drawing.
    start : Start
        Initial state.
    run_elsewhere : RunElsewhere
        Runs long computations.
    """

    def __init__(
        self, measurements: Measurements, files: DrawingFiles, start: Start, run_elsewhere: RunElsewhere
    ) -> None:
        self._measurements = measurements
        self.files = files
        self.history = start.history
        self.selected: str | None = None
        self.measured = Measured()
        self.notice = Notice("")
        #: Files written in this run, in order.
        self.written: list[Path] = []
        #: File changed by another program, and its fingerprint; it is replaced only after confirmation.
        self.in_the_way: tuple[Path, str] | None = None
        #: Fingerprints of the files when last read or written here.
        self._stored = {files.output: start.stored}
        self._saved, self._read, self._proposals = start.saved, start.read, start.proposals
        self.run_elsewhere = run_elsewhere
        #: Whether measuring is under way, and has to begin anew.
        self._measuring, self._again = False, False
        self._listeners: list[Callable[[], None]] = []
        self._kept = ""

    @property
    def image(self) -> PageImage:
        """The image."""
        return self._measurements.image

    def renew(self, measurements: Measurements) -> None:
        """Show and measure another image, as of a live camera; regions outside a smaller one stay, without values."""
        self._measurements = measurements
        if self.image.size != self.files.size:
            self.files = replace(self.files, size=self.image.size)
            self.history = self.history.resized(self.image.size)
        self.measure()

    @property
    def drawing(self) -> Drawing:
        """The current drawing."""
        return self.history.present

    @property
    def unsaved(self) -> bool:
        """Whether the drawing has unsaved changes."""
        shapes = self.drawing.shapes
        return shapes != self._saved and (not shapes or shapes != self._read)

    def listen(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Call `listener` after each change; returns a function that unsubscribes it."""
        self._listeners.append(listener)
        return lambda: self._listeners.remove(listener) if listener in self._listeners else None

    def do(self, message: dict[str, Any]) -> bool:
        """Apply a message of mouse, keys or buttons; an invalid one changes nothing but the notice.

        Parameters
        ----------
        message : dict
            As for `messages.change`, or ``undo``, ``redo``, ``select`` (name or None), ``save`` (file name or None),
            ``load`` (file name), ``replace`` (the file in the way), ``accept all``, ``discard``, ``pair`` (names).

        Returns
        -------
        bool
            Whether it was applied.
        """
        try:
            self._do(message)
        except InputError as error:
            self.warn(error)
            return False
        return True

    def select(self, name: str) -> None:
        """Select a region, if there is one of this name."""
        self.do({"do": "select", "name": name})

    def begin(self) -> None:
        """Measure the initial drawing and show initial proposals."""
        if self._proposals:
            self.propose(self._proposals, "Found")
        else:
            self.measure()

    def propose(self, proposals: Iterable[Shape], what: str) -> None:
        """Show proposals to be confirmed; `what` names their origin."""
        shapes = tuple(proposals)
        new = new_shapes(shapes, self.drawing.shapes)
        n, n_known = len(new), len(shapes) - len(new)
        there = f" {n_known} more {'exist' if n_known > 1 else 'exists'} already." if n_known else ""
        text = f"{n} region{'s' if n > 1 else ''} proposed. They count once you accept them.{there}"
        if not new:
            text = f"all {n_known} regions found exist already." if n_known > 1 else "the region exists already."
        self._change(self.drawing.proposed(new), self.selected, Notice(f"{what}: {text}"))

    def warn(self, error: Exception) -> None:
        """Report an error."""
        self._tell(Notice(capitalised(str(error)), "warning"))

    def say(self, text: str) -> None:
        """Show a sentence."""
        self._tell(Notice(capitalised(text)))

    def measure(self) -> None:
        """Start measuring the drawing, now or after the current step; called after each change."""
        self._again = self._measuring
        if not self._measuring:
            self._measuring = True
            self.run_elsewhere(self._steps(), self._take, self._measured_all)

    def _steps(self) -> Iterator[Measured]:
        for step in self._measurements.measured(self.drawing):
            yield step
            if self._again:
                return

    def _measured_all(self) -> None:
        self._measuring = False
        if self._again:
            self.measure()

    def last_words(self, unchanged: str = "Nothing was changed") -> list[str]:
        """Return the final message: saved files and unsaved changes, or that there are none."""
        lines = [f"Saved: {path}" for path in dict.fromkeys(self.written)]
        n = len(self.drawing.shapes)
        if not self.unsaved:
            return lines or [unchanged]
        if not self.drawing.shapes:
            return [*lines, "Not saved: all regions were deleted; the file is unchanged"]
        what = f"Not saved: the drawing of {n} region{'s' if n > 1 else ''}"
        if not self._kept:
            return [*lines, f"{what}; it is kept in {self.files.unsaved}; the same command resumes it"]
        return [*lines, f"{what}; it is lost, because it could not be stored: {self._kept}"]

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
        elif what == "load":
            self._load(self.files.beside(str(message.get("name"))))
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
        """Name of the shape of a region."""
        for shape in self.drawing.shapes:
            if any(roi.name == name for roi in shape.rois()):
                return shape.name
        return self.drawing.shape(name).name

    def _save(self, name: object, replace: bool = False) -> None:
        if not self.drawing.shapes:
            raise InputError("there is no region to save: draw one first, or accept a proposal")
        path = self.files.output if name is None else self.files.beside(str(name))
        there = self.files.fingerprint(path)
        if there and path not in self._stored:
            raise InputError(f"{path} exists already: choose another name")
        if there not in ("", self._stored.get(path)) and not (replace and self.in_the_way == (path, there)):
            self.in_the_way = (path, there)
            raise InputError(
                f"{path} was changed by another program since it was read, and is not replaced: save under another "
                "name, or confirm with Replace"
            )
        self._stored[path] = self.files.save(path, self.drawing.shapes)
        self.in_the_way = None
        self.written.append(path)
        self._saved = self.drawing.shapes
        n = len(self.drawing.shapes)
        self._keep()
        self._tell(Notice(f"Saved: {n} region{'s' if n > 1 else ''} in {path}", "done"))

    def _load(self, path: Path) -> None:
        stored, shapes = self.files.fingerprint(path), load_regions(path, self.files.size)
        self._stored[path], self._read = stored, shapes
        self._change(Drawing.of(self.files.size, shapes), None, Notice(f"Loaded: {path}; Undo brings back the others"))

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
            self.files.keep(self.drawing.shapes if self.unsaved else ())
        except InputError as error:
            self._kept = str(error)
        else:
            self._kept = ""

    def _take(self, measured: Measured) -> None:
        self.measured = measured
        self.changed()

    def _tell(self, notice: Notice) -> None:
        if self._kept:
            notice = Notice(f"Unsaved regions cannot be stored: {self._kept}. Save it under another name.", "warning")
        self.notice = notice
        self.changed()

    def changed(self) -> None:
        """Tell all tabs that something has changed."""
        for listener in tuple(self._listeners):
            listener()
