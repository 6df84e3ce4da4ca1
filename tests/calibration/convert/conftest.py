"""A calibration as a fit would give it, of a camera whose truth is known, and frames of that camera."""

from __future__ import annotations

import numpy as np
import pytest

from labcdp.calibration import (
    CameraState,
    DarkModel,
    LensIdentity,
    MeterScale,
    PatchResidual,
    Provenance,
    ResponsivityFit,
    TemporalNoise,
)
from labcdp.calibration.findings import FitError
from labcdp.calibration.frames.measure import measure_whole
from labcdp.calibration.model import Calibration
from labcdp.core.dn import Response

from .. import conftest

SHAPE = (48, 64)
RESPONSIVITY, K, DARK_NOISE, OFFSET, RATE = 1200.0, 0.25, 1.5, 64.0, 40.0


def new_calibration(shape=SHAPE, bit_depth=12, **changes):
    full = 2**bit_depth - 1
    values = {
        "state": CameraState(conftest.CAMERA, f"Mono{bit_depth}", bit_depth, shape, 0.0, float(full), 64.0),
        "lens": LensIdentity("Kowa LM6NCL", "", 0.006, 2.6),
        "source_spectrum": "LED-B4",
        "meter_scale": MeterScale(conftest.METER, 0.02),
        "responsivity": ResponsivityFit(RESPONSIVITY, 0.003, 10.0, 11, 0.0, 0.0, None, None),
        "response": Response(),
        "fit_errors": (
            FitError("fit", (1.0, full), (0.003, 0.003)),
            FitError("dark and temperature", (1.0, full), (0.0, 0.0), (), (0.2, 0.0, 0.0), 0.0),
        ),
        "dark": DarkModel(OFFSET, RATE, ((0.04, 0, 0), (0, 0, 0), (0, 0, 0)), DARK_NOISE, 0.0, (0.001, 0.064)),
        "noise": TemporalNoise(K, DARK_NOISE),
        "gains": (),
        "vignetting": None,
        "defects": None,
        "dark_library": None,
        "range_cd_m2": (0.5, 2000.0),
        "range_net_dn": (5.0, full - 100.0),
        "exposures_s": (0.001, 0.008, 0.064),
        "residuals": (PatchResidual("P1", 100.0, 0.1, 4, 100.0, (0.008,), 0.0, 0.0, (32.0, 24.0), None),),
        "held_out": (),
        "left_out": (),
        "ladder": (),
        "tests": (),
        "findings": (),
        "provenance": Provenance(conftest.START, "0" * 64, {"labcdp": "0"}),
    }
    return Calibration(**values | changes)


def new_frame(mean_dn, exposure_s=0.008, frame_id=0, bit_depth=12, **changes):
    return conftest.make_frame(mean_dn, exposure_s, frame_id, bit_depth, **changes)


def exposed(luminance_cd_m2, exposure_s, rng, pattern_dn=0.0, v=1.0, frame_id=0):
    """A noisy frame of a scene."""
    net = RESPONSIVITY * np.asarray(luminance_cd_m2, dtype=float) * v * exposure_s
    noise = rng.normal(0, 1, net.shape) * np.sqrt(K * net + DARK_NOISE**2 - 1 / 12)
    return new_frame(OFFSET + RATE * exposure_s + pattern_dn + net + noise, exposure_s, frame_id)


@pytest.fixture(scope="session")
def make_calibration():
    return new_calibration


@pytest.fixture(scope="session")
def make_frame():
    return new_frame


@pytest.fixture(scope="session")
def expose():
    return exposed


@pytest.fixture(scope="session")
def statistics():
    """Statistics of noisy frames of a scene."""

    def take(luminance_cd_m2, exposure_s, n, rng, **changes):
        return measure_whole(exposed(luminance_cd_m2, exposure_s, rng, frame_id=i, **changes) for i in range(n))

    return take
