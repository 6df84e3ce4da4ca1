"""labcdp measures how probable it is that a driver-assistance camera still sees a contrast.

Names load when they are first used, so that importing the package, and ``labcdp --help``, stay quick.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import calibration as calibration
    from . import chain as chain
    from . import drivers as drivers
    from . import sources as sources
    from .contrast import cdp as cdp
    from .contrast import cdp_neighbours as cdp_neighbours
    from .errors import LabcdpError as LabcdpError
    from .frame import Frame as Frame
    from .luminance import LuminanceMap as LuminanceMap
    from .reading import Reading as Reading
    from .roi import Roi as Roi

_HOME = {
    "Frame": "frame",
    "LabcdpError": "errors",
    "LuminanceMap": "luminance",
    "Reading": "reading",
    "Roi": "roi",
    "cdp": "contrast",
    "cdp_neighbours": "contrast",
}
_ROOMS = ("calibration", "chain", "drivers", "sources")

__all__ = [
    "Frame",
    "LabcdpError",
    "LuminanceMap",
    "Reading",
    "Roi",
    "calibration",
    "cdp",
    "cdp_neighbours",
    "chain",
    "drivers",
    "sources",
]


def __getattr__(name: str) -> Any:
    if name in _ROOMS:
        return import_module(f".{name}", __name__)
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
