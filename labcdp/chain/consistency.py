"""Checks that the parts of a chain fit together."""

from __future__ import annotations

from collections.abc import Sequence

from ..core.errors import InputError
from .capture import SensorModel
from .exposure import ExposureSettings
from .hdr.exposures import Hdr
from .scene.flat import Scene
from .signal import UNITS, Stage

_Stages = Sequence[tuple[str, Stage]]


def require_consistent(
    scene: Scene,
    before: _Stages,
    sensors: Sequence[tuple[str, SensorModel]],
    settings: ExposureSettings | None,
    hdr: Hdr | None,
    behind: _Stages,
) -> None:
    """Refuse parts that do not fit together; parameters as those of `Chain`.

    Raises
    ------
    InputError
        Naming the first part that does not fit.
    """
    quantity = "luminance"
    for name, stage in before:
        _require_takes(name, stage, quantity)
        quantity = stage.gives
    if not sensors:
        if settings is not None or hdr is not None or behind:
            raise InputError("there is no sensor to expose: add a sensor, or leave out what follows it")
        return
    if quantity != "illuminance":
        raise InputError(
            f"the sensor takes illuminance in lx, but what comes to it is {quantity} in {UNITS[quantity]}: add "
            "optics in front of it"
        )
    for _, sensor in sensors:
        if sensor.shape != scene.shape:
            raise InputError(
                f"sensor has width {sensor.shape[1]} and height {sensor.shape[0]}, the scene {scene.shape[1]} and "
                f"{scene.shape[0]}: give them once, in scene or sensor"
            )
    if settings is None:
        raise InputError("exposure is missing: add a table [exposure] with exposure_s, in s")
    if len(settings.exposure_s) > 1 and hdr is None and behind:
        raise InputError(
            f"exposure.exposure_s has {len(settings.exposure_s)} times and nothing merges them: add a table "
            "[hdr], or give one time"
        )
    quantity = "digital number"
    for name, stage in behind:
        _require_takes(name, stage, quantity)
        quantity = stage.gives


def _require_takes(name: str, stage: Stage, quantity: str) -> None:
    for asked in (stage.takes, stage.gives):
        if asked not in UNITS:
            raise InputError(f"{name} takes {stage.takes!r} and gives {stage.gives!r}: give two of {', '.join(UNITS)}")
    if stage.takes != quantity:
        raise InputError(
            f"{name} takes {stage.takes} in {UNITS[stage.takes]}, but what comes to it is {quantity} in "
            f"{UNITS[quantity]}: put it elsewhere in the chain"
        )
