"""The picture of the page: a Bokeh figure, and the channel for its mouse and key events."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    CustomJS,
    Div,
    LinearColorMapper,
    LogColorMapper,
    RadioButtonGroup,
    Range1d,
)
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from numpy.typing import NDArray

from .display import DisplayScale, Tile, any_in_blocks, tile
from .drawing import Drawing
from .messages import PageLink, state_of
from .page_image import PageImage
from .wording import PROPOSAL_COLOUR

#: Largest side of the reduced whole image shown below the visible part.
_OVERVIEW_PX = 1000
#: Height of the longest hint beside the picture: what is below does not move with the mode.
_HINT_PX = 84
#: Most pixels of a part, however large a screen is.
_MOST_PX = 4096

#: Scripts for the browser, in this order.
_SCRIPTS = ("picture.js", "gestures.js", "themes.js")

#: Modes of a click on the picture, as on the buttons; picture.js has the same order.
MODES = ("Select", "Polygon", "Rectangle", "Ellipse", "Line")

#: Colours of pixels at 0 or below the black, and of saturated ones.
_BLACK, _SATURATED, _SATURATED_IN_RED = "#3050ff", "#ff3020", "#000000"
#: Number of the theme that shows one colour only; see themes.js.
_RED_LIGHT = 2
_GREY = tuple(f"#{level:02x}{level:02x}{level:02x}" for level in range(256))


class PictureView:
    """The picture of one tab.

    Parameters
    ----------
    image : PageImage
        The image.
    """

    def __init__(self, image: PageImage) -> None:
        self.image = image
        self.link = PageLink()
        self.scale = DisplayScale.of(image.display)
        #: Whether luminance is shown, and whether images follow each other.
        self.shows_light, self._live = False, False
        self.modes = RadioButtonGroup(labels=list(MODES), active=0, name="modes")
        self.theme = RadioButtonGroup(labels=["Light", "Dark", "Red light"], active=0, name="theme", margin=(4, 8))
        self.hint = Div(text="", name="hint", sizing_mode="stretch_width", min_height=_HINT_PX)
        self._n_sent = 0
        self._part: tuple[float, float, float, float] | None = None
        self._screen = (1, 1)
        self._overview, self._detail = _image_source(), _image_source()
        drawn = CustomJS(
            args={"link": self.link},
            code="requestAnimationFrame(() => { link.drawn = cb_obj.get_column('number')[0] })",
        )
        self._detail.js_on_change("data", drawn)
        # Only the page changes what it draws itself.
        self._sources = {
            "shapes": _source("xs", "ys", "colour", "dash", "width", "casing", "fill", syncable=False),
            "draft": _source("x", "y", syncable=False),
            "handles": _source("x", "y", syncable=False),
            "labels": _source("x", "y", "text", "colour", syncable=False),
        }
        self.isolines, self.isoline_labels = _source("xs", "ys"), _source("x", "y", "text")
        self.profile_line = _source("x", "y")
        self._palette: tuple[str, ...] = _GREY
        self._colours = LinearColorMapper(palette=list(_GREY), low=0, high=255)
        self.theme.on_change("active", lambda _attr, _old, _new: self._colour_ends())
        # A bar for each kind of scale: its ticks are chosen when it is made.
        look = {"visible": False, "width": 14, "major_label_text_color": "#808080", "background_fill_color": None}
        self._bars = {
            name: ColorBar(color_mapper=kind(palette=Viridis256, low=0.1, high=1.0), **look)
            for name, kind in (("linear", LinearColorMapper), ("logarithm", LogColorMapper))
        }
        self.figure = self._new_figure()
        # Only properties of models in the document are synchronised.
        self.figure.tags = [self.link]
        self.show_scale(self.scale)

    def script(self) -> CustomJS:
        """Return a callback that attaches the mouse and key handlers when the page is loaded."""
        folder = files("labcdp") / "data" / "roi-page"
        code = "\n".join((folder / name).read_text(encoding="utf-8") for name in _SCRIPTS)
        arguments = {"figure": self.figure, "link": self.link, "modes": self.modes, "hint": self.hint}
        arguments |= {"theme": self.theme, **self._sources}
        return CustomJS(args=arguments, code=code)

    def go_live(self) -> None:
        """Show images that follow each other: saturated pixels are red and those at 0 blue.

        Without overview and axes, which take a browser as long to draw as the image.
        """
        self._live = True
        self.figure.axis.visible = False
        # What it has is the first image, which would be seen beside a smaller one.
        self.figure.renderers[0].visible = False
        self.figure.min_border_left = self.figure.min_border_bottom = 4
        self._colour_ends()

    def show(self, drawing: Drawing, selected: str | None) -> None:
        """Show a drawing."""
        state = json.dumps({"image": self.image.name} | state_of(drawing, selected), separators=(",", ":"))
        if state != self.link.state:
            self.link.state = state

    def renew(self, image: PageImage | None) -> None:
        """Show another image if the browser has drawn the one before, so that none waits on the way."""
        if image is None or image is self.image or self.link.drawn < self._n_sent or self._part is None:
            return
        self.image = image
        self.show_part(self._part, self._screen)

    def show_scale(self, scale: DisplayScale, *, shows_light: bool = False, coloured: bool = False) -> None:
        """Change the mapping of values, or of luminance, to grey levels or false colours."""
        self.scale, self.shows_light = scale, shows_light
        palette = Viridis256 if coloured else _GREY
        self._palette = tuple(palette)
        self._colour_ends()
        for name, bar in self._bars.items():
            bar.visible = shows_light and name == scale.name
            if bar.visible:
                bar.color_mapper.update(low=scale.black, high=scale.white, palette=list(palette))
        self._show_overview()
        if self._part is not None:
            self.show_part(self._part, self._screen)

    def _colour_ends(self) -> None:
        """Mark saturated pixels and those at 0 or below the black; in red light other reds would not differ."""
        palette, saturated = self._palette, _SATURATED_IN_RED if self.theme.active == _RED_LIGHT else _SATURATED
        ends = (_BLACK, saturated) if self.shows_light or self._live else (palette[0], palette[-1])
        self._colours.palette = [ends[0], *palette[1:-1], ends[1]]

    def _show_overview(self) -> None:
        if self._live:
            return
        height, width = self._shown.shape
        reduction = max(width, height) / _OVERVIEW_PX
        screen = round(width / reduction), round(height / reduction)
        self._put(self._overview, tile(self._shown, self.scale, (0, 0, width, height), screen))

    def show_part(self, part: tuple[float, float, float, float], screen: tuple[int, int]) -> None:
        """Show a part of the image (left, top, right, bottom) with as many pixels as it has on the screen."""
        self._part, self._screen = part, screen
        step = self._step
        left, top, right, bottom = (edge / step for edge in part)
        pixels = min(screen[0], _MOST_PX), min(screen[1], _MOST_PX)
        self._n_sent += 1
        shown = tile(self._shown, self.scale, (left, top, right, bottom), pixels)
        self._put(self._detail, self._marked(shown) if self._live and not self.shows_light else shown)

    def _marked(self, shown: Tile) -> Tile:
        """Mark what has a saturated pixel or one at 0, however far out the picture is zoomed."""
        n, (rows, columns) = self._step, self.image.display.shape
        top, left, height, width = (round(n * edge) for edge in (shown.y, shown.x, shown.height, shown.width))
        values = self.image.values[top : min(top + height, n * rows), left : min(left + width, n * columns)]
        block, pixels = height // len(shown.pixels), shown.pixels.clip(1, 254)
        pixels[any_in_blocks(values == 0, block)] = 0
        if self.image.saturation_dn is not None:
            pixels[any_in_blocks(values >= self.image.saturation_dn, block)] = 255
        return replace(shown, pixels=pixels)

    @property
    def _shown(self) -> NDArray[Any]:
        return self.image.light_display if self.shows_light else self.image.display

    @property
    def _step(self) -> int:
        """Pixels of the image, along each side, per displayed pixel."""
        if self.shows_light:
            return self.image.step
        return 1 if self.image.colour_filter is None else 2

    def _put(self, source: ColumnDataSource, part: Tile) -> None:
        source.data = _image_data(part, self._step, self._n_sent)

    def _new_figure(self) -> Any:
        width, height = self.image.size
        plot = figure(
            tools="",
            toolbar_location=None,
            sizing_mode="stretch_both",
            x_range=Range1d(0, width),
            y_range=Range1d(height, 0),
            # Room for the numbers of the axes: the picture would move under the pointer when they get longer.
            min_border=4,
            min_border_left=50,
            min_border_bottom=26,
            border_fill_color=None,
            background_fill_color="#2b2b2b",
            outline_line_color="#999999",
            name="picture",
        )
        plot.grid.visible = False
        plot.axis.minor_tick_line_color = None
        plot.axis.axis_line_color = None
        plot.axis.major_label_text_color = "#808080"
        for source in (self._overview, self._detail):
            plot.image(image="image", x="x", y="y", dw="dw", dh="dh", color_mapper=self._colours, source=source)
        for bar in self._bars.values():
            plot.add_layout(bar, "right")
        sources, text_on = self._sources, {"text": "text", "text_font_size": "12px", "text_baseline": "bottom"}
        # A dark casing: outlines are seen on bright patches, too, also where the theme leaves one colour.
        cased = {"fill_color": None, "line_color": "#1a1a1a", "line_width": "casing"}
        outlined = {"line_color": "colour", "line_width": "width", "line_dash": "dash"}
        plot.patches("xs", "ys", source=sources["shapes"], **cased)
        plot.patches("xs", "ys", source=sources["shapes"], fill_color="colour", fill_alpha="fill", **outlined)
        plot.line("x", "y", source=sources["draft"], line_color=PROPOSAL_COLOUR, line_width=2)
        square = {"marker": "square", "size": 9, "fill_color": "white", "line_color": "#1a1a1a"}
        plot.scatter("x", "y", source=sources["handles"], **square)
        behind = {"background_fill_color": "#1a1a1a", "background_fill_alpha": 0.9, "padding": 3, "y_offset": -4}
        plot.multi_line("xs", "ys", source=self.isolines, line_color="white")
        plot.text("x", "y", source=self.isoline_labels, text="text", text_color="white", text_font_size="11px")
        plot.line("x", "y", source=self.profile_line, line_color="white", line_dash="dashed", line_width=2)
        plot.text("x", "y", source=sources["labels"], text_color="colour", **text_on, **behind)
        return plot


def _source(*columns: str, syncable: bool = True) -> ColumnDataSource:
    return ColumnDataSource(data={name: [] for name in columns}, syncable=syncable)


def _image_source() -> ColumnDataSource:
    return ColumnDataSource(data=_image_data(Tile(np.zeros((1, 1), dtype=np.uint8), 0, 0, 1, 1), 1, 0))


def _image_data(part: Tile, step: int, number: int) -> dict[str, list[Any]]:
    """Columns of a part whose pixels stand for `step` pixels of the image along each side."""
    rectangle = {"x": part.x, "y": part.y, "dw": part.width, "dh": part.height}
    return {"image": [part.pixels], **{name: [step * value] for name, value in rectangle.items()}, "number": [number]}
