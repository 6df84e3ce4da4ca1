"""Sensor and camera up to a stage of a chain that can be predicted."""

from __future__ import annotations

from ...core.errors import PredictionError
from ..chain import Chain
from ..isp import CodeCurve
from ..sensor import Sensor
from .camera import CameraModel


def sensor_of_stage(chain: Chain, stage: str) -> tuple[Sensor, str]:
    """Sensor that a stage belongs to, and the stage's name without the sensor's."""
    for sensor_name, sensor in chain.sensors:
        for name in chain.recorded_names:
            if chain.sensor_stage_name(name, sensor_name) == stage:
                if isinstance(sensor, Sensor):
                    return sensor, name
                raise PredictionError(
                    f"sensor {sensor_name!r} is not an EMVA 1288 sensor, the only kind that can be predicted: "
                    "simulate instead"
                )
    known = [
        chain.sensor_stage_name(name, sensor_name) for sensor_name, _ in chain.sensors for name in chain.recorded_names
    ]
    raise PredictionError(
        f"stage is {stage!r}, which cannot be predicted: give one of {', '.join(known) or 'a sensor'}"
    )


def camera_of_stage(chain: Chain, sensor: Sensor, stage: str) -> CameraModel:
    """Sensor, exposures, merge and tone curve up to a stage."""
    assert chain.settings is not None
    names = chain.recorded_names
    index = names.index(stage)
    captures = sensor.capture_models(chain.settings, chain.spectrum)
    if index < len(captures):
        return CameraModel(captures[index].sensor, captures[index].settings)
    curves = [curve for name, curve in chain.behind if names.index(name) <= index]
    if len(curves) > 1 or not all(isinstance(curve, CodeCurve) for curve in curves):
        raise PredictionError(
            f"{stage} follows stages other than a single tone curve: simulate, or choose an earlier stage"
        )
    curve = curves[0] if curves else None
    tone_curve = curve if isinstance(curve, CodeCurve) else None
    if chain.hdr is None:
        # What is not merged is a single capture, with its own gain and photodiode.
        (capture,) = captures
        return CameraModel(capture.sensor, capture.settings, None, tone_curve)
    return CameraModel(sensor, chain.settings, chain.hdr, tone_curve, chain.spectrum)
