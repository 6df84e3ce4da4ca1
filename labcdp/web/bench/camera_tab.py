"""The tab of the camera: its settings and all its features, read back."""

from __future__ import annotations

from dataclasses import astuple
from typing import Any

import panel as pn

from ...core.pixel_format import PIXEL_FORMATS
from ...drivers.camera_settings import CameraSettings, FeatureDescription, FeatureValue, Region
from .. import look
from ..html import row, table, text
from ..regions.page import Page
from .live_camera import Live, LiveCamera

#: Rows of the table of features.
_MOST_ROWS = 60


class CameraTab:
    """Pixel format, frame rate, black level, region, and any GenICam feature.

    Parameters
    ----------
    camera : LiveCamera
        The camera.
    page : Page
        The tab of the browser.
    """

    def __init__(self, camera: LiveCamera, page: Page) -> None:
        self._camera, self._page = camera, page
        self._settings, self._table = page.text("camera settings"), page.text("features")
        self._format = pn.widgets.Select(name="Pixel format", width=150)
        self._rate = pn.widgets.FloatInput(name="Frames per second", start=0.0, width=130)
        self._black = pn.widgets.FloatInput(name="Black level (register)", width=140)
        self._region = pn.widgets.TextInput(name="Region: x, y, width, height", width=210)
        self._find = pn.widgets.TextInput(name="Find features", placeholder="part of a name", width=140)
        self._feature = pn.widgets.TextInput(name="Set a feature", placeholder="for example Gamma = 1", width=180)
        self._refresh = page.button("Read again", camera.read_features, margin=(19, 4))
        self._shown: tuple[CameraSettings | None, tuple[FeatureDescription, ...], str] = (None, (), "")
        page.watch(self._format, lambda value: camera.request(pixel_format=value))
        page.watch(self._rate, lambda value: camera.request(frame_rate_hz=float(value)))
        page.watch(self._black, lambda value: camera.request(black_level=float(value)))
        page.watch(self._region, self._set_region)
        page.on_enter(self._feature, self._set_feature)
        self._find.param.watch(lambda _event: self._list(), "value")

    def layout(self) -> Any:
        """Return the tab."""
        return look.column(
            look.row(self._format, self._rate, self._black),
            look.row(self._region),
            self._settings,
            look.row(self._feature, self._find, self._refresh),
            self._table,
        )

    def update(self, live: Live, settings_text: str) -> None:
        """Refresh the tab."""
        self._settings.object = settings_text
        settings, features = live.settings, live.features
        if settings is None or (settings, features, live.error) == self._shown:
            return
        self._shown = (settings, features, live.error)
        choices = next((one.choices for one in features if one.name == "PixelFormat"), ())
        formats = dict.fromkeys([*(one for one in choices if one in PIXEL_FORMATS), settings.pixel_format])
        rate_hz = settings.frame_rate_hz
        with self._page.quietly():
            self._format.param.update(options=list(formats), value=settings.pixel_format)
            self._rate.value = None if rate_hz is None else float(f"{rate_hz:.6g}")
            self._black.value = settings.black_level
            self._region.value = ", ".join(f"{n}" for n in astuple(settings.region))
        self._list()

    def _set_region(self, text: str) -> None:
        parts = text.replace(",", " ").split()
        if len(parts) != 4 or not all(part.isdigit() for part in parts):
            self._page.workspace.say("The region is four whole numbers: x, y, width, height")
            return
        self._camera.request(region=Region(*map(int, parts)))

    def _set_feature(self, text: str) -> None:
        if not text:
            return
        name, _, given = (part.strip() for part in text.partition("="))
        known = {one.name.lower(): one for one in self._camera.live.features}.get(name.lower())
        value = None if known is None else _value(known, given)
        if known is None or value is None:
            self._page.workspace.say(f"{text!r} is not understood: give NAME = VALUE as the table below has them")
            return
        self._camera.request(**{known.name: value})
        self._feature.value = ""

    def _list(self) -> None:
        wanted = self._find.value.lower()
        found = [one for one in self._camera.live.features if wanted in one.name.lower()]
        shown = found[:_MOST_ROWS]
        rows = (row(text(one.name), (f"{_number(one.value)} {one.unit}", _range(one))) for one in shown)
        more = f"<p class='quiet'>{len(found) - _MOST_ROWS} more</p>" if len(found) > _MOST_ROWS else ""
        self._table.object = table(("Feature", "value", "possible"), rows, "dense features") + more


def _value(feature: FeatureDescription, text: str) -> FeatureValue | None:
    """Read a value of the kind that the feature has; None if it is none."""
    kind = type(feature.value)
    if kind is bool:
        return {"true": True, "1": True, "false": False, "0": False}.get(text.lower())
    try:
        return kind(text) if text else None
    except ValueError:
        return None


def _range(feature: FeatureDescription) -> str:
    if not feature.writable:
        return "read only"
    if feature.choices:
        return ", ".join(feature.choices)
    return "" if feature.limits is None else " to ".join(map(_number, feature.limits))


def _number(value: FeatureValue) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
