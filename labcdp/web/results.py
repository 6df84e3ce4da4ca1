"""Results of a run, served to the page that started it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any


def results_route(folder: Callable[[], Path | None]) -> tuple[str, Any]:
    """Return a route that serves the files of a folder, once there is one, under ``/report/``."""
    from tornado.web import HTTPError, StaticFileHandler

    class Results(StaticFileHandler):
        def initialize(self) -> None:  # type: ignore[override]
            super().initialize(os.path.realpath(folder() or os.devnull))

        def prepare(self) -> None:
            if folder() is None:
                raise HTTPError(404)

    return r"/report/(.*)", Results
