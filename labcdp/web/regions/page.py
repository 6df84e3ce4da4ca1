"""One tab of the page: picture, buttons and tables of a workspace."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from itertools import count
from math import inf
from typing import Any

import panel as pn

from ...core.errors import LabcdpError
from .. import html
from ..html import column, row, style
from .figure import PictureView
from .messages import parse_message
from .shapes import METHOD_NAMES, default_size_px, propose
from .widgets import Widgets
from .wording import pair_table, region_table, warning_list
from .workspace import Workspace

#: Changes within this time are one refresh.
_SOON_MS = 30
#: Refreshes on the way to a browser.
_MOST_UNHANDLED = 3
#: Place of messages: two lines, more are scrolled to. Where all of the page scrolls it stays in sight, and what is
#: below it can be pressed while it is empty.
_MESSAGES_PX = 54
_MESSAGES_STYLE = {
    "overflow-y": "auto",
    "min-width": "0",
    "position": "sticky",
    "top": "0",
    "z-index": "5",
    "pointer-events": "none",
}


class WorkspacePage(Widgets):
    """One tab.

    Parameters
    ----------
    workspace : Workspace
        State common to all tabs.
    document : bokeh.document.Document
        The tab.
    may_change : function
        Whether the tab may change anything now.
    """

    def __init__(self, workspace: Workspace, document: Any, may_change: Callable[[], bool] = lambda: True) -> None:
        super().__init__(workspace, may_change)
        self.document = document
        #: Called after each refresh, in this order.
        self.after_update: list[Callable[[], None]] = []
        self.picture = PictureView(workspace.image)
        #: What is done soon, and whether a refresh waits for the browser.
        self._due: set[Callable[[], None]] = set()
        #: What is said before and after what the workspace says: kind and text of each message.
        self.messages_above: Callable[[], list[tuple[str, str]]] = list
        self.messages_below: Callable[[], list[tuple[str, str]]] = list
        #: What else a message of the browser may ask for.
        self.acts: dict[str, Callable[[dict[str, Any]], object]] = {}
        self._late = False
        self._request_numbers = count(1)
        #: By serial number, whether messages since the last refresh were applied.
        self._answers: dict[str, bool] = {}
        css, scrolled = style(), {"overflow-x": "auto", "min-width": "0"}

        def text(name: str, content: str = "") -> Any:
            return pn.pane.HTML(
                content, name=name, stylesheets=[css], sizing_mode="stretch_width", margin=(2, 8), styles=scrolled
            )

        self._head, self._readout, self._messages = text("head"), text("readout"), text("messages")
        # A place of their own: nothing else moves when they come and go.
        self._messages.height, self._messages.styles = _MESSAGES_PX, _MESSAGES_STYLE
        self._regions, self._pair, self._warnings = text("regions"), text("pair"), text("warnings")
        wide: dict[str, Any] = {"sizing_mode": "stretch_width"}
        title = "File (.json, or .zip or .roi for ImageJ)"
        self._name = self.field("TextInput", "Name of the selected region", self._rename, disabled=True, **wide)
        self._first, self._second = (
            self.field("Select", f"Region {letter}", self._pair_chosen, **wide) for letter in "AB"
        )
        self._file = self.field("TextInput", title, value=workspace.files.output.name, **wide)
        methods = {name: method for method, name in METHOD_NAMES.items()}
        self._method = self.field("Select", "Propose regions", options=methods, **wide)
        size_px = default_size_px(workspace.image)
        self._size = self.number("Size in pixels", limits=(6, inf), value=size_px, width=110)
        self._size.widget.visible = False
        self._buttons = self._new_buttons()
        self.text = text
        self._connect()
        self.update()

    def head(self, *more: Any) -> tuple[Any, ...]:
        """Return the head of the page: theme, `more`, value under the pointer, and messages."""
        return pn.Row(self.picture.theme, *more, self._readout, margin=0, sizing_mode="stretch_width"), self._messages

    def side(self) -> Any:
        """Return tools, tables and files beside the picture."""
        button, text = self._buttons, self.text
        return column(
            self._head,
            self.picture.modes,
            self.picture.hint,
            row(*(button[name] for name in ("Undo", "Redo", "Delete", "Fit", "+", "-")), margin=(0, 3)),
            text("h", "<h2>Regions</h2>"),
            self._regions,
            self._name,
            text("h", "<h2>Contrast of two regions</h2>"),
            row(self._first, self._second, sizing_mode="stretch_width"),
            self._pair,
            text("h", "<h2>File</h2>"),
            self._file,
            row(*(button[name] for name in ("Save", "Load", "Replace")), margin=(0, 3)),
            text("h", "<h2>More</h2>"),
            row(self._method, self._size),
            row(*(button[name] for name in ("Propose", "Accept", "Accept all", "Discard")), margin=(0, 3)),
            self._warnings,
        )

    def do(self, message: dict[str, Any]) -> bool:
        """Apply a message, by `acts` or `Workspace.do`, if the tab may change anything; all tabs may select."""
        act = self.acts.get(message["do"])
        if act is None:
            return (message["do"] == "select" or self.may_change()) and self.workspace.do(message)
        if self.may_change():
            try:
                act(message)
            except LabcdpError as error:
                self.workspace.warn(error)
        return self.may_change()

    def changed(self) -> None:
        """Schedule a refresh, once the browser has handled those before; call it in the server's loop."""
        link = self.picture.link
        self._late = link.n_refreshes - link.n_handled > _MOST_UNHANDLED
        if not self._late:
            self.soon(self.update)

    def soon(self, action: Callable[[], None], after_ms: int = _SOON_MS) -> None:
        """Do something a little later, once, however often it is asked for; models of Bokeh are changed in this way."""
        if action not in self._due:
            self._due.add(action)
            self.document.add_timeout_callback(partial(self._do_now, action), after_ms)

    def _do_now(self, action: Callable[[], None]) -> None:
        self._due.discard(action)
        action()

    def at_end(self, end: Callable[[], None]) -> None:
        """Call `end` when the tab is closed."""
        self.document.on_session_destroyed(lambda _session: end())

    def update(self) -> None:
        """Refresh the tab from the workspace, in one message to the browser."""
        link = self.picture.link
        with pn.io.hold(self.document):
            self._update()
            for follow in self.after_update:
                follow()
            link.n_refreshes += 1
            # With what is refreshed: a person who sees why a shape is refused can go on with it.
            if self._answers:
                link.answers, self._answers = json.dumps(self._answers), {}

    def _update(self) -> None:
        workspace = self.workspace
        image, drawing, measured = workspace.image, workspace.drawing, workspace.measured
        with self.quietly():
            self.picture.show(drawing, workspace.selected)
            self._head.object = self._heading()
            self._regions.object = region_table(image, drawing, measured, workspace.selected)
            self._pair.object = pair_table(drawing, measured)
            self._warnings.object = warning_list(image, drawing, measured)
            self._messages.object = "".join(self._message_lines())
            names = [roi.name for roi in drawing.rois]
            for widget, chosen in zip((self._first, self._second), drawing.pair, strict=True):
                widget.param.update(options={"none": None, **{name: name for name in names}}, value=chosen)
            self._name.param.update(value=workspace.selected or "", disabled=workspace.selected is None)
            button = self._buttons
            button["Undo"].disabled = not workspace.history.past
            button["Redo"].disabled = not workspace.history.future
            button["Delete"].disabled = workspace.selected is None
            proposals = bool(drawing.proposals)
            button["Accept all"].disabled = button["Discard"].disabled = not proposals
            button["Replace"].visible = workspace.in_the_way is not None
            button["Accept"].disabled = workspace.selected is None or not drawing.is_proposal(workspace.selected)

    def _message_lines(self) -> Iterator[str]:
        """Write the messages of the moment, each once."""
        notice = self.workspace.notice
        messages = self.messages_above()
        messages += [("warning", f"{field}: {why}") for field, why in self.complaints.items()]
        messages += [(notice.kind, notice.text), *self.messages_below()]
        for kind, words in dict.fromkeys(message for message in messages if message[1]):
            role = "alert" if kind == "question" else "status"
            yield f"<div class='notice {kind}' role='{role}'>{html.text(words)}</div>"

    def _heading(self) -> str:
        workspace = self.workspace
        image = workspace.image
        width, height = image.size
        state = "<span class='state unsaved'>not saved</span>" if workspace.unsaved else ""
        if not workspace.unsaved and workspace.written:
            state = "<span class='state'>saved</span>"
        size = f"{width} x {height} pixels {'· ' + state if state else ''}"
        return f"<h1>{html.text(image.name)}</h1><p class='quiet'>{size}</p>"

    def _new_buttons(self) -> dict[str, Any]:
        tips = {
            "Undo": "Ctrl + Z",
            "Redo": "Ctrl + Y",
            "Delete": "Delete the selected region (Del)",
            "Save": "Ctrl + S",
            "Load": "Replace the regions with those of the file",
            "Replace": "Replace the file that another program changed",
            "Accept": "Accept the selected proposal (Enter)",
            "Accept all": "Accept all proposals",
            "Discard": "Discard all proposals",
        }
        buttons = {name: self.button(name, partial(self._press, name), description=tip) for name, tip in tips.items()}
        buttons["Save"].button_type = "primary"
        tip = "Find regions; they count once you accept them"
        buttons["Propose"] = self.button("Propose", self._propose, description=tip)
        views = ("Fit", "fit", "Show the whole picture (F)"), ("+", "in", "Zoom in (+)"), ("-", "out", "Zoom out (-)")
        for name, what, tip in views:
            buttons[name] = pn.widgets.Button(name=name, description=tip, margin=(3, 4))
            buttons[name].on_click(lambda _event, what=what: self._ask(what))
        return buttons

    def _press(self, name: str) -> bool:
        """Do what a button says: to the selected region, or with the file that is named."""
        file = self._file.value_input or self._file.value
        return self.do({"do": name.lower(), "name": file if name in ("Save", "Load") else self.workspace.selected})

    def _connect(self) -> None:
        link, workspace = self.picture.link, self.workspace
        link.on_change("sent", lambda _attr, _old, new: self._received(new))
        link.on_change("n_handled", lambda _attr, _old, _new: self.changed() if self._late else None)
        link.on_change("view", lambda _attr, _old, _new: self.soon(self._show_view))
        link.on_change("pointer", lambda _attr, _old, _new: self.soon(self._point))
        self._method.param.watch(
            lambda event: self._size.widget.param.update(visible=event.new == "superpixels"), "value"
        )
        self._point()
        self.at_end(workspace.listen(self.changed))

    def _received(self, text: str) -> None:
        """Apply a mouse or key message, to be answered with the next refresh; the page shows a preview until then."""
        try:
            message = parse_message(text)
        except LabcdpError as error:
            self.workspace.warn(error)
            return
        done = self._press("Save") if message["do"] == "save" else self.do(message)
        self._answers[str(message.get("serial"))] = done
        self.changed()

    def _show_view(self) -> None:
        if len(view := self.picture.link.view) == 6:
            left, top, right, bottom, width, height = view
            self.picture.show_part((left, top, right, bottom), (int(width), int(height)))

    def _point(self) -> None:
        pointer = self.picture.link.pointer
        text = self.workspace.image.readout(*pointer) if len(pointer) == 2 else ""
        self._readout.object = f"<div class='readout'>{html.text(text)}</div>"

    def _ask(self, what: str) -> None:
        self.picture.link.ask = f"{what} {next(self._request_numbers)}"

    def _propose(self) -> None:
        method = self._method.value
        try:
            shapes = propose(self.workspace.image, method, self._size.value if method == "superpixels" else None)
            self.workspace.propose(shapes, METHOD_NAMES[method])
        except LabcdpError as error:
            self.workspace.warn(error)

    def _rename(self, name: str) -> None:
        if self.workspace.selected is not None:
            self.do({"do": "rename", "name": self.workspace.selected, "to": name})

    def _pair_chosen(self, _name: str | None) -> None:
        self.do({"do": "pair", "first": self._first.value, "second": self._second.value})
