"""Widgets of a tab: their actions are done if the tab may change anything, and not when the program sets them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf, isfinite
from typing import Any

import panel as pn

from .workspace import Workspace


class Widgets:
    """Makes the widgets of a tab.

    Parameters
    ----------
    workspace : Workspace
        What is said to the person at the tab.
    may_change : function
        Whether the tab may change anything now.
    """

    def __init__(self, workspace: Workspace, may_change: Callable[[], bool]) -> None:
        self.workspace, self.may_change = workspace, may_change
        self._updating = False

    def changed(self) -> None:
        """Show the state of the tab, soon."""
        raise NotImplementedError

    def field(self, kind: str, name: str, action: Callable[[Any], object] | None = None, **options: Any) -> Any:
        """Return a widget of Panel; `action` gets a new value of a person, if the tab may change anything."""
        widget = getattr(pn.widgets, kind)(name=name, **options)

        def watcher(event: Any) -> None:
            if action is not None and not self._updating:
                self.guarded(action)(event.new)
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
        **options: Any,
    ) -> Any:
        """Return a field for a number, for whole ones if its value is an int; it may be empty without value and action.

        A number beyond the limits is reverted, with a message: Panel's own limits ignore it and leave it on the screen.
        """
        low, high = limits
        within, whole = [options.get("value")], isinstance(options.get("value"), int)
        may_be_empty = action is None and within[0] is None

        def taken(value: Any) -> bool:
            return may_be_empty if value is None else isfinite(value) and low <= value <= high

        def entered(value: Any) -> None:
            if taken(value):
                if action is not None:
                    action(value if whole else float(value))
                return
            wanted = "a number" if low == -inf else f"{low:g} or more" if high == inf else f"{low:g} to {high:g}"
            self.workspace.say(f"{name}: give {wanted}")
            with self.quietly():
                widget.value = within[0]

        widget = self.field("IntInput" if whole else "FloatInput", name, entered, **options)
        # After the watcher that reverts, and also for numbers that the program sets.
        widget.param.watch(lambda event: within.__setitem__(0, event.new) if taken(event.new) else None, "value")
        return widget

    def on_enter(self, field: Any, action: Callable[[str], object]) -> None:
        """Call `action` once with a text that a person ends with Enter: its value comes when it is left, too."""
        field.param.watch(self.guarded(lambda _event: action(field.value)), "enter_pressed")

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

    @contextmanager
    def quietly(self) -> Iterator[None]:
        """Set widgets that are watched without calling their actions."""
        before, self._updating = self._updating, True
        try:
            yield
        finally:
            self._updating = before
