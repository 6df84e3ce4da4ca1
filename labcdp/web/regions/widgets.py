"""Widgets of a tab: their actions are done if the tab may change anything, and not when the program sets them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from math import inf
from typing import Any

import panel as pn

from ...core.errors import InputError, LabcdpError
from ..numbers import number
from .workspace import Workspace

#: A field whose text is not taken.
_WRONG = ".bk-input, .bk-input:focus { border: 2px solid #a32a00; background: #fff4e8; }"


class NumberField(pn.viewable.Viewer):  # type: ignore[misc]
    """A field for a number, with a decimal point or comma; it stays as typed, and is marked, until it can be taken.

    Parameters
    ----------
    name : str
        Text of the label; the unit follows in brackets.
    limits : (float, float)
        Least and greatest number.
    value : float, int or None
        At first; None for empty, which it then may be.
    whole : bool
        Whether only whole numbers are taken.
    unit : str
        Unit of the number; it may be typed, too.
    **options
        Of the widget.
    """

    def __init__(
        self,
        name: str,
        limits: tuple[float, float] = (-inf, inf),
        value: float | None = None,
        whole: bool = False,
        unit: str = "",
        **options: Any,
    ) -> None:
        super().__init__()
        self._limits, self._value, self._whole = limits, value, whole
        self._unit, self._may_be_empty = unit, value is None
        self.widget = pn.widgets.TextInput(name=f"{name} ({unit})" if unit else name, value=_written(value), **options)

    def __panel__(self) -> Any:
        """Return the widget, for layouts."""
        return self.widget

    @property
    def value(self) -> Any:
        """The number; None if it is empty."""
        return self._value

    @property
    def label(self) -> str:
        """Label of the field."""
        return str(self.widget.name)

    @property
    def limits(self) -> tuple[float, float]:
        """Least and greatest number."""
        return self._limits

    @limits.setter
    def limits(self, limits: tuple[float, float]) -> None:
        self._limits = limits

    def show(self, value: float | None) -> None:
        """Show a number that the program sets."""
        self._value = value
        self.widget.value = _written(value)

    def take(self, text: str) -> None:
        """Take what was typed; raises InputError if it is no number, or one beyond the limits."""
        low, high = self._limits
        if not text.strip() and self._may_be_empty:
            self._value = None
            return
        wanted = "" if low == -inf else f"{low:g} or more" if high == inf else f"{low:g} to {high:g}"
        try:
            value = number(text, self._unit)
        except InputError as error:
            raise InputError(f"{error}{', ' * bool(wanted)}{wanted}") from None
        if self._whole and value != int(value):
            raise InputError(f"give a whole number{', ' * bool(wanted)}{wanted}")
        if not low <= value <= high:
            raise InputError(f"give {wanted}{' ' * bool(self._unit)}{self._unit}")
        self._value = int(value) if self._whole else value


def _written(value: float | None) -> str:
    return "" if value is None else f"{value:.9g}"


class Widgets:
    """Makes the widgets of a tab.

    Parameters
    ----------
    workspace : Workspace
        State of the page; its notice is shown at the tab.
    may_change : function
        Whether the tab may change anything now.
    """

    def __init__(self, workspace: Workspace, may_change: Callable[[], bool]) -> None:
        self.workspace, self.may_change = workspace, may_change
        self._updating = False
        #: By the label of its field, what is wrong with a text.
        self.complaints: dict[str, str] = {}

    def changed(self) -> None:
        """Show the state of the tab, soon."""
        raise NotImplementedError

    def field(self, kind: str, name: str, action: Callable[[Any], object] | None = None, **options: Any) -> Any:
        """Return a widget of Panel; `action` gets a new value of a person, if the tab may change anything.

        An error of an action is shown at the field until it takes another value.
        """
        widget = getattr(pn.widgets, kind)(name=name, **options)

        def watcher(event: Any) -> None:
            if action is not None and not self._updating:
                self.guarded(partial(self._try, widget, action))(event.new)
                # A refused change is reverted.
                self.changed()

        if action is not None:
            widget.param.watch(watcher, "value")
        return widget

    def number(
        self,
        name: str,
        action: Callable[[Any], object] | None = None,
        limits: tuple[float, float] = (-inf, inf),
        *,
        view_only: bool = False,
        **options: Any,
    ) -> NumberField:
        """Return a field for a number, for whole ones if its value is an int; it may be empty if it has none at first.

        With `view_only` it changes only what this tab shows, and may be used in all tabs.
        """
        value = options.pop("value", None)
        field = NumberField(name, limits, value, isinstance(value, int), **options)

        def entered(text: str) -> None:
            field.take(text)
            if action is not None and field.value is not None:
                action(field.value)

        def watcher(event: Any) -> None:
            if self._updating:
                self._complain(field.widget, "")
                return
            act = partial(self._try, field.widget, entered)
            (act if view_only else self.guarded(act))(event.new)
            self.changed()

        field.widget.param.watch(watcher, "value")
        return field

    def show_number(self, field: NumberField, value: float | None) -> None:
        """Show a number that the program sets, without its action."""
        with self.quietly():
            field.show(value)
        self.settle(field.widget)

    def settle(self, widget: Any) -> None:
        """Forget complaints about a field's text, which the program has set."""
        self._complain(widget, "")

    def on_enter(self, field: Any, action: Callable[[str], object]) -> None:
        """Call `action` once with a text that a person ends with Enter: its value comes when it is left, too."""
        act = self.guarded(lambda _event: self._try(field, action, field.value))

        def entered(event: Any) -> None:
            act(event)
            self.changed()

        field.param.watch(entered, "enter_pressed")

    def watch_view(self, field: Any, action: Callable[[str], object]) -> None:
        """Call `action` with each new text of a field that changes what this tab shows only."""

        def watcher(event: Any) -> None:
            self._try(field, action, event.new)
            self.changed()

        field.param.watch(watcher, "value")

    def button(self, name: str, action: Callable[[], object], **options: Any) -> Any:
        """Return a button whose action only a tab does that may change anything."""
        button = pn.widgets.Button(name=name, **{"margin": (3, 4)} | options)
        button.on_click(self.guarded(lambda _event: action()))
        return button

    def guarded(self, action: Callable[[Any], object]) -> Callable[[Any], None]:
        """Return an action that does nothing in a tab that may only look on."""

        def acting(value: Any) -> None:
            if self.may_change():
                self.workspace.say("")  # no longer what was said of an earlier input
                action(value)

        return acting

    def _try(self, widget: Any, action: Callable[[Any], object], value: Any) -> None:
        """Do an action; say of its field why it cannot be done."""
        try:
            action(value)
        except LabcdpError as error:
            self._complain(widget, str(error))
        else:
            self._complain(widget, "")

    def _complain(self, widget: Any, why: str) -> None:
        """Mark a field and say why its text is not taken; empty if it is."""
        marked = [sheet for sheet in widget.stylesheets if sheet != _WRONG]
        if why:
            self.complaints[widget.name] = why
            widget.stylesheets = [*marked, _WRONG]
        elif self.complaints.pop(widget.name, None) is not None:
            widget.stylesheets = marked

    @contextmanager
    def quietly(self) -> Iterator[None]:
        """Set widgets that are watched without calling their actions."""
        before, self._updating = self._updating, True
        try:
            yield
        finally:
            self._updating = before
