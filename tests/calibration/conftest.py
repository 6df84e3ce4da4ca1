"""A bench on arrays: a linear camera with noise, and a meter with scale error, repeatability and digits."""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from math import floor, log10, sqrt

import numpy as np
import pytest

from labcdp.calibration import CameraState, DarkObservation, LensIdentity, PatchObservation, Setup, fit
from labcdp.calibration.fit_records import FitError
from labcdp.calibration.frames.measure import measure_whole
from labcdp.calibration.frames.nonuniformity import Nonuniformity
from labcdp.calibration.sensor.dark_library import DarkLibrary
from labcdp.core.frame import PLANES, CameraIdentity, Frame
from labcdp.core.reading import MeterIdentity, Reading
from labcdp.core.vignetting import FlatField, middle_of

CAMERA = CameraIdentity("Allied Vision", "Manta G-505C", "503363706")
METER = MeterIdentity("LS-110", "73323007")
START = datetime(2018, 3, 1, 12, tzinfo=UTC)
EVEN = Nonuniformity((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 3, 100.0)
STATE = CameraState(CAMERA, "Mono12", 12, (48, 64), 0.0, 4095.0, 64.0)


@dataclass(frozen=True)
class SimulatedCamera:
    """A linear camera; `observe` and `dark` draw what the accumulator would find."""

    responsivity_dn_s_cd_m2: float = 1200.0
    k_dn_per_e: float = 0.25
    dark_noise_dn: float = 1.5
    dark_offset_dn: float = 64.0
    dark_rate_dn_s: float = 40.0
    state: CameraState = STATE

    def mean_dn(self, luminance_cd_m2, exposure_s):
        light = self.responsivity_dn_s_cd_m2 * luminance_cd_m2
        return self.dark_offset_dn + (self.dark_rate_dn_s + light) * exposure_s

    def pixel_variance_dn2(self, luminance_cd_m2, exposure_s):
        net = self.responsivity_dn_s_cd_m2 * luminance_cd_m2 * exposure_s
        return self.k_dn_per_e * net + self.dark_noise_dn**2

    def observe(self, patch, luminance_cd_m2, exposure_s, rng, size=(400, 4)):
        """One patch; without a generator, free of noise. `size` is pixels and frames."""
        n_pixels, n_frames = size
        mean, variance = self.mean_dn(luminance_cd_m2, exposure_s), self.pixel_variance_dn2(luminance_cd_m2, exposure_s)
        saturated = mean + 4 * sqrt(variance) >= self.state.saturation_dn
        dof = (n_pixels - 1) * (n_frames - 1)
        mean += rng.normal(0, sqrt(variance / (n_pixels * n_frames))) if rng else 0.0
        return PatchObservation(
            patch=patch,
            exposure_s=exposure_s,
            mean_dn=mean,
            frame_means_dn=(mean,) * n_frames,
            mean_inverse_v=1.0,
            n_pixels=n_pixels,
            temporal_variance_dn2=variance * (rng.chisquare(dof) / dof if rng else 1.0),
            nonuniformity=EVEN,
            saturated_share=1.0 if saturated else 0.0,
            state=self.state,
            vignetting=None,
        )

    def dark(self, exposure_s, rng, size=(3072, 4)):
        n_pixels, n_frames = size
        variance = self.dark_noise_dn**2 / n_pixels
        mean = self.mean_dn(0.0, exposure_s) + (rng.normal(0, sqrt(variance / n_frames)) if rng else 0.0)
        # Their variance from frame to frame is that of noise.
        means = mean + sqrt(variance * (n_frames - 1) / n_frames) * np.resize([-1.0, 1.0], n_frames)
        return DarkObservation(
            exposure_s=exposure_s,
            mean_dn=mean,
            frame_means_dn=tuple(means.tolist()),
            n_pixels=n_pixels,
            temporal_variance_dn2=self.dark_noise_dn**2,
            nonuniformity_dn=0.0,
            state=self.state,
        )


@dataclass(frozen=True)
class SimulatedMeter:
    """A meter with four digits and no more than two decimals, like the LS-110."""

    scale_half_width_rel: float = 0.02
    repeatability_rel: float = 0.002
    true_scale_error_rel: float = 0.0
    identity: MeterIdentity = field(default=METER)

    def read(self, luminance_cd_m2, rng, second=0):
        shown = luminance_cd_m2 * (1 + self.true_scale_error_rel)
        shown *= 1 + (rng.normal(0, self.repeatability_rel) if rng else 0.0)
        resolution = max(10.0 ** (floor(log10(shown)) - 3), 0.01) if shown > 0 else 0.01
        meter = {"meter": self.identity, "resolution": resolution, "digits_half_width": resolution / 2}
        errors = {"scale_half_width_rel": self.scale_half_width_rel, "repeatability_rel": self.repeatability_rel}
        at = START + timedelta(seconds=second)
        return make_reading(round(shown / resolution) * resolution, timestamp=at, **meter, **errors)


#: Of the planes of a camera with colour filters.
RESPONSIVITIES = dict(zip(PLANES, (700.0, 1200.0, 1180.0, 800.0), strict=True))


def colour_bench(seen, names, rng, changes=(), dark_dn=(), exposures_s=(0.001, 0.008, 0.064)):
    """Observations and dark frames of planes; `seen` gives what a plane sees of a patch, in cd/m^2 of a grey one."""
    observations, darks = {}, {}
    for plane, responsivity in RESPONSIVITIES.items():
        one = SimulatedCamera(
            responsivity_dn_s_cd_m2=responsivity * dict(changes).get(plane, 1.0),
            dark_offset_dn=64.0 + dict(dark_dn).get(plane, 0.0),
            state=replace(STATE, plane=plane),
        )
        observations[plane] = [one.observe(name, seen(plane, name), t, rng) for name in names for t in exposures_s]
        darks[plane] = [one.dark(t, rng) for t in exposures_s]
    return observations, darks


def make_frame(mean_dn, exposure_s=0.01, frame_id=0, bit_depth=12, **changes):
    full = 2**bit_depth - 1
    frame = Frame(
        dn=np.clip(np.rint(mean_dn), 0, full).astype(np.uint16),
        exposure_s=exposure_s,
        gain_db=0.0,
        bit_depth=bit_depth,
        saturation_dn=float(full),
        black_level_dn=64.0,
        pixel_format=f"Mono{bit_depth}",
        colour_filter=None,
        temperature_c=30.0,
        timestamp=START + timedelta(seconds=frame_id),
        camera_timestamp_ns=frame_id,
        frame_id=frame_id,
        camera=CAMERA,
    )
    return replace(frame, **changes)


def make_reading(value, **changes):
    reading = Reading(value, "cd/m2", 0.01, 0.02, 0.01, 0.002, False, "preset", False, METER, START, f"{value:6.2f}")
    return replace(reading, **changes)


def flat_field(shape=STATE.image_shape, seed=1):
    """One of a pattern without smoothness."""
    relative = np.random.default_rng(seed).normal(1, 0.02, shape)
    return FlatField(relative / relative[middle_of(shape)].mean(), 0.001, 0.002, 10)


def large_dark_library():
    """A pattern of 20 DN and of 20 DN/s."""
    offset, rate = np.random.default_rng(4).normal(0, 20, (2, *STATE.image_shape)).astype(np.float32)
    return DarkLibrary(offset, rate, ((0.01, 0.0), (0.0, 0.01)), ((400.0, 0.0), (0.0, 400.0)), 30.0, 8.0, 16)


def expose(luminance_cd_m2, exposure_s, rng, pattern_dn=0.0, v=1.0, frame_id=0):
    """A noisy frame of a scene by the camera of `SimulatedCamera()`; rounding adds 1/12 DN^2 to the noise."""
    net = 1200.0 * np.asarray(luminance_cd_m2, dtype=float) * v * exposure_s
    noise = rng.normal(0, 1, net.shape) * np.sqrt(0.25 * net + 1.5**2 - 1 / 12)
    return make_frame(64 + 40 * exposure_s + pattern_dn + net + noise, exposure_s, frame_id)


def statistics(luminance_cd_m2, exposure_s, n, rng, **changes):
    """Statistics of noisy frames of a scene."""
    return measure_whole(expose(luminance_cd_m2, exposure_s, rng, frame_id=i, **changes) for i in range(n))


@pytest.fixture(scope="session")
def setup():
    return Setup(LensIdentity("Kowa LM6NCL", "", 0.006, 2.6), "LED-B4", "0" * 64)


@pytest.fixture(scope="session")
def camera():
    return SimulatedCamera()


#: Luminances of the patches of a whole calibration, and its exposures.
LUMINANCES, EXPOSURES_S = tuple(float(v) for v in np.geomspace(0.5, 2000, 12)), (0.001, 0.008, 0.064)
#: A smaller one.
FEW_CD_M2, FEW_S = (0.5, 1.0, 2.5, 6.0, 15.0, 40.0, 100.0, 250.0), (0.002, 0.01, 0.1)


def bench(camera, read=make_reading, rng=None, luminances=LUMINANCES, exposures_s=EXPOSURES_S, n_readings=1):
    """Observations, dark frames and readings of patches P0, P1, ...; without a generator free of noise."""
    observations = [camera.observe(f"P{i}", v, t, rng) for i, v in enumerate(luminances) for t in exposures_s]
    darks = [camera.dark(t, rng) for t in exposures_s]
    readings = {
        f"P{i}": [replace(read(float(v)), timestamp=START + timedelta(seconds=s)) for s in range(n_readings)]
        for i, v in enumerate(luminances)
    }
    return observations, darks, readings


def codes(one):
    """Codes of what was found."""
    return {finding.code for finding in one.findings}


def found(calibration, name):
    """The test of that name."""
    return next(test for test in calibration.tests if test.name == name)


def row(rows, source):
    """The row of a budget."""
    return next(r for r in rows if r.source == source)


@pytest.fixture(scope="session")
def calibrated(camera, setup):
    """A calibration by data free of noise."""
    return fit(*bench(camera), setup)


@pytest.fixture(scope="session")
def make_calibration(calibrated):
    """A calibration of another size, bit depth or with other parts; its dark signal is uncertain by 0.2 DN."""

    def make(shape=(48, 64), bit_depth=12, **changes):
        full = 2.0**bit_depth - 1
        state = replace(
            STATE, pixel_format=f"Mono{bit_depth}", bit_depth=bit_depth, image_shape=shape, saturation_dn=full
        )
        errors = (
            FitError("fit", (1.0, full), (0.003, 0.003)),
            FitError("dark and temperature", (1.0, full), (0.0, 0.0), (), (0.2, 0.0, 0.0), 0.0),
        )
        values = {"state": state, "fit_errors": errors, "range_net_dn": (5.0, full - 100), "range_cd_m2": (0.5, 2000.0)}
        return replace(calibrated, **values | changes)

    return make
