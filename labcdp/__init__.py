"""labcdp computes how probable it is that a camera still detects a contrast.

- `cdp`, `cdp_matrix`, `cdp_neighbours`: contrast detection probability (CDP) of pixels
- `colour_separation`: how well a camera tells two colours apart
- `sfr`: sharpness at slanted edges
- `flare`: stray light beside a source
- `read_image`, `open_video`: pictures and videos, with regions, as luminance
- `Session`: recorded bench sessions, their calibration and evaluation
- `Chain`: the simulated imaging chain, runs and sweeps
- `flicker`: flicker of a lamp over the frames of a video
- `compare`: chains, sweeps, sessions or calibrations side by side
- `Requirement`: what pictures, videos, sessions and chains are judged by
- `read_dataset`: results that were saved as NetCDF
- `drivers.open_camera`, `drivers.open_meter`: devices
- `calibration`, `chain`, `drivers`, `files`, `metrics`, `regions`: the packages behind them

Results over several values are xarray datasets; their accessor ``labcdp`` finds usable ranges and draws sweeps.
Contrasts are fractions: 1.0 is 100 %. Names load when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import calibration as calibration
    from . import chain as chain
    from . import drivers as drivers
    from . import files as files
    from . import metrics as metrics
    from . import regions as regions
    from .api.accessor import read_dataset as read_dataset
    from .api.chain import Chain as Chain
    from .api.compare import Comparison as Comparison
    from .api.compare import compare as compare
    from .api.picture import Image as Image
    from .api.picture import read_image as read_image
    from .api.session import Session as Session
    from .api.video import Video as Video
    from .api.video import open_video as open_video
    from .core.errors import InputError as InputError
    from .core.errors import LabcdpError as LabcdpError
    from .core.frame import Frame as Frame
    from .core.luminance import LuminanceMap as LuminanceMap
    from .core.reading import Reading as Reading
    from .core.roi import Roi as Roi
    from .evaluate.requirement import Requirement as Requirement
    from .metrics import Cdp as Cdp
    from .metrics import DetectionInterval as DetectionInterval
    from .metrics import Flicker as Flicker
    from .metrics import cdp as cdp
    from .metrics import cdp_matrix as cdp_matrix
    from .metrics import cdp_neighbours as cdp_neighbours
    from .metrics import colour_separation as colour_separation
    from .metrics import flare as flare
    from .metrics import flicker as flicker
    from .metrics import sfr as sfr

    __version__: str

_HOME = {
    "Cdp": "metrics",
    "Chain": "api.chain",
    "Comparison": "api.compare",
    "DetectionInterval": "metrics",
    "Flicker": "metrics",
    "Frame": "core.frame",
    "Image": "api.picture",
    "InputError": "core.errors",
    "LabcdpError": "core.errors",
    "LuminanceMap": "core.luminance",
    "Reading": "core.reading",
    "Requirement": "evaluate.requirement",
    "Roi": "core.roi",
    "Session": "api.session",
    "Video": "api.video",
    "cdp": "metrics",
    "cdp_matrix": "metrics",
    "cdp_neighbours": "metrics",
    "colour_separation": "metrics",
    "compare": "api.compare",
    "flicker": "metrics",
    "flare": "metrics",
    "open_video": "api.video",
    "read_dataset": "api.accessor",
    "read_image": "api.picture",
    "sfr": "metrics",
}
_PACKAGES = ("calibration", "chain", "drivers", "files", "metrics", "regions")

__all__ = [*_HOME, *_PACKAGES]


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return import_module(f".{name}", __name__)
    if name in _HOME:
        return getattr(import_module(f".{_HOME[name]}", __name__), name)
    if name == "__version__":
        from importlib.metadata import version

        return version("labcdp")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
