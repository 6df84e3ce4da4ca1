"""Interactive figures for self-contained pages that work offline."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..layout import Script

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

_FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, "Liberation Sans", sans-serif'


def interactive(figure: Figure, scroll_zoom: bool = False) -> Script:
    """Return a figure with plotly.js (4.8 MB) embedded.

    Parameters
    ----------
    figure : plotly.graph_objects.Figure
        The figure; it gets the common style.
    scroll_zoom : bool
        Whether the mouse wheel zooms.
    """
    figure.update_layout(template="plotly_white", font_family=_FONT)
    # plotly's own button would upload the figure to plotly's servers.
    config = {"displaylogo": False, "responsive": True, "showSendToCloud": False, "scrollZoom": scroll_zoom}
    return Script(figure.to_html(full_html=False, include_plotlyjs=True, div_id="figure", config=config))
