"""Settings of a measurement that were read back, compared with those wanted."""

from __future__ import annotations

from collections.abc import Callable
from math import isclose
from typing import Any

from ...core.frame import CameraIdentity
from ..camera import CameraSettingError, CameraSettings, CameraSetup, FeatureValue, Region

#: Relative difference from a wanted number that a camera may round to.
_ROUNDED_REL = 0.01


def require_kept(
    who: CameraIdentity, wanted: CameraSetup, settings: CameraSettings, feature: Callable[[str], FeatureValue]
) -> None:
    """Refuse a camera that keeps other settings than those it was given.

    Parameters
    ----------
    who : CameraIdentity
        The camera.
    wanted : CameraSetup
        What it was given.
    settings : CameraSettings
        In force.
    feature : callable
        Reads a feature by name.

    Raises
    ------
    CameraSettingError
        Naming the first that differs.
    """
    now = _as_set(settings)
    pairs = {name: (value, now[name]) for name, value in wanted.settings.items()}
    pairs |= {name: (value, feature(name)) for name, value in wanted.features.items()}
    for name, (value, kept) in pairs.items():
        if not _same(value, kept):
            raise CameraSettingError(f"{who} keeps {name} at {kept}, not {value}: give a value that it keeps")


def _as_set(settings: CameraSettings) -> dict[str, Any]:
    region = Region(settings.offset_x, settings.offset_y, settings.width, settings.height)
    return {
        "binning": settings.binning,
        "region": region,
        "frame_rate_hz": settings.frame_rate_hz,
        "black_level": settings.black_level,
        "trigger": settings.trigger,
    }


def _same(value: Any, kept: Any) -> bool:
    if isinstance(value, float) and isinstance(kept, int | float):
        return isclose(value, kept, rel_tol=_ROUNDED_REL)
    return bool(value == kept)
