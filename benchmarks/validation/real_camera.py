"""The CDP of a real camera's images beside the one predicted from its characterisation."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import labcdp
from labcdp.calibration.emva.index import IndexBlock, load_index
from labcdp.calibration.emva.result import Characterisation
from labcdp.chain.predict.camera import CameraModel
from labcdp.chain.predict.prediction import PatchRates, predict
from labcdp.chain.sensor import Sensor
from labcdp.chain.signal import ExposureSettings
from labcdp.evaluate.camera.result import result
from labcdp.report.files import envelope_json

from .check import Check, absolute

#: Levels of the darker image, the first the darkest of the series, and how many levels brighter the other one is.
_PAIRS = tuple((level, level + step) for level in (0, 1, 2, 4, 8, 16, 24) for step in (1, 3))
#: Tolerances of the contrast.
_EPSILONS = (0.1, 0.5)
#: Largest deviation that agrees. The temporal variance of the camera of set 001 is up to 3.6 % above the straight line
#: of the model; a CDP changes by up to 0.24 of that, 0.009. K and counting add 0.003.
_LIMIT = 0.012


def real_camera(folder: Path, found: Characterisation) -> Iterator[Check]:
    """Count the CDP of pairs of real images, every pixel against every other, and predict it.

    The prediction knows the sensor by the characterisation, and of the images only their means; these stand for the
    light, which the data set states too roughly for a contrast. The dark signal is a mean over images without light.

    Parameters
    ----------
    folder : Path
        An EMVA 1288 data set with pairs of images at rising levels of light, and dark images at the same exposures.
    found : Characterisation
        Of this data set.
    """
    blocks = load_index(folder).blocks
    lights = sorted((b for b in blocks if b.kind == "bright" and len(b.images) == 2), key=lambda b: b.photons)
    darks = {b.exposure_ns: _mean_dn(b) for b in blocks if b.kind == "dark"}
    sensor = _sensor(found)
    for pair in _PAIRS:
        dark, bright = (lights[level] for level in pair)
        pixels = [_pixels(b.images[0]) - darks[b.exposure_ns] for b in (dark, bright)]
        means = [_mean_dn(b) - darks[b.exposure_ns] for b in (dark, bright)]
        contrast = means[1] / means[0] - 1
        # One exposure time for both: the light differs as the signals do.
        rates = [np.array([mean / sensor.k_dn_per_e / dark.exposure_s]) for mean in means]
        camera = CameraModel(sensor, ExposureSettings((dark.exposure_s,), 0.0, sensor.reference_temperature_c))
        for epsilon in _EPSILONS:
            counted = labcdp.cdp(pixels[1], pixels[0], contrast, epsilon).cdp
            predicted = predict(camera, PatchRates(*rates), contrast, epsilon).cdp.item()
            name = f"{means[0]:.0f} DN, contrast {contrast:.1%}, ε {epsilon:.0%}"
            yield absolute(name, float(counted), predicted, _LIMIT, "all pairs of pixels of two real images")


def _pixels(image: Path) -> NDArray[np.float64]:
    return np.asarray(cv2.imread(str(image), cv2.IMREAD_UNCHANGED), dtype=np.float64)


def _mean_dn(block: IndexBlock) -> float:
    return float(np.mean([_pixels(image).mean() for image in block.images]))


def _sensor(found: Characterisation) -> Sensor:
    """Return the sensor as ``labcdp init chain --sensor`` makes it from the results."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "results.json"
        path.write_text(envelope_json(result(found)))
        ((_, sensor),) = labcdp.Chain.load("manta-g505").with_emva1288(path).sensors
    assert isinstance(sensor, Sensor)
    # The non-uniformity of all parts; the scatter of dark currents is the preset's, and no part of the results.
    dsnu = found.quantities()["dsnu_e"]
    assert dsnu is not None
    return replace(sensor, dsnu_e=dsnu.value, column_dsnu_e=0.0, row_dsnu_e=0.0, dsnu_e_s=0.0)
