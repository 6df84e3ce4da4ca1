"""The page of an image that was recorded: its regions, and its luminance as a map."""

from __future__ import annotations

from typing import Any

import panel as pn
from bokeh.models import CustomJS

from ..look import beside
from ..regions.page import Page
from ..regions.workspace import Workspace
from .tab import MapTab


def map_page(workspace: Workspace, document: Any, *, map_first: bool) -> tuple[Any, CustomJS]:
    """Return the layout of a tab of the browser, and the script that starts with it.

    Parameters
    ----------
    workspace : Workspace
        State common to all tabs.
    document : bokeh.document.Document
        The tab.
    map_first : bool
        Whether the luminance is shown first, in false colours, instead of the regions.
    """
    page = Page(workspace, document)
    luminance = MapTab(page, map_first)
    tabs = pn.Tabs(
        ("Regions", page.side()),
        ("Luminance", luminance.layout()),
        active=int(map_first),
        sizing_mode="stretch_both",
    )
    return beside(page.picture.figure, (*page.head(), tabs)), page.picture.script()
